"""Converts the geometry that the factory stored in the arm into rows of arm.toml.

The maker's chain is the modified form: Tx(A)·Rx(α), then, at the third joint, Ry(β), then
Rz(θ)·Tz(D). Shifting A and α one row back gives armd's rows exactly; β is then in row 2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from armd.drivers.microscribe.wire import N_JOINTS

MM_PER_UNIT = 0.0254  # lengths are in thousandths of an inch
DEG_PER_UNIT = 180.0 / 32768
BALL_INCH = 0.242  # the maker adds this to D5 for the ball tip instead of the point


@dataclass(frozen=True)
class Row:
    """One row of arm.toml's geometry; θ0 is zero in all rows."""

    d_mm: float
    a_mm: float
    alpha_deg: float
    beta_deg: float


def compute_rows_and_tip(
    parameters: Sequence[int], beta: int = 0, ball: bool = False
) -> tuple[list[Row], tuple[float, float, float]]:
    """Compute the rows and the tip (x, y, z) mm.

    *parameters*: the reply to PARAMETERS (α, A, D of six frames); *beta*: BETA of the extended
    ones. The first frame's α and A displace the base and must be zero, as in all known arms; raises
    `ValueError` otherwise.
    """
    if len(parameters) != 3 * (N_JOINTS + 1):
        raise ValueError(f"{len(parameters)} parameters, not {3 * (N_JOINTS + 1)}")
    n = N_JOINTS + 1
    alpha, a, d = parameters[:n], parameters[n : 2 * n], parameters[2 * n :]
    if alpha[0] or a[0]:
        raise ValueError(f"a base displaced by alpha {alpha[0]} and A {a[0]}, not by 0")
    rows = [
        Row(
            d_mm=d[k] * MM_PER_UNIT,
            a_mm=a[k + 1] * MM_PER_UNIT,
            alpha_deg=alpha[k + 1] * DEG_PER_UNIT,
            beta_deg=beta * DEG_PER_UNIT if k == 1 else 0.0,
        )
        for k in range(N_JOINTS)
    ]
    return rows, (0.0, 0.0, d[-1] * MM_PER_UNIT + BALL_INCH * 25.4 * ball)
