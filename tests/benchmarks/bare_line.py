"""A process that writes its CLOCK_MONOTONIC in ns to a pseudo-terminal at a rate: the line alone.

python bare_line.py RATE_HZ SECONDS: prints the port's path, then each instant in 40 bytes, as
long as a packed SAMPLE is.
"""

from __future__ import annotations

import struct
import sys
import time

from armd.simulator.live.pty_port import PtyPort


def main(rate_hz: float, seconds: float) -> None:
    port = PtyPort()
    print(port.path, flush=True)
    sys.stdin.readline()
    due_ns = time.monotonic_ns()
    for _ in range(int(rate_hz * seconds)):
        due_ns += int(1e9 / rate_hz)
        if (wait_ns := due_ns - time.monotonic_ns()) > 0:
            time.sleep(wait_ns * 1e-9)
        port.write(struct.pack("<q32x", time.monotonic_ns()))
    port.drain(1.0)


if __name__ == "__main__":
    main(float(sys.argv[1]), float(sys.argv[2]))
