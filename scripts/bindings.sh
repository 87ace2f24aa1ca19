#!/usr/bin/env bash
# Writes the declarations of both MuJoCo versions anew from the headers in their wheels. Needed only when the set of types
# changes; wants `pip`, `unzip`, libclang and `bindgen` (cargo install bindgen-cli).
set -euo pipefail
cd "$(dirname "$0")/.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

for version in 2.3.7 3.17.0; do
    python3 -m pip download -q --no-deps --only-binary=:all: --python-version 3.11 --implementation cp --abi cp311 \
        --platform manylinux_2_17_x86_64 --platform manylinux_2_28_x86_64 -d "$work" "mujoco==$version"
    unzip -qo "$work/mujoco-$version-"*.whl 'mujoco/include/*' -d "$work/$version"
    out=src/sim/engine/bindings_${version//./_}.rs
    {
        echo "//! Declarations of \`MuJoCo\` $version's \`mjModel\` and \`mjData\`, generated once by \`scripts/bindings.sh\` from the headers of the"
        echo "//! official wheel \`mujoco==$version\`. Not edited by hand."
        printf '\n#![expect(non_camel_case_types, non_snake_case, unreachable_pub, reason = "generated")]\n\n'
        bindgen "$work/$version/mujoco/include/mujoco/mujoco.h" --allowlist-type 'mjModel|mjData' \
            --no-layout-tests --no-doc-comments --no-prepend-enum-name --rust-target 1.82 --blocklist-function '.*' \
            -- -I"$work/$version/mujoco/include" -I"$(cc -print-file-name=include)" | tail -n +2
    } > "$out"
done
cargo fmt
