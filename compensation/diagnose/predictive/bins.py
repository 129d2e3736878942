"""The bins of a variable over which residuals are summed, each with rests of similar values."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass, replace
from typing import Literal

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import (
    AXES,
    INSEPARABLE,
    LEAST_BIN_RESTS,
    LEAST_BINS,
    MOST_BINS,
    WIDEST_DEG,
)
from armd.compensation.diagnose.problem.linear import Rests

_SIGNS = np.array([*itertools.product((1.0, 0.0, -1.0), repeat=AXES)])
_FULL = np.isin(np.abs(_SIGNS).sum(axis=1), (1, AXES))
#: (14, 3) unit vectors along the axes and into the octants.
DIRECTIONS: F64 = _SIGNS[_FULL] / np.linalg.norm(_SIGNS[_FULL], axis=1, keepdims=True)
VariableKind = Literal["angle", "rate", "temperature", "time", "name"]


@dataclass(frozen=True)
class Bins:
    """The rests of each bin of a variable, and each bin's middle."""

    variable: str  # a column's name
    title: str  # label of a plot's axis
    order: I64  # (k,) rests, bin by bin; those whose value is missing are in none
    starts: I64  # (B,) where each bin begins in `order`
    middle: F64  # (B,) mean value, in the axis' unit
    labels: tuple[str, ...] = ()  # (B,) names, where the variable has names instead of values
    _: KW_ONLY
    values: F64 | None = None  # (k,) of the rests in `order`, in the axis' unit
    kind: VariableKind = "name"
    alike: tuple[str, ...] = ()  # variables that these readings cannot separate from it


def make_bins(rests: Rests) -> list[Bins]:
    """Make bins of every variable that was recorded and varies, over the rests that are points."""
    every = [bins for bins in _iterate_bins(rests) if len(bins.starts) >= LEAST_BINS]
    return [replace(bins, alike=_find_inseparable(bins, every)) for bins in every]


def _find_inseparable(bins: Bins, every: list[Bins]) -> tuple[str, ...]:
    """List the temperatures, and the time, that these readings cannot separate from *bins*.

    A straight line over either leaves less than a tenth of the other's variance (Marquardt,
    Technometrics 12, 1970: a variance inflated tenfold).
    """
    return tuple(
        other_bins.variable
        for other_bins in every
        if other_bins is not bins and bins.values is not None and other_bins.values is not None
        if {bins.kind, other_bins.kind} <= {"temperature", "time"}
        if _shared_variance(bins, other_bins) > INSEPARABLE
    )


def _shared_variance(bins: Bins, other_bins: Bins) -> float:
    """Return the squared correlation over the rests at which both are known."""
    assert bins.values is not None and other_bins.values is not None
    common, i, j = np.intersect1d(bins.order, other_bins.order, return_indices=True)
    if not len(common):
        return 0.0
    first = bins.values[i] - bins.values[i].mean()
    second = other_bins.values[j] - other_bins.values[j].mean()
    squares = float(first @ first) * float(second @ second)
    return float(first @ second) ** 2 / squares if squares > 0.0 else 0.0


def _iterate_bins(rests: Rests) -> Iterator[Bins]:
    observations = rests.points  # they precede the orientations
    states, arm = observations.states, observations.arm
    for k in range(arm.n_joints):
        degrees = np.degrees(states.q[:, k])
        yield _bin_by_value(f"q{k + 1}", f"joint {k + 1}, °", degrees, "angle", WIDEST_DEG)
    for k in range(arm.n_joints):
        yield _bin_by_value(f"w{k + 1}", f"rate of joint {k + 1}, rad/s", states.rate[:, k], "rate")
    for s, name in enumerate(arm.sensors):
        yield _bin_by_value(name, f"{name}, °C", states.temperature_c[:, s], "temperature")
    reference = [s.artefact.reference_temperature_c for s in rests.sessions]
    artefact_c = rests.artefact_rise_c[: observations.n] + np.array(reference)[observations.session]
    read = np.array([np.isfinite(s.artefact_c).any() for s in rests.sessions])
    known_c = np.where(read[observations.session], artefact_c, np.nan)
    yield _bin_by_value("artefact_c", "artefact, °C", known_c, "temperature")
    hours = (states.time_s - np.nanmin(states.time_s, initial=np.inf)) / 3600.0
    yield _bin_by_value("time_s", "time since the first reading, h", hours, "time")
    yield _bin_by_name("placement", observations.placement, observations.placement_names)
    labels = list(dict.fromkeys(rests.target_label))
    place = np.array([labels.index(label) for label in rests.target_label])
    yield _bin_by_name("target", place[observations.target], labels)
    yield _bin_by_approach(states.approach)


def _bin_by_value(
    variable: str, title: str, values: F64, kind: VariableKind, widest: float = np.inf
) -> Bins:
    """Make bins of nearly equal count: ties stay together, no bin is wider than *widest*."""
    order = np.flatnonzero(np.isfinite(values))
    order = order[np.argsort(values[order], kind="stable")]
    ascending = values[order]
    count = max(LEAST_BIN_RESTS, -(-len(order) // MOST_BINS))
    starts: list[int] = []
    for i, value in enumerate(ascending):
        full = not starts or i - starts[-1] >= count
        wide = bool(starts) and value - ascending[starts[-1]] > widest
        tied = bool(starts) and value == ascending[i - 1]
        if (full and not tied) or wide:
            starts.append(i)
    if len(starts) > 1 and np.isinf(widest) and len(order) - starts[-1] < count // 2:
        starts.pop()  # the last but one takes its rests, too
    bin_starts = np.array(starts, dtype=np.int64)
    if not len(bin_starts):
        return Bins(variable, title, order, bin_starts, np.zeros(0))
    counts = np.diff(np.append(bin_starts, len(order)))
    middle = np.add.reduceat(ascending, bin_starts) / counts
    return Bins(variable, title, order, bin_starts, middle, values=ascending, kind=kind)


def _bin_by_name(variable: str, number: I64, names: list[str]) -> Bins:
    order = np.argsort(number, kind="stable")
    sorted_ = number[order]
    starts = np.flatnonzero(np.diff(sorted_, prepend=-1))
    labels = tuple(str(names[i]) for i in sorted_[starts])
    middle = np.arange(len(starts), dtype=float)
    return Bins(variable, variable, order, starts, middle, labels)


def _bin_by_approach(approach: F64) -> Bins:
    """Make bins by the nearest of fourteen directions of the base frame: its axes and octants."""
    rests = np.flatnonzero(np.isfinite(approach).all(axis=1))
    nearest = np.argmax(approach[rests] @ DIRECTIONS.T, axis=1)
    bins = _bin_by_name(
        "approach", nearest, [_describe_direction(direction) for direction in DIRECTIONS]
    )
    return replace(bins, title="direction of approach", order=rests[bins.order])


def _describe_direction(direction: F64) -> str:
    """Describe a direction, as in "+x −z"."""
    parts = zip(direction, "xyz", strict=True)
    return " ".join(f"{'+' if part > 0 else '−'}{axis}" for part, axis in parts if part)
