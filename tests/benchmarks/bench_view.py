"""What `armd view` costs: its processor and memory at 1 kHz in, with so many browsers, and whether
the stream feels it.

The stream's latency is from the true latch to a subscriber beside the page (as in `bench_daemon`),
with no page served and with each number of browsers in turn, in rounds; a browser is a connection
that reads all it is told. `stalled` are forty that read nothing. `ippdme_stalled` is a host of
`armd ippdme` that asks and asks and reads nothing, again and again as it is hung up on.
"""

from __future__ import annotations

import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from floors import Arrivals
from measured import processor_s, resident_mb

from support.running_bridge import RunningBridge, running_bridge
from support.running_daemon import running_daemon
from support.simulated_arm import SimulatedArm, simulated_arm

RATE_HZ = 1000
ROUNDS, SECONDS = 3, 10.0
SETTLE_S = 2.0
STALLED = 40


def run() -> dict[str, Any]:
    series: defaultdict[str, list[np.ndarray]] = defaultdict(list)
    figures: defaultdict[str, defaultdict[str, list[float]]] = defaultdict(
        lambda: defaultdict(list)
    )
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        arm = stack.enter_context(simulated_arm(folder, rate_hz=RATE_HZ, seconds=600))
        daemon = stack.enter_context(running_daemon(folder, arm.port))
        arrivals = Arrivals()
        session = stack.enter_context(daemon.session())
        session.declare_subscriber(f"armd/{daemon.serial}/point", arrivals.take)
        time.sleep(5.0)  # clock mapped
        for _ in range(ROUNDS):
            series["no_page"].append(_latency_us(arm, arrivals))
            options = ("--endpoint", daemon.endpoint, "--listen", "127.0.0.1:0")
            with running_bridge("view", *options) as view:
                for name, reading, stalled in (
                    ("0_browsers", 0, 0),
                    ("1_browser", 1, 0),
                    ("3_browsers", 3, 0),
                    ("stalled", 1, STALLED),
                ):
                    with browsers(view, reading, stalled) as heard:
                        time.sleep(SETTLE_S)
                        cpu_s, n = processor_s(view.process.pid), heard[0]
                        series[name].append(_latency_us(arm, arrivals))
                        own = figures[name]
                        cpu_s = processor_s(view.process.pid) - cpu_s
                        own["cpu_percent_of_a_core"].append(100 * cpu_s / SECONDS)
                        own["resident_mb"].append(resident_mb(view.process.pid))
                        if reading:
                            own["updates_hz"].append((heard[0] - n) / SECONDS / reading)
            with running_bridge("ippdme", *options) as dme, flooding(dme):
                time.sleep(SETTLE_S)
                series["ippdme_stalled"].append(_latency_us(arm, arrivals))
        lost = _lost(arrivals)
    result: dict[str, Any] = {"lost": lost}
    for name, parts in series.items():
        # Of each round by itself: what else the machine did in one of them does not decide.
        p50, p99 = np.median([np.percentile(part, [50, 99]) for part in parts], axis=0)
        result[name] = {"p50_us": float(p50), "p99_us": float(p99)}
        result[name] |= {key: float(np.median(values)) for key, values in figures[name].items()}
        if name != "no_page":
            for key in ("p50", "p99"):
                alone_us = result["no_page"][f"{key}_us"]
                result[name][f"{key}_ratio"] = result[name][f"{key}_us"] / alone_us
    return result


@contextmanager
def browsers(view: RunningBridge, reading: int, stalled: int) -> Iterator[list[int]]:
    """Connections that read, and ones that do not; yields how many live figures were read."""
    heard = [0]
    with ExitStack() as stack:
        request = f"GET /events HTTP/1.1\r\nHost: {view.where}\r\n\r\n".encode()
        connections = [stack.enter_context(view.connect()) for _ in range(reading + stalled)]
        for connection in connections:
            connection.sendall(request)
        for connection in connections[:reading]:
            threading.Thread(target=_read, args=(connection, heard), daemon=True).start()
        yield heard
        for connection in connections[:reading]:
            connection.shutdown(socket.SHUT_RDWR)


#: In a process of its own: a thread here would hold up the subscriber whose latency is measured.
FLOOD = """
import contextlib, socket, sys
while True:
    with contextlib.suppress(OSError), socket.create_connection((sys.argv[1], sys.argv[2])) as host:
        host.settimeout(0.1)
        host.sendall(b"00001 StartSession()\\r\\n")
        while True:
            with contextlib.suppress(TimeoutError):
                host.sendall(b"00002 IsHomed()\\r\\n" * 100)
"""


@contextmanager
def flooding(bridge: RunningBridge) -> Iterator[None]:
    """A host that never reads its answers, for as long as this `with` lasts."""
    host, _, port = bridge.where.rpartition(":")
    with subprocess.Popen([sys.executable, "-c", FLOOD, host, port]) as flood:
        try:
            yield
        finally:
            flood.kill()


def _read(connection: socket.socket, heard: list[int]) -> None:
    with connection.makefile("rb") as lines:
        for line in lines:
            heard[0] += line == b"event: live\n"


def _latency_us(arm: SimulatedArm, arrivals: Arrivals) -> np.ndarray:
    """Of the points of the next seconds."""
    first = len(arrivals.payloads)
    time.sleep(SECONDS)
    last = len(arrivals.payloads)
    points, arrived_ns = arrivals.points(first, last)
    latency_us: np.ndarray = (arrived_ns - arm.latch_ns(points["seq"])) / 1000
    return latency_us


def _lost(arrivals: Arrivals) -> int:
    seq = arrivals.points()[0]["seq"].astype(np.int64)
    return int((np.diff(seq) - 1).sum())
