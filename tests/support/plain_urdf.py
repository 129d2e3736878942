"""The poses of a URDF's links, by 4 × 4 matrices: truth for what armd writes."""

from __future__ import annotations

from xml.etree import ElementTree as Xml

import numpy as np
from scipy.spatial.transform import Rotation


def numbers(element: Xml.Element | None, name: str, usual: str) -> np.ndarray:
    text = usual if element is None else element.get(name, usual)
    return np.array([float(word) for word in text.split()])


def chain(robot: Xml.Element, tip: str, base: str | None = None) -> list[Xml.Element]:
    """The joints from the base link (the root) to the tip's."""
    moved_by = {joint.find("child").get("link"): joint for joint in robot.findall("joint")}  # type: ignore[union-attr]
    joints: list[Xml.Element] = []
    while tip in moved_by and tip != base:
        joints.insert(0, moved_by[tip])
        tip = moved_by[tip].find("parent").get("link")  # type: ignore[union-attr]
    return joints


def tip_poses(robot: Xml.Element, q: np.ndarray, tip: str, base: str | None = None) -> np.ndarray:
    """Poses (n, 4, 4) of the tip's link in the base link, mm, at angles (n, N) rad."""
    poses = np.tile(np.eye(4), (len(q), 1, 1))
    angles = iter(q.T)
    for joint in chain(robot, tip, base):
        origin = joint.find("origin")
        step = np.eye(4)
        step[:3, 3] = 1e3 * numbers(origin, "xyz", "0 0 0")
        if origin is not None and "quat_xyzw" in origin.attrib:
            step[:3, :3] = Rotation.from_quat(numbers(origin, "quat_xyzw", "")).as_matrix()
        else:
            rpy = numbers(origin, "rpy", "0 0 0")
            step[:3, :3] = Rotation.from_euler("xyz", rpy).as_matrix()
        poses = poses @ step
        if joint.get("type") != "fixed":
            axis = numbers(joint.find("axis"), "xyz", "1 0 0")
            vectors = next(angles)[:, None] * axis / np.linalg.norm(axis)
            turned = np.tile(np.eye(4), (len(q), 1, 1))
            turned[:, :3, :3] = Rotation.from_rotvec(vectors).as_matrix()
            poses = poses @ turned
    return poses
