"""What has changed, averaged over the ways in which it may have been.

Of several causes that the checks cannot tell apart the likeliest is wrong too often to correct by
it alone. Of all corrections the mean over what is possible has the least expected square error
(Bayes), and its variance is the mean of each way's own plus the spread between them:

    m = Σ w·μ,   C = Σ w·(V + μ·μᵀ) − m·mᵀ

over the amplitudes of all ways side by side, those that a way does not have being zero in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armd.compensation.interim.changes.change import Change, Way, count_amplitudes
from armd.compensation.interim.changes.growth import FEW_BENDS
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.beside import Beside
from armd.compensation.interim.evidence.stack import Stack
from armd.compensation.interim.report.amend import Amplitudes, fit, telling_checks

#: A calibration file has a covariance of so many rows at most: a file of more than 100 000 values
#: is refused (`armd.files.schema`).
MOST_ROWS = 300


@dataclass(frozen=True)
class Averaged:
    """Everything that changes may have been, side by side."""

    changes: tuple[Change, ...]
    of_change: tuple[int, ...]  # which change in order of onset each may have been, ascending
    shares: tuple[float, ...]
    amplitudes: Amplitudes  # of all of them; mean and covariance over the ways

    def until(self, index: int) -> int:
        """How many of them belong to the changes up to *index*."""
        return sum(number <= index for number in self.of_change)


def affordable(ways: Sequence[Way], causes: Sequence[Cause], rows: int) -> list[Way]:
    """The likeliest of *ways* that a calibration whose covariance has so many *rows* can hold,
    beside as many again in the epochs to come; their shares add up to 1.

    A growth of unsure course in doubtful months has a term for each bend of each cause. While not
    all ways have room, growths of many bends get half as many. If the likeliest way alone still has
    too many, its growths go straight.
    """
    most = (MOST_ROWS - rows) // 2
    ordered = sorted(ways, key=lambda one: -one[0])
    kept, terms = _fitting(ordered, causes, most)
    while (len(kept) < len(ordered) or terms > most) and any(_bends(way) for _, way in ordered):
        ordered = [
            (share, tuple(c.coarser if len(c.bends_d) > FEW_BENDS else c for c in way))
            for share, way in ordered
        ]
        kept, terms = _fitting(ordered, causes, most)
    if terms > most:
        kept = [(share, tuple(replace(c, bends_d=()) for c in way)) for share, way in kept]
    total = sum(share for share, _ in kept)
    return [(share / total, way) for share, way in kept]


def _bends(way: Sequence[Change]) -> bool:
    """Whether a growth has so many bends that half of them may be enough."""
    return any(len(change.bends_d) > FEW_BENDS for change in way)


def _fitting(ordered: Sequence[Way], causes: Sequence[Cause], most: int) -> tuple[list[Way], int]:
    """The first ways that together have no more than *most* terms, one at least, and how many they
    have."""
    kept: list[Way] = []
    terms: set[tuple[object, ...]] = set()
    for share, way in ordered:
        more = terms.union(*(_terms(change, causes) for change in way))
        if kept and len(more) > most:
            break
        kept.append((share, way))
        terms = more
    return kept, len(terms)


def _terms(change: Change, causes: Sequence[Cause]) -> set[tuple[object, ...]]:
    """What a calibration has of a change: terms of its columns, each since every instant."""
    if change.cause is None:
        return set()
    since = (change.origin_d, *change.bends_d) if change.gradual else (change.first,)
    return {
        (change.gradual, at, term.model_dump_json(include={"parameter", "basis"}))
        for column in causes[change.cause].candidate.columns
        for term in column.terms
        for at in since
    }


def averaged(
    of: Stack, causes: Sequence[Cause], ways: Sequence[Way], bad: Sequence[int]
) -> Averaged:
    """Mean and covariance of the amplitudes over *ways*, whose shares add up to 1; a change of no
    cause is the same in all."""
    distinct: dict[tuple[object, ...], tuple[int, Change]] = {}
    shares: dict[tuple[object, ...], float] = {}
    for share, way in ways:
        for number, change in enumerate(way):
            distinct.setdefault(_key(number, change), (number, change))
            shares[_key(number, change)] = shares.get(_key(number, change), 0.0) + share
    keys = sorted(distinct, key=lambda key: distinct[key][0])
    sizes = [count_amplitudes(of, distinct[key][1]) for key in keys]
    ends = np.cumsum(sizes)
    slots = {key: np.arange(end - n, end) for key, n, end in zip(keys, sizes, ends, strict=True)}
    width = int(ends[-1]) if len(ends) else 0
    mean, second = np.zeros(width), np.zeros((width, width))
    told_by = Beside(of, telling_checks(of, ways[0][1], bad))
    for share, way in ways:
        own = fit(of, causes, way, bad, told_by)
        at = [slots[_key(number, change)] for number, change in enumerate(way)]
        places = np.concatenate(at) if at else np.zeros(0, int)
        values = np.concatenate([value.ravel() for value in own.values]) if at else np.zeros(0)
        mean[places] += share * values
        second[np.ix_(places, places)] += share * (own.covariance + np.outer(values, values))
    split = tuple(
        mean[slots[key]].reshape(1 + len(distinct[key][1].bends_d), -1)
        if len(slots[key])
        else np.zeros((0, 0))
        for key in keys
    )
    return Averaged(
        tuple(distinct[key][1] for key in keys),
        tuple(distinct[key][0] for key in keys),
        tuple(shares[key] for key in keys),
        Amplitudes(split, second - np.outer(mean, mean)),
    )


def _key(number: int, change: Change) -> tuple[object, ...]:
    """The same change by another size is the same column."""
    return number, *change.key, change.origin_d if change.gradual else None, change.bends_d
