"""The temperatures measured at, and what is left out of them in turn to choose a thermal model."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.folds import make_placement_folds
from armd.compensation.estimate.observations import Observations

#: Placements closer than this in temperature count as one temperature.
SAME_TEMPERATURE_K = 0.75
#: Of many placements each is close to the next, however far the last is from the first: what spans
#: more than this is no one temperature (docs/decisions/0024).
MOST_SPAN_K = 3.0
#: So many sets the lowest and the highest temperature's placements are left out in: few, as each
#: set costs a fit, and more than two, as what stays has to tell the temperature.
SETS_AT_AN_END = 3


@dataclass(frozen=True)
class LeftOut:
    """One set of readings to leave out, all of one temperature."""

    group: int  # of the temperatures, ascending
    rows: Mask  # (n,)
    stays: Mask  # (n,) readings at the same temperature that stay


def group_temperatures(observations: Observations) -> list[tuple[float, Mask]]:
    """Temperatures measured at, ascending: mean in °C, and its readings (n,)."""
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
    """Placements, by ascending temperature, in as few equal spans as are short enough."""
    rise_k = mean_c[chain] - mean_c[chain[0]]
    if not rise_k[-1] > MOST_SPAN_K:  # nor where it is unknown
        return [chain]
    spans = int(np.ceil(rise_k[-1] / MOST_SPAN_K))
    span = np.minimum((rise_k / rise_k[-1] * spans).astype(np.int64), spans - 1)
    return [chain[span == k] for k in range(spans)]


def are_far_apart(groups: list[tuple[float, Mask]]) -> bool:
    """Whether temperatures are surely as far apart as telling expansion takes."""
    return groups[-1][0] - groups[0][0] > MOST_SPAN_K


def _split_in_halves(chain: I64, mean_c: F64) -> list[I64]:
    """The only temperature as two, where it spans more than one may: there are no others that could
    tell whether lengths grow with it."""
    rise_k = mean_c[chain] - mean_c[chain[0]]
    if not rise_k[-1] > SAME_TEMPERATURE_K:
        return [chain]
    warm = rise_k > rise_k[-1] / 2
    return [chain[~warm], chain[warm]]


def validate_by_temperature(
    observations: Observations, groups: list[tuple[float, Mask]]
) -> list[LeftOut]:
    """Every temperature between the lowest and the highest as a whole, these two in parts.

    The daemon flags what lies beyond the temperatures measured at, so extrapolation is not what
    to choose by: something of the lowest and of the highest always stays. They must have a voice
    all the same. What expands evenly is as long at the mean temperature as a fit without any
    thermal model says: an only temperature between the two hardly tells whether there is one.
    """
    sets = [
        LeftOut(g, rows, np.zeros(observations.n, dtype=bool))
        for g, (_, rows) in enumerate(groups[1:-1], 1)
    ]
    for g in (0, len(groups) - 1):
        rows = groups[g][1]
        for part in make_placement_folds(observations.rows(rows), SETS_AT_AN_END)[0]:
            out = np.zeros(observations.n, dtype=bool)
            out[np.flatnonzero(rows)[part]] = True
            sets.append(LeftOut(g, out, rows & ~out))
    return sets
