"""How the arm should stand for the next reading: as unlike all earlier ones as the target allows.

A reading in a posture that was there before tells little that is new. Where the target is known,
postures that reach it are solved for, and the one farthest from those measured is proposed; else
the joint that has moved least is named. Where `armd design` chose the posture, it is that one,
turned as little as it takes to reach the target.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armd.arrays import F64
from armd.compensation.design.reaching import solve_postures
from armd.compensation.model.arm import Arm

CANDIDATES = 96
MARGIN_RAD = np.radians(5.0)  # kept from the end stops


class Proposal(NamedTuple):
    q_rad: F64 | None  # (N,) as read; None: no posture is proposed
    why: str  # in words; "" where nothing need be said


def propose(arm: Arm, constants: F64, target_mm: F64 | None, measured: F64, seed: int) -> Proposal:
    """For the next reading, after those at *measured* angles (n, N) rad; *constants* are the
    calibration's parameter vector. The same *seed* gives the same proposal."""
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
    """The posture *designed_q* (N,) rad, turned to reach the target where that is known."""
    q = designed_q
    if target_mm is not None:
        reaching = _solve_reaching(arm, constants, target_mm, designed_q[None])
        q = reaching[0] if len(reaching) else designed_q
    return Proposal(q, _describe_beyond(arm, q, measured) if len(measured) else "")


def _describe_beyond(arm: Arm, q: F64, measured: F64) -> str:
    """The joint that leaves what was covered farthest is what a person should know; "" if none."""
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
    """Postures (m, N) within the limits whose tip is at the target."""
    low, high = arm.range_rad
    rng = np.random.default_rng(seed)
    q = rng.uniform(low + MARGIN_RAD, high - MARGIN_RAD, (CANDIDATES, arm.n_joints))
    return _solve_reaching(arm, constants, target_mm, q)


def _solve_reaching(arm: Arm, constants: F64, target_mm: F64, q: F64) -> F64:
    """Of postures *q* (m, N) those that can be turned to reach the target within the limits."""
    solved, reached = solve_postures(arm, constants, target_mm, q)
    solutions: F64 = solved[reached]
    return solutions
