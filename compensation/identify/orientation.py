"""Compute what the orientations of a measured body add to readings of its position."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from armd.compensation.estimate.gauge import describe_unidentifiable
from armd.compensation.estimate.observations import TURN_MM
from armd.compensation.identify.fit import Identification
from armd.terminal.counted import format_count


@dataclass(frozen=True)
class OrientationGain:
    """A fit with orientations compared with the same fit without them."""

    readings: int
    standard_deviation_rad: float  # of one orientation, per axis
    rank: int
    rank_without: int
    added: tuple[str, ...]  # combinations that only the orientations determine
    uncertainty_ratio: float  # with over without, geometric mean over all known directions

    def as_json(self) -> dict[str, Any]:
        """Return the object that `armd calibrate --json` contains."""
        return {**asdict(self), "added": list(self.added)}

    def in_words(self) -> str:
        noise = f"{np.degrees(self.standard_deviation_rad):.2g}° per axis"
        words = (
            f"{format_count(self.readings, 'orientation')} ({noise}) raise the rank from"
            f" {self.rank_without} to {self.rank}"
            if self.rank > self.rank_without
            else f"{format_count(self.readings, 'orientation')} ({noise})"
            f" leave the rank at {self.rank}"
        )
        return f"{words}; uncertainties are {self.uncertainty_ratio:.2f} times those without them"


def compute_orientation_gain(identification: Identification) -> OrientationGain | None:
    """Return what the orientations of a fit add; None without any."""
    observations = identification.observations
    turned = observations.turned
    if not turned.any():
        return None
    scale, pull = identification.solution.scale, -identification.departure
    whitening = np.where(turned[:, None, None], 0.0, identification.arm_problem.whitening)
    without = replace(identification.arm_problem, whitening=whitening, full_problem=None).solve(
        scale, pull
    )
    names, arm = identification.unknowns.words(identification.terms), observations.arm
    open_with = set(describe_unidentifiable(identification.solution.null, names, arm))
    known_directions = without.directions[:, without.is_known]
    variances = []
    for solution in (identification.solution, without):
        scaled = solution.covariance(known_directions[:, :0]) / np.outer(scale, scale)
        variances.append(np.einsum("ck,ck->k", known_directions, scaled @ known_directions))
    ratio = (
        np.exp(0.5 * np.mean(np.log(variances[0] / variances[1])))
        if known_directions.size
        else np.nan
    )
    return OrientationGain(
        readings=int(turned.sum()),
        standard_deviation_rad=identification.noise.turn_mm / TURN_MM,
        rank=identification.solution.rank,
        rank_without=without.rank,
        added=tuple(
            w for w in describe_unidentifiable(without.null, names, arm) if w not in open_with
        ),
        uncertainty_ratio=float(ratio),
    )
