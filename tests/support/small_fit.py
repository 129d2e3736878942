"""A fit of a linear problem made up by hand: columns, priors and noise as a test wants them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.fitting.nuisance import NuisanceBlock, join_blocks
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.layout import AFTER, BEFORE, IDENTIFIED, PLACEMENTS
from armd.compensation.diagnose.problem.whitening import RestNoise
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.estimate.linear.linear_model import LinearModel


def unit_noise(n: int, distances: int = 0) -> RestNoise:
    """A noise of one unit per component of *n* rests and per certified length."""
    return RestNoise(1.0, 0.0, 0.0, 0.0, 1.0, np.tile(np.eye(3), (n, 1, 1)), np.ones(distances))


def candidate(cause: str, joint: int, widths: int = 1, typical: float = 1.0) -> Candidate:
    """A cause without terms: its columns are what a test says."""
    columns = tuple(Column(f"c{i}", "1", typical) for i in range(widths))
    return Candidate(cause, location.joint(joint), columns, (f"q{joint}",))


def small_fit(
    residual: np.ndarray,
    placements: np.ndarray,
    findings: dict[Candidate, np.ndarray] | None = None,
    raw: np.ndarray | None = None,
    identified: np.ndarray | None = None,
) -> Fit:
    """A fit to *residual* (3 n,) with *placements* (3 n, p) free, and *findings* by columns, each
    amplitude a priori of variance 100; *identified* (3 n, c) of what a calibration identified."""
    n = len(residual) // 3
    findings = findings or {}

    def block(columns: F64, variance: float = 100.0) -> NuisanceBlock:
        return columns, np.full(columns.shape[1], variance)

    always = {name: block(np.zeros((3 * n, 0))) for name in (*BEFORE, *AFTER)}
    always[PLACEMENTS] = block(placements, np.inf)
    if identified is not None:
        always[IDENTIFIED] = block(identified)
    nuisance, layout = join_blocks(always, [block(x) for x in findings.values()], np.zeros(n, int))
    columns = nuisance.columns.to_dense()
    problem = LinearModel.from_products(layout.blocks, columns.T @ columns, nuisance.variance)
    solution, inverse = problem.solve(columns.T @ residual)
    untimed = SimpleNamespace(time_s=np.full(n, np.nan))
    observations = SimpleNamespace(
        placement=np.zeros(n, dtype=np.int64), placement_names=["P"], states=untimed,
        turned=np.zeros(n, dtype=bool),
    )  # fmt: skip
    rests = SimpleNamespace(n=n, observations=observations, posture=np.arange(n))
    joints = np.zeros((n, 3, 1))  # the noise is the tip's own
    linear: Any = SimpleNamespace(rests=rests, residual=residual, joints=joints)
    nothing: Any = None
    return Fit(
        baseline=nothing,
        linear=linear,
        model=nothing,
        findings=tuple(findings),
        amplitudes=tuple(-solution[at] for at in layout.findings),
        covariances=tuple(inverse[at, at] for at in layout.findings),
        noise=unit_noise(n),
        nuisance=nuisance,
        layout=layout,
        residual=residual,
        raw_residual=residual if raw is None else raw,
        fitted=columns @ solution,
        solution=solution,
        problem=problem,
    )


def whitened_by(fit: Fit, whitener: F64) -> Fit:
    """The fit with another whitener (n, 3, 3), zero for rests that are left out."""
    return replace(fit, noise=replace(fit.noise, whitener=whitener))
