"""How the arm should stand for the next reading: as unlike all earlier ones as the target allows.

A reading in a posture that was there before tells little that is new. Where the target is known,
postures that reach it are solved for, and the one farthest from those measured is proposed; else
the joint that has moved least is named.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import jacobian

F64 = npt.NDArray[np.float64]

CANDIDATES = 96
ITERATIONS = 25
#: A candidate counts when its tip comes this near; the person finds the target by hand.
REACHED_MM = 0.5
#: Longest step of a joint while a candidate is solved for, and the damping of short ones.
STEP_RAD, DAMPING_MM = 0.4, 3.0
MARGIN_RAD = np.radians(5.0)  # kept from the end stops


class Posture(NamedTuple):
    q_rad: F64 | None  # (N,) as read; None: no posture is proposed
    why: str  # in words; "" where nothing need be said


def propose(arm: Arm, constants: F64, target_mm: F64 | None, measured: F64, seed: int) -> Posture:
    """For the next reading, after those at *measured* angles (n, N) rad; *constants* are the
    calibration's parameter vector. The same *seed* gives the same proposal."""
    if len(measured) == 0:
        return Posture(None, "")
    low, high = _limits(arm)
    k = int(np.argmin(np.ptp(measured, axis=0) / (high - low)))
    share = float(np.ptp(measured, axis=0)[k] / (high - low)[k])
    why = f"joint {k + 1} has turned over {100 * share:.0f} % of its range so far"
    if target_mm is None:
        return Posture(None, f"{why}: turn it farther")
    reaching = _reaching(arm, constants, target_mm, seed)
    if len(reaching) == 0:
        return Posture(None, f"{why}: turn it farther")
    gap = np.linalg.norm((reaching[:, None, :] - measured) / (high - low), axis=2).min(axis=1)
    q = reaching[int(np.argmax(gap))]
    # The joint that leaves what was covered farthest is what a person should know.
    beyond = np.maximum(measured.min(axis=0) - q, q - measured.max(axis=0))
    j = int(np.argmax(beyond / (high - low)))
    if beyond[j] > 0:
        least, most = np.degrees([measured[:, j].min(), measured[:, j].max()])
        why = f"joint {j + 1} to about {np.degrees(q[j]):+.0f}°"
        why += f": so far {least:+.0f}° to {most:+.0f}°"
    else:
        why = "a posture between those measured, as unlike each of them as there is"
    return Posture(q, why)


def _reaching(arm: Arm, constants: F64, target_mm: F64, seed: int) -> F64:
    """Postures (m, N) within the limits whose tip is at the target (damped least squares)."""
    low, high = _limits(arm)
    rng = np.random.default_rng(seed)
    q = rng.uniform(low + MARGIN_RAD, high - MARGIN_RAD, (CANDIDATES, arm.n_joints))
    for _ in range(ITERATIONS):
        tip, derivatives = jacobian(q, constants)
        columns = derivatives[:, :, 0 : 5 * arm.n_joints : 5]
        way = (target_mm - tip)[:, :, None]
        squared = columns @ columns.transpose(0, 2, 1) + DAMPING_MM**2 * np.eye(3)
        step = (columns.transpose(0, 2, 1) @ np.linalg.solve(squared, way))[:, :, 0]
        q += np.clip(step, -STEP_RAD, STEP_RAD)
    missed = np.linalg.norm(jacobian(q, constants)[0] - target_mm, axis=1)
    inside = ((q >= low) & (q <= high)).all(axis=1)
    reached: F64 = q[inside & (missed < REACHED_MM)]
    return reached


def _limits(arm: Arm) -> tuple[F64, F64]:
    low = [-180.0 if joint.min_deg is None else joint.min_deg for joint in arm.joint]
    high = [180.0 if joint.max_deg is None else joint.max_deg for joint in arm.joint]
    return np.radians(low), np.radians(high)
