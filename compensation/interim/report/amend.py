"""Amplitudes of the changes, and a calibration that contains them."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.interim.changes.change import (
    Change,
    compute_shapes,
    count_amplitudes,
    list_amplitude_sizes,
    list_change_columns,
)
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.extended_sums import ExtendedSums
from armd.compensation.interim.evidence.likelihood import estimate_known_errors
from armd.compensation.interim.evidence.stack import ALL_ALONG, RAMP_DAYS, Stack
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.slow_factors import DAY_S, After, Time
from armd.compensation.model.terms import Factor, Term

HOUR_S = 3600.0
#: Smaller terms are dropped; a share of the effect's largest term.
NEGLIGIBLE = 1e-9


@dataclass(frozen=True)
class Amplitudes:
    """Amplitudes of all changes together, in the columns' own units (growths: per 30 days)."""

    values: tuple[F64, ...]  # per change (1 + bends, p)
    covariance: F64  # of all of them, flattened in this order

    def slice_of(self, index: int) -> slice:
        start = sum(value.size for value in self.values[:index])
        return slice(start, start + self.values[index].size)


def fit(
    stacked: Stack,
    causes: Sequence[Cause],
    changes: Sequence[Change],
    bad: Sequence[int],
    sums: ExtendedSums | None = None,
) -> Amplitudes:
    """Fit the amplitudes of all named *changes* together, with the known errors as nuisances.

    The checks are those of *sums*, by default all that determine the changes
    (`list_telling_checks`). The shift of a cause is the difference between after and before. Its
    size before may be as large as that of any standing error, whatever the size of the others
    (decision 30).
    """
    moved_columns = sorted(
        {
            column
            for c in changes
            if c.cause is not None
            for column in _list_columns(stacked, c.cause)
        }
    )
    before = max(ALL_ALONG) if stacked.has_standing_errors else 0.0
    pairs = zip(stacked.columns, list_change_columns(stacked, changes), strict=True)
    extra = [
        np.concatenate([before * columns[:, moved_columns], new], axis=1) for columns, new in pairs
    ]
    q = stacked.error_columns[0].shape[1] + len(moved_columns)
    estimate = estimate_known_errors(
        (sums or ExtendedSums(stacked, list_telling_checks(stacked, changes, bad))).sum_with(extra)
    )
    sizes = _compute_sizes(causes, changes)
    # The sign is reversed: a residual is the position under the calibration minus that of the
    # target.
    values = -estimate.mean[q:] * sizes
    cov = estimate.scale * estimate.covariance[q:, q:] * np.outer(sizes, sizes)
    split, position = [], 0
    for change in changes:
        if change.cause is None:
            split.append(np.zeros((0, 0)))
            continue
        count = count_amplitudes(stacked, change)
        split.append(values[position : position + count].reshape(1 + len(change.bends_d), -1))
        position += count
    return Amplitudes(tuple(split), cov)


def list_telling_checks(stacked: Stack, changes: Sequence[Change], bad: Sequence[int]) -> list[int]:
    """List the good checks that determine *changes*.

    Checks from the first change without a cause on are excluded, because their deviations have no
    model.
    """
    until = min((change.first for change in changes if change.cause is None), default=stacked.n)
    return [i for i in range(until) if i not in bad]


def _list_columns(stacked: Stack, cause: int) -> range:
    return range(stacked.blocks[cause].start, stacked.blocks[cause].stop)


def _compute_sizes(causes: Sequence[Cause], changes: Sequence[Change]) -> F64:
    """Return the prior standard deviations of the changes' amplitudes, in the columns'
    own units.
    """
    sizes = []
    for change in changes:
        if change.cause is None:
            continue
        typical = np.array([c.prior_sd for c in causes[change.cause].candidate.columns])
        sizes.append((list_amplitude_sizes(change, len(typical)) * typical).ravel())
    return np.concatenate(sizes) if sizes else np.zeros(0)


def compute_final_size(stacked: Stack, change: Change, amplitudes: F64) -> F64:
    """Return the size (p,) of a change at the last check."""
    end: F64 = compute_shapes(stacked, change)[-1] @ amplitudes
    return end


def extend_calibration(
    calibration: Calibration,
    begun_unix_s: float,
    causes: Sequence[Cause],
    changes: Sequence[Change],
    instants_unix_s: Sequence[float],
    amplitudes: Amplitudes,
    until_unix_s: float,
    provenance: dict[str, object],
) -> Calibration:
    """Return the *calibration* with all named *changes*, each from its instant on.

    A growth continues until the last check, *until_unix_s*, and is constant afterwards. Terms with
    equal parameter and basis are joined into one.
    """
    terms = list(calibration.terms)
    rows: dict[str, F64] = {}  # by term: its derivatives by the amplitudes
    places: dict[str, int] = {}
    width = len(amplitudes.covariance)
    for index, (change, instant) in enumerate(zip(changes, instants_unix_s, strict=True)):
        if change.cause is None:
            continue
        candidate = causes[change.cause].candidate
        start = amplitudes.slice_of(index).start
        for b, factor in enumerate(_list_factors(change, instant, begun_unix_s, until_unix_s)):
            per = HOUR_S / (RAMP_DAYS * DAY_S) if change.gradual else 1.0
            for j, column in enumerate(candidate.columns):
                largest = max((abs(t.coefficient) for t in column.terms), default=0.0)
                for term in column.terms:
                    if abs(term.coefficient) <= NEGLIGIBLE * largest:
                        continue
                    new = Term(
                        parameter=term.parameter,
                        basis=[*term.basis, factor],
                        effect=f"{candidate.cause} {candidate.location}",
                    )
                    alike = new.model_dump_json(include={"parameter", "basis"})
                    if alike not in places:
                        places[alike] = len(terms)
                        terms.append(new)
                    name = f"term {places[alike]}"
                    row = rows.setdefault(name, np.zeros(width))
                    row[start + b * len(candidate.columns) + j] += term.coefficient * per
    matrix = np.array(list(rows.values())).reshape(len(rows), width)
    term_covariance = matrix @ amplitudes.covariance @ matrix.T
    mean = matrix @ np.concatenate([value.ravel() for value in amplitudes.values])[:width]
    for place, coefficient, variance in zip(
        places.values(), mean, np.diag(term_covariance), strict=True
    ):
        terms[place] = terms[place].model_copy(
            update={
                "coefficient": float(coefficient),
                "standard_uncertainty": float(np.sqrt(max(variance, 0.0))),
            }
        )
    before = np.array(calibration.covariance).reshape((len(calibration.covariance_of),) * 2)
    size = len(before) + len(term_covariance)
    covariance = np.zeros((size, size))
    covariance[: len(before), : len(before)] = before
    covariance[len(before) :, len(before) :] = (term_covariance + term_covariance.T) / 2
    created = datetime.datetime.fromtimestamp(until_unix_s, datetime.UTC)
    return calibration.model_copy(
        update={
            # The date of the last check, so that the same checks make the same file.
            "created": created.isoformat(timespec="seconds"),
            "terms": terms,
            "covariance_of": [*calibration.covariance_of, *rows],
            "covariance": covariance.tolist(),
            "provenance": {**calibration.provenance, "interim": provenance},
            "content_sha256": "",
        }
    )


def _list_factors(
    change: Change, instant: float, begun_unix_s: float, until_unix_s: float
) -> list[Factor]:
    if not change.gradual:
        return [After(instant_unix_s=instant)]
    begins = [begun_unix_s + start_d * DAY_S for start_d in (change.origin_d, *change.bends_d)]
    return [Time(since_unix_s=begin, until_unix_s=max(until_unix_s, begin)) for begin in begins]
