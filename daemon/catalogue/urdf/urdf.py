"""Convert a robot's URDF to an arm.toml: Denavit–Hartenberg rows, joint by joint.

Axes at zero angles are lines in the base frame; `axes` converts them to rows. The base's own pose
is dropped, because a placement absorbs it, but its effect on the direction of gravity is kept.
"""

from __future__ import annotations

import re
import tomllib
from dataclasses import dataclass
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.parameters import MOST_JOINTS
from armd.daemon.catalogue.axes import choose_across, convert_axes_to_rows, format_point
from armd.daemon.catalogue.urdf.joints import (
    TURNING,
    describe_joint,
    read_axis,
    read_limit,
    read_origin,
    refuse_mimic,
)
from armd.daemon.catalogue.urdf.xml_tree import read_robot
from armd.errors import BadInput
from armd.files.schema import validate
from armd.terminal.suggest import format_names

KEYS = ("theta_deg", "d_mm", "a_mm", "alpha_deg", "beta_deg")


@dataclass(frozen=True)
class Chain:
    """The chain from the base to a link, at zero angles, mm in the base frame."""

    origins: F64  # (N, 3) a point on each axis
    axes: F64  # (N, 3) directions
    tip: F64  # (3,)
    limits: list[tuple[float, float] | None]  # degrees
    name: str
    joints: list[str]  # names of those that turn
    links: tuple[str, str]  # names of the first and the last


def write_arm_toml(path: Path, tip_link: str | None = None) -> tuple[str, list[str]]:
    """Return the text of arm.toml, and remarks.

    Raises `BadInput` if the file has no chain of turning joints.
    """
    chain = read_chain(path, tip_link)
    rows, tip, first = compute_denavit_hartenberg(chain)
    serial = re.sub(r"[^!-~]|[*$?#/]", "-", chain.name)[:16] or "ARM-1"
    gravity = first.T @ np.array([0.0, 0.0, -1.0])
    lines = [
        f"# From {path.name}; its base frame stands elsewhere, which a placement takes up.",
        'schema = "armd.arm/1"',
        f'serial_number = "{serial}"',
        f"gravity = {_format_numbers(gravity / np.linalg.norm(gravity), 12)}",
    ]
    for row, limit in zip(rows.tolist(), chain.limits, strict=True):
        lines += ["", "[[joint]]"]
        values = dict(zip(KEYS, row, strict=True))
        lines += [
            f"{key} = {_format_text(value)}"
            for key, value in values.items()
            if key != "beta_deg" or abs(value) > 1e-12
        ]
        if limit is not None and limit[0] < limit[1]:
            low, high = limit
            lines += [f"min_deg = {_format_text(low)}", f"max_deg = {_format_text(high)}"]
    text = "\n".join([*lines, "", "[tip]", f"offset_mm = {_format_numbers(tip, 9)}", ""])
    validate(path, tomllib.loads(text), Arm)
    begin, end = chain.links
    remarks = [
        f"the chain from {begin} to {end}, joints {', '.join(chain.joints)}, as rows"
        " A = Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)",
        f"the tip at zero angles: {format_point(chain.tip)} mm in the frame of {begin}",
    ]
    return text, remarks


def compute_denavit_hartenberg(chain: Chain) -> tuple[F64, F64, F64]:
    """Return rows (N, 5) of θ°, d mm, a mm, α°, β°, and tip and first frame.

    The tip (3,) mm is in the last frame; the first frame is its rotation (3, 3).
    """
    z = chain.axes[0]
    x = choose_across(z)
    rows, tip = convert_axes_to_rows(chain.origins, chain.axes, chain.tip, x)
    return rows, tip, np.column_stack([x, np.cross(z, x), z])


def read_chain(path: Path, tip_link: str | None = None, base_link: str | None = None) -> Chain:
    """Read the chain from the base link to the tip's; raises `BadInput`."""
    root = read_robot(path)
    joints, ends = list_joints_between(path, root, base_link, tip_link)
    return follow_joints(path, joints, root.get("name", ""), ends)


def list_joints_between(
    path: Path, root: Element, base_link: str | None, tip_link: str | None
) -> tuple[list[Element], tuple[str, str]]:
    """Return the joints from the base link to the tip's, and the names of both links.

    The joints are in their order. Without *base_link* the chain begins at the root, without
    *tip_link* it ends at the only end. Raises `BadInput`.
    """
    joints: dict[str, Element] = {}
    for joint in root.findall("joint"):  # deeper ones are a simulator's
        child, parent = joint.find("child"), joint.find("parent")
        if child is None or parent is None:
            continue
        link = child.get("link")
        if not link or not parent.get("link"):
            raise BadInput(
                path, describe_joint(joint), "a parent or child without link", "two links"
            )
        if link in joints:
            problem = f"two joints, {joints[link].get('name')} and {joint.get('name')}"
            raise BadInput(path, f"link {link}", problem, "one joint that moves it")
        joints[link] = joint
    link = tip_link or _find_last_link(path, joints)
    if link not in joints:
        raise BadInput(path, "the tip's link", repr(link), f"one of {format_names(joints)}")
    links: list[Element] = []
    end = link
    while link in joints and link != base_link:
        if joints[link] in links:
            raise BadInput(path, f"link {link}", "a loop", "a chain from the base")
        links.insert(0, joints[link])
        parent = joints[link].find("parent")
        link = "" if parent is None else parent.get("link", "")
    if base_link not in (None, link):
        above = [joint.find("parent").get("link", "") for joint in links]  # type: ignore[union-attr]
        expected = f"a link above {end}: one of {format_names(above)}"
        raise BadInput(path, "the base link", repr(base_link), expected)
    return links, (link, end)


def follow_joints(path: Path, links: list[Element], name: str, ends: tuple[str, str]) -> Chain:
    """Compute axes and tip of these joints at zero angles.

    They are in the frame of the first joint's parent. Raises `BadInput`.
    """
    rotation, position = np.eye(3), np.zeros(3)
    origins, axes, limits, names = [], [], [], []
    for joint in links:
        xyz, turn = read_origin(path, joint)
        position = position + rotation @ (1e3 * xyz)
        rotation = rotation @ turn
        kind = joint.get("type")
        if kind in TURNING:
            refuse_mimic(path, joint)
            origins.append(position)
            axes.append(rotation @ read_axis(path, joint))
            limits.append(read_limit(joint))
            names.append(joint.get("name", ""))
        elif kind != "fixed":
            raise BadInput(
                path, describe_joint(joint), f"the type {kind!r}", "joints that turn, or are fixed"
            )
    if not 3 <= len(axes) <= MOST_JOINTS:
        problem = f"{len(axes)} turning joints"
        raise BadInput(path, "the chain", problem, f"3 to {MOST_JOINTS}")
    return Chain(np.array(origins), np.array(axes), position, limits, name, names, ends)


def _find_last_link(path: Path, joints: dict[str, Element]) -> str:
    parents = {joint.find("parent").get("link") for joint in joints.values()}  # type: ignore[union-attr]
    ends = [link for link in joints if link not in parents]
    if len(ends) == 1:
        return ends[0]
    if not joints:
        raise BadInput(path, "the chain", "no joints", "a robot with joints")
    problem = f"{len(ends)} ends: {format_names(ends)}" if ends else "no end"
    raise BadInput(path, "the chain", problem, "--tip-link to say which link touches")


def _format_text(value: float) -> str:
    return repr(round(value, 9) + 0.0)


def _format_numbers(values: F64, places: int) -> str:
    return "[" + ", ".join(repr(round(v, places) + 0.0) for v in values.tolist()) + "]"
