"""The calibrated arm as a URDF: links are cylinders, joints turn as in `joint_states`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any
from xml.etree import ElementTree as Xml

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import compute_frames
from armd.daemon.catalogue.urdf.roll_pitch_yaw import convert_matrix_to_rpy
from armd.files.schema import load_json_data, validate
from armd.terminal.counted import format_count
from armd.terminal.suggest import format_names

RADIUS_M = 0.02  # of a cylinder, about that of an arm's tube
SHORTEST_M = 1e-3  # of a link that is drawn
#: URDF requires these two; a joint without end stops is continuous.
TURNING = {"effort": "0", "velocity": "10"}


def write(info: Mapping[str, Any], calibration: str | None, namespace: str, frame: str) -> str:
    """Return the XML of the arm that its `info` and *calibration* file describe.

    The root link is *frame*. Raises `BadInput` if the data describe no arm.
    """
    arm = validate("the daemon's info", info["arm"], Arm)
    parameters = arm.nominal()
    if calibration is not None:
        parameters = _content(calibration).vector(arm.n_joints)
    return write_geometry(arm, parameters, namespace.replace("/", "_"), frame)


def _content(calibration: str) -> Calibration:
    """Parse the daemon's active calibration; raises `BadInput` for an invalid answer."""
    source = "the daemon's calibration"
    return validate(source, load_json_data(source, calibration.encode()), Calibration)


def write_geometry(arm: Arm, parameters: F64, prefix: str, frame: str) -> str:
    """Return the XML of the arm with these parameters (P,).

    The links' names begin with *prefix*; the root link is *frame*.
    """
    robot = Xml.Element("robot", name=prefix)
    origins, rotations = (
        part[0] for part in compute_frames(np.zeros((1, arm.n_joints)), parameters)
    )
    tip = parameters[arm.layout.tip]
    # A joint's row is Rz(q) followed by constants: joint k is at the end of row k−1.
    steps = [(rotations[0], origins[0])] + [
        (
            rotations[k].T @ rotations[k + 1],
            rotations[k].T @ (origins[k + 1] - origins[k]),
        )
        for k in range(arm.n_joints)
    ]
    _link(robot, frame, steps[0][1])
    parent = frame
    for k in range(1, arm.n_joints + 1):
        link = f"{prefix}_link_{k}"
        joint = arm.joint[k - 1]
        limits = None
        if joint.min_deg is not None and joint.max_deg is not None:
            limits = math.radians(joint.min_deg), math.radians(joint.max_deg)
        _joint(robot, f"joint_{k}", parent, link, steps[k - 1], limits)
        _link(robot, link, steps[k][1])
        parent = link
    _fixed(robot, f"{prefix}_wrist", parent, steps[-1])
    _link(robot, f"{prefix}_wrist", tip)
    _fixed(robot, f"{prefix}_ball", f"{prefix}_wrist", (np.eye(3), tip))
    _ball(robot, f"{prefix}_ball", arm.tip.radius_mm)
    Xml.indent(robot)
    return Xml.tostring(robot, encoding="unicode", xml_declaration=True) + "\n"


def describe_omissions(calibration: str | None) -> str:
    """Describe in a sentence the terms of *calibration* that a URDF cannot hold.

    The sentence is empty if there are none. A term changes a parameter with the arm's state: its
    temperature, posture or time.
    """
    if calibration is None:
        return ""
    terms = _content(calibration).terms
    if not terms:
        return ""
    names = dict.fromkeys(term.effect or f"of {term.parameter}" for term in terms)
    return (
        f"without {format_count(len(terms), 'term')} of the calibration ({format_names(names)}),"
        " for which a URDF has no place: its tip is where the constants alone put it, not the"
        " corrected one"
    )


def _joint(
    robot: Xml.Element,
    name: str,
    parent: str,
    child: str,
    step: tuple[F64, F64],
    limits: tuple[float, float] | None,
) -> None:
    kind = "continuous" if limits is None else "revolute"
    element = _placed(robot, name, kind, parent, child, step)
    Xml.SubElement(element, "axis", xyz="0 0 1")
    if limits is not None:
        low, high = (f"{value:.9g}" for value in limits)
        Xml.SubElement(element, "limit", {"lower": low, "upper": high, **TURNING})


def _fixed(robot: Xml.Element, child: str, parent: str, step: tuple[F64, F64]) -> None:
    _placed(robot, f"{child}_fixed", "fixed", parent, child, step)


def _placed(
    robot: Xml.Element, name: str, kind: str, parent: str, child: str, step: tuple[F64, F64]
) -> Xml.Element:
    joint = Xml.SubElement(robot, "joint", name=name, type=kind)
    rotation, offset_mm = step
    Xml.SubElement(joint, "parent", link=parent)
    Xml.SubElement(joint, "child", link=child)
    Xml.SubElement(
        joint, "origin", xyz=_words(offset_mm * 1e-3), rpy=_words(convert_matrix_to_rpy(rotation))
    )
    return joint


def _link(robot: Xml.Element, name: str, to_mm: F64) -> None:
    """Add a link with a cylinder from its origin to the next link's origin."""
    link = Xml.SubElement(robot, "link", name=name)
    to_m = to_mm * 1e-3
    length = float(np.linalg.norm(to_m))
    if length < SHORTEST_M:
        return
    x, y, z = to_m / length
    tilt = np.array([0.0, math.acos(max(-1.0, min(1.0, z))), math.atan2(y, x)])
    visual = Xml.SubElement(link, "visual")
    Xml.SubElement(visual, "origin", xyz=_words(to_m / 2), rpy=_words(tilt))
    geometry = Xml.SubElement(visual, "geometry")
    Xml.SubElement(geometry, "cylinder", radius=f"{RADIUS_M:g}", length=f"{length:.9g}")


def _ball(robot: Xml.Element, name: str, radius_mm: float) -> None:
    link = Xml.SubElement(robot, "link", name=name)
    if radius_mm > 0:
        geometry = Xml.SubElement(Xml.SubElement(link, "visual"), "geometry")
        Xml.SubElement(geometry, "sphere", radius=f"{radius_mm * 1e-3:.9g}")


def _words(values: F64) -> str:
    """Format numbers with all their digits: rounding to twelve moves a tip by 4e-9 mm."""
    return " ".join(repr(value + 0.0) for value in values.tolist())
