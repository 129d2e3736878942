"""Propose the arm's posture for the next reading, as different as possible from earlier ones.

A reading in a posture that was used before adds little information. Where the target is known,
postures that reach it are solved for, and the one farthest from the measured ones is proposed. Else
the joint that has moved least is named. A posture that `armd design` chose is used, turned as
little as necessary to reach the target.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armd.arrays import F64
from armd.compensation.design.reaching import solve_postures
from armd.compensation.model.arm import Arm

CANDIDATES = 96
MARGIN_RAD = np.radians(5.0)  # distance from the end stops


class Proposal(NamedTuple):
    q_rad: F64 | None  # (N,) joint angles as read; None: no posture is proposed
    why: str  # in words; may be ""


def propose(arm: Arm, constants: F64, target_mm: F64 | None, measured: F64, seed: int) -> Proposal:
    """Propose the next posture after those at *measured* angles (n, N) rad.

    *constants* are the calibration's parameter vector. Equal seeds give equal proposals.
    """
    if len(measured) == 0:
        return Proposal(None, "")
    low, high = arm.range_rad
    k = int(np.argmin(np.ptp(measured, axis=0) / (high - low)))
    share = float(np.ptp(measured, axis=0)[k] / (high - low)[k])
    why = f"joint {k + 1} has turned over {100 * share:.0f} % of its range so far"
    if target_mm is None:
        return Proposal(None, f"{why}: turn it farther")
    reaching = _find_reaching(arm, constants, target_mm, seed)
    if len(reaching) == 0:
        return Proposal(None, f"{why}: turn it farther")
    gap = np.linalg.norm((reaching[:, None, :] - measured) / (high - low), axis=2).min(axis=1)
    q = reaching[int(np.argmax(gap))]
    beyond = _describe_beyond(arm, q, measured)
    return Proposal(q, beyond or "a posture between those measured, as unlike each as there is")


def choose_designed(
    arm: Arm, constants: F64, target_mm: F64 | None, designed_q: F64, measured: F64
) -> Proposal:
    """Return the posture *designed_q* (N,) rad, turned to reach the target if that is known."""
    q = designed_q
    if target_mm is not None:
        reaching = _solve_reaching(arm, constants, target_mm, designed_q[None])
        q = reaching[0] if len(reaching) else designed_q
    return Proposal(q, _describe_beyond(arm, q, measured) if len(measured) else "")


def _describe_beyond(arm: Arm, q: F64, measured: F64) -> str:
    """Describe the joint that goes farthest beyond its covered range; "" if none does."""
    low, high = arm.range_rad
    beyond = np.maximum(measured.min(axis=0) - q, q - measured.max(axis=0))
    j = int(np.argmax(beyond / (high - low)))
    if beyond[j] <= 0:
        return ""
    lowest, highest = np.degrees([measured[:, j].min(), measured[:, j].max()])
    return (
        f"joint {j + 1} to about {np.degrees(q[j]):+.0f}°: so far {lowest:+.0f}° to {highest:+.0f}°"
    )


def _find_reaching(arm: Arm, constants: F64, target_mm: F64, seed: int) -> F64:
    """Return postures (m, N) within the limits whose tip is at the target."""
    low, high = arm.range_rad
    rng = np.random.default_rng(seed)
    q = rng.uniform(low + MARGIN_RAD, high - MARGIN_RAD, (CANDIDATES, arm.n_joints))
    return _solve_reaching(arm, constants, target_mm, q)


def _solve_reaching(arm: Arm, constants: F64, target_mm: F64, q: F64) -> F64:
    """Solve postures *q* (m, N) for the target; return those that reach it within limits."""
    solved, reached = solve_postures(arm, constants, target_mm, q)
    solutions: F64 = solved[reached]
    return solutions
