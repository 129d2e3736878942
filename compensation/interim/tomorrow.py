"""Which check to make tomorrow: poses on one seat that tell a change's cause from its likeliest
rival."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.adjustment import adjusted
from armd.compensation.interim.judge import Judgement, Told
from armd.compensation.interim.reach import moves, poses
from armd.compensation.interim.result import named
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import forward
from armd.compensation.model.state import States

F64 = npt.NDArray[np.float64]

#: How many poses a check has, of how many tried on a seat, and how many seats are tried.
POSES, TRIED, SEATS = 12, 60, 12
#: A cause this sure needs no check of its own.
SURE = 0.95
#: Steps of an arm's way to a seat, and how near is there, mm.
STEPS, THERE_MM = 25, 0.5
#: A difference between two causes of less than this share of the change itself cannot be told.
LEAST_TOLD = 0.05
LOWEST_MM = 0.0


@dataclass(frozen=True)
class Tomorrow:
    """The next check."""

    sentence: str
    seat_mm: F64 | None = None  # (3,) base frame
    tip_mm: F64 | None = None  # (n, 3)
    states: States | None = None

    def as_json(self) -> dict[str, Any]:
        """As the result has it."""
        found: dict[str, Any] = {"sentence": self.sentence, "seat_mm": None, "poses_deg": []}
        if self.states is not None and self.seat_mm is not None:
            found["seat_mm"] = [round(float(v), 1) for v in self.seat_mm]
            found["poses_deg"] = np.degrees(self.states.q).round(1).tolist()
        return found


def tomorrow(judgement: Judgement) -> Tomorrow:
    """The check that settles the most doubtful change of the latest epoch."""
    if not judgement.changed:
        return Tomorrow("the usual check, in other poses than today's")
    last = judgement.latest.checks[-1]
    doubtful = [t for t in judgement.latest.told if t.cause and t.change.probability < SURE]
    for told in sorted(doubtful, key=lambda t: t.change.probability):
        found = _telling(told, last.arm, last.calibration.content)
        if found is not None:
            return found
    return Tomorrow(
        "the usual check, with the mended calibration: it confirms that nothing else has changed"
    )


def _telling(told: Told, arm: Arm, calibration: Calibration) -> Tomorrow | None:
    """Poses on one seat that tell a change from its likeliest rival, if any do."""
    assert told.cause is not None
    for rival, _ in told.rivals:
        best: tuple[float, F64, States, F64] | None = None
        drawn = poses(arm, calibration.reference_temperature_c, 40 * SEATS, 21)
        tips, _ = moves(arm, calibration, drawn, told.cause.candidate)
        for seat in tips[tips[:, 2] > LOWEST_MM][:SEATS]:
            on_seat = _reaching(arm, calibration, seat, drawn)
            if on_seat is None:
                continue
            chosen, merit = _best(told, rival.candidate, arm, calibration, on_seat)
            if chosen is not None and (best is None or merit > best[0]):
                states = on_seat.rows(chosen)
                at, _ = moves(arm, calibration, states, told.cause.candidate)
                best = merit, seat, states, at
        if best is not None and best[0] > LEAST_TOLD:
            x, y, z = best[1]
            sentence = (
                f"to tell {named(told.cause)} from {named(rival)}: one seat at about "
                f"({x:.0f}, {y:.0f}, {z:.0f}) mm, these {POSES} poses"
            )
            return Tomorrow(sentence, best[1], best[3], best[2])
    return None


def _reaching(arm: Arm, calibration: Calibration, seat: F64, drawn: States) -> States | None:
    """Different poses with the tip on *seat* (3,), within the limits; None for too few."""
    constants = calibration.vector(arm.n_joints)
    parameters = np.tile(constants, (drawn.n, 1))
    q = drawn.q
    for _ in range(STEPS):
        q = adjusted(q, parameters, np.tile(seat, (drawn.n, 1)))
    states = States(q, drawn.rate, drawn.temperature_c, drawn.time_s, drawn.approach, drawn.series)
    near = np.linalg.norm(forward(q, parameters)[0] - seat, axis=1) < THERE_MM
    low, high = arm.limits_rad
    inside = ((q > low) & (q < high)).all(axis=1)
    good = np.flatnonzero(near & inside)[:TRIED]
    return states.rows(good) if len(good) >= 2 * POSES else None


def _best(
    told: Told, rival: Candidate, arm: Arm, calibration: Calibration, states: States
) -> tuple[npt.NDArray[np.int64] | None, float]:
    """The poses in which a change differs most from what its rival and the seat can do, and that
    difference as a share of the change itself."""
    assert told.cause is not None
    _, own = moves(arm, calibration, states, told.cause.candidate)
    _, other = moves(arm, calibration, states, rival)
    change = own @ told.values
    absorbed = np.concatenate([np.tile(np.eye(3), (states.n, 1, 1)), other], axis=2)
    if not np.any(change):
        return None, 0.0
    scale = np.maximum(np.sqrt((absorbed**2).sum(axis=(0, 1))), 1e-12)
    absorbed = absorbed / scale
    flat, columns = change.reshape(-1), absorbed.reshape(-1, absorbed.shape[2])
    apart = flat - columns @ np.linalg.lstsq(columns, flat, rcond=None)[0]
    order = np.argsort(-(apart.reshape(-1, 3) ** 2).sum(axis=1))
    chosen = np.sort(order[:POSES])
    some, with_seat = change[chosen].reshape(-1), absorbed[chosen].reshape(3 * POSES, -1)
    left = some - with_seat @ np.linalg.lstsq(with_seat, some, rcond=None)[0]
    return chosen, float(np.linalg.norm(left)) / max(float(np.linalg.norm(some)), 1e-300)
