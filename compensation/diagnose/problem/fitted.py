"""A fit as a value: model, noise, residuals and solution."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.problem.layout import MOUNT, PLACEMENTS, FitLayout, name_block
from armd.compensation.diagnose.problem.linear import Baseline, Linear, ModelState
from armd.compensation.diagnose.problem.whitening import Nuisance, RestNoise
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.linear.blocks import Blocks
from armd.compensation.estimate.linear.linear_model import LinearModel


@dataclass(frozen=True, kw_only=True)
class Fit:
    """The result of a fit: the model, its residual and the columns that absorb."""

    baseline: Baseline
    linear: Linear
    model: ModelState  # constants and its own terms, findings not included
    findings: tuple[Candidate, ...]
    amplitudes: tuple[F64, ...]  # per finding
    covariances: tuple[F64, ...]
    noise: RestNoise
    nuisance: Nuisance
    layout: FitLayout
    residual: F64  # (N,) before any column absorbs, winsorised about the fit
    raw_residual: F64  # (N,) the same as measured
    fitted: F64  # (N,) the part of the residual that the nuisance columns explain
    solution: F64  # (b,)
    problem: LinearModel  # of the nuisance columns

    @property
    def inverse(self) -> F64:
        """The covariance (b, b) of the solution."""
        return self.problem.covariance

    @property
    def rest_residual_mm(self) -> F64:
        """The residual (n, 3) mm of each rest as measured, after the fit."""
        n = self.linear.rests.n
        return (self.raw_residual - self.fitted)[: 3 * n].reshape(n, 3)

    @property
    def point_residual_mm(self) -> F64:
        """The residual (m, 3) mm of the points alone: an orientation's residual is no distance."""
        return self.rest_residual_mm[self.noise.points]

    def across(self, columns: F64) -> F64:
        """Return products (b, …) of the nuisance columns with others (N, …), both whitened."""
        return self._white.across(self.noise.whiten(columns))

    @cached_property
    def _white(self) -> Blocks:
        return self.nuisance.columns.whitened(self.noise.whitener, self.noise.distance_mm)

    @property
    def noise_floor_um(self) -> float:
        """The 3-D RMS in µm that noise alone causes.

        It has two parts: each rest's own noise, before placements absorb some of it; and noise that
        rests share (a drifting base, certified positions), less the part that placements absorb.
        From session to session a base may drift far without any residual that shows it.
        """
        free, shared = (
            self.layout.blocks.find_columns([PLACEMENTS]),
            slice(self.layout.shared, None),
        )
        absorbed = self.problem.only(free).solve_amplitudes(self.problem.gram[free, shared])
        # |shared − free · taken|² by products of the columns, of the rests alone, in mm².
        points = ~self.linear.rests.observations.turned
        rests = points[:, None, None] * np.eye(3)
        no_lengths = np.full(len(self.noise.distance_mm), np.inf)
        products = self.nuisance.columns.products(rests, no_lengths, self.residual)[:-1, :-1]
        across, within = products[free, shared], products[np.ix_(free, free)]
        remaining = np.diag(products)[shared] - ((2.0 * across - within @ absorbed) * absorbed).sum(
            axis=0
        )
        variance = self.nuisance.variance[shared]
        common = float(np.maximum(remaining, 0.0) @ variance) / max(int(points.sum()), 1)
        return 1e3 * float(np.sqrt(self.noise.own_mm**2 + common))

    def net_signature(self, index: int) -> F64:
        """Return the tip's motion (n, 3) mm by a finding, cleared of the rest of the model.

        Errors that rests share by chance (certified targets, a slow drift) are noise. They count in
        the weights, but the part that they could absorb remains in the finding's motion.
        """
        moves = (
            -self.nuisance.columns.to_dense(self.layout.findings[index]) @ self.amplitudes[index]
        )
        return self._net(name_block(index), moves)

    def net_growth(self) -> F64:
        """Return the tip's motion (n, 3) mm by the first link's growth, cleared of all else."""
        span = self.layout.mount
        return self._net(MOUNT, self.nuisance.columns.to_dense(span) @ self.solution[span])

    def _net(self, block: str, moves: F64) -> F64:
        keep = self.layout.blocks.find_other_columns([block])
        absorbed = self.problem.only(keep).solve_amplitudes(self.across(moves)[keep])
        model = keep < self.layout.shared
        amplitudes = np.zeros(len(self.solution))
        amplitudes[keep[model]] = absorbed[model]
        absorbed_moves = self.nuisance.columns.times(amplitudes)
        net: F64 = (moves - absorbed_moves)[: 3 * self.linear.rests.n].reshape(-1, 3)
        return net
