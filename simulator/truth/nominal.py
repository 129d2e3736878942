"""The nominal demo arm: a portable measuring arm of six joints, 1.1 m of reach.

Vertical column, shoulder and elbow hinges with parallel axes (so that Hayati's β is needed at the
shoulder), then a wrist of roll, pitch and roll. Carbon tubes between aluminium joint housings.

Arms of 3 to 9 joints have the same parts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64

SERIAL_NUMBER = "SIM-0001"
REFERENCE_C = 20.0
COUNTS_PER_TURN = 1 << 23
TIP_MM = (45.0, 0.0, 110.0)
TIP_RADIUS_MM = 3.0


@dataclass(frozen=True)
class NominalJoint:
    """One row A = Rz(θ+θ0)·Tz(d)·Tx(a)·Rx(α)·Ry(β), its limits and the link after it."""

    theta_deg: float
    d_mm: float
    a_mm: float
    alpha_deg: float
    min_deg: float
    max_deg: float
    mass_kg: float
    centre_of_mass_mm: tuple[float, float, float]


JOINTS = (
    NominalJoint(0.0, 280.0, 0.0, 90.0, -180.0, 180.0, 2.4, (0.0, -120.0, 0.0)),
    NominalJoint(0.0, 130.0, 520.0, 0.0, -60.0, 130.0, 1.7, (-270.0, 0.0, -10.0)),
    NominalJoint(90.0, 0.0, 40.0, 90.0, -155.0, 5.0, 0.9, (-20.0, 0.0, 30.0)),
    NominalJoint(0.0, 460.0, 0.0, -90.0, -180.0, 180.0, 1.1, (0.0, 210.0, 0.0)),
    NominalJoint(0.0, 0.0, 0.0, 90.0, -115.0, 115.0, 0.5, (0.0, 0.0, 20.0)),
    NominalJoint(0.0, 120.0, 0.0, 0.0, -180.0, 180.0, 0.4, (15.0, 0.0, -20.0)),
)
#: Radius of the grating of every joint's disc, mm.
GRATING_RADIUS_MM = 25.0
#: Power of each joint's encoder and electronics, W.
SELF_HEATING_W = np.array([1.2, 0.9, 0.8, 0.6, 0.5, 0.6])


def list_parts(joints: int) -> list[int]:
    """List the `JOINTS` of an arm of 3 to 9 joints, base to wrist.

    Column, shoulder and elbow, then forearms of a roll and a pitch each, and a last roll if one
    joint remains.
    """
    return [0, 1, 2] + [3, 4] * ((joints - 3) // 2) + [5] * ((joints - 3) % 2)


def list_nominal_joints(joints: int = len(JOINTS)) -> list[NominalJoint]:
    return [JOINTS[part] for part in list_parts(joints)]


def list_sensor_names(joints: int = len(JOINTS)) -> list[str]:
    """List one sensor in each link, in the order of the wire's channels."""
    return [f"t{k}" for k in range(1, joints + 1)]


def get_limits_rad(joints: int = len(JOINTS)) -> tuple[F64, F64]:
    """Return lower and upper end stops (N,), rad."""
    low = np.radians([joint.min_deg for joint in list_nominal_joints(joints)])
    return low, np.radians([joint.max_deg for joint in list_nominal_joints(joints)])


def make_arm_toml(
    serial: str = SERIAL_NUMBER,
    rows: F64 | None = None,
    tip: F64 | None = None,
    joints: int = len(JOINTS),
) -> str:
    """Make the text of the `arm.toml` of an arm of so many *joints*.

    *rows* (N, 5: θ0, d, a, α, β in rad and mm) and *tip* (3,) replace the nominal values, for an
    arm with those of an earlier measurement.
    """
    if rows is None:
        rows = list_nominal_rows(joints)
    tip_mm = TIP_MM if tip is None else tuple(float(x) for x in tip)
    lines = [
        'schema = "armd.arm/1"',
        f'serial_number = "{serial}"',
        f"reference_temperature_c = {REFERENCE_C}",
        "",
    ]
    for name in list_sensor_names(joints):
        lines += ["[[temperature_sensor]]", f'name = "{name}"']
    for k, (joint, row) in enumerate(zip(list_nominal_joints(joints), rows, strict=True), 1):
        theta, d, a, alpha, beta = (float(x) for x in row)
        lines += [
            "",
            f"[[joint]]  # {k}",
            f"theta_deg = {math.degrees(theta):.8f}",
            f"d_mm = {d:.6f}",
            f"a_mm = {a:.6f}",
            f"alpha_deg = {math.degrees(alpha):.8f}",
            f"beta_deg = {math.degrees(beta):.8f}",
            f"counts_per_turn = {COUNTS_PER_TURN}",
            f"min_deg = {joint.min_deg}",
            f"max_deg = {joint.max_deg}",
            f'temperature = "t{k}"',
            f"mass_kg = {joint.mass_kg}",
            f"centre_of_mass_mm = {list(joint.centre_of_mass_mm)}",
        ]
    lines += [
        "",
        "[tip]",
        f"offset_mm = [{', '.join(f'{x:.6f}' for x in tip_mm)}]",
        f"radius_mm = {TIP_RADIUS_MM}",
    ]
    return "\n".join(lines) + "\n"


def list_nominal_rows(joints: int = len(JOINTS)) -> F64:
    """Return the nominal joint rows (N, 5): θ0, d, a, α, β in rad and mm."""
    return np.array(
        [
            (math.radians(j.theta_deg), j.d_mm, j.a_mm, math.radians(j.alpha_deg), 0.0)
            for j in list_nominal_joints(joints)
        ]
    )
