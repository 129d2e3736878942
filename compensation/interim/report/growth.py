"""The expansion of links that the calibration leaves unknown, estimated from all good checks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import chi2

from armd.arrays import F64
from armd.compensation.identify.thermal.terms import get_last_lever_mm
from armd.compensation.interim.changes.change import Change, list_change_columns
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.history import Check
from armd.compensation.interim.checks.open_growth import GROWTH, OpenGrowth, list_open_growth
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.evidence.extended_sums import ExtendedSums
from armd.compensation.interim.evidence.likelihood import KnownErrors, estimate_known_errors
from armd.compensation.interim.evidence.stack import Stack, join_checks
from armd.compensation.interim.report.amend import list_telling_checks
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration

#: The growth of all links together is reported if links without growth would look so in at most
#: this share of histories.
ALPHA = 1e-3
#: Half the width of a 95 % interval, in standard uncertainties.
SURE = 1.96


@dataclass(frozen=True)
class LinkGrowth:
    """The expansion of a link, 1/K."""

    location: str
    per_k: float
    standard_uncertainty: float

    @property
    def is_significant(self) -> bool:
        return abs(self.per_k) > SURE * self.standard_uncertainty


@dataclass(frozen=True)
class FittedGrowth:
    """The expansion of the links, from the good checks of an epoch."""

    links: tuple[LinkGrowth, ...]  # those whose interval excludes zero; all, if none does
    separable: bool  # whether any does
    heldout_um: tuple[float, float]  # RMS with checks held out in turn: without and with the growth
    made_within_k: float
    calibration: Calibration  # with the growth


def find_growth(
    checks: Sequence[Check], stacked: Stack, causes: Sequence[Cause], changes: Sequence[Change],
    bad: Sequence[int],
) -> FittedGrowth | None:  # fmt: skip
    """Find the growth of the links in addition to *changes*, from the checks that are not *bad*.

    Returns None where the calibration contains it, or the checks do not distinguish it from zero.
    """
    arm, calibration = checks[0].arm, checks[0].calibration.content
    growth = list_open_growth(arm, calibration)
    good = list_telling_checks(stacked, changes, bad)
    if not growth or not good:
        return None
    reduced = [check.reduced for check in checks]
    without = join_checks([_drop_growth(check) for check in reduced], causes)
    without = without.rescale(stacked.share / without.share)
    growth_columns = [check.error_columns[:, _is_growth(check)] for check in reduced]
    change_columns = list_change_columns(without, changes)
    estimate = _fit(without, growth_columns, change_columns, good)
    q = slice(without.error_columns[0].shape[1], without.error_columns[0].shape[1] + len(growth))
    covariance = estimate.scale * estimate.covariance[q, q]
    statistic = float(estimate.mean[q] @ np.linalg.solve(covariance, estimate.mean[q]))
    if statistic < chi2.isf(ALPHA, len(growth)):
        return None
    size = np.array([expansion.size for expansion in growth])
    # The sign is reversed: a residual is the position under the calibration minus that of the
    # target.
    values, spread = -estimate.mean[q] * size, covariance * np.outer(size, size)
    links = _sum_by_link(growth, values, spread, calibration, arm)
    significant = tuple(link for link in links if link.is_significant)
    rms_um = float(np.sqrt(np.mean([reduced[i].rms_um ** 2 for i in good])))
    ranges = calibration.temperature_range_c.values()
    return FittedGrowth(
        significant or links,
        bool(significant),
        (rms_um, rms_um * _compute_heldout_share(without, growth_columns, change_columns, good)),
        max(high - low for low, high in ranges),
        add_growth(calibration, growth, values, spread, [reduced[i] for i in good]),
    )


def _is_growth(reduced: Reduced) -> list[int]:
    return [i for i, name in enumerate(reduced.known_names) if name.startswith(GROWTH)]


def _drop_growth(reduced: Reduced) -> Reduced:
    columns = [i for i, name in enumerate(reduced.known_names) if not name.startswith(GROWTH)]
    names = tuple(reduced.known_names[i] for i in columns)
    return replace(reduced, error_columns=reduced.error_columns[:, columns], known_names=names)


def _fit(
    stacked: Stack, growth: Sequence[F64], changes: Sequence[F64], chosen: Sequence[int]
) -> KnownErrors:
    extra = [np.concatenate(pair, axis=1) for pair in zip(growth, changes, strict=True)]
    return estimate_known_errors(ExtendedSums(stacked, chosen).sum_with(extra))


def _compute_heldout_share(
    stacked: Stack, growth: Sequence[F64], changes: Sequence[F64], good: Sequence[int]
) -> float:
    """Return the held-out RMS with the growth, as a share of that without.

    The growth is estimated without each check in turn; residuals are whitened.
    """
    before, after = 0.0, 0.0
    start = stacked.error_columns[0].shape[1]
    for i in good:
        estimate = _fit(stacked, growth, changes, [j for j in good if j != i])
        mean_growth = estimate.mean[start : start + growth[i].shape[1]]
        before += float(stacked.residual[i] @ stacked.residual[i])
        after += float(np.sum((stacked.residual[i] - growth[i] @ mean_growth) ** 2))
    return float(np.sqrt(after / before)) if before else 1.0


def _sum_by_link(
    growth: Sequence[OpenGrowth], values: F64, spread: F64, calibration: Calibration, arm: Arm
) -> tuple[LinkGrowth, ...]:
    """Average the growth of each link's lengths, per mm, weighted by their squares.

    The last link and the stylus count as one link.
    """
    lengths: dict[int, list[int]] = {}
    lever = dict(zip(("tip_x", "tip_y", "tip_z"), map(float, get_last_lever_mm(arm)), strict=True))
    length_mm: dict[str, float] = {**calibration.constants, **lever}
    for i, expansion in enumerate(growth):
        stem, _, number = expansion.term.parameter.partition("_")
        lengths.setdefault(arm.n_joints if stem == "tip" else int(number), []).append(i)
    links = []
    for link, members in sorted(lengths.items()):
        mm = np.array([length_mm.get(growth[i].term.parameter, 0.0) for i in members])
        row = np.zeros(len(values))
        row[members] = mm / max(float(mm @ mm), 1e-12)
        deviation = float(np.sqrt(max(float(row @ spread @ row), 0.0)))
        links.append(LinkGrowth(f"link {link}", float(row @ values), deviation))
    return tuple(links)


def add_growth(
    calibration: Calibration,
    growth: Sequence[OpenGrowth],
    values: F64,
    spread: F64,
    checks: Sequence[Reduced],
) -> Calibration:
    """Return the *calibration* with growths of *values* (m,) mm per kelvin and covariance *spread*.

    The lengths at the calibration's own temperatures do not change. The temperature range is
    widened by that of *checks*.
    """
    constants, first = dict(calibration.constants), len(calibration.terms)
    names = list(calibration.covariance_of)
    terms = [
        expansion.term.model_copy(
            update={"coefficient": float(value), "standard_uncertainty": float(deviation),
                    "effect": "link_expansion"}
        )
        for expansion, value, deviation in zip(
            growth, values, np.sqrt(np.maximum(np.diag(spread), 0.0)), strict=True
        )
    ]  # fmt: skip
    before = np.array(calibration.covariance).reshape((len(names),) * 2)
    moves = np.zeros((len(names) + len(growth), len(growth)))
    for j, (expansion, value) in enumerate(zip(growth, values, strict=True)):
        parameter = expansion.term.parameter
        constants[parameter] = constants.get(parameter, 0.0) - float(value) * expansion.made_k
        moves[len(names) + j, j] = 1.0
        if parameter in names:
            moves[names.index(parameter), j] = -expansion.made_k
    covariance = moves @ spread @ moves.T
    covariance[: len(names), : len(names)] += before
    return calibration.model_copy(
        update={
            "constants": constants,
            "terms": [*calibration.terms, *terms],
            "temperature_range_c": _widen(calibration.temperature_range_c, checks),
            "covariance_of": [*names, *(f"term {first + j}" for j in range(len(growth)))],
            "covariance": ((covariance + covariance.T) / 2).tolist(),
            "content_sha256": "",
        }
    )


def _widen(
    ranges: dict[str, tuple[float, float]], checks: Sequence[Reduced]
) -> dict[str, tuple[float, float]]:
    widened = dict(ranges)
    for name, (low, high) in ranges.items():
        seen_c = [check.temperature_c[name] for check in checks if name in check.temperature_c]
        widened[name] = (min(low, *(a for a, _ in seen_c)) if seen_c else low,
                         max(high, *(b for _, b in seen_c)) if seen_c else high)  # fmt: skip
    return widened
