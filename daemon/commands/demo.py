"""`armd demo`: a simulated arm warms up on a real pty, or on CAN; its points arrive over Zenoh."""

from __future__ import annotations

import argparse
import signal
import time
from collections import deque
from contextlib import suppress

import numpy as np
import numpy.typing as npt
from rich.console import Console

import armd
from armd import POINT, Arm, Lost, keys
from armd.arguments import seconds, seed
from armd.daemon.comparison import Errors, compare, load_truth, numbered_like
from armd.daemon.screen import Screen, refreshes
from armd.daemon.stage import CAN, SERIAL, Stage

WARM_UP_K = 10.0
WARM_UP_S = 20.0
REFRESH_S = 0.25
#: Every so many-th point is kept for the comparison with the truth, so that a demo may run on.
KEPT = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--seconds", type=seconds, metavar="S", help="stop by itself (at Ctrl-C)")
    parser.add_argument("--can", action="store_true", help="as CANopen nodes instead of a pty")
    parser.add_argument("--seed", type=seed, default=1, metavar="N", help="which arm (1)")


def run(args: argparse.Namespace) -> int:
    """1 if samples were lost."""
    console = Console()
    meter = Meter()
    wire = CAN if args.can else SERIAL
    with Stage(wire, args.seed, WARM_UP_K, args.seconds or WARM_UP_S) as stage:
        with console.status("measuring a simulated arm at five temperatures, and calibrating it…"):
            stage.calibrate()
        with console.status(f"starting the arm on {wire.name}, and the daemon…"):
            stage.start()
        with armd.connect(endpoint=stage.endpoint) as arm:
            _watch(arm, meter, console, args.seconds)
        truth = load_truth(stage.truth)
        if wire is CAN:
            truth = numbered_like(meter.kept, truth)
        errors = compare(meter.kept, truth)
    console.print(_summary(meter, arm.lost, errors), highlight=False)
    return 1 if arm.lost.total else 0


class Meter:
    """Takes every point as it arrives, with the instant of its arrival."""

    def __init__(self) -> None:
        self._arrived: deque[tuple[int, bytes]] = deque()
        self._latency_us: list[npt.NDArray[np.int32]] = []
        self._kept: list[npt.NDArray[np.void]] = []
        self.samples = 0

    def take(self, payload: bytes) -> None:
        self._arrived.append((time.monotonic_ns(), payload))

    def collect(self, arm: Arm) -> npt.NDArray[np.void]:
        """The points (n,) that arrived since the last call."""
        arrived = [self._arrived.popleft() for _ in range(len(self._arrived))]
        if not arrived:
            return np.empty(0, POINT)
        points = arm.decode([payload for _, payload in arrived])
        latency_ns = np.array([when for when, _ in arrived]) - points["monotonic_ns"]
        mapped = (points["flags"] & armd.Flag.CLOCK) == 0
        self._latency_us.append((latency_ns[mapped] // 1000).astype(np.int32))
        self._kept.append(points[::KEPT].copy())
        self.samples += len(points)
        return points

    @property
    def kept(self) -> npt.NDArray[np.void]:
        return np.concatenate(self._kept) if self._kept else np.empty(0, POINT)

    @property
    def latency_ms(self) -> npt.NDArray[np.float64]:
        return np.concatenate([np.zeros(0, np.int32), *self._latency_us]) / 1000


def _watch(arm: Arm, meter: Meter, console: Console, seconds: float | None) -> None:
    """Until Ctrl-C or SIGTERM, or for *seconds*; collects what arrived till then."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with (
        Screen(arm, console) as screen,
        arm.calling(keys.POINT, meter.take),
        suppress(KeyboardInterrupt),
    ):
        for elapsed_s in refreshes(seconds, REFRESH_S):
            screen.show(meter.collect(arm), elapsed_s)
    meter.collect(arm)


def _summary(meter: Meter, lost: Lost, errors: Errors) -> str:
    p50, p99 = np.percentile(meter.latency_ms, [50, 99])
    return (
        f"\nsamples               {meter.samples}\n"
        f"lost                  {lost.total}\n"
        f"latency p50           {p50:.3f} ms   from the latch in the arm to this process\n"
        f"latency p99           {p99:.3f} ms\n"
        f"error before          {errors.before_um:.1f} µm RMS against the simulator's truth\n"
        f"error after           {errors.after_um:.1f} µm RMS\n"
        f"improvement           {errors.improvement:.1f}×, by corrections of up to"
        f" {errors.correction_um:.0f} µm"
    )
