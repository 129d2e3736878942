"""What the live path stands on, each alone: Zenoh, and the line."""

from __future__ import annotations

import math
import os
import select
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
import serial
import zenoh

from armd import POINT
from armd.arrays import F64, I64
from support.running_daemon import free_endpoint, session_with


class Latencies(NamedTuple):
    """How long each took (N,), and when it arrived on CLOCK_MONOTONIC."""

    latency_us: F64
    arrived_ns: I64
    cpu_s: float = math.nan  # of the sender, while it sent
    rss_mb: float = math.nan  # of the sender, resident in the end


class Arrivals:
    """A subscriber's callback that does as little as one can: when what came."""

    def __init__(self) -> None:
        self.payloads: list[bytes] = []
        self.arrived_ns: list[int] = []

    def take(self, sample: zenoh.Sample) -> None:
        self.arrived_ns.append(time.monotonic_ns())
        self.payloads.append(sample.payload.to_bytes())

    def points(self, first: int = 0, last: int | None = None) -> tuple[np.ndarray, I64]:
        """Points (n,) and when each arrived."""
        points = np.frombuffer(b"".join(self.payloads[first:last]), POINT)
        return points, np.array(self.arrived_ns[first:last])


def zenoh_alone(rate_hz: int, seconds: float, through: Sequence[str] = ()) -> Latencies:
    """From put to callback of 136 bytes; one latency for each, the first second left out. The
    sender is started by the program *through* if given."""
    endpoint, key = free_endpoint(), "bare/point"
    script = Path(__file__).with_name("bare_put.py")
    command = [*through, sys.executable, str(script), endpoint, key, str(rate_hz), str(seconds + 1)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as sender:
        assert sender.stdout is not None
        sender.stdout.readline()
        arrivals = Arrivals()
        with session_with(endpoint) as session:
            session.declare_subscriber(key, arrivals.take)
            cpu_s, rss_mb = map(float, sender.stdout.readline().split())
            sender.wait(60)
    put_ns = np.frombuffer(b"".join(arrivals.payloads), np.int64).reshape(-1, 17)[:, 0]
    arrived_ns = np.array(arrivals.arrived_ns)
    return Latencies((arrived_ns - put_ns)[rate_hz:] / 1000, arrived_ns[rate_hz:], cpu_s, rss_mb)


def line_alone(rate_hz: int, seconds: float) -> Latencies:
    """From a write to the end of a read in another process, over a pseudo-terminal."""
    script = Path(__file__).with_name("bare_line.py")
    command = [sys.executable, str(script), str(rate_hz), str(seconds + 1)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as sender:
        assert sender.stdin is not None and sender.stdout is not None
        with serial.Serial(sender.stdout.readline().strip(), timeout=0) as port:
            poll = select.poll()
            poll.register(port.fileno(), select.POLLIN)
            sender.stdin.write("go\n")
            sender.stdin.flush()
            data = bytearray()
            arrived_ns: list[int] = []
            with suppress(OSError):  # the line breaks, or reads as ended, when all is sent
                while poll.poll(1000) and (chunk := os.read(port.fileno(), 1 << 16)):
                    data += chunk
                    now_ns = time.monotonic_ns()
                    arrived_ns += [now_ns] * (len(data) // 40 - len(arrived_ns))
    sent_ns = np.frombuffer(data, np.int64).reshape(-1, 5)[:, 0]
    came_ns = np.array(arrived_ns)
    return Latencies((came_ns - sent_ns)[rate_hz:] / 1000, came_ns[rate_hz:])
