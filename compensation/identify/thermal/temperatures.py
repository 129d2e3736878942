"""Group readings by temperature, and hold them out in turn to choose a thermal model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.folds import make_placement_folds
from armd.compensation.estimate.observations import Observations

#: Placements closer than this in temperature count as one temperature.
SAME_TEMPERATURE_K = 0.75
#: With many placements each may be close to the next while the first and last are far apart: a
#: larger span is not one temperature (docs/decisions/0024).
MOST_SPAN_K = 3.0
#: The sets in which placements of the lowest and of the highest temperature are held out. Few,
#: because each set costs a fit; more than two, because the readings that stay must represent the
#: temperature.
SETS_AT_AN_END = 3


@dataclass(frozen=True)
class HeldOutSet:
    """One set of readings to hold out, all of one temperature."""

    group: int  # number of the temperature, ascending
    rows: Mask  # (n,)
    stays: Mask  # (n,) readings at the same temperature that are not held out


def group_temperatures(observations: Observations) -> list[tuple[float, Mask]]:
    """Return the measured temperatures, ascending: mean in °C, and a mask of the readings (n,)."""
    used = observations.arm.used_sensors
    if not used:
        return []
    columns = [observations.arm.sensors.index(name) for name in used]
    row_c = observations.states.temperature_c[:, columns].mean(axis=1)
    counts = np.bincount(observations.placement, minlength=len(observations.placement_names))
    mean = np.bincount(observations.placement, row_c, len(counts)) / np.maximum(counts, 1)
    order = [p for p in np.argsort(mean) if counts[p]]
    chains: list[list[int]] = []
    for p in order:
        if chains and mean[p] - mean[chains[-1][-1]] < SAME_TEMPERATURE_K:
            chains[-1].append(int(p))
        else:
            chains.append([int(p)])
    groups = [group for chain in chains for group in _split_evenly(np.array(chain), mean)]
    if len(groups) == 1:
        groups = _split_in_halves(groups[0], mean)
    masks = [np.isin(observations.placement, group) for group in groups]
    return [(float(row_c[mask].mean()), mask) for mask in masks]


def _split_evenly(chain: I64, mean_c: F64) -> list[I64]:
    """Split placements, by ascending temperature, in the fewest equal spans of allowed size."""
    rise_k = mean_c[chain] - mean_c[chain[0]]
    if not rise_k[-1] > MOST_SPAN_K:  # also true for NaN
        return [chain]
    spans = int(np.ceil(rise_k[-1] / MOST_SPAN_K))
    span = np.minimum((rise_k / rise_k[-1] * spans).astype(np.int64), spans - 1)
    return [chain[span == k] for k in range(spans)]


def are_far_apart(groups: list[tuple[float, Mask]]) -> bool:
    """Return whether the temperatures are far enough apart to determine expansion."""
    return groups[-1][0] - groups[0][0] > MOST_SPAN_K


def _split_in_halves(chain: I64, mean_c: F64) -> list[I64]:
    """Split the only temperature in two, if it spans more than `SAME_TEMPERATURE_K`.

    There are no other temperatures that could show whether lengths expand.
    """
    rise_k = mean_c[chain] - mean_c[chain[0]]
    if not rise_k[-1] > SAME_TEMPERATURE_K:
        return [chain]
    warm = rise_k > rise_k[-1] / 2
    return [chain[~warm], chain[warm]]


def validate_by_temperature(
    observations: Observations, groups: list[tuple[float, Mask]]
) -> list[HeldOutSet]:
    """Return the held-out sets: each inner temperature as a whole, the outer two in parts.

    The daemon flags temperatures outside the measured range, so a model is not chosen by its
    extrapolation: part of the lowest and of the highest temperature always remains in the fit.
    These two must be tested as well. At the mean temperature, a link that expands evenly has the
    length that a fit without a thermal model gives. So a single temperature between the two hardly
    shows whether there is expansion.
    """
    sets = [
        HeldOutSet(g, rows, np.zeros(observations.n, dtype=bool))
        for g, (_, rows) in enumerate(groups[1:-1], 1)
    ]
    for g in (0, len(groups) - 1):
        rows = groups[g][1]
        for part in make_placement_folds(observations.rows(rows), SETS_AT_AN_END)[0]:
            out = np.zeros(observations.n, dtype=bool)
            out[np.flatnonzero(rows)[part]] = True
            sets.append(HeldOutSet(g, out, rows & ~out))
    return sets
