"""What a controller pays for the daemon, where the arm and the subscriber are other machines.

Here they are processes of this machine, which take its processors and its caches. So the simulated
arm and the subscriber together get SHARE of one processor and no more, by a control group, and the
daemon what it asks for: its processor time then is its own, on processors that nobody else fills.
The floor, in turn in the same run: a process that only puts the same 136 bytes at the same rate by
Zenoh, with the same subscriber held to the same share.

`stopped_percent` says in how many periods of 10 ms the share was used up and arm and subscriber
stood still: latencies hold for what they do with so little, the processor time of the daemon holds
anyway, as its points come at the arm's rate (`points_hz`).
"""

from __future__ import annotations

from collections import defaultdict
from typing import Any

import numpy as np
from bench_daemon import daemon
from floors import zenoh_alone
from share import Unavailable, share_of_a_processor

RATES_HZ = (1000, 5000)
SHARE = 0.75
ROUNDS, SECONDS = 3, 10.0


def run() -> dict[str, Any]:
    try:
        return {"share_of_a_processor": SHARE} | {f"{hz}_hz": at(hz) for hz in RATES_HZ}
    except Unavailable as error:
        return {"left_out": str(error)}


def at(rate_hz: int) -> dict[str, float]:
    """Processor time of the daemon and of the floor, in percent of one; latencies; memory."""
    sums: dict[str, float] = defaultdict(float)
    latencies: dict[str, list[np.ndarray]] = {"daemon": [], "zenoh_alone": []}
    with share_of_a_processor(SHARE) as share:
        for _ in range(ROUNDS):
            floor = zenoh_alone(rate_hz, SECONDS, share.free)
            latencies["zenoh_alone"].append(floor.latency_us)
            sums["floor_cpu_s"] += floor.cpu_s
            sums["floor_rss_mb"] += floor.rss_mb
            took, _, figures = daemon(rate_hz, SECONDS, share.free)
            latencies["daemon"].append(took.latency_us)
            for name, value in figures.items():
                sums[name] += value
        stopped_percent = share.stopped_percent()
    cpu_percent = 100 * sums["cpu_s"] / (ROUNDS * SECONDS)
    floor_percent = 100 * sums["floor_cpu_s"] / (ROUNDS * (SECONDS + 1))
    result = {
        "cpu_percent_of_a_core": cpu_percent,
        "zenoh_alone_cpu_percent_of_a_core": floor_percent,
        "cpu_ratio": cpu_percent / floor_percent,
        "points_hz": sums["points"] / (ROUNDS * SECONDS),
        "lost_before_armd": sums["lost_before_armd"],
        "rss_mb": sums["rss_mb"] / ROUNDS,
        "zenoh_alone_rss_mb": sums["floor_rss_mb"] / ROUNDS,
        "stopped_percent": stopped_percent,
    }
    for name, parts in latencies.items():
        p50, p99 = np.percentile(np.concatenate(parts), [50, 99])
        result |= {f"{name}_p50_us": float(p50), f"{name}_p99_us": float(p99)}
    return result
