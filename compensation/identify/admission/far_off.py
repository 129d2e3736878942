"""Find readings far from where all others place them: the button pressed in the air, a seat missed.

The result lists their rows; the caller decides what becomes of them. The poses are fitted robustly,
so far readings hardly move them and several can be found at once. A reading at another target is
also found here; `find_wrong_names` finds out at which one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.data.sessions.session import Session
from armd.compensation.estimate.noise.robust import LEAST_MM, SUSPECT, find_monstrous
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.placements.fit_poses import fit_robust_poses
from armd.terminal.counted import format_count

#: The most readings that are listed.
MOST_TOLD = 6


@dataclass(frozen=True)
class FarOff:
    """The readings far off, the farthest first, and the median distance of all readings."""

    reading: I64  # (m,) index among the readings that were examined
    off_mm: F64  # (m,)
    usual_mm: float

    def in_words(self, session: Session) -> list[str]:
        """Return a line for each reading, MOST_TOLD at most; the readings are rows of *session*."""
        lines = []
        for i, off_mm in zip(self.reading[:MOST_TOLD], self.off_mm, strict=False):
            target = session.artefact.target_names[session.target[i]]
            placement = session.placement_names[session.placement[i]]
            lines.append(
                f"{session.row_in_words(i)}, {target} in {placement}: {off_mm:.3g} mm off,"
                f" {off_mm / self.usual_mm:.3g} times what half of the readings are within"
                f" ({1e3 * self.usual_mm:.3g} µm)"
            )
        if len(self.reading) > MOST_TOLD:
            remainder = format_count(len(self.reading) - MOST_TOLD, "reading")
            lines.append(f"{session.name}: {remainder} more so far off")
        return lines


def find_far_readings(off_mm: F64, times: float = SUSPECT) -> FarOff:
    """Find readings more than *times* the median distance off.

    *off_mm* (n,) is NaN where a distance is not known.
    """
    rows = np.flatnonzero(np.isfinite(off_mm))
    if not len(rows):
        return FarOff(rows, np.empty(0), LEAST_MM)
    of_mm = off_mm[rows]
    far_rows = rows[find_monstrous(of_mm[:, None], times)]
    farthest = far_rows[np.argsort(-off_mm[far_rows], kind="stable")]
    return FarOff(farthest, off_mm[farthest], max(float(np.median(of_mm)), LEAST_MM))


def list_without_temperature(session: Session, usable: Mask) -> list[str]:
    """Return a line about readings that are skipped for lack of a temperature, or none.

    *usable* (n,) marks the readings that are used.
    """
    rows = np.flatnonzero(~usable)
    if not len(rows):
        return []
    named = ", ".join(session.row_in_words(i) for i in rows[:MOST_TOLD])
    ellipsis = ", …" if len(rows) > MOST_TOLD else ""
    without = "without a temperature that the calibration needs"
    return [f"{format_count(len(rows), 'reading')} {without}, not counted: {named}{ellipsis}"]


def measure_distances_mm(observations: Observations, position_mm: F64) -> F64:
    """Measure how far the tip lies from each reading's target, (n,) mm.

    *position_mm* (n, 3), base frame, is the tip's position. The distance is NaN without a position,
    for a duplicate row, and for the only reading at an uncertified seat, because it alone places
    the seat.
    """
    distance = np.full(observations.n, np.nan)
    usable = np.isfinite(position_mm).all(axis=1)
    rows = np.column_stack([observations.states.q, observations.target, observations.placement])
    again = np.ones(observations.n, dtype=bool)
    again[np.unique(rows, axis=0, return_index=True)[1]] = False
    usable &= ~again
    count = np.bincount(observations.target[usable], minlength=len(observations.unknown))
    is_single = observations.unknown & (count < 2)
    is_judged = usable & (observations.has_truth | ~is_single[observations.target])
    if is_judged.any():
        distance[is_judged] = fit_robust_poses(
            observations.rows(is_judged), position_mm[is_judged]
        )[1]
    return distance
