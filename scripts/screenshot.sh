#!/usr/bin/env bash
# A picture of a scene, without a display: scripts/screenshot.sh SCENE.rrd PICTURE.png [WIDTHxHEIGHT]
#
# Needs the viewer (`pip install rerun-sdk==0.36.3`; $RERUN names another program than `rerun`) and a Vulkan driver: on a
# machine without a graphics card Debian's `mesa-vulkan-drivers` draws in software.
set -euo pipefail
scene=${1:?which scene?}
picture=${2:?which picture?}
size=${3:-1920x1200}
"${RERUN:-rerun}" rrd verify "$scene"
# What the viewer has to say would stand in front of the plots.
RUST_LOG=error "${RERUN:-rerun}" "$scene" --headless --screenshot-to "$picture" --window-size "$size" --port auto --bind 127.0.0.1
test -s "$picture"
