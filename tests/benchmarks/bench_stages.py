"""Where each microsecond goes between the bytes of one SAMPLE in a port and its point in Zenoh.

One process does what the daemon's measuring thread does for each sample, through the same
functions, with a clock read between any two of them: a SAMPLE is written to a pseudo-terminal,
read, decoded, corrected and put, while a subscriber in another process listens. Medians, so that
what else the machine does hardly counts: once sample after sample (`warm`), once a millisecond
apart with the processors kept awake (`paced`), when caches hold what ran meanwhile.
"""

from __future__ import annotations

import json
import os
import pty
import select
import subprocess
import sys
import tempfile
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from unittest.mock import patch

import numpy as np
import zenoh
from bench_daemon import calibrate, processors_awake
from pump import HELLO, JOINTS, SENSORS

from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration
from armd.daemon.config import Limits
from armd.daemon.health import Tally
from armd.daemon.live.measurement import Averager
from armd.daemon.live.pipeline import Pipeline
from armd.daemon.network.publisher import Publisher
from armd.drivers.host_time import HostTime
from armd.drivers.identity import Expectation
from armd.drivers.sample import RawFrame, Temperatures
from armd.drivers.serial import wire
from armd.drivers.serial.decoder import SerialDecoder
from armd.simulator.live.electronics import COUNTS_PER_TURN
from support.running_daemon import free_endpoint
from support.simulated_arm import simulated_arm

SAMPLES = 4000
PERIOD_S = 0.001
COUNT_EVERY = 50  # as the daemon's ticks do
STAGES = {
    "poll": "system call: is there anything",
    "read": "system call: read it",
    "stamp": "two clocks, raw frame",
    "decode": "COBS, CRC, sequence, clock, counts: a sample",
    "correct": "angles, motion, kernel, flags: a point",
    "put": "136 bytes, and Zenoh's put",
    "yield": "system call: Zenoh's thread may send",
    "note": "joints' key, health's tally, average of a rest",
}
SUBSCRIBER = """
import sys, zenoh
config = zenoh.Config()
config.insert_json5("connect/endpoints", sys.argv[1])
config.insert_json5("scouting/multicast/enabled", "false")
with zenoh.open(config) as session:
    heard = session.declare_subscriber("armd/SIM-0001/point", lambda sample: None)
    print("listens", flush=True)
    sys.stdin.read()
"""


def run(samples: int = SAMPLES) -> dict[str, dict[str, float]]:
    """Median µs of each stage, and of all up to Zenoh's put, `warm` and `paced`."""
    with tempfile.TemporaryDirectory() as folder, ExitStack() as stack:
        take = stack.enter_context(_live_path(Path(folder)))
        packets = iter(
            wire.encode_sample(k, 1000 * k, [k % 1000 + j for j in range(JOINTS)])
            for k in range(2 * samples)
        )
        warm = _medians([take(next(packets)) for _ in range(samples)])
        stack.enter_context(processors_awake())
        return {"warm": warm, "paced": _medians(list(_paced(take, packets)))}


def shown(figures: dict[str, dict[str, float]]) -> list[str]:
    """The table: a line for each stage, and their sum up to the put."""
    rows = {**STAGES, "until_put": "all of these up to the put"}
    return ["µs: warm, a millisecond apart"] + [
        f"{name:10} {figures['warm'][name]:6.1f} {figures['paced'][name]:6.1f}  {what}"
        for name, what in rows.items()
    ]


def _paced(take: Callable[[bytes], list[int]], packets: Iterator[bytes]) -> Iterator[list[int]]:
    due_s = time.monotonic()
    for packet in packets:
        due_s = max(due_s + PERIOD_S, time.monotonic() - PERIOD_S)
        time.sleep(max(0.0, due_s - time.monotonic()))
        yield take(packet)


def _medians(instants_ns: list[list[int]]) -> dict[str, float]:
    took_us = np.diff(np.array(instants_ns), axis=1) / 1000
    until_put = took_us[:, : 1 + list(STAGES).index("put")].sum(axis=1)
    medians = dict(zip(STAGES, np.median(took_us, axis=0).tolist(), strict=True))
    return medians | {"until_put": float(np.median(until_put))}


@contextmanager
def _live_path(folder: Path) -> Iterator[Callable[[bytes], list[int]]]:
    """A function that takes a packet all the way; returns instants before, between and after the
    stages."""
    with simulated_arm(folder, seconds=0.1) as simulated:  # for its arm.toml
        simulated.wait()
    calibrate(folder)
    arm = load_arm(folder / "arm.toml")
    pipeline = Pipeline(arm, load_calibration(folder / "calibration.json", arm), Limits())
    decoder = SerialDecoder(Expectation("SIM-0001", JOINTS, SENSORS, (COUNTS_PER_TURN,) * JOINTS))
    decoder.warm_up()
    host, averager, tally = HostTime(), Averager(0.5, JOINTS), Tally(0)

    def frame(data: bytes) -> RawFrame:
        monotonic_ns, unix_ns = host.now()
        return RawFrame(monotonic_ns, unix_ns, "rx", data)

    greeting = b"\0" + wire.encode_hello(HELLO) + wire.encode_temperature(0, [20.0] * SENSORS)
    for item in decoder.feed(frame(greeting)):
        if isinstance(item, Temperatures):
            pipeline.take_temperatures(item)
    with _publisher() as publisher, _port() as (writer, reader):
        poll, count, now, give_way = select.poll(), 0, time.perf_counter_ns, os.sched_yield
        poll.register(reader, select.POLLIN)
        instants: list[int] = []

        def yield_noted() -> None:
            instants.append(now())
            give_way()

        def take(packet: bytes) -> list[int]:
            nonlocal count, instants
            os.write(writer, packet)
            poll.poll(1000)  # the line's time is none of ours
            instants = [now()]
            poll.poll(50)
            instants.append(now())
            data = os.read(reader, 1 << 16)
            instants.append(now())
            received = frame(data)
            instants.append(now())
            (samples,) = decoder.feed(received)
            assert isinstance(samples, np.ndarray)
            instants.append(now())
            points, joints = pipeline.correct(samples)
            instants.append(now())
            publisher.put_points(points)  # which calls `yield_noted`
            instants.append(now())
            publisher.put_joints(points, samples, joints)
            tally.add(points, samples, time.monotonic_ns())
            averager.remember(points, joints.q)
            instants.append(now())
            count += 1
            if count % COUNT_EVERY == 0:
                tally.count()
            return instants

        with patch("os.sched_yield", yield_noted):
            yield take


@contextmanager
def _publisher() -> Iterator[Publisher]:
    """The daemon's, while somebody listens."""
    endpoint, config = json.dumps([free_endpoint()]), zenoh.Config()
    config.insert_json5("listen/endpoints", endpoint)
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("timestamping/enabled", "true")
    command = [sys.executable, "-c", SUBSCRIBER, endpoint]
    with zenoh.open(config) as session:
        publisher = Publisher(session, "SIM-0001")
        with subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        ) as subscriber:
            assert subscriber.stdout is not None
            subscriber.stdout.readline()
            yield publisher
            subscriber.kill()
        publisher.close()


@contextmanager
def _port() -> Iterator[tuple[int, int]]:
    """Both ends of a pseudo-terminal that changes no byte."""
    writer, reader = pty.openpty()
    tty.setraw(reader)
    os.set_blocking(reader, False)
    try:
        yield writer, reader
    finally:
        os.close(writer)
        os.close(reader)
