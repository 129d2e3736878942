"""Waves of a joint's angle error over angles: teeth and rollers, finer than the bins.

They are taken over each joint's angle, and over the sum and the difference of two neighbours'
angles: a wheel between two joints turns by either (`effects/mechanical/gear_mesh.py`).
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
    """The waves over all joints' angles."""

    variables: tuple[str, ...]
    single: F64  # (V, WAVES, 3, n) by variable and order: constant, cosine and sine

    def strengths(self, score: Score, joint: str, misfit: Misfit) -> dict[str, float]:
        """Score the variables for a component along the motion of a *joint*, such as "q2".

        The score of its angle with a neighbour's belongs to the one that explains more by itself.
        """
        if not self.variables:
            return {}
        shapes = self.single.reshape(-1, *self.single.shape[2:])
        scores = score_shapes(*score.sum_along(shapes), misfit, WAVES)
        best = scores.reshape(len(self.variables), WAVES).max(axis=1)
        single_strengths = dict(zip(self.variables, best.tolist(), strict=True))
        strengths = dict(single_strengths)
        pairs = [names for names in self._list_pairs() if joint in names]
        for names in pairs:
            name = max(names, key=lambda name: single_strengths[name])
            waves = [self.single[self.variables.index(name)] for name in names]
            searched = 2 * WAVES * len(pairs)
            pair_strength = score_shapes(*score.sum_along(_combine(*waves)), misfit, searched).max()
            strengths[name] = max(strengths[name], float(pair_strength))
        return strengths

    def _list_pairs(self) -> list[tuple[str, str]]:
        """List the pairs of variables of neighbouring joints."""
        neighbours = ((name, f"q{int(name[1:]) + 1}") for name in self.variables)
        return [names for names in neighbours if names[1] in self.variables]


def make_waves(bins: Sequence[Bins], rests: int) -> Waves:
    """Make waves over those of *bins* that are joints' angles; *rests*: number of points."""
    angles = [angle for angle in bins if angle.kind == "angle"]
    single = np.zeros((len(angles), WAVES, 3, rests))
    orders = np.arange(1, WAVES + 1)[:, None]
    for waves, angle in zip(single, angles, strict=True):
        if angle.values is not None:
            phase = orders * np.radians(angle.values)
            waves[:, 0, angle.order] = 1.0
            waves[:, 1, angle.order], waves[:, 2, angle.order] = np.cos(phase), np.sin(phase)
    return Waves(tuple(angle.variable for angle in angles), single)


def _combine(first: F64, second: F64) -> F64:
    """Return waves (2 WAVES, 3, n) of the sum, then of the difference, of two angles.

    *first* and *second* (WAVES, 3, n) are the waves of each.
    """
    flat, cosines, sines = np.moveaxis(first * second, 1, 0)
    mixed, mixed_back = first[:, 2] * second[:, 1], first[:, 1] * second[:, 2]
    of_sum = [flat, cosines - sines, mixed + mixed_back]
    of_difference = [flat, cosines + sines, mixed - mixed_back]
    return np.concatenate([np.stack(waves, axis=1) for waves in (of_sum, of_difference)])
