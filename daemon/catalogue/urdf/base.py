"""Locate armd's base frame in a URDF, and check that the file's joints are arm.toml's."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_frames
from armd.daemon.catalogue.axes import choose_across, make_turn
from armd.daemon.catalogue.frame_poses import FramePose, make_rotations_about
from armd.daemon.catalogue.urdf.joints import TURNING, describe_joint, read_axis, read_origin
from armd.daemon.catalogue.urdf.urdf import list_joints_between
from armd.errors import BadInput

#: Axes farther off than this, at zero angles, belong to another arm.
OTHER_ARM_RAD, OTHER_ARM_SHARE = 0.2, 0.1
#: Another pose of the base frame must fit better by this much.
CLEARLY_MM = 1e-3


@dataclass(frozen=True)
class JointChain:
    """The joints between two links, as the file has them."""

    path: Path
    joints: list[Element]
    origins: list[FramePose]
    axes: list[F64 | None]  # None: fixed

    @classmethod
    def from_joints(cls, path: Path, joints: list[Element]) -> JointChain:
        origins = [read_origin(path, joint) for joint in joints]
        axes = [read_axis(path, j) if j.get("type") in TURNING else None for j in joints]
        return cls(path, joints, [FramePose(turned, 1e3 * xyz) for xyz, turned in origins], axes)

    def links(self) -> list[FramePose]:
        """Return the frame of each joint's child at zero angles, in the base link's frame."""
        poses, pose = [], FramePose(np.eye(3), np.zeros(3))
        for origin in self.origins:
            pose = pose @ origin
            poses.append(pose)
        return poses

    def tip(self, q: F64) -> tuple[F64, F64]:
        """Return positions (n, 3) mm and rotations (n, 3, 3) of the last link."""
        position, rotation = np.zeros((len(q), 3)), np.tile(np.eye(3), (len(q), 1, 1))
        angles = iter(q.T)
        for origin, axis in zip(self.origins, self.axes, strict=True):
            position = position + rotation @ origin.origin
            rotation = rotation @ origin.rotation
            if axis is not None:
                rotation = rotation @ make_rotations_about(axis, next(angles))
        return position, rotation


def place_base(chain: JointChain, arm: Arm, root: Element, base_link: str) -> FramePose:
    """Return armd's base frame in the base link's frame.

    It is placed as `armd import` places it from the base link. If arm.toml fits better so, it is
    placed as at import from the file's root, or is the base link's own frame. Raises `BadInput`
    where none fits.
    """
    root_pose = FramePose(np.eye(3), np.zeros(3))
    above: list[Element] = []
    if _has_parent(root, base_link):
        above, _ = list_joints_between(chain.path, root, None, base_link)
    first = next(k for k, axis in enumerate(chain.axes) if axis is not None)
    axis = chain.axes[first]
    assert axis is not None
    link = chain.links()[first]
    to_base = root_pose
    for joint in above:
        xyz, turned = read_origin(chain.path, joint)
        to_base = to_base @ FramePose(turned, 1e3 * xyz)
    best: tuple[float, FramePose] | None = None
    faults = []
    for base in (
        _place_imported_base(root_pose, link, axis),
        _place_imported_base(to_base, link, axis),
        root_pose,
    ):
        off_mm, fault = _measure_misfit(chain, arm, base)
        if fault is not None:
            faults.append(fault)
        elif best is None or off_mm < best[0] - CLEARLY_MM:
            best = off_mm, base
    if best is None:
        raise faults[0]
    return best[1]


def _place_imported_base(start: FramePose, link: FramePose, axis: F64) -> FramePose:
    """Return the base frame of `armd import` in the base link's frame.

    *start* is the base link's frame in that of the file's root. The base frame is on the first
    axis, its z along it.
    """
    joint = start @ link
    z = joint.rotation @ axis
    x = choose_across(z)
    frame = FramePose(np.column_stack([x, np.cross(z, x), z]), joint.origin)
    return start.inverse @ frame


def _has_parent(root: Element, link: str) -> bool:
    children = (joint.find("child") for joint in root.findall("joint"))
    return any(child is not None and child.get("link") == link for child in children)


def _measure_misfit(chain: JointChain, arm: Arm, base: FramePose) -> tuple[float, BadInput | None]:
    """Measure how far the axes at zero angles are from arm.toml's, in mm at its reach.

    Also returns the error if these are not its joints, else None.
    """
    worst_mm, number = 0.0, 0
    for joint, axis, link in zip(chain.joints, chain.axes, chain.links(), strict=True):
        if axis is None:
            continue
        frame = base @ compute_joint_frames(arm, arm.nominal())[number]
        number += 1
        along, drawn = link.rotation @ axis, frame.rotation[:, 2]
        angle = float(np.arctan2(np.linalg.norm(np.cross(along, drawn)), along @ drawn))
        off_mm = float(np.linalg.norm(np.cross(drawn, link.origin - frame.origin)))
        worst_mm = max(worst_mm, off_mm, angle * arm.reach_mm)
        if angle < OTHER_ARM_RAD and off_mm < OTHER_ARM_SHARE * arm.reach_mm:
            continue
        is_turned = angle >= OTHER_ARM_RAD
        away = f"{np.degrees(angle):.3g}°" if is_turned else f"{off_mm:.4g} mm"
        expected = f"the axis of joint {number} of arm.toml (`armd import` makes one of a URDF)"
        problem = f"an axis {away} away at zero angles"
        return worst_mm, BadInput(chain.path, describe_joint(joint), problem, expected)
    return worst_mm, None


def compute_joint_frames(arm: Arm, parameters: F64) -> list[FramePose]:
    """Return G_k of each joint at zero angles in armd's base frame; z is its axis."""
    origins, rotations = (
        part[0] for part in compute_frames(np.zeros((1, arm.n_joints)), parameters)
    )
    theta = np.degrees(parameters[arm.layout.angles])
    return [
        FramePose(rotations[k] @ make_turn(2, float(theta[k])), origins[k])
        for k in range(arm.n_joints)
    ]
