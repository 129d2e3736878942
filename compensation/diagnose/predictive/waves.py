"""Waves of a joint's angle error over angles: teeth and rollers, which bins of degrees smear.

Of each joint's angle, and of the sum and the difference of two neighbours' angles: a wheel that
runs between two joints turns by either (`effects/mechanical/gear_mesh.py`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import WAVES
from armd.compensation.diagnose.predictive.bins import Bins
from armd.compensation.diagnose.predictive.scores import Score
from armd.compensation.diagnose.predictive.strength import Misfit, score_shapes


@dataclass(frozen=True)
class Waves:
    """Of all joints' angles."""

    variables: tuple[str, ...]
    single: F64  # (WAVES a variable, 3, n): flat, cosine and sine of each order
    pairs: dict[tuple[str, str], F64]  # (2 WAVES, 3, n) of the sum and of the difference

    def strengths(self, score: Score, joint: str, misfit: Misfit) -> dict[str, float]:
        """Of the variables, for a component along a *joint*'s motion, as "q2"; of its angle with a
        neighbour's, for the one that explains more by itself."""
        single = score_shapes(*score.sum_along(self.single), misfit, WAVES)
        best = single.reshape(len(self.variables), -1).max(axis=1)
        strengths = dict(zip(self.variables, best.tolist(), strict=True))
        single_strengths = dict(strengths)
        pairs = [names for names in self.pairs if joint in names]
        for names in pairs:
            name = max(names, key=lambda name: single_strengths[name])
            searched = 2 * WAVES * len(pairs)
            pair_strength = score_shapes(
                *score.sum_along(self.pairs[names]), misfit, searched
            ).max()
            strengths[name] = max(strengths[name], float(pair_strength))
        return strengths


def make_waves(bins: Sequence[Bins], rests: int) -> Waves:
    """Over those of *bins* that are joints' angles, each of all points."""
    angles = [angle for angle in bins if angle.kind == "angle"]
    turns = {angle.variable: np.full(rests, np.nan) for angle in angles}
    for angle in angles:
        if angle.values is not None:
            turns[angle.variable][angle.order] = np.radians(angle.values)
    single = [_make_waves(turn) for turn in turns.values()]
    pairs = {
        (a, b): np.concatenate([_make_waves(turns[a] + turns[b]), _make_waves(turns[a] - turns[b])])
        for a, b in ((f"q{k}", f"q{k + 1}") for k in range(1, len(turns)))
        if a in turns and b in turns
    }
    return Waves(tuple(turns), np.concatenate([np.empty((0, 3, rests)), *single]), pairs)


def _make_waves(turn: F64) -> F64:
    phase = np.arange(1, WAVES + 1)[:, None] * turn
    waves = np.stack([np.ones_like(phase), np.cos(phase), np.sin(phase)], axis=1)
    waves[:, :, np.isnan(turn)] = 0.0
    return waves
