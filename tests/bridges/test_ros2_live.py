"""`armd ros2` through a router, seen by a subscriber as rmw_zenoh declares one."""

from __future__ import annotations

import re
import struct
import subprocess
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
import zenoh
from rosbags.typesys import Stores, get_typestore
from zenoh import ext

from support.careless_network import session
from support.program import ARMD, run_armd
from support.running_daemon import Daemon, free_endpoint, running_daemon
from support.selection import parametrize_default
from support.simulated_arm import simulated_arm
from support.waiting import wait_until

STORE = get_typestore(Stores.ROS2_JAZZY)
DOMAIN = 7
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
TOPICS = {
    "/SIM_0001/point": "geometry_msgs/msg/PointStamped",
    "/SIM_0001/pose": POSE,
    "/SIM_0001/measurement": POSE,
    "/SIM_0001/joint_states": "sensor_msgs/msg/JointState",
    "/tf": "tf2_msgs/msg/TFMessage",
    "/tf_static": "tf2_msgs/msg/TFMessage",
    "/diagnostics": "diagnostic_msgs/msg/DiagnosticArray",
}


# --- rmw_zenoh's own reading of a liveliness token, ported -------------------------------------


def parse_entity(key: str) -> dict[str, Any]:
    """`Entity::make` of rmw_zenoh_cpp/src/detail/liveliness_utils.cpp."""
    parts = key.split("/")
    assert all(parts), "no part may be empty"
    assert parts[0] == "@ros2_lv"
    assert len(parts) >= 9
    entity: dict[str, Any] = {
        "domain": int(parts[1]),
        "zid": parts[2],
        "nid": parts[3],
        "id": parts[4],
        "kind": parts[5],
        "enclave": parts[6].replace("%", "/"),
        "namespace": parts[7].replace("%", "/"),
        "node": parts[8],
    }
    assert entity["kind"] in ("NN", "MP", "MS", "SS", "SC")
    if entity["kind"] != "NN":
        assert len(parts) == 13
        entity["topic"] = parts[9].replace("%", "/")
        entity["type"], entity["hash"], entity["qos"] = parts[10], parts[11], parse_qos(parts[12])
    return entity


def parse_qos(text: str) -> dict[str, Any]:
    """`keyexpr_to_qos`: an empty field is the default."""
    reliability, durability, history, deadline, lifespan, liveliness = text.split(":")
    kind, depth = history.split(",")
    assert len(deadline.split(",")) == len(lifespan.split(",")) == 2
    assert len(liveliness.split(",")) == 3
    return {
        "reliability": int(reliability or 1),
        "durability": int(durability or 2),
        "history": int(kind or 1),
        "depth": int(depth or 42),
    }


class Ros:
    """Subscribes as rmw_zenoh does: any type hash, advanced, with history where it is latched."""

    def __init__(self, session: zenoh.Session) -> None:
        self.heard: defaultdict[str, list[tuple[Any, int]]] = defaultdict(list)
        self._keep = [
            ext.declare_advanced_subscriber(
                session,
                f"{DOMAIN}{topic}/{type_key(name)}",
                self._take(topic, name),
                history=ext.HistoryConfig(detect_late_publishers=True, max_samples=1000),
                recovery=ext.RecoveryConfig(heartbeat=True),
            )
            for topic, name in TOPICS.items()
        ]

    def _take(self, topic: str, name: str) -> Callable[[zenoh.Sample], None]:
        def take(sample: zenoh.Sample) -> None:
            attachment = sample.attachment
            assert attachment is not None
            raw = attachment.to_bytes()
            assert len(raw) == 33
            sequence, sent_ns, length = struct.unpack_from("<qqB", raw)
            assert length == 16
            assert abs(time.time_ns() - sent_ns) < 600e9
            self.heard[topic].append(
                (STORE.deserialize_cdr(sample.payload.to_bytes(), name), sequence)
            )

        return take

    def wait(self, topic: str, n: int = 1) -> list[tuple[Any, int]]:
        wait_until(lambda: len(self.heard[topic]) >= n, topic)
        return list(self.heard[topic])

    def close(self) -> None:
        for subscriber in self._keep:
            subscriber.undeclare()


def type_key(name: str) -> str:
    package, _, short = name.split("/")
    return (
        f"{package}::msg::dds_::{short}_/RIHS01_{STORE.hash_rihs01(name).removeprefix('RIHS01_')}"
    )


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    folder = tmp_path_factory.mktemp("ros2")
    with simulated_arm(folder) as arm, running_daemon(folder, arm.port) as daemon:
        yield daemon


def test_a_router_that_is_not_there_is_told_of_and_so_is_one_that_goes(daemon: Daemon) -> None:
    endpoint = free_endpoint()
    words, pipe = ["--endpoint", daemon.endpoint, "--router", endpoint], subprocess.PIPE
    with subprocess.Popen([*ARMD, "ros2", *words], stdout=pipe, stderr=pipe, text=True) as process:
        try:
            assert process.stdout is not None and process.stderr is not None
            waits = process.stderr.readline()
            assert waits.startswith(f"armd: router {endpoint}: no connection yet, still waiting")
            with session("router", endpoint):
                assert process.stdout.readline() == f"armd: ready ros2 on {endpoint}\n"
            gone = process.stderr.readline()
            assert gone.startswith(f"armd: router {endpoint}: the connection is gone")
            with session("router", endpoint):
                assert process.stderr.readline() == f"armd: router {endpoint}: connected again\n"
        finally:
            process.kill()


@pytest.mark.slow
def test_topics_through_a_router(daemon: Daemon) -> None:
    endpoint = free_endpoint()
    words = [*ARMD, "ros2", "--endpoint", daemon.endpoint]
    words += ["--router", endpoint, "--domain", str(DOMAIN), "--rate", "50"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as process:
        try:
            time.sleep(3.0)  # there is no router yet: it waits
            assert process.poll() is None
            with session("router", endpoint):
                assert process.stdout is not None
                assert process.stdout.readline() == f"armd: ready ros2 on {endpoint}\n"
                see_topics(endpoint)
            time.sleep(1.0)  # the router is gone, and comes back
            with session("router", endpoint), session("client", endpoint) as client:
                again = Ros(client)
                again.wait("/SIM_0001/point", 20)
                again.wait("/tf_static")
                tokens = list(client.liveliness().get(f"@ros2_lv/{DOMAIN}/**"))
                assert len(tokens) == 1 + len(TOPICS)
                again.close()
                process.terminate()
                assert process.wait(60) == 0
        finally:
            process.kill()


def see_topics(endpoint: str) -> None:
    with session("client", endpoint) as client:
        early = Ros(client)
        entities = [
            parse_entity(str(reply.ok.key_expr))
            for reply in client.liveliness().get(f"@ros2_lv/{DOMAIN}/**")
            if reply.ok is not None
        ]
        assert {(e["namespace"], e["node"], e["enclave"]) for e in entities} == {
            ("/SIM_0001", "armd", "/")
        }
        assert [e["kind"] for e in entities].count("NN") == 1
        publishers = {e["topic"]: e for e in entities if e["kind"] == "MP"}
        assert len({e["id"] for e in publishers.values()}) == len(TOPICS)
        for topic, name in TOPICS.items():
            token = publishers[topic]
            assert f"{token['type']}/{token['hash']}" == type_key(name)
            latched = topic in ("/tf_static", "/SIM_0001/measurement")
            assert token["qos"]["durability"] == (1 if latched else 2)
            assert token["qos"]["reliability"] == 1

        points = early.wait("/SIM_0001/point", 100)
        sequences = [sequence for _, sequence in points]
        assert sequences == list(range(sequences[0], sequences[0] + len(points)))
        stamps = np.array([p.header.stamp.sec + p.header.stamp.nanosec * 1e-9 for p, _ in points])
        assert np.median(np.diff(stamps)) == pytest.approx(1 / 50, rel=0.05)
        assert {p.header.frame_id for p, _ in points} == {"SIM_0001_base"}
        place = np.array([[p.point.x, p.point.y, p.point.z] for p, _ in points])
        assert (np.linalg.norm(place, axis=1) < 3.0).all()  # metres

        joints = early.wait("/SIM_0001/joint_states", 50)[-1][0]
        assert joints.name == [f"joint_{k}" for k in range(1, 7)]
        assert len(joints.position) == 6
        tf = early.wait("/tf", 50)[-1][0].transforms[0]
        assert (tf.header.frame_id, tf.child_frame_id) == ("SIM_0001_base", "SIM_0001_tip")
        status = early.wait("/diagnostics")[-1][0].status[0]
        assert re.match(r"(READY|WARMING|DEGRADED)", status.message)
        assert status.hardware_id == "SIM-0001"
        assert status.level in (0, 1)
        assert not early.heard["/SIM_0001/pose"]  # nominal geometry: no covariance is known
        measured = early.wait("/SIM_0001/measurement")
        early.close()

    with session("client", endpoint) as client:  # late: gets what is latched
        late = Ros(client)
        static = late.wait("/tf_static")[0][0].transforms[0]
        assert (static.header.frame_id, static.child_frame_id) == ("world", "SIM_0001_base")
        again = late.wait("/SIM_0001/measurement", len(measured))
        # Those from before the bridge began have a publisher of their own: stamps give the order.
        assert sorted(s for _, s in again)[: len(measured)] == sorted(s for _, s in measured)
        assert again[0][0].pose.covariance[0] == -1  # not known
        late.close()


def test_the_arm_is_drawn(daemon: Daemon, tmp_path: Path) -> None:
    file = tmp_path / "arm.urdf"
    done = run_armd("ros2", "--endpoint", daemon.endpoint, "--urdf", file)
    assert done.returncode == 0, done.stderr
    robot = Xml.parse(file).getroot()
    names = [
        joint.attrib["name"] for joint in robot.iter("joint") if joint.attrib["type"] != "fixed"
    ]
    assert names == [f"joint_{k}" for k in range(1, 7)]


@parametrize_default(
    ("words", "said"),
    [
        ([], "--router: found nothing, expected the endpoint"),
        (["--router", "tcp/h:1", "--domain", "233"], "--domain: found 233, expected a number"),
        (["--router", "tcp/h:1", "--namespace", "0-8"], "--namespace: found '0-8', expected"),
        (["--router", "tcp/h:1", "--rate", "0"], "--rate: found 0, expected"),
    ],
    default=2,
)
def test_bad_usage(words: list[str], said: str) -> None:
    done = run_armd("ros2", *words)
    assert done.returncode == 2
    assert said in done.stderr
