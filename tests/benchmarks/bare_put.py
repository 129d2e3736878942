"""A process that puts 136 bytes at a rate, the first eight its CLOCK_MONOTONIC in ns: Zenoh alone.

python bare_put.py ENDPOINT KEY RATE_HZ SECONDS: prints `ready`; at the end the processor time, in
seconds, that putting took, and the MB that are resident.
"""

from __future__ import annotations

import json
import os
import struct
import sys
import time
from pathlib import Path

import zenoh


def main(endpoint: str, key: str, rate_hz: float, seconds: float) -> None:
    config = zenoh.Config()
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    with zenoh.open(config) as session:
        publisher = session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.DROP, express=False
        )
        print("ready", flush=True)
        while not publisher.matching_status.matching:
            time.sleep(0.01)
        start_s = time.process_time()
        due_ns, filler = time.monotonic_ns(), bytes(120)
        for seq in range(int(rate_hz * seconds)):
            due_ns += int(1e9 / rate_hz)
            if (wait_ns := due_ns - time.monotonic_ns()) > 0:
                time.sleep(wait_ns * 1e-9)
            publisher.put(struct.pack("<qq", time.monotonic_ns(), seq) + filler)
        cpu_s = time.process_time() - start_s
        pages = int(Path("/proc/self/statm").read_text().split()[1])
        print(cpu_s, pages * os.sysconf("SC_PAGE_SIZE") / 1e6, flush=True)
        time.sleep(0.5)  # what is on its way arrives


if __name__ == "__main__":
    main(sys.argv[1], sys.argv[2], float(sys.argv[3]), float(sys.argv[4]))
