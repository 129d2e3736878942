"""Readings far from where all others place them: the button pressed in the air, a seat missed.

Which they are is told, by row; what becomes of them is for whoever asks. They are told at poses
that they hardly move themselves, so several are told beside each other. A reading at another
target is one of them, too; `find_wrong_names` tells of which.
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

#: Readings that are listed.
MOST_TOLD = 6


@dataclass(frozen=True)
class FarOff:
    """m readings, the farthest first, and what half of all readings are within."""

    reading: I64  # (m,) by their place among those that were asked about
    off_mm: F64  # (m,)
    usual_mm: float

    def in_words(self, session: Session) -> list[str]:
        """A line for each, if not too many; they are rows of *session*."""
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
    """Which of readings are so many *times* farther off than the middle one; *off_mm* (n,) is NaN
    where it is not known."""
    rows = np.flatnonzero(np.isfinite(off_mm))
    if not len(rows):
        return FarOff(rows, np.empty(0), LEAST_MM)
    of_mm = off_mm[rows]
    far_rows = rows[find_monstrous(of_mm[:, None], times)]
    farthest = far_rows[np.argsort(-off_mm[far_rows], kind="stable")]
    return FarOff(farthest, off_mm[farthest], max(float(np.median(of_mm)), LEAST_MM))


def list_without_temperature(session: Session, usable: Mask) -> list[str]:
    """Which readings take no part because they lack a temperature; *usable* (n,): those that do."""
    rows = np.flatnonzero(~usable)
    if not len(rows):
        return []
    named = ", ".join(session.row_in_words(i) for i in rows[:MOST_TOLD])
    ellipsis = ", …" if len(rows) > MOST_TOLD else ""
    without = "without a temperature that the calibration needs"
    return [f"{format_count(len(rows), 'reading')} {without}, not counted: {named}{ellipsis}"]


def measure_distances_mm(observations: Observations, position_mm: F64) -> F64:
    """(n,) how far the tip at *position_mm* (n, 3), base frame, lies from each reading's target.

    NaN without a position, for a row that stands there a second time, and for the only reading at
    a seat, which says itself where that is.
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
