"""The average of a change over the scenarios in which it may have been.

If the checks cannot separate several causes, the likeliest one is wrong too often to correct for it
alone. Of all corrections the mean over the scenarios has the least expected square error (Bayes).
Its variance is the mean of each scenario's own plus the spread between them:

    m = Σ w·μ,   C = Σ w·(V + μ·μᵀ) − m·mᵀ

over the amplitudes of all scenarios side by side; amplitudes that a scenario lacks are zero in it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armd.compensation.interim.changes.change import Change, ChangeScenario, count_amplitudes
from armd.compensation.interim.changes.growth import FEW_BENDS
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.extended_sums import ExtendedSums
from armd.compensation.interim.evidence.stack import Stack
from armd.compensation.interim.report.amend import Amplitudes, fit, list_telling_checks

#: The most rows of a calibration file's covariance: a file of more than 100 000 values is refused
#: (`armd.files.schema`).
MOST_ROWS = 300


@dataclass(frozen=True)
class Averaged:
    """All alternatives of the changes, side by side."""

    changes: tuple[Change, ...]
    of_change: tuple[int, ...]  # index of the change that each may be, ascending
    shares: tuple[float, ...]
    amplitudes: Amplitudes  # of all of them; mean and covariance over the scenarios

    def count_until(self, index: int) -> int:
        """Count the alternatives that belong to the changes up to *index*."""
        return sum(number <= index for number in self.of_change)


def choose_affordable(
    scenarios: Sequence[ChangeScenario], causes: Sequence[Cause], rows: int
) -> list[ChangeScenario]:
    """Choose the likeliest of *scenarios* that fit into a calibration; their shares add up to 1.

    Its covariance has *rows* already, and as many free rows are reserved for later epochs. A growth
    of uncertain course over many months has a term for each bend of each cause. While not all
    scenarios fit, growths with many bends get half as many. If the likeliest scenario alone still
    has too many terms, all its growths lose their bends.
    """
    max_terms = (MOST_ROWS - rows) // 2
    ordered = sorted(scenarios, key=lambda scenario: -scenario[0])
    chosen, terms = _select_fitting(ordered, causes, max_terms)
    while (len(chosen) < len(ordered) or terms > max_terms) and any(
        _has_bend(changes) for _, changes in ordered
    ):
        ordered = [
            (share, tuple(c.coarser if len(c.bends_d) > FEW_BENDS else c for c in changes))
            for share, changes in ordered
        ]
        chosen, terms = _select_fitting(ordered, causes, max_terms)
    if terms > max_terms:
        chosen = [
            (share, tuple(replace(c, bends_d=()) for c in changes)) for share, changes in chosen
        ]
    total = sum(share for share, _ in chosen)
    return [(share / total, changes) for share, changes in chosen]


def _has_bend(changes: Sequence[Change]) -> bool:
    """Return whether a growth has so many bends that half of them may be enough."""
    return any(len(change.bends_d) > FEW_BENDS for change in changes)


def _select_fitting(
    ordered: Sequence[ChangeScenario], causes: Sequence[Cause], max_terms: int
) -> tuple[list[ChangeScenario], int]:
    """Select the first scenarios, one at least, that have at most *max_terms* terms together.

    Returns them and the number of their terms.
    """
    chosen: list[ChangeScenario] = []
    terms: set[tuple[object, ...]] = set()
    for share, changes in ordered:
        extended = terms.union(*(_list_terms(change, causes) for change in changes))
        if chosen and len(extended) > max_terms:
            break
        chosen.append((share, changes))
        terms = extended
    return chosen, len(terms)


def _list_terms(change: Change, causes: Sequence[Cause]) -> set[tuple[object, ...]]:
    """List the terms that a change adds to a calibration: those of its columns, from each instant
    on.
    """
    if change.cause is None:
        return set()
    since = (change.origin_d, *change.bends_d) if change.gradual else (change.first,)
    return {
        (change.gradual, begin, term.model_dump_json(include={"parameter", "basis"}))
        for column in causes[change.cause].candidate.columns
        for term in column.terms
        for begin in since
    }


def compute_average(
    stacked: Stack, causes: Sequence[Cause], scenarios: Sequence[ChangeScenario], bad: Sequence[int]
) -> Averaged:
    """Average the amplitudes over *scenarios*, whose shares add up to 1.

    Returns their mean and covariance. A change without a cause is the same in all scenarios.
    """
    distinct: dict[tuple[object, ...], tuple[int, Change]] = {}
    shares: dict[tuple[object, ...], float] = {}
    for share, changes in scenarios:
        for number, change in enumerate(changes):
            distinct.setdefault(_make_key(number, change), (number, change))
            shares[_make_key(number, change)] = shares.get(_make_key(number, change), 0.0) + share
    keys = sorted(distinct, key=lambda key: distinct[key][0])
    sizes = [count_amplitudes(stacked, distinct[key][1]) for key in keys]
    ends = np.cumsum(sizes)
    slots = {key: np.arange(end - n, end) for key, n, end in zip(keys, sizes, ends, strict=True)}
    width = int(ends[-1]) if len(ends) else 0
    mean, second = np.zeros(width), np.zeros((width, width))
    sums = ExtendedSums(stacked, list_telling_checks(stacked, scenarios[0][1], bad))
    for share, changes in scenarios:
        amplitudes = fit(stacked, causes, changes, bad, sums)
        used_slots = [slots[_make_key(number, change)] for number, change in enumerate(changes)]
        places = np.concatenate(used_slots) if used_slots else np.zeros(0, int)
        values = (
            np.concatenate([value.ravel() for value in amplitudes.values])
            if used_slots
            else np.zeros(0)
        )
        mean[places] += share * values
        second[np.ix_(places, places)] += share * (amplitudes.covariance + np.outer(values, values))
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


def _make_key(number: int, change: Change) -> tuple[object, ...]:
    """Make the key of a change; changes that differ in size only share their column."""
    return number, *change.key, change.origin_d if change.gradual else None, change.bends_d
