"""Edit the joints of a user's URDF, between base and tip, to match a geometry.

Link k keeps its pose in the frame of its joint, G_k = F_{k−1}·Rz(θ_k), as in the original. It moves
with all that the calibration changes before it, θ_k included, and its axis stays the file's.
Lengths are in metres in the URDF and in mm in armd.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.catalogue.frame_poses import FramePose, find_least_rotation, measure_difference
from armd.daemon.catalogue.urdf.base import JointChain, compute_joint_frames, place_base
from armd.daemon.catalogue.urdf.joints import describe_joint
from armd.daemon.catalogue.urdf.places import (
    Edit,
    JointPlaces,
    apply_edits,
    find_joints,
    replace_tag,
)
from armd.daemon.catalogue.urdf.roll_pitch_yaw import (
    convert_matrix_to_quaternion,
    convert_matrix_to_rpy,
)
from armd.daemon.catalogue.urdf.urdf import follow_joints, list_joints_between
from armd.daemon.catalogue.urdf.xml_tree import read_robot
from armd.errors import ArmdError, BadInput
from armd.files.inputs import read_input

#: Numbers of the file stay where they differ less from the geometry's (m, rad).
SAME = 1e-10
#: Largest allowed difference of the edited file's tip from armd's.
EXACT_MM, EXACT_RAD = 1e-6, 1e-9
CHECKED = 1000


@dataclass(frozen=True)
class Edited:
    """The file's new content, and its differences."""

    content: bytes
    off_mm: float  # its tip from armd's, largest
    off_rad: float
    moved_mm: float  # its tip from the original's, largest
    nominal_mm: float  # the original's tip from arm.toml's, largest
    ends: tuple[str, str]


def correct_urdf(
    path: Path,
    arm: Arm,
    parameters: F64,
    base_link: str | None = None,
    tip_link: str | None = None,
) -> Edited:
    """Return the URDF *path* with this geometry; raises `BadInput` for another arm's URDF."""
    content = read_input(path)
    places = find_robot_joints(path, content)
    root = read_robot(path, content)
    joints, ends = list_joints_between(path, root, base_link, tip_link)
    chain = JointChain.from_joints(path, joints)
    follow_joints(path, joints, "", ends)  # raises for other than a chain of turning joints
    turning = [k for k, axis in enumerate(chain.axes) if axis is not None]
    if len(turning) != arm.n_joints:
        names = ", ".join(joints[k].get("name", "") for k in turning)
        problem = f"{len(turning)} turning joints from {ends[0]} to {ends[1]} ({names})"
        raise BadInput(path, "the chain", problem, f"{arm.n_joints}, as in arm.toml")
    base = place_base(chain, arm, root, ends[0])
    targets = _compute_targets(chain, turning, arm, parameters, base)
    order = {id(joint): k for k, joint in enumerate(root.findall("joint"))}
    of_joint = [places[order[id(joint)]] for joint in joints]
    q = np.random.default_rng(1).uniform(*arm.range_rad, (CHECKED, arm.n_joints))
    for same in (SAME, 0.0):
        edits = _make_edits(content, chain, of_joint, targets, same)
        new = apply_edits(content, edits)
        again, _ = list_joints_between(path, read_robot(path, new), base_link, tip_link)
        edited = JointChain.from_joints(path, again).tip(q)
        off_mm, off_rad = measure_difference(edited, _locate_tip(q, chain, arm, parameters, base))
        if off_mm < EXACT_MM / 4 and off_rad < EXACT_RAD / 4:
            break
    else:
        if off_mm > EXACT_MM or off_rad > EXACT_RAD:
            raise ArmdError(f"{path}: the edited file's tip is {off_mm:.3g} mm from armd's")
    before = chain.tip(q)
    moved_mm = measure_difference(edited, before)[0]
    nominal_mm = measure_difference(before, _locate_tip(q, chain, arm, arm.nominal(), base))[0]
    return Edited(new, off_mm, off_rad, moved_mm, nominal_mm, ends)


def find_robot_joints(path: Path, content: bytes) -> list[JointPlaces]:
    """Return the result of `find_joints`, after a check that the file is a robot's."""
    read_robot(path, content)
    return find_joints(path, content)


def _compute_tip_turn(chain: JointChain, arm: Arm, base: FramePose) -> F64:
    """Return the nominal rotation (3, 3) from armd's last frame to the tip's link."""
    last = base.rotation @ compute_pose(np.zeros((1, arm.n_joints)), arm.nominal())[1][0]
    turned: F64 = last.T @ chain.links()[-1].rotation
    return turned


def _locate_tip(
    q: F64, chain: JointChain, arm: Arm, parameters: F64, base: FramePose
) -> tuple[F64, F64]:
    position, rotation = compute_pose(q, parameters)
    turned = base.rotation @ rotation @ _compute_tip_turn(chain, arm, base)
    return base.origin + position @ base.rotation.T, turned


def _compute_targets(
    chain: JointChain, turning: list[int], arm: Arm, parameters: F64, base: FramePose
) -> list[tuple[FramePose, F64 | None]]:
    """Return the origin of each joint, and its axis."""
    nominal, calibrated = (compute_joint_frames(arm, p) for p in (arm.nominal(), parameters))
    links = chain.links()
    position, rotation = _locate_tip(np.zeros((1, arm.n_joints)), chain, arm, parameters, base)
    tip = FramePose(rotation[0], position[0])
    new: list[tuple[FramePose, F64 | None]] = []
    before = FramePose(np.eye(3), np.zeros(3))
    for k, (origin, axis) in enumerate(zip(chain.origins, chain.axes, strict=True)):
        link = before @ origin
        if axis is not None:
            number = turning.index(k)
            link_pose = (base @ nominal[number]).inverse @ links[k]
            link = base @ calibrated[number] @ _move_onto_axis(link_pose, axis)
        if k == len(chain.joints) - 1:
            if axis is not None:
                axis = _compute_axis_at_tip(chain, base @ calibrated[-1], tip, axis)
            link = tip
        new.append((before.inverse @ link, axis))
        before = link
    return new


def _move_onto_axis(pose: FramePose, axis: F64) -> FramePose:
    """Return a link in its joint's frame, with its axis along z and its origin on it."""
    along = pose.rotation @ axis
    rotation = find_least_rotation(along, np.array([0.0, 0.0, 1.0])) @ pose.rotation
    return FramePose(rotation, np.array([0.0, 0.0, pose.origin[2]]))


def _compute_axis_at_tip(chain: JointChain, joint: FramePose, tip: FramePose, axis: F64) -> F64:
    """Return the axis (3,) of a last joint that moves the tip's link itself.

    Raises `BadInput` if the tip is off that axis.
    """
    off = np.cross(joint.rotation[:, 2], tip.origin - joint.origin)
    off_mm = float(np.linalg.norm(off))
    if off_mm > EXACT_MM / 10:
        element = chain.joints[-1]
        problem = (
            f"a joint that moves the tip's link itself, and a tip {off_mm:.4g} mm off its axis"
        )
        expected = "a link at the tip with a fixed joint of its own (--tip-link)"
        raise BadInput(chain.path, describe_joint(element), problem, expected)
    turned: F64 = tip.rotation.T @ joint.rotation[:, 2]
    return axis if np.abs(turned - axis).max() < SAME else turned


def _make_edits(
    content: bytes,
    chain: JointChain,
    places: list[JointPlaces],
    targets: list[tuple[FramePose, F64 | None]],
    same: float,
) -> list[Edit]:
    edits = []
    for k, (origin, axis) in enumerate(targets):
        now, joint = chain.origins[k], chain.joints[k]
        attributes = {"xyz": _list_changed(1e-3 * now.origin, 1e-3 * origin.origin, same)}
        if np.abs(now.rotation - origin.rotation).max() > same:
            name, old, new = _format_rotation(joint.find("origin"), origin.rotation)
            attributes[name] = _list_changed(old, new, same)
        edits += replace_tag(content, places[k], "origin", attributes)
        if axis is not None and axis is not chain.axes[k]:
            edits += replace_tag(content, places[k], "axis", {"xyz": axis.tolist()})
    return edits


def _format_rotation(origin: Element | None, rotation: F64) -> tuple[str, F64, F64]:
    """Return the rotation's attribute, its numbers in the file, and those of *rotation*."""
    attributes = {} if origin is None else origin.attrib
    if "quat_xyzw" in attributes:
        old = np.array(attributes["quat_xyzw"].split(), dtype=np.float64)
        return "quat_xyzw", old, convert_matrix_to_quaternion(rotation)
    old = np.array(attributes.get("rpy", "0 0 0").split(), dtype=np.float64)
    return "rpy", old, convert_matrix_to_rpy(rotation, old)


def _list_changed(old: F64, new: F64, same: float) -> list[float | None]:
    """Return the new numbers; None where the old one may stay."""
    pairs = zip(old.tolist(), new.tolist(), strict=True)
    return [None if abs(a - b) <= same else b for a, b in pairs]
