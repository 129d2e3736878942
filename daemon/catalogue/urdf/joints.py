"""Read a joint's elements in a URDF as numbers and check them: origin, axis, limit."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from armd.arrays import F64
from armd.daemon.catalogue.urdf.roll_pitch_yaw import (
    convert_quaternion_to_matrix,
    convert_rpy_to_matrix,
)
from armd.errors import BadInput
from armd.terminal.suggest import format_names

TURNING = ("revolute", "continuous")
#: Allowed attributes of an origin and an axis; any other is an error, because it would be ignored.
ORIGIN, AXIS = {"xyz", "rpy", "quat_xyzw"}, {"xyz"}


def describe_joint(joint: Element) -> str:
    return f"joint {joint.get('name')}"


def read_origin(path: Path, joint: Element) -> tuple[F64, F64]:
    """Return a joint's origin in metres (3,) and its rotation matrix (3, 3).

    Raises `BadInput`.
    """
    origin = _find_only(path, joint, "origin", ORIGIN)
    if origin is None:
        return np.zeros(3), np.eye(3)
    place = f"{describe_joint(joint)}, origin"
    xyz = _parse_numbers(path, place, origin.get("xyz", "0 0 0"), 3)
    if "quat_xyzw" not in origin.attrib:  # URDF 1.2 has either
        rpy = _parse_numbers(path, place, origin.get("rpy", "0 0 0"), 3)
        return xyz, convert_rpy_to_matrix(rpy)
    if "rpy" in origin.attrib:
        raise BadInput(path, place, "both rpy and quat_xyzw", "one of them")
    quaternion = _parse_numbers(path, place, origin.attrib["quat_xyzw"], 4)
    if not np.linalg.norm(quaternion) > 1e-6:
        raise BadInput(path, place, f"quat_xyzw={origin.get('quat_xyzw')!r}", "a quaternion, not 0")
    return xyz, convert_quaternion_to_matrix(quaternion)


def read_axis(path: Path, joint: Element) -> F64:
    """Return a joint's axis, a unit vector (3,); raises `BadInput`."""
    axis = _find_only(path, joint, "axis", AXIS)
    place = f"{describe_joint(joint)}, axis"
    text = "1 0 0" if axis is None else axis.get("xyz", "1 0 0")
    along = _parse_numbers(path, place, text, 3)
    length = float(np.linalg.norm(along))
    if not length > 1e-6:
        raise BadInput(path, place, repr(text), "a direction, which is not zero")
    unit: F64 = along / length
    return unit


def _find_only(path: Path, joint: Element, tag: str, attributes: set[str]) -> Element | None:
    """Return the only element *tag* of a joint, or None.

    Raises `BadInput` for attributes or elements that armd does not know.
    """
    elements = joint.findall(tag)
    place = f"{describe_joint(joint)}, {tag}"
    if len(elements) > 1:
        raise BadInput(path, place, f"{len(elements)} of it", "one")
    for element in elements:
        strange = [
            *(key for key in element.attrib if key not in attributes),
            *(e.tag for e in element),
        ]
        if strange:
            raise BadInput(
                path, place, format_names(strange), f"{' or '.join(sorted(attributes))} alone"
            )
        return element
    return None


def refuse_mimic(path: Path, joint: Element) -> None:
    mimic = joint.find("mimic")
    if mimic is not None:
        problem = f"one that follows joint {mimic.get('joint')} (mimic)"
        expected = "joints with an encoder each: an arm that is coupled so has no rows"
        raise BadInput(path, describe_joint(joint), problem, expected)


def read_limit(joint: Element) -> tuple[float, float] | None:
    limit = joint.find("limit")
    if joint.get("type") == "continuous" or limit is None:
        return None
    try:
        low, high = (math.degrees(float(limit.get(side, "nan"))) for side in ("lower", "upper"))
    except ValueError:
        return None
    return (low, high) if low < high else None


def _parse_numbers(path: Path, location: str, text: str, count: int) -> F64:
    try:
        numbers = np.array([float(word) for word in text.split()])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.shape != (count,) or not np.isfinite(numbers).all():
        expected = {3: "three numbers", 4: "four numbers"}[count]
        raise BadInput(path, location, repr(text), expected)
    return numbers
