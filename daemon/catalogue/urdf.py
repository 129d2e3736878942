"""A robot's URDF as an arm.toml: rows of Denavit–Hartenberg parameters, joint by joint.

Axes at zero angles are lines in the base frame; each row follows from the common normal of two
neighbouring lines. The base's own pose is left out, for a placement absorbs it; what it does to
the direction of gravity is not.
"""

from __future__ import annotations

import math
import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from armd.arrays import F64
from armd.errors import BadInput
from armd.files.inputs import read_input

#: Directions that differ by less than this are parallel: a URDF prints quarter turns to 4 digits.
PARALLEL = 1e-4
TURNING = ("revolute", "continuous")


@dataclass(frozen=True)
class Chain:
    """Of the base to a link, at zero angles, mm in the base frame."""

    origins: F64  # (N, 3) a point on each axis
    axes: F64  # (N, 3) directions
    tip: F64  # (3,)
    limits: list[tuple[float, float] | None]  # degrees
    name: str


def arm_toml(path: Path, tip_link: str | None = None) -> str:
    """The file's text; raises `BadInput` for what is no chain of turning joints."""
    chain = read_chain(path, tip_link)
    rows, tip, first = denavit_hartenberg(chain)
    serial = re.sub(r"[^!-~]|[*$?#/]", "-", chain.name)[:16] or "ARM-1"
    gravity = first.T @ np.array([0.0, 0.0, -1.0])
    lines = [
        f"# From {path.name}; its base frame stands elsewhere, which a placement takes up.",
        'schema = "armd.arm/1"',
        f'serial_number = "{serial}"',
        f"gravity = {_numbers_text(gravity / np.linalg.norm(gravity), 12)}",
    ]
    for (theta, d, a, alpha), limit in zip(rows.tolist(), chain.limits, strict=True):
        lines += ["", "[[joint]]"]
        values = {"theta_deg": theta, "d_mm": d, "a_mm": a, "alpha_deg": alpha}
        lines += [f"{key} = {_text(value)}" for key, value in values.items()]
        if limit is not None and limit[0] < limit[1]:
            low, high = limit
            lines += [f"min_deg = {_text(low)}", f"max_deg = {_text(high)}"]
    lines += ["", "[tip]", f"offset_mm = {_numbers_text(tip, 9)}", ""]
    return "\n".join(lines)


def rows_and_tip(path: Path, tip_link: str) -> tuple[F64, F64]:
    """Rows (N, 4) of θ°, d mm, a mm, α°, and the tip (3,) mm in the last frame."""
    rows, tip, _ = denavit_hartenberg(read_chain(path, tip_link))
    return rows, tip


def denavit_hartenberg(chain: Chain) -> tuple[F64, F64, F64]:
    """Rows (N, 4), the tip (3,) in the last frame, and the first frame's rotation (3, 3)."""
    axes, origin = chain.axes, chain.origins[0]
    x = np.cross(axes[0], [0.0, 0.0, 1.0] if abs(axes[0][2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    first = np.column_stack([x, np.cross(axes[0], x), axes[0]])
    rows = []
    for z, other, other_z in zip(axes[:-1], chain.origins[1:], axes[1:], strict=True):
        normal, foot, other_foot = _common_normal(origin, x, z, other, other_z)
        theta = np.arctan2(np.cross(x, normal) @ z, x @ normal)
        alpha = np.arctan2(np.cross(z, other_z) @ normal, z @ other_z)
        d, a = (foot - origin) @ z, (other_foot - foot) @ normal
        rows.append([np.degrees(theta), d, a, np.degrees(alpha)])
        x, origin = normal, other_foot
    rows.append([0.0, 0.0, 0.0, 0.0])
    frame = np.column_stack([x, np.cross(axes[-1], x), axes[-1]])
    return np.array(rows), frame.T @ (chain.tip - origin), first


def _common_normal(p: F64, x: F64, z: F64, other: F64, other_z: F64) -> tuple[F64, F64, F64]:
    """Unit normal from the line p + s z to the other line, and its feet on both."""
    normal = np.cross(z, other_z)
    apart = other - p
    if np.linalg.norm(normal) < PARALLEL:  # parallel: the normal through p
        across = apart - (apart @ z) * z
        length = float(np.linalg.norm(across))
        if length < 1e-9:  # one line twice: any normal is one
            return x, p, p
        return across / length, p, p + across
    normal /= np.linalg.norm(normal)
    s, t, _ = np.linalg.solve(np.column_stack([z, -other_z, normal]), apart)
    foot, other_foot = p + s * z, other + t * other_z
    if (other_foot - foot) @ normal < -1e-9:
        normal = -normal
    return normal, foot, other_foot


def read_chain(path: Path, tip_link: str | None = None) -> Chain:
    """Raises `BadInput`."""
    try:
        root = ElementTree.fromstring(read_input(path))
    except ElementTree.ParseError as error:
        raise BadInput(path, "the file", str(error), "a URDF (XML)") from error
    joints: dict[str, ElementTree.Element] = {}
    for joint in root.iter("joint"):
        child = joint.find("child")
        if child is not None and joint.find("parent") is not None:
            joints[child.get("link", "")] = joint
    link = tip_link or _last_link(path, joints)
    if link not in joints:
        raise BadInput(path, "the tip's link", repr(link), f"one of {', '.join(joints)}")
    links: list[ElementTree.Element] = []
    while link in joints:
        if joints[link] in links:
            raise BadInput(path, f"link {link}", "a loop", "a chain from the base")
        links.insert(0, joints[link])
        parent = joints[link].find("parent")
        link = "" if parent is None else parent.get("link", "")
    return _walk(path, links, root.get("name", ""))


def _walk(path: Path, links: list[ElementTree.Element], name: str) -> Chain:
    rotation, position = np.eye(3), np.zeros(3)
    origins, axes, limits = [], [], []
    for joint in links:
        origin = joint.find("origin")
        xyz, rpy = ("0 0 0", "0 0 0") if origin is None else (
            origin.get("xyz", "0 0 0"), origin.get("rpy", "0 0 0"),
        )  # fmt: skip
        position = position + rotation @ (1e3 * _three(path, joint, xyz))
        turn = Rotation.from_euler("xyz", _three(path, joint, rpy))
        rotation = rotation @ turn.as_matrix()
        kind = joint.get("type")
        if kind in TURNING:
            axis = joint.find("axis")
            along = _three(path, joint, "1 0 0" if axis is None else axis.get("xyz", "1 0 0"))
            origins.append(position)
            axes.append(rotation @ (along / np.linalg.norm(along)))
            limits.append(_limit(joint))
        elif kind != "fixed":
            where = f"joint {joint.get('name')}"
            raise BadInput(path, where, f"the type {kind!r}", "joints that turn, or are fixed")
    if not 3 <= len(axes) <= 9:
        raise BadInput(path, "the chain", f"{len(axes)} turning joints", "3 to 9")
    return Chain(np.array(origins), np.array(axes), position, limits, name)


def _last_link(path: Path, joints: dict[str, ElementTree.Element]) -> str:
    parents = {joint.find("parent").get("link") for joint in joints.values()}  # type: ignore[union-attr]
    ends = [link for link in joints if link not in parents]
    if len(ends) == 1:
        return ends[0]
    found = f"{len(ends)} ends: {', '.join(ends)}" if ends else "no joints"
    raise BadInput(path, "the chain", found, "--tip-link to say which link touches")


def _limit(joint: ElementTree.Element) -> tuple[float, float] | None:
    limit = joint.find("limit")
    if joint.get("type") == "continuous" or limit is None:
        return None
    try:
        low, high = (math.degrees(float(limit.get(side, "nan"))) for side in ("lower", "upper"))
    except ValueError:
        return None
    return (low, high) if low < high else None


def _three(path: Path, joint: ElementTree.Element, text: str) -> F64:
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        raise BadInput(path, f"joint {joint.get('name')}", repr(text), "three numbers")
    return numbers


def _text(value: float) -> str:
    return repr(round(value, 9) + 0.0)


def _numbers_text(values: F64, places: int) -> str:
    return "[" + ", ".join(repr(round(v, places) + 0.0) for v in values.tolist()) + "]"
