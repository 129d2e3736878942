"""A robot's URDF as rows of Denavit–Hartenberg parameters, joint by joint.

Axes at zero angles are lines in the base frame; each row follows from the common normal of two
neighbouring lines. The base's own pose is left out: a placement absorbs it.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation


def rows_and_tip(path: Path, tip_link: str) -> tuple[np.ndarray, np.ndarray]:
    """Rows (N, 4) of θ°, d mm, a mm, α°, and the tip (3,) mm in the last frame."""
    origins, axes, tip = _axes(path, tip_link)
    x = np.cross(axes[0], [0.0, 0.0, 1.0] if abs(axes[0][2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    origin = origins[0]
    rows = []
    for z, other, other_z in zip(axes[:-1], origins[1:], axes[1:], strict=True):
        normal, foot, other_foot = _common_normal(origin, z, other, other_z)
        theta = np.arctan2(np.cross(x, normal) @ z, x @ normal)
        alpha = np.arctan2(np.cross(z, other_z) @ normal, z @ other_z)
        d, a = (foot - origin) @ z, (other_foot - foot) @ normal
        rows.append([np.degrees(theta), d, a, np.degrees(alpha)])
        x, origin = normal, other_foot
    rows.append([0.0, 0.0, 0.0, 0.0])
    frame = np.column_stack([x, np.cross(axes[-1], x), axes[-1]])
    return np.array(rows), frame.T @ (tip - origin)


def _common_normal(
    p: np.ndarray, z: np.ndarray, other: np.ndarray, other_z: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Unit normal from the line p + s z to the other line, and its feet on both."""
    normal = np.cross(z, other_z)
    apart = other - p
    if np.linalg.norm(normal) < 1e-4:  # parallel: the normal through p
        across = apart - (apart @ z) * z
        normal = across / np.linalg.norm(across)
        return normal, p, p + across
    normal /= np.linalg.norm(normal)
    s, t, _ = np.linalg.solve(np.column_stack([z, -other_z, normal]), apart)
    foot, other_foot = p + s * z, other + t * other_z
    if (other_foot - foot) @ normal < -1e-9:
        normal = -normal
    return normal, foot, other_foot


def _axes(path: Path, tip_link: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points on the axes (N, 3) mm, their directions (N, 3), and the tip (3,) mm, at zero."""
    joints = {
        joint.find("child").get("link"): joint
        for joint in ElementTree.parse(path).getroot().iter("joint")
        if joint.find("child") is not None
    }
    chain = []
    link = tip_link
    while link in joints:
        chain.insert(0, joints[link])
        link = joints[link].find("parent").get("link")
    rotation, position = np.eye(3), np.zeros(3)
    origins, axes = [], []
    for joint in chain:
        origin = joint.find("origin")
        position = position + rotation @ (1e3 * _numbers(origin.get("xyz")))
        rotation = rotation @ Rotation.from_euler("xyz", _numbers(origin.get("rpy"))).as_matrix()
        if joint.get("type") == "revolute":
            origins.append(position)
            axes.append(rotation @ _numbers(joint.find("axis").get("xyz")))
    return np.array(origins), np.array(axes), position


def _numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.split()])
