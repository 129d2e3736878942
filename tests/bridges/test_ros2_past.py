"""Presses before the bridge began: for subscribers that want the past, and for nobody else."""

from __future__ import annotations

import time

from zenoh import ext

from armd.daemon.bridges.ros2 import messages
from armd.daemon.bridges.ros2.node import Quality, RosNode
from support.careless_network import careless_network
from support.waiting import wait_until

KEY = f"0/arm/measurement/{messages.POINT_STAMPED.dds}/{messages.POINT_STAMPED.hash}"
PAST = ext.HistoryConfig(detect_late_publishers=True)


def test_the_past_reaches_late_joiners_and_no_volatile_subscriber() -> None:
    heard: dict[str, list[bytes]] = {"volatile": [], "before": [], "late": []}

    def into(name: str) -> object:
        return lambda sample: heard[name].append(sample.payload.to_bytes())

    with careless_network() as (ours, other, arm):
        subscribers = [
            other.declare_subscriber(KEY, into("volatile")),
            ext.declare_advanced_subscriber(other, KEY, into("before"), history=PAST),
        ]
        node = RosNode(ours, 0, "arm")
        publisher = node.publisher("/arm/measurement", messages.POINT_STAMPED, Quality(10, True))
        publisher.put_past([b"first", b"second"])
        publisher.put(b"third")
        subscribers.append(
            ext.declare_advanced_subscriber(arm._session, KEY, into("late"), history=PAST)
        )
        for name in ("before", "late"):
            wait_until(lambda name=name: {b"first", b"second", b"third"} <= set(heard[name]), heard)
            assert sorted(heard[name]) == [b"first", b"second", b"third"], name
        assert set(heard["volatile"]) <= {b"third"}  # which may come before it is known
        assert len(subscribers) == 3


def test_a_time_that_ros_cannot_write_is_none() -> None:
    assert messages.has_ros_time(time.time_ns())
    assert not messages.has_ros_time(1 << 62) and not messages.has_ros_time(-(1 << 62))
