"""`armd/<serial>/joints`: one per point, only while somebody listens, angles as the wire counts."""

from __future__ import annotations

import struct
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from armd import POINT
from armd.compensation.model.arm import load_arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.config import Limits
from armd.daemon.live.pipeline import Pipeline
from armd.daemon.network.publisher import Publisher, encode_joint_messages
from support.careless_network import session
from support.running_daemon import free_endpoint, running_daemon, session_with
from support.simulated_arm import simulated_arm
from support.small_arm import samples_of, small_arm
from support.waiting import wait_until

KEY = "armd/SIM-0001/joints"


class Counting:
    """Counts what reaches a subscriber that may come and go."""

    def __init__(self) -> None:
        self.samples: list[zenoh.Sample] = []
        self.first_ns = 0

    def take(self, sample: zenoh.Sample) -> None:
        self.first_ns = self.first_ns or time.monotonic_ns()
        self.samples.append(sample)


def unpack(payload: bytes) -> tuple[int, int, tuple[float, ...], tuple[float, ...]]:
    """By the contract's words, not by armd's dtype."""
    seq, stamp_ns, n, zero = struct.unpack_from("<QqII", payload)
    assert zero == 0
    assert len(payload) == 24 + 12 * n
    angles = struct.unpack_from(f"<{n}d", payload, 24)
    return seq, stamp_ns, angles, struct.unpack_from(f"<{n}f", payload, 24 + 8 * n)


@pytest.mark.slow
def test_one_per_point_and_only_while_somebody_listens(tmp_path: Path) -> None:
    with (
        simulated_arm(tmp_path) as arm,
        running_daemon(tmp_path, arm.port) as daemon,
        daemon.session() as session,
    ):
        points: list[bytes] = []
        session.declare_subscriber(
            "armd/SIM-0001/point", lambda sample: points.append(sample.payload.to_bytes())
        )
        heard = Counting()
        began_ns = time.monotonic_ns()
        session.declare_subscriber(KEY, heard.take)
        wait_until(lambda: len(heard.samples) > 500)
        assert heard.first_ns - began_ns < 1e9
        assert {str(s.encoding) for s in heard.samples} == {
            "application/octet-stream;armd.joints.v1"
        }
        messages = [unpack(s.payload.to_bytes()) for s in heard.samples]
        wait_until(lambda: points_of(points)["seq"][-1] > messages[-1][0])
        by_seq = {int(point["seq"]): point for point in points_of(points)}
        seqs = [message[0] for message in messages]
        assert seqs == sorted(s for s in by_seq if seqs[0] <= s <= seqs[-1])
        model = load_arm(tmp_path / "arm.toml")
        assert {len(message[2]) for message in messages} == {model.n_joints}
        for seq, stamp_ns, angles, rates in messages[::100]:
            point = by_seq[seq]
            assert stamp_ns == point["stamp_ns"]
            # Without calibration the point is the nominal geometry's at these very angles.
            tip, _ = compute_pose(np.array([angles]), model.nominal())
            assert tip[0] == pytest.approx(point["position_mm"], abs=1e-6)
            assert len(rates) == model.n_joints
        ok, info = daemon.get("info")
        assert ok
        assert info["joints"]["key"] == KEY
        assert info["joints"]["size"] == 24 + 12 * model.n_joints


def looks_into_it(publisher: Publisher) -> bool:
    """Whether the joints would be put, now that the publisher has looked for listeners."""
    untouchable: Any = None
    publisher.look_for_listeners()
    try:
        publisher.put_joints(untouchable, untouchable, untouchable)
    except TypeError:
        return True
    return False


def test_unheard_they_cost_one_question_on_the_tick() -> None:
    endpoint = free_endpoint()
    with session("peer", endpoint) as here, closing(Publisher(here, "SIM-0001")) as publisher:
        assert not looks_into_it(publisher)
        with session_with(endpoint) as there:
            subscriber = there.declare_subscriber(KEY, lambda _: None)
            wait_until(lambda: looks_into_it(publisher))
            subscriber.undeclare()
            wait_until(lambda: not looks_into_it(publisher))


def test_a_broken_joint_has_no_angle() -> None:
    arm = small_arm()
    samples = samples_of(np.array([[10.0, 20.0, 30.0], [11.0, 20.0, 30.0]]))
    samples["joint_invalid"][1] = 0b010
    pipeline = Pipeline(arm, None, Limits())
    points, joints = pipeline.correct(samples)
    first, second = (unpack(m) for m in encode_joint_messages(points, samples, joints))
    assert np.degrees(first[2]) == pytest.approx([10, 20, 30], abs=1e-3)
    assert np.degrees([second[2][0], second[2][2]]) == pytest.approx([11, 30], abs=1e-3)
    assert np.isnan(second[2][1])
    assert np.isnan(second[3]).all()  # rates begin anew with the next whole sample


def points_of(payloads: list[bytes]) -> np.ndarray:
    return np.frombuffer(b"".join(list(payloads)), POINT)
