#!/usr/bin/env python3
"""Runs a command once for every line of the standard input, in a process of its own with a limit on its address space,
and prints a line of JSON for each: how it ended, the processor time, the largest resident memory.

    measure.py LIMIT-IN-BYTES COMMAND…     each line is appended to the command as its last word
"""

import json
import os
import resource
import subprocess
import sys
import time


def run(limit, command):
    start = time.monotonic()
    child = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)),
    )
    said = child.stderr.read()
    _, status, used = os.wait4(child.pid, 0)
    # Linux counts kibibytes, macOS bytes.
    unit = 1 if sys.platform == "darwin" else 1024
    return {
        "code": os.waitstatus_to_exitcode(status),
        "processor_seconds": used.ru_utime + used.ru_stime,
        "seconds": time.monotonic() - start,
        "peak_bytes": used.ru_maxrss * unit,
        "stderr": said.decode(errors="replace"),
    }


if __name__ == "__main__":
    for line in sys.stdin.read().splitlines():
        print(json.dumps(run(int(sys.argv[1]), [*sys.argv[2:], line])))
