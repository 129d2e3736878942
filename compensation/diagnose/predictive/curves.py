"""Residuals along each joint's motion over each variable, inside or outside of what noise makes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.predictive.bins import Bins, all_bins
from armd.compensation.diagnose.predictive.replicates import Refitted, refit

#: The pointwise band holds 95 % of the drawn sets.
BAND = (0.025, 0.975)
HALF_WIDTH = 1.96  # of it, in standard deviations
#: So many drawn sets are kept to be shown.
SHOWN = 12


@dataclass(frozen=True)
class ResidualCurve:
    """What a model leaves along one joint's motion over one variable, rad, and drawn sets' band."""

    mean: F64  # (B,) of each bin
    low: F64  # (B,)
    high: F64  # (B,)
    outside: float  # the share of bins outside of the band
    p_value: float  # that a drawn set has so large a share
    sets: F64  # (SHOWN, B) a few drawn sets
    draws: int  # sets in all
    weight: F64  # (B,) mm²/rad²: square of the tip's motion with the angle, summed over each bin
    rests: int

    @property
    def rms_um(self) -> float:
        """3-D RMS in µm of what the curve explains of the tip's residuals, beyond what noise makes:
        of curves that are wholly outside, the one that the error goes by has the largest."""
        sigma = (self.high - self.low) / (2.0 * HALF_WIDTH)
        square = float((self.weight * (self.mean**2 - sigma**2)).sum())
        return 1e3 * float(np.sqrt(max(square, 0.0) / self.rests))


@dataclass(frozen=True)
class ResidualComparison:
    """One variable and component, under the model under test and with the findings."""

    bins: Bins
    joint: int  # from 1
    before: ResidualCurve
    after: ResidualCurve

    @property
    def component(self) -> str:
        return f"angle joint {self.joint}"

    def as_json(self) -> dict[str, str | float]:
        """An entry of `predictive`."""
        return {
            "variable": self.bins.variable,
            "component": self.component,
            "outside_before": self.before.outside,
            "outside_after": self.after.outside,
            "p_before": self.before.p_value,
            "p_after": self.after.p_value,
            "curve_um_before": self.before.rms_um,
            "curve_um_after": self.after.rms_um,
        }


def compare(diagnosis: Diagnosis) -> list[ResidualComparison]:
    """Every variable with every joint's motion, by the noise that the last fit found; what
    explains most of the residuals under the model under test stands first."""
    search = diagnosis.search
    last = search.last
    bins = all_bins(last.linear.rests)
    after = _curves(refit(last, last.noise), bins)
    alike = not last.findings and search.first is last
    before = after if alike else _curves(refit(search.first, last.noise), bins)
    joints = range(1, diagnosis.arm.n_joints + 1)
    places = [(one, joint) for one in bins for joint in joints]
    made = [
        ResidualComparison(one, joint, first, second)
        for (one, joint), first, second in zip(places, before, after, strict=True)
    ]
    return sorted(made, key=lambda one: -one.before.rms_um)


def _curves(model: Refitted, bins: list[Bins]) -> list[ResidualCurve]:
    """Bins by bins, joint by joint."""
    joints = model.fit.linear.joints  # (n, 3, N) mm/rad
    square = (joints**2).sum(axis=1)
    weight = [np.maximum(one.sums(square), 1e-12) for one in bins]  # (B, N)
    measured = np.einsum("nij,ni->nj", joints, model.left_mm)
    mean = [one.sums(measured) / own for one, own in zip(bins, weight, strict=True)]
    drawn: list[list[F64]] = [[] for _ in bins]
    for left in model.replicates():
        along = np.einsum("nij,nir->njr", joints, left)
        for one, own, kept in zip(bins, weight, drawn, strict=True):
            kept.append((one.sums(along) / own[:, :, None]).astype(np.float32))
    found = []
    for one, levers, own, kept in zip(bins, weight, mean, drawn, strict=True):
        sets = np.concatenate(kept, axis=2)  # (B, N, R)
        low, high = np.quantile(sets, BAND, axis=2)
        share = ((sets < low[:, :, None]) | (sets > high[:, :, None])).mean(axis=0)  # (N, R)
        outside = ((own < low) | (own > high)).mean(axis=0)  # (N,)
        p_value = (share >= outside[:, None] - 1e-9).mean(axis=1)
        for k in range(own.shape[1]):
            found.append(
                ResidualCurve(
                    own[:, k],
                    low[:, k],
                    high[:, k],
                    float(outside[k]),
                    float(p_value[k]),
                    sets[:, k, :SHOWN].T.astype(np.float64),
                    sets.shape[2],
                    levers[:, k],
                    len(one.order),
                )
            )
    return found
