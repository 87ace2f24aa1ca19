#!/usr/bin/env bash
# Builds the fuzz targets and runs each for the given number of seconds (10 by default), side by side. Ends with an error
# at the first finding; the input lies in fuzz/findings/<target>/ then.
#
#     scripts/fuzz.sh [seconds-per-target] [target…]
#
# Needs a C++ compiler (for libFuzzer) and Python 3 (for the seeds), but neither cargo-fuzz nor a nightly compiler: the
# instrumentation is an ordinary pass of LLVM.
set -euo pipefail
cd "$(dirname "$0")/../fuzz"

seconds=${1:-10}
shift || true
targets=("$@")
[ ${#targets[@]} -gt 0 ] || targets=(pickle archive torch normaliser safetensors numpy json)

host=$(rustc -vV | sed -n 's/^host: //p')
export CARGO_TARGET_DIR=${FUZZ_TARGET_DIR:-$PWD/target}
# What `cargo fuzz` passes, less the address sanitiser, which our code without `unsafe` does not need. With --target the
# flags do not reach build scripts and procedural macros.
flags=(
    -Cpasses=sancov-module
    -Cllvm-args=-sanitizer-coverage-level=4
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters
    -Cllvm-args=-sanitizer-coverage-pc-table
    -Cllvm-args=-sanitizer-coverage-trace-compares
)
RUSTFLAGS="${flags[*]}" cargo build --release --locked --target "$host"

corpus=$(mktemp -d)
trap 'rm -rf "$corpus"' EXIT
python3 ../tests/hostile/make_corpus.py seeds "$corpus"

running=()
for target in "${targets[@]}"; do
    mkdir -p "findings/$target" "grown/$target" "$corpus/$target"
    "$CARGO_TARGET_DIR/$host/release/$target" -max_total_time="$seconds" -max_len=16384 -timeout=10 -rss_limit_mb=512 \
        -print_final_stats=1 -verbosity=0 -artifact_prefix="findings/$target/" \
        "grown/$target" "$corpus/$target" > "findings/$target/log" 2>&1 &
    running+=($!)
done
failed=0
for index in "${!targets[@]}"; do
    target=${targets[$index]}
    if wait "${running[$index]}"; then
        runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "findings/$target/log")
        echo "$target: $runs inputs in $seconds s, nothing found"
    else
        failed=1
        echo "$target: a finding, see fuzz/findings/$target/" >&2
        tail -n 30 "findings/$target/log" >&2
    fi
done
exit $failed
