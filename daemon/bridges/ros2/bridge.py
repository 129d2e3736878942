"""One arm's streams as ROS topics."""

from __future__ import annotations

import asyncio
import json
import math
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np
import zenoh

from armd import POINT, Arm, Flag, joints_dtype, keys
from armd.daemon.bridges.process import close_soon, report_ready, run_in_thread, warn
from armd.daemon.bridges.ros2 import messages
from armd.daemon.bridges.ros2.node import Quality, RosNode

POLL_S = 0.005
#: Health comes every second; without it for this long, the diagnostics report STALE.
STALE_S = 3.0
#: Time until an unreachable router is reported, and the period of the reminders.
GONE_S, WAITING_S = 3.0, 60.0
LEVELS = {
    "READY": messages.OK,
    "WARMING": messages.OK,
    "INACCURATE": messages.WARN,
    "DEGRADED": messages.WARN,
    "NOT_READY": messages.ERROR,
}
STREAM = Quality(10)
RETRY = {"period_init_ms": 100, "period_max_ms": 1000, "period_increase_factor": 2}


@dataclass(frozen=True)
class Settings:
    """The settings of the command line."""

    router: str
    domain: int
    namespace: str
    frame: str
    rate_hz: float


class Slots:
    """Lets the first point of each period pass, by the points' own time."""

    def __init__(self, rate_hz: float) -> None:
        self._per_ns = rate_hz * 1e-9
        self._last = -1

    def opens(self, stamp_ns: int) -> bool:
        slot = int(stamp_ns * self._per_ns)
        if slot == self._last or not messages.has_ros_time(stamp_ns):
            return False
        self._last = slot
        return True


class Bridge:
    """Publishes one arm in one ROS domain."""

    def __init__(self, arm: Arm, settings: Settings) -> None:
        self._arm = arm
        self._settings = settings
        self._point_slots = Slots(settings.rate_hz)
        self._joint_slots = Slots(settings.rate_hz)
        self._heard_s = time.monotonic()
        self._told_stale_s = 0.0
        self._link = RouterLink(settings.router)

    async def serve(self) -> None:
        """Wait for the router without limit, with messages; then publish until cancelled."""
        session = await _wait_for_router(
            run_in_thread(lambda: open_client(self._settings.router)), self._settings.router
        )
        try:
            await self._serve(session)
        finally:
            close_soon(session)

    async def _serve(self, session: zenoh.Session) -> None:
        # Keep a reference: Zenoh withdraws a token with the object that declared it.
        self._node = RosNode(session, self._settings.domain, self._settings.namespace)
        self._declare(self._node)
        loop = asyncio.get_running_loop()

        def hand_over(data: bytes) -> None:  # in Zenoh's thread
            if not loop.is_closed():
                loop.call_soon_threadsafe(lambda: self._tell_measurement(json.loads(data)))

        with ExitStack() as stack:
            stack.enter_context(self._arm.calling(keys.MEASUREMENT, hand_over))
            points = stack.enter_context(self._arm.stream(keys.POINT))
            joints = stack.enter_context(self._arm.stream(keys.JOINTS))
            health = stack.enter_context(self._arm.stream(keys.HEALTH))
            past = await run_in_thread(lambda: self._arm.past(keys.MEASUREMENT))
            poses = map(self._as_pose, past)
            self._measurement.put_past([pose for pose in poses if pose is not None])
            report_ready("ros2", self._settings.router)
            while True:
                await asyncio.sleep(POLL_S)
                if payloads := points.take():
                    self._tell_points(np.frombuffer(b"".join(payloads), POINT))
                for payload in joints.take():
                    self._tell_joints(payload)
                for payload in health.take():
                    self._tell_health(json.loads(payload))
                self._tell_if_stale()
                self._link.look(session)

    def _declare(self, node: RosNode) -> None:
        prefix = f"/{self._settings.namespace}"
        pose = messages.POSE_WITH_COVARIANCE_STAMPED
        self._point = node.publisher(f"{prefix}/point", messages.POINT_STAMPED, STREAM)
        self._pose = node.publisher(f"{prefix}/pose", pose, STREAM)
        self._measurement = node.publisher(f"{prefix}/measurement", pose, Quality(1000, True))
        self._joints = node.publisher(f"{prefix}/joint_states", messages.JOINT_STATE, STREAM)
        self._tf = node.publisher("/tf", messages.TF_MESSAGE, Quality(100))
        self._tf_static = node.publisher("/tf_static", messages.TF_MESSAGE, Quality(1, True))
        self._diagnostics = node.publisher("/diagnostics", messages.DIAGNOSTIC_ARRAY, STREAM)
        origin = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
        frame = self._settings.frame
        self._tf_static.put(messages.encode_transform(time.time_ns(), "world", frame, *origin))

    def _tell_points(self, points: np.ndarray[Any, np.dtype[np.void]]) -> None:
        """Publish valid points; invalid ones are skipped, because NaN upsets viewers."""
        for point in points[(points["flags"] & Flag.INVALID) == 0]:
            stamp_ns = int(point["stamp_ns"])
            if not self._point_slots.opens(stamp_ns):
                continue
            frame, tip = self._settings.frame, f"{self._settings.namespace.replace('/', '_')}_tip"
            position = to_metres(point["position_mm"].tolist())
            orientation = point["orientation"].tolist()
            self._point.put(messages.encode_point(stamp_ns, frame, position))
            self._tf.put(messages.encode_transform(stamp_ns, frame, tip, position, orientation))
            covariance = to_square_metres(point["covariance_mm2"].tolist())
            if covariance is not None:
                self._pose.put(
                    messages.encode_pose(stamp_ns, frame, position, orientation, covariance)
                )

    def _tell_joints(self, payload: bytes) -> None:
        n = int.from_bytes(payload[16:20], "little")
        joints = np.frombuffer(payload, joints_dtype(n))[0]
        angles, rates = joints["angle_rad"].tolist(), joints["rate_rad_s"].tolist()
        stamp_ns = int(joints["stamp_ns"])
        if all(map(math.isfinite, angles)) and self._joint_slots.opens(stamp_ns):
            names = [f"joint_{k}" for k in range(1, n + 1)]
            finite_rates = rates if all(map(math.isfinite, rates)) else []
            self._joints.put(messages.encode_joint_state(stamp_ns, names, angles, finite_rates))

    def _tell_measurement(self, measurement: dict[str, Any]) -> None:
        if (message := self._as_pose(measurement)) is not None:
            self._measurement.put(message)

    def _as_pose(self, measurement: dict[str, Any]) -> bytes | None:
        """Encode a measurement; None without a position or a time that ROS can write."""
        stamp_ns = measurement["stamp_ns"]
        if measurement["position_mm"] is None or not messages.has_ros_time(stamp_ns):
            return None
        return messages.encode_pose(
            stamp_ns,
            self._settings.frame,
            to_metres(measurement["position_mm"]),
            measurement["orientation"],
            to_square_metres(measurement["covariance_mm2"]),
        )

    def _tell_health(self, health: dict[str, Any]) -> None:
        self._heard_s = time.monotonic()
        values = {
            "state": health["state"],
            "points_hz": f"{health['rates']['points_hz']:.1f}",
            "calibration": health["calibration"] or "none",
            "tip": health["tip"] or "the calibration's own",
        }
        for name, celsius in health["temperatures"].items():
            values[name] = "missing" if celsius is None else f"{celsius:.2f}"
        for flag, count in health["last_second"]["flagged"].items():
            values[flag] = str(count)
        text = f"{health['state']}: {health['reason']}"
        stamp_ns = health["stamp_ns"]
        if not messages.has_ros_time(stamp_ns):
            stamp_ns = time.time_ns()
        self._tell_state(stamp_ns, LEVELS.get(health["state"], messages.WARN), text, values)

    def _tell_if_stale(self) -> None:
        now_s = time.monotonic()
        if now_s - self._heard_s > STALE_S and now_s - self._told_stale_s > 1.0:
            self._told_stale_s = now_s
            self._tell_state(time.time_ns(), messages.STALE, "STALE: no word of the daemon", {})

    def _tell_state(self, stamp_ns: int, level: int, text: str, values: dict[str, str]) -> None:
        serial = self._arm.serial
        self._diagnostics.put(
            messages.encode_diagnostics(stamp_ns, level, f"armd: {serial}", text, serial, values)
        )


class RouterLink:
    """Reports on standard error when the router is gone, and when it is back."""

    def __init__(self, router: str) -> None:
        self._router = router
        self._looked_s = self._seen_s = time.monotonic()
        self._is_gone = False

    def look(self, session: zenoh.Session) -> None:
        now_s = time.monotonic()
        if now_s - self._looked_s < 1.0:
            return
        self._looked_s = now_s
        info = session.info
        if info.routers_zid() or info.peers_zid():
            self._seen_s = now_s
            if self._is_gone:
                self._is_gone = False
                warn(f"router {self._router}: connected again")
        elif not self._is_gone and now_s - self._seen_s > GONE_S:
            self._is_gone = True
            warn(f"router {self._router}: the connection is gone; it is tried again and again")


async def _wait_for_router(opening: asyncio.Future[zenoh.Session], router: str) -> zenoh.Session:
    """Wait for *opening* and return its session; meanwhile messages say so."""
    patience_s = GONE_S
    while not (await asyncio.wait({opening}, timeout=patience_s))[0]:
        warn(f"router {router}: no connection yet, still waiting: is rmw_zenohd running there?")
        patience_s = WAITING_S
    return opening.result()


def open_client(router: str) -> zenoh.Session:
    """Open a session with the ROS router, separate from the arm's; wait without limit."""
    config = zenoh.Config()
    for key, value in {
        "mode": "client",
        "connect/endpoints": [router],
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": RETRY,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "timestamping/enabled": True,
    }.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


def to_metres(position_mm: Sequence[float]) -> list[float]:
    return [value * 1e-3 for value in position_mm]


def to_square_metres(covariance_mm2: Sequence[float] | None) -> list[float] | None:
    """Convert a covariance to m²; None if it is unknown."""
    if covariance_mm2 is None or not all(map(math.isfinite, covariance_mm2)):
        return None
    return [value * 1e-6 for value in covariance_mm2]
