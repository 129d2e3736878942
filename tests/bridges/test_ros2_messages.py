"""ROS messages against published vectors and rosbags, an independent coder; the drawn arm."""

from __future__ import annotations

import json
import math
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
from rosbags.typesys import Stores, get_typestore

from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.bridges.ros2 import messages, urdf
from armd.daemon.bridges.ros2.node import escape, make_legal_name
from support.plain_urdf import tip_poses
from support.small_arm_toml import ARM, CALIBRATION

STAMP_NS = 1_700_000_000_123_456_789
P = (0.742189, 0.229745, 0.747277)
Q = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
STORES = [get_typestore(store) for store in (Stores.ROS2_JAZZY, Stores.ROS2_KILTED)]
STORE = STORES[0]

VECTORS = {
    "0001000000f1536515cd5b0705000000626173650000000000000000226e4e2503c0e73fd5b2b5be4868cd3f"
    "1cb28174b1e9e73f": messages.encode_point(STAMP_NS, "base", P),
    "000100000100000000f1536515cd5b070500000062617365000000000400000074697000226e4e2503c0e73f"
    "d5b2b5be4868cd3f1cb28174b1e9e73f00000000000000000000000000000000cd3b7f669ea0e63f"
    "cd3b7f669ea0e63f": messages.encode_transform(STAMP_NS, "base", "tip", P, Q),
    "0001000000f1536515cd5b07010000000000000001000000010000000f00000061726d643a2053494d2d3030"
    "30310000080000005741524d494e47000900000053494d2d3030303100000000010000000300000074310000"
    "0600000032372e373300": messages.encode_diagnostics(
        STAMP_NS, messages.WARN, "armd: SIM-0001", "WARMING", "SIM-0001", {"t1": "27.73"}
    ),
}  # fmt: skip
TYPES = {
    "geometry_msgs/msg/PointStamped": messages.POINT_STAMPED,
    "geometry_msgs/msg/PoseWithCovarianceStamped": messages.POSE_WITH_COVARIANCE_STAMPED,
    "sensor_msgs/msg/JointState": messages.JOINT_STATE,
    "tf2_msgs/msg/TFMessage": messages.TF_MESSAGE,
    "diagnostic_msgs/msg/DiagnosticArray": messages.DIAGNOSTIC_ARRAY,
}


@pytest.mark.parametrize("expected", VECTORS)
def test_published_vectors(expected: str) -> None:
    assert VECTORS[expected].hex() == expected


@pytest.mark.parametrize("name", TYPES)
def test_hashes_and_names(name: str) -> None:
    package, _, short = name.split("/")
    assert TYPES[name].dds == f"{package}::msg::dds_::{short}_"
    for store in STORES:
        assert TYPES[name].hash.removeprefix("RIHS01_") == store.hash_rihs01(name).removeprefix(
            "RIHS01_"
        )


def read(data: bytes, name: str) -> Any:
    message = STORE.deserialize_cdr(data, name)
    assert bytes(STORE.serialize_cdr(message, name)) == data  # byte for byte what rosbags writes
    return message


def test_joint_state() -> None:
    names = ["joint_1", "joint_2"]
    data = messages.encode_joint_state(STAMP_NS, names, [0.5, -1.0], [0.1, 0.2])
    message = read(data, "sensor_msgs/msg/JointState")
    assert message.name == names
    assert message.position.tolist() == [0.5, -1.0]
    assert message.velocity.tolist() == [0.1, 0.2]
    assert (
        len(
            read(
                messages.encode_joint_state(0, names, [1.0, 2.0], []), "sensor_msgs/msg/JointState"
            ).velocity
        )
        == 0
    )


def test_pose_with_covariance() -> None:
    data = messages.encode_pose(STAMP_NS, "base", P, Q, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0])
    assert len(data) == 372
    message = read(data, "geometry_msgs/msg/PoseWithCovarianceStamped")
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == divmod(STAMP_NS, 10**9)
    matrix = message.pose.covariance.reshape(6, 6)
    assert matrix[:3, :3].tolist() == [[1, 2, 3], [2, 4, 5], [3, 5, 6]]
    assert not matrix[3:].any()
    assert not matrix[:, 3:].any()
    unknown = messages.encode_pose(STAMP_NS, "base", P, Q, None)
    assert read(unknown, "geometry_msgs/msg/PoseWithCovarianceStamped").pose.covariance[0] == -1


@pytest.mark.parametrize("frame", ["", "a", "ab", "abcdefgh", "SIM_0001_base"])
def test_every_alignment(frame: str) -> None:
    point = read(messages.encode_point(STAMP_NS, frame, P), "geometry_msgs/msg/PointStamped")
    assert (point.header.frame_id, point.point.z) == (frame, P[2])
    tf = read(
        messages.encode_transform(STAMP_NS, frame, "x" + frame, P, Q), "tf2_msgs/msg/TFMessage"
    )
    assert tf.transforms[0].child_frame_id == "x" + frame
    values = {"t1": "1", "longer": "22"}
    text = messages.encode_diagnostics(STAMP_NS, 3, frame, "m", "h", values)
    status = read(text, "diagnostic_msgs/msg/DiagnosticArray").status[0]
    assert {pair.key: pair.value for pair in status.values} == values


def test_names() -> None:
    assert make_legal_name("SIM-0001") == "SIM_0001"
    assert make_legal_name("0815 ü") == "arm_0815__"
    assert escape("/a/b") == "%a%b"


# --- the drawn arm -----------------------------------------------------------------------------


@pytest.mark.parametrize("calibrated", [False, True])
def test_the_drawn_arm_ends_where_the_arm_does(calibrated: bool) -> None:
    file = json.dumps(CALIBRATION) if calibrated else None
    robot = Xml.fromstring(urdf.write({"arm": ARM}, file, "SMALL_1", "SMALL_1_base"))
    arm = Arm.model_validate_json(json.dumps(ARM))
    parameters = arm.nominal()
    if calibrated:
        calibration = Calibration.model_validate_json(json.dumps(CALIBRATION))
        parameters = calibration.vector(arm.n_joints)
        assert not np.allclose(parameters, arm.nominal())
    rng = np.random.default_rng(3)
    q = rng.uniform(-2, 2, (20, arm.n_joints))
    turning = [joint for joint in robot.iter("joint") if joint.get("type") != "fixed"]
    assert [joint.get("name") for joint in turning] == ["joint_1", "joint_2", "joint_3"]
    expected, last = compute_pose(q, parameters)
    drawn = tip_poses(robot, q, "SMALL_1_ball")
    assert drawn[:, :3, 3] == pytest.approx(expected, abs=1e-6)
    assert drawn[:, :3, :3] == pytest.approx(last, abs=1e-9)


def test_terms_that_a_urdf_drops_are_reported() -> None:
    terms = [
        {"parameter": "theta_2", "coefficient": 1e-4, "effect": "joint_compliance joint 2"},
        {"parameter": "a_2", "coefficient": 4e-3},
    ]
    file = json.dumps(CALIBRATION | {"terms": terms})
    said = urdf.describe_omissions(file)
    assert "without 2 terms of the calibration (joint_compliance joint 2, of a_2)" in said
    assert urdf.describe_omissions(json.dumps(CALIBRATION | {"terms": []})) == ""
    assert urdf.describe_omissions(None) == ""


def test_the_drawing_is_one_tree_with_tubes_of_the_right_length() -> None:
    robot = Xml.fromstring(urdf.write({"arm": ARM}, None, "S", "S_base"))
    links = {link.attrib["name"] for link in robot.iter("link")}
    parents = [joint.find("parent").attrib["link"] for joint in robot.iter("joint")]  # type: ignore[union-attr]
    children = [joint.find("child").attrib["link"] for joint in robot.iter("joint")]  # type: ignore[union-attr]
    assert set(parents) | set(children) == links
    assert len(children) == len(set(children)) == len(links) - 1
    assert links - set(children) == {"S_base"}
    lengths = [float(c.attrib["length"]) for c in robot.iter("cylinder")]
    assert 0.3 in lengths
    limits = [(limit.attrib["lower"], limit.attrib["upper"]) for limit in robot.iter("limit")]
    assert len(limits) == 3
    assert float(limits[0][1]) == pytest.approx(math.radians(170))
