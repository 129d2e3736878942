"""A person's own URDF with the joints between base and tip where a geometry has them.

Link k is held to the frame of its joint, G_k = F_{k−1}·Rz(θ_k), as in the original: it moves along
with what the calibration changes before it, θ_k included, and its axis stays the one of the file.
Lengths in metres and mm: the URDF's and armd's.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import forward, frames
from armd.daemon.catalogue.axes import across, turn
from armd.daemon.catalogue.frame_poses import FramePose, differ_by, least_rotation, rotations_about
from armd.daemon.catalogue.roll_pitch_yaw import quaternion_of_matrix, rpy_of_matrix
from armd.daemon.catalogue.urdf import joints_between, walk
from armd.daemon.catalogue.urdf_joints import TURNING, axis_of, origin_of, where
from armd.daemon.catalogue.urdf_places import (
    Edit,
    JointPlaces,
    apply_edits,
    edit_tag,
    find_joints,
)
from armd.daemon.catalogue.xml_tree import read_robot
from armd.errors import ArmdError, BadInput
from armd.files.inputs import read_input

#: Numbers of the file stay as they are where the geometry's are no farther off (m, rad).
SAME = 1e-10
#: What the edited file's tip may differ by from armd's.
EXACT_MM, EXACT_RAD = 1e-6, 1e-9
#: Axes farther off than this, at zero angles, are another arm's.
OTHER_ARM_RAD, OTHER_ARM_SHARE = 0.2, 0.1
CHECKED = 1000


@dataclass(frozen=True)
class Edited:
    """The file's new content, and how it compares."""

    content: bytes
    off_mm: float  # its tip from armd's, largest
    off_rad: float
    moved_mm: float  # its tip from the original's, largest
    nominal_mm: float  # the original's tip from arm.toml's, largest
    ends: tuple[str, str]


@dataclass(frozen=True)
class _Chain:
    """The joints between the links as a file has them."""

    path: Path
    joints: list[Element]
    origins: list[FramePose]
    axes: list[F64 | None]  # None: fixed

    @classmethod
    def of(cls, path: Path, joints: list[Element]) -> _Chain:
        origins = [origin_of(path, joint) for joint in joints]
        axes = [axis_of(path, j) if j.get("type") in TURNING else None for j in joints]
        return cls(path, joints, [FramePose(turned, 1e3 * xyz) for xyz, turned in origins], axes)

    def links(self) -> list[FramePose]:
        """The frame of each joint's child at zero angles, in that of the base link."""
        poses, pose = [], FramePose(np.eye(3), np.zeros(3))
        for origin in self.origins:
            pose = pose @ origin
            poses.append(pose)
        return poses

    def tip(self, q: F64) -> tuple[F64, F64]:
        """Positions (n, 3) mm and rotations (n, 3, 3) of the last link."""
        position, rotation = np.zeros((len(q), 3)), np.tile(np.eye(3), (len(q), 1, 1))
        angles = iter(q.T)
        for origin, axis in zip(self.origins, self.axes, strict=True):
            position = position + rotation @ origin.origin
            rotation = rotation @ origin.rotation
            if axis is not None:
                rotation = rotation @ rotations_about(axis, next(angles))
        return position, rotation


def correct_urdf(
    path: Path,
    arm: Arm,
    parameters: F64,
    base_link: str | None = None,
    tip_link: str | None = None,
) -> Edited:
    """The URDF *path* with this geometry; raises `BadInput` for the URDF of another arm."""
    content = read_input(path)
    places = find_joints_of(path, content)
    root = read_robot(path, content)
    joints, ends = joints_between(path, root, base_link, tip_link)
    chain = _Chain.of(path, joints)
    walk(path, joints, "", ends)  # refuses what is no chain of turning joints
    turning = [k for k, axis in enumerate(chain.axes) if axis is not None]
    if len(turning) != arm.n_joints:
        names = ", ".join(joints[k].get("name", "") for k in turning)
        found = f"{len(turning)} turning joints from {ends[0]} to {ends[1]} ({names})"
        raise BadInput(path, "the chain", found, f"{arm.n_joints}, as in arm.toml")
    base = _place_base(chain, arm, root, ends[0])
    wanted = _wanted(chain, turning, arm, parameters, base)
    order = {id(joint): k for k, joint in enumerate(root.findall("joint"))}
    of_joint = [places[order[id(joint)]] for joint in joints]
    q = np.random.default_rng(1).uniform(*arm.range_rad, (CHECKED, arm.n_joints))
    for same in (SAME, 0.0):
        edits = _edits(content, chain, of_joint, wanted, same)
        new = apply_edits(content, edits)
        again, _ = joints_between(path, read_robot(path, new), base_link, tip_link)
        edited = _Chain.of(path, again).tip(q)
        off_mm, off_rad = differ_by(edited, _armd_tip(q, chain, arm, parameters, base))
        if off_mm < EXACT_MM / 4 and off_rad < EXACT_RAD / 4:
            break
    else:
        if off_mm > EXACT_MM or off_rad > EXACT_RAD:
            raise ArmdError(f"{path}: the edited file's tip is {off_mm:.3g} mm from armd's")
    before = chain.tip(q)
    moved_mm = differ_by(edited, before)[0]
    nominal_mm = differ_by(before, _armd_tip(q, chain, arm, arm.nominal(), base))[0]
    return Edited(new, off_mm, off_rad, moved_mm, nominal_mm, ends)


def find_joints_of(path: Path, content: bytes) -> list[JointPlaces]:
    """As `find_joints`, once the file is known to be a robot's."""
    read_robot(path, content)
    return find_joints(path, content)


def _place_base(chain: _Chain, arm: Arm, root: Element, base_link: str) -> FramePose:
    """armd's base frame in the base link's, placed as at import from the base link or, where
    arm.toml fits that alone, from the file's root. Raises `BadInput` where it fits neither."""
    above: list[Element] = []
    if _has_parent(root, base_link):
        above, _ = joints_between(chain.path, root, None, base_link)
    to_base = FramePose(np.eye(3), np.zeros(3))
    for joint in above:
        xyz, turned = origin_of(chain.path, joint)
        to_base = to_base @ FramePose(turned, 1e3 * xyz)
    first = next(k for k, axis in enumerate(chain.axes) if axis is not None)
    axis = chain.axes[first]
    assert axis is not None
    faults = []
    for start in (FramePose(np.eye(3), np.zeros(3)), to_base):
        link = start @ chain.links()[first]
        z = link.rotation @ axis
        x = across(z)
        frame = FramePose(np.column_stack([x, np.cross(z, x), z]), link.origin)
        base = start.inverse @ frame
        fault = _misfit(chain, arm, base)
        if fault is None:
            return base
        faults.append(fault)
    raise faults[0]


def _has_parent(root: Element, link: str) -> bool:
    children = (joint.find("child") for joint in root.findall("joint"))
    return any(child is not None and child.get("link") == link for child in children)


def _misfit(chain: _Chain, arm: Arm, base: FramePose) -> BadInput | None:
    """What says that these are not the joints of arm.toml, if anything does."""
    number = 0
    for joint, axis, link in zip(chain.joints, chain.axes, chain.links(), strict=True):
        if axis is None:
            continue
        frame = base @ _frames_of_joints(arm, arm.nominal())[number]
        number += 1
        along, drawn = link.rotation @ axis, frame.rotation[:, 2]
        angle = float(np.arctan2(np.linalg.norm(np.cross(along, drawn)), along @ drawn))
        off_mm = float(np.linalg.norm(np.cross(drawn, link.origin - frame.origin)))
        expected = f"the axis of joint {number} of arm.toml (`armd import` makes one of a URDF)"
        if angle > OTHER_ARM_RAD:
            found = f"an axis {np.degrees(angle):.3g}° away at zero angles"
            return BadInput(chain.path, where(joint), found, expected)
        if off_mm > OTHER_ARM_SHARE * arm.reach_mm:
            found = f"an axis {off_mm:.4g} mm away at zero angles"
            return BadInput(chain.path, where(joint), found, expected)
    return None


def _frames_of_joints(arm: Arm, parameters: F64) -> list[FramePose]:
    """G_k of each joint at zero angles in armd's base frame: z is its axis."""
    origins, rotations = (part[0] for part in frames(np.zeros((1, arm.n_joints)), parameters))
    theta = np.degrees(parameters[arm.layout.angles])
    return [
        FramePose(rotations[k] @ turn(2, float(theta[k])), origins[k]) for k in range(arm.n_joints)
    ]


def _tip_turn(chain: _Chain, arm: Arm, base: FramePose) -> F64:
    """Rotation (3, 3) from armd's last frame to the tip's link, as drawn."""
    last = base.rotation @ forward(np.zeros((1, arm.n_joints)), arm.nominal())[1][0]
    turned: F64 = last.T @ chain.links()[-1].rotation
    return turned


def _armd_tip(q: F64, chain: _Chain, arm: Arm, parameters: F64, base: FramePose) -> tuple[F64, F64]:
    position, rotation = forward(q, parameters)
    turned = base.rotation @ rotation @ _tip_turn(chain, arm, base)
    return base.origin + position @ base.rotation.T, turned


def _wanted(
    chain: _Chain, turning: list[int], arm: Arm, parameters: F64, base: FramePose
) -> list[tuple[FramePose, F64 | None]]:
    """The origin of each joint, and its axis."""
    nominal, calibrated = (_frames_of_joints(arm, p) for p in (arm.nominal(), parameters))
    links = chain.links()
    position, rotation = _armd_tip(np.zeros((1, arm.n_joints)), chain, arm, parameters, base)
    tip = FramePose(rotation[0], position[0])
    new: list[tuple[FramePose, F64 | None]] = []
    before = FramePose(np.eye(3), np.zeros(3))
    for k, (origin, axis) in enumerate(zip(chain.origins, chain.axes, strict=True)):
        link = before @ origin
        if axis is not None:
            number = turning.index(k)
            held = (base @ nominal[number]).inverse @ links[k]
            link = base @ calibrated[number] @ _onto_axis(held, axis)
        if k == len(chain.joints) - 1:
            if axis is not None:
                axis = _axis_at_tip(chain, base @ calibrated[-1], tip, axis)
            link = tip
        new.append((before.inverse @ link, axis))
        before = link
    return new


def _onto_axis(held: FramePose, axis: F64) -> FramePose:
    """A link in its joint's frame, with its axis along z and its origin on it."""
    along = held.rotation @ axis
    rotation = least_rotation(along, np.array([0.0, 0.0, 1.0])) @ held.rotation
    return FramePose(rotation, np.array([0.0, 0.0, held.origin[2]]))


def _axis_at_tip(chain: _Chain, joint: FramePose, tip: FramePose, axis: F64) -> F64:
    """The axis (3,) of a last joint that moves the tip's link itself."""
    off = np.cross(joint.rotation[:, 2], tip.origin - joint.origin)
    off_mm = float(np.linalg.norm(off))
    if off_mm > EXACT_MM / 10:
        element = chain.joints[-1]
        found = f"a joint that moves the tip's link itself, and a tip {off_mm:.4g} mm off its axis"
        expected = "a link at the tip with a fixed joint of its own (--tip-link)"
        raise BadInput(chain.path, where(element), found, expected)
    turned: F64 = tip.rotation.T @ joint.rotation[:, 2]
    return axis if np.abs(turned - axis).max() < SAME else turned


def _edits(
    content: bytes,
    chain: _Chain,
    places: list[JointPlaces],
    wanted: list[tuple[FramePose, F64 | None]],
    same: float,
) -> list[Edit]:
    edits = []
    for k, (origin, axis) in enumerate(wanted):
        now, joint = chain.origins[k], chain.joints[k]
        attributes = {"xyz": _changed(1e-3 * now.origin, 1e-3 * origin.origin, same)}
        if np.abs(now.rotation - origin.rotation).max() > same:
            name, old, new = _rotation(joint.find("origin"), origin.rotation)
            attributes[name] = _changed(old, new, same)
        edits += edit_tag(content, places[k], "origin", attributes)
        if axis is not None and axis is not chain.axes[k]:
            edits += edit_tag(content, places[k], "axis", {"xyz": axis.tolist()})
    return edits


def _rotation(origin: Element | None, rotation: F64) -> tuple[str, F64, F64]:
    """The attribute that says it, its numbers in the file, and those of *rotation*."""
    said = {} if origin is None else origin.attrib
    if "quat_xyzw" in said:
        old = np.array(said["quat_xyzw"].split(), dtype=np.float64)
        return "quat_xyzw", old, quaternion_of_matrix(rotation)
    old = np.array(said.get("rpy", "0 0 0").split(), dtype=np.float64)
    return "rpy", old, rpy_of_matrix(rotation, old)


def _changed(old: F64, new: F64, same: float) -> list[float | None]:
    """The new numbers; None where the old one may stay."""
    pairs = zip(old.tolist(), new.tolist(), strict=True)
    return [None if abs(a - b) <= same else b for a, b in pairs]
