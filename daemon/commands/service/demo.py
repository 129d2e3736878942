"""`armd demo`: run a simulated arm that warms up, and show its points from Zenoh.

The arm is on a real pty, on CAN or on a servo bus.
"""

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
from armd.arrays import F64
from armd.daemon.commands.screen import Screen, generate_refreshes
from armd.daemon.commands.service.comparison import (
    PointErrors,
    compare,
    load_truth,
    match_instants,
    match_numbers,
)
from armd.daemon.commands.service.stage import CAN, SERIAL, Stage, make_servo_wire
from armd.terminal.arguments import parse_integer, parse_seconds, parse_seed
from armd.terminal.plain import make_moving_console

WARM_UP_K = 10.0
WARM_UP_S = 20.0
REFRESH_S = 0.25
#: One point of so many is kept for the comparison with the truth, so that a long demo fits memory.
KEPT = 10
#: Joints of the arm that is calibrated first; joints of a servo arm, without its gripper.
JOINTS, SERVO_JOINTS = 6, 5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seconds", type=parse_seconds, metavar="S", help="stop by itself (at Ctrl-C)"
    )
    wire = parser.add_mutually_exclusive_group()
    wire.add_argument("--can", action="store_true", help="as CANopen nodes instead of a pty")
    wire.add_argument(
        "--servo",
        choices=["feetech", "dynamixel", "dynamixel1"],
        help="a printed arm on a servo bus instead",
    )
    parser.add_argument(
        "--joints",
        type=lambda text: parse_integer(text, 3, 9),
        metavar="N",
        help="of the arm: 3 to 9 (6; --servo: 5); others are not calibrated first",
    )
    parser.add_argument("--seed", type=parse_seed, default=1, metavar="N", help="which arm (1)")


def run(args: argparse.Namespace) -> int:
    """Run the demo; the exit code is 1 if samples were lost."""
    console = make_moving_console()
    meter = Meter()
    if args.servo:
        wire = make_servo_wire(args.servo, args.joints or SERVO_JOINTS)
    else:
        wire = CAN if args.can else SERIAL
    calibrated = not args.servo and args.joints in (None, JOINTS)
    warm_up_s = args.seconds or WARM_UP_S
    steps = Steps(console)
    with Stage(wire, args.seed, WARM_UP_K, warm_up_s, args.joints) as stage:
        if calibrated:
            with console.status("measuring a simulated arm at five temperatures, calibrating it…"):
                stage.calibrate()
            steps.done("measured at five temperatures and calibrated")
        with console.status(
            f"starting the arm on {wire.name}, and the daemon "
            "(the first time on a machine it compiles for half a minute)…"
        ):
            stage.start()
        steps.done("arm and daemon started")
        console.print(
            f"endpoint  {stage.endpoint}   in another terminal: armd watch --endpoint "
            f"{stage.endpoint}, or the subscriber of the README: python subscriber.py "
            f"{stage.endpoint}",
            highlight=False,
            soft_wrap=True,
        )
        with armd.connect(endpoint=stage.endpoint) as arm:
            _watch(arm, meter, console, args.seconds)
        stage.stop()  # simulated servos write the truth when they stop
        truth = load_truth(stage.truth)
        if wire is CAN:
            truth = match_numbers(meter.sampled_points, truth)
        elif args.servo:
            truth = match_instants(meter.sampled_points, truth)
        errors = compare(meter.sampled_points, truth)
    console.print(format_summary(meter, arm.lost, errors, calibrated), highlight=False)
    return 1 if arm.lost.total else 0


class Steps:
    """Prints how long each step before the first live point took."""

    def __init__(self, console: Console) -> None:
        self._console, self._last_s = console, time.monotonic()

    def done(self, step: str) -> None:
        now_s = time.monotonic()
        self._console.print(f"{now_s - self._last_s:5.1f} s  {step}", highlight=False)
        self._last_s = now_s


class Meter:
    """Collects every point, with the instant of its arrival."""

    def __init__(self) -> None:
        self._arrived: deque[tuple[int, bytes]] = deque()
        self._latency_us: list[npt.NDArray[np.int32]] = []
        self._samples: list[npt.NDArray[np.void]] = []
        self.samples = 0

    def take(self, payload: bytes) -> None:
        self._arrived.append((time.monotonic_ns(), payload))

    def collect(self, arm: Arm) -> npt.NDArray[np.void]:
        """Return the points (n,) that arrived since the last call."""
        arrived = [self._arrived.popleft() for _ in range(len(self._arrived))]
        if not arrived:
            return np.empty(0, POINT)
        points = arm.decode([payload for _, payload in arrived])
        latency_ns = np.array([arrival_ns for arrival_ns, _ in arrived]) - points["monotonic_ns"]
        mapped = (points["flags"] & armd.Flag.CLOCK) == 0
        self._latency_us.append((latency_ns[mapped] // 1000).astype(np.int32))
        self._samples.append(points[::KEPT].copy())
        self.samples += len(points)
        return points

    @property
    def sampled_points(self) -> npt.NDArray[np.void]:
        return np.concatenate(self._samples) if self._samples else np.empty(0, POINT)

    @property
    def latency_ms(self) -> F64:
        return np.concatenate([np.zeros(0, np.int32), *self._latency_us]) / 1000


def _watch(arm: Arm, meter: Meter, console: Console, seconds: float | None) -> None:
    """Show the arm until Ctrl-C or SIGTERM, or for *seconds*, and collect its points."""
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    with (
        Screen(arm, console) as screen,
        arm.calling(keys.POINT, meter.take),
        suppress(KeyboardInterrupt),
    ):
        for elapsed_s in generate_refreshes(seconds, REFRESH_S):
            screen.show(meter.collect(arm), elapsed_s)
    meter.collect(arm)


def format_summary(meter: Meter, lost: Lost, errors: PointErrors, calibrated: bool) -> str:
    """Return the text that `armd demo` prints at its end."""
    p50, p99 = np.percentile(meter.latency_ms, [50, 99])
    stream = (
        f"\nsamples               {meter.samples}\n"
        f"lost                  {lost.total}\n"
        f"latency p50           {p50:.3f} ms   from the latch in the arm to this process\n"
        f"latency p99           {p99:.3f} ms\n"
    )
    if not calibrated:
        return f"{stream}error                 {errors.after_um:.1f} µm RMS, nominal geometry"
    return (
        f"{stream}"
        f"error before          {errors.before_um:.1f} µm RMS against the simulator's truth\n"
        f"error after           {errors.after_um:.1f} µm RMS\n"
        f"improvement           {errors.improvement:.1f}×, by corrections of up to"
        f" {errors.correction_um:.0f} µm"
    )
