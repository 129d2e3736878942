"""A robot's URDF as an arm.toml: rows of Denavit–Hartenberg parameters, joint by joint.

Axes at zero angles are lines in the base frame, which `axes` makes rows of. The base's own pose is
left out, for a placement absorbs it; what it does to the direction of gravity is not.
"""

from __future__ import annotations

import math
import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from scipy.spatial.transform import Rotation

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.daemon.catalogue.axes import across, rows_of_axes
from armd.daemon.catalogue.xml_tree import read_robot
from armd.errors import BadInput
from armd.files.schema import validate
from armd.terminal.suggest import few

TURNING = ("revolute", "continuous")
#: What an origin or an axis may say: whatever else stands there would be passed over in silence.
ORIGIN, AXIS = {"xyz", "rpy", "quat_xyzw"}, {"xyz"}
KEYS = ("theta_deg", "d_mm", "a_mm", "alpha_deg", "beta_deg")


@dataclass(frozen=True)
class Chain:
    """Of the base to a link, at zero angles, mm in the base frame."""

    origins: F64  # (N, 3) a point on each axis
    axes: F64  # (N, 3) directions
    tip: F64  # (3,)
    limits: list[tuple[float, float] | None]  # degrees
    name: str
    joints: list[str]  # names of those that turn
    links: tuple[str, str]  # names of the first and the last


def arm_toml(path: Path, tip_link: str | None = None) -> tuple[str, list[str]]:
    """The file's text, and what is said of it; raises `BadInput` for no chain of turning joints."""
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
    for row, limit in zip(rows.tolist(), chain.limits, strict=True):
        lines += ["", "[[joint]]"]
        values = dict(zip(KEYS, row, strict=True))
        lines += [
            f"{key} = {_text(value)}"
            for key, value in values.items()
            if key != "beta_deg" or abs(value) > 1e-12
        ]
        if limit is not None and limit[0] < limit[1]:
            low, high = limit
            lines += [f"min_deg = {_text(low)}", f"max_deg = {_text(high)}"]
    text = "\n".join([*lines, "", "[tip]", f"offset_mm = {_numbers_text(tip, 9)}", ""])
    validate(path, tomllib.loads(text), Arm)
    begin, end = chain.links
    said = [
        f"the chain from {begin} to {end}, joints {', '.join(chain.joints)}, as rows"
        " A = Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)",
        f"the tip at zero angles: {point_text(chain.tip)} mm in the frame of {begin}",
    ]
    return text, said


def point_text(point: F64) -> str:
    """`(805, 0, 1180)`, to a micrometre."""
    return "(" + ", ".join(f"{round(x, 3) + 0.0:.10g}" for x in point.tolist()) + ")"


def rows_and_tip(path: Path, tip_link: str) -> tuple[F64, F64]:
    """Rows (N, 5) of θ°, d mm, a mm, α°, β°, and the tip (3,) mm in the last frame."""
    rows, tip, _ = denavit_hartenberg(read_chain(path, tip_link))
    return rows, tip


def denavit_hartenberg(chain: Chain) -> tuple[F64, F64, F64]:
    """Rows (N, 5), the tip (3,) in the last frame, and the first frame's rotation (3, 3)."""
    z = chain.axes[0]
    x = across(z)
    rows, tip = rows_of_axes(chain.origins, chain.axes, chain.tip, x)
    return rows, tip, np.column_stack([x, np.cross(z, x), z])


def read_chain(path: Path, tip_link: str | None = None) -> Chain:
    """Raises `BadInput`."""
    root = read_robot(path)
    joints: dict[str, Element] = {}
    for joint in root.findall("joint"):  # of the robot: what stands deeper is a simulator's
        child, parent = joint.find("child"), joint.find("parent")
        if child is None or parent is None:
            continue
        link = child.get("link")
        if not link or not parent.get("link"):
            raise BadInput(path, _where(joint), "a parent or child without link", "two links")
        if link in joints:
            both = f"two joints, {joints[link].get('name')} and {joint.get('name')}"
            raise BadInput(path, f"link {link}", both, "one joint that moves it")
        joints[link] = joint
    link = tip_link or _last_link(path, joints)
    if link not in joints:
        raise BadInput(path, "the tip's link", repr(link), f"one of {few(joints)}")
    links: list[Element] = []
    end = link
    while link in joints:
        if joints[link] in links:
            raise BadInput(path, f"link {link}", "a loop", "a chain from the base")
        links.insert(0, joints[link])
        parent = joints[link].find("parent")
        link = "" if parent is None else parent.get("link", "")
    return _walk(path, links, root.get("name", ""), (link, end))


def _walk(path: Path, links: list[Element], name: str, ends: tuple[str, str]) -> Chain:
    rotation, position = np.eye(3), np.zeros(3)
    origins, axes, limits, names = [], [], [], []
    for joint in links:
        xyz, turn = _origin(path, joint)
        position = position + rotation @ (1e3 * xyz)
        rotation = rotation @ turn
        kind = joint.get("type")
        if kind in TURNING:
            _refuse_mimic(path, joint)
            origins.append(position)
            axes.append(rotation @ _axis(path, joint))
            limits.append(_limit(joint))
            names.append(joint.get("name", ""))
        elif kind != "fixed":
            raise BadInput(
                path, _where(joint), f"the type {kind!r}", "joints that turn, or are fixed"
            )
    if not 3 <= len(axes) <= 9:
        raise BadInput(path, "the chain", f"{len(axes)} turning joints", "3 to 9")
    return Chain(np.array(origins), np.array(axes), position, limits, name, names, ends)


def _where(joint: Element) -> str:
    return f"joint {joint.get('name')}"


def _origin(path: Path, joint: Element) -> tuple[F64, F64]:
    """Metres (3,) and the rotation matrix (3, 3)."""
    origin = _only(path, joint, "origin", ORIGIN)
    if origin is None:
        return np.zeros(3), np.eye(3)
    where = f"{_where(joint)}, origin"
    xyz = _numbers(path, where, origin.get("xyz", "0 0 0"), 3)
    if "quat_xyzw" not in origin.attrib:  # URDF 1.2 has either
        rpy = _numbers(path, where, origin.get("rpy", "0 0 0"), 3)
        return xyz, Rotation.from_euler("xyz", rpy).as_matrix()
    if "rpy" in origin.attrib:
        raise BadInput(path, where, "both rpy and quat_xyzw", "one of them")
    quaternion = _numbers(path, where, origin.attrib["quat_xyzw"], 4)
    if not np.linalg.norm(quaternion) > 1e-6:
        raise BadInput(path, where, f"quat_xyzw={origin.get('quat_xyzw')!r}", "a quaternion, not 0")
    return xyz, Rotation.from_quat(quaternion).as_matrix()


def _axis(path: Path, joint: Element) -> F64:
    """Unit vector (3,)."""
    axis = _only(path, joint, "axis", AXIS)
    where = f"{_where(joint)}, axis"
    text = "1 0 0" if axis is None else axis.get("xyz", "1 0 0")
    along = _numbers(path, where, text, 3)
    length = float(np.linalg.norm(along))
    if not length > 1e-6:
        raise BadInput(path, where, repr(text), "a direction, which is not zero")
    unit: F64 = along / length
    return unit


def _only(path: Path, joint: Element, tag: str, known: set[str]) -> Element | None:
    """The one element *tag* of a joint, or None; raises `BadInput` for what armd does not know."""
    there = joint.findall(tag)
    where = f"{_where(joint)}, {tag}"
    if len(there) > 1:
        raise BadInput(path, where, f"{len(there)} of it", "one")
    for element in there:
        strange = [*(key for key in element.attrib if key not in known), *(e.tag for e in element)]
        if strange:
            raise BadInput(path, where, few(strange), f"{' or '.join(sorted(known))} alone")
        return element
    return None


def _refuse_mimic(path: Path, joint: Element) -> None:
    mimic = joint.find("mimic")
    if mimic is not None:
        found = f"one that follows joint {mimic.get('joint')} (mimic)"
        expected = "joints with an encoder each: an arm that is coupled so has no rows"
        raise BadInput(path, _where(joint), found, expected)


def _last_link(path: Path, joints: dict[str, Element]) -> str:
    parents = {joint.find("parent").get("link") for joint in joints.values()}  # type: ignore[union-attr]
    ends = [link for link in joints if link not in parents]
    if len(ends) == 1:
        return ends[0]
    if not joints:
        raise BadInput(path, "the chain", "no joints", "a robot with joints")
    found = f"{len(ends)} ends: {few(ends)}" if ends else "no end"
    raise BadInput(path, "the chain", found, "--tip-link to say which link touches")


def _limit(joint: Element) -> tuple[float, float] | None:
    limit = joint.find("limit")
    if joint.get("type") == "continuous" or limit is None:
        return None
    try:
        low, high = (math.degrees(float(limit.get(side, "nan"))) for side in ("lower", "upper"))
    except ValueError:
        return None
    return (low, high) if low < high else None


def _numbers(path: Path, where: str, text: str, count: int) -> F64:
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        expected = {3: "three numbers", 4: "four numbers"}[count]
        raise BadInput(path, where, repr(text), expected)
    return numbers


def _text(value: float) -> str:
    return repr(round(value, 9) + 0.0)


def _numbers_text(values: F64, places: int) -> str:
    return "[" + ", ".join(repr(round(v, places) + 0.0) for v in values.tolist()) + "]"
