#!/usr/bin/env bash
# A picture of a scene, without a display, of a file or of what is played:
#
#   scripts/screenshot.sh SCENE.rrd PICTURE.png [WIDTHxHEIGHT]
#   scripts/screenshot.sh --live PICTURE.png COMMAND…
#
# The second starts a viewer that draws, runs `COMMAND… --connect` with its address, and takes the picture when the command has
# ended, or $AFTER seconds after it began. $SIZE is the size of the window; 1920x1200 unless told.
#
# Needs the viewer (`pip install rerun-sdk==0.36.3`; $RERUN names another program than `rerun`, $PYTHON the Python it is
# installed for) and a Vulkan driver: on a machine without a graphics card Debian's `mesa-vulkan-drivers` draws in software.
set -euo pipefail
rerun=${RERUN:-rerun}
python=${PYTHON:-python3}
# What the viewer has to say would stand in front of the plots.
export RUST_LOG=error

live() {
  picture=$(realpath -m "${1:?which picture?}")
  shift
  : "${1:?which command?}"
  port=$("$python" -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])')
  address=rerun+http://127.0.0.1:$port/proxy
  rm -f "$picture"
  # In a group of its own: the program `rerun` starts another, and both must end.
  setsid "$rerun" --headless --hide-welcome-screen --window-size "${SIZE:-1920x1200}" --bind 127.0.0.1 --port "$port" &
  viewer=$!
  trap 'kill -- "-$viewer"' EXIT
  until (exec 3<>"/dev/tcp/127.0.0.1/$port") 2>/dev/null; do
    kill -0 "$viewer"
    sleep 0.2
  done
  "$@" --connect "$address" &
  command=$!
  if [ -n "${AFTER:-}" ]; then sleep "$AFTER"; else wait "$command"; fi
  # What has arrived must be drawn before it can be seen.
  sleep 3
  # A viewer that is busy may refuse.
  for _ in $(seq 10); do
    "$python" - "$address" "$picture" <<'END'
import sys
from rerun.experimental import ViewerClient
ViewerClient.connect(sys.argv[1]).save_screenshot(sys.argv[2])
END
    sleep 1
    [ -s "$picture" ] && break
  done
  test -s "$picture"
  if [ -n "${AFTER:-}" ]; then wait "$command"; fi
}

if [ "${1:-}" = --live ]; then
  shift
  live "$@"
  exit
fi
scene=${1:?which scene?}
picture=${2:?which picture?}
"$rerun" rrd verify "$scene"
"$rerun" "$scene" --headless --screenshot-to "$picture" --window-size "${3:-1920x1200}" --port auto --bind 127.0.0.1
test -s "$picture"
