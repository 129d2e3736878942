"""Fit constants and coefficients by least squares, with placements and free targets.

Gauss–Newton with Levenberg's damping where a step fails, on unknowns scaled by their plausible
departure from the nominal values. After each round the noise of a reading is estimated again from
the residuals, and readings are weighted by it and by the robust loss. While the noise is not yet
known, the nominal values count as one more reading of every unknown, good to its plausible
departure. So a start far off cannot diverge along directions that the readings hardly determine.
Afterwards this prior is kept only where the readings determine nothing (docs/decisions/0023).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.gauge import compute_gauge
from armd.compensation.estimate.linear.solution import Solution
from armd.compensation.estimate.linearise import Linearisation, linearise
from armd.compensation.estimate.noise.postures import compute_counts, estimate_shared_part
from armd.compensation.estimate.noise.reading import (
    ReadingNoise,
    Weighting,
    estimate_noise,
    estimate_turn_noise,
    make_whitening,
)
from armd.compensation.estimate.noise.regions import find_regions
from armd.compensation.estimate.noise.robust import (
    DOWNWEIGHT_CHI2,
    LEAST_MM,
    compute_mahalanobis2,
    compute_redescending_weights,
    compute_usual_square,
    find_monstrous,
    select_outliers,
    to_three_components,
)
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.orientations import compute_observed
from armd.compensation.estimate.placements.fit_poses import fit_steady_poses
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.arm_alone import ArmAlone
from armd.compensation.identify.descent import Descent, End
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.kinematics import compute_jacobian
from armd.compensation.model.parameters import ParameterLayout
from armd.compensation.model.terms import Term
from armd.compensation.progress import TellStep

MOST_ROUNDS = 10
#: Random postures: several times more equations than an arm has unknowns.
GAUGE_POSTURES = 200


@dataclass(frozen=True, kw_only=True)
class Identification:
    """The result of a fit."""

    observations: Observations
    reference_c: float
    constants: F64  # (P,)
    terms: list[Term]  # with their coefficients and standard uncertainties
    unknowns: Unknowns
    solution: Solution
    linearisation: Linearisation  # at the solution
    arm_problem: ArmAlone  # with the last round's weights
    noise: ReadingNoise
    distance2: F64  # (n,) squared Mahalanobis distances of the readings
    counts: F64  # (n,) how much each reading counts: copies of a posture share their error
    region: Mask  # (n,) readings far off like their neighbours in posture: no outliers
    departure: F64  # (C,) of the unknowns from the nominal values
    covariance: F64  # (C, C) of the unknowns; zero along directions that move no point
    variance_factor: float  # χ² per degree of freedom, contained in the covariance
    steps: int
    converged: bool

    @property
    def down_weighted(self) -> I64:
        """The rows with less than full weight, the tails of the noise among them."""
        return np.flatnonzero((self.distance2 > DOWNWEIGHT_CHI2) & ~self.region)

    @cached_property
    def outliers(self) -> I64:
        """The rows that are outliers, by the same test as in `armd diagnose`."""
        return select_outliers(self.distance2, self.region)[0]

    def outlier_words(self, max_words: int = 4) -> str:
        """Name the outliers and their distances, the farthest first."""
        far_mm = np.linalg.norm(self.linearisation.residual_mm[self.outliers], axis=1)
        words = [
            f"{self.observations.name_row(i)} ({mm:.3g} mm off)"
            for mm, i in sorted(zip(far_mm, self.outliers, strict=True), reverse=True)
        ]
        return ", ".join(words[:max_words]) + (", …" if len(words) > max_words else "")

    @property
    def rms_um(self) -> float:
        """The 3-D RMS of all readings' residuals."""
        return compute_rms_um(self.linearisation.residual_mm)

    def of_points(self) -> Identification:
        """Return the fit with only the rows of points, without those of orientations."""
        points = ~self.observations.turned
        if points.all():
            return self
        linearisation = self.linearisation.rows(points)
        return replace(
            self,
            observations=linearisation.observations,
            linearisation=linearisation,
            distance2=self.distance2[points],
            counts=self.counts[points],
            region=self.region[points],
        )

    def without_terms(self, count: int) -> Identification:
        """Return the fit without its first *count* terms, as if they were no unknowns."""
        n = len(self.unknowns.constants)
        later = [place for place, i in enumerate(self.unknowns.terms) if i >= count]
        columns = [*range(n), *(n + place for place in later)]
        return replace(
            self,
            terms=self.terms[count:],
            unknowns=Unknowns(
                self.unknowns.constants, [self.unknowns.terms[place] - count for place in later]
            ),
            covariance=self.covariance[np.ix_(columns, columns)],
        )


def compute_rms_um(residual_mm: F64) -> float:
    """Compute the 3-D RMS in µm of residuals (n, 3) mm; rows with NaN are skipped."""
    squares = np.sum(residual_mm**2, axis=1)
    return float(np.sqrt(np.nanmean(squares))) * 1e3 if np.isfinite(squares).any() else np.nan


def fit(
    observations: Observations,
    constants: F64,
    terms: Sequence[Term],
    unknowns: Unknowns,
    reference_c: float,
    *,
    noise: ReadingNoise | None = None,
    begin: F64 | None = None,
    rounds: int = MOST_ROUNDS,
    progress: TellStep | None = None,
) -> Identification:
    """Fit *unknowns*; *constants* (P,) and the terms' coefficients are the nominal values.

    *begin* (P,): constants to begin at instead, where an earlier fit knows them better. *noise*:
    what to weight the readings by at first, where it is known. *rounds*: how often at most noise
    and robust weights are estimated again; 1 keeps the first weights. Every row needs the
    temperatures that the terms use.
    """
    start = unknowns.values(constants, terms)
    constants, terms = constants if begin is None else begin, list(terms)
    x = unknowns.values(constants, terms)
    states = observations.states
    basis = compute_basis_values(terms, states, observations.arm, reference_c, constants)
    rows = compute_parameter_rows(constants, terms, basis)
    position = compute_observed(states.q, rows, observations.turned)
    poses = fit_steady_poses(observations, position)
    residual_mm = poses.residual(observations, position)
    freedom = observations.freedom
    turned, points = observations.turned, ~observations.turned
    alike = _make_equal_noise(residual_mm[points], freedom[points])
    weighing = noise or alike
    # A monstrous reading has no weight from the start; it would make its neighbours a region.
    squared = np.sum(residual_mm**2, axis=1) / alike.reading_mm**2
    distance2 = np.where(find_monstrous(residual_mm), squared, 0.0)
    region = np.zeros(observations.n, dtype=bool)
    steps, with_prior = 0, noise is None
    end: End | None = None
    posture = observations.posture
    counts = compute_counts(posture, 1.0)
    for round_ in range(1, rounds + 1):
        if end is None or not np.array_equal(basis, end.linearisation.basis):
            begun = linearise(observations, constants, terms, poses, reference_c, basis)
        else:  # the end of the previous round
            begun = end.linearisation
        joints = begun.joints
        weight = counts * compute_redescending_weights(distance2, region)
        if with_prior:
            typical = weighing.compute_typical_mm(joints[points], freedom[points])
            weighing = ReadingNoise(0.0, typical, weighing.turn_mm or typical)
        weighting = Weighting(weighing, joints, weight, turned)
        descent = Descent(
            observations, constants, terms, unknowns, reference_c, basis, start, weighting
        )
        # A certified length is nonlinear: far from the solution it must not outweigh the readings.
        floor_mm = weighing.reading_mm * (1.0 if with_prior else 0.01)
        end = descent.run(x, begun, floor_mm, with_prior)
        stands = np.array_equal(end.x, x)
        x, poses, steps = end.x, end.linearisation.poses, steps + end.steps
        constants, terms = unknowns.put(x, constants, terms)
        fitted = end.arm_problem.rank + end.solution.effective_rank
        joints = end.linearisation.joints
        residual_share = end.arm_problem.compute_residual_share(end.solution.root)
        whiten, before = end.arm_problem.whitening, weighing
        weighing = _estimate_noises(end.linearisation, whiten, residual_share, region, counts)
        covariance = weighing.covariance(joints, turned)
        distance2 = to_three_components(
            compute_mahalanobis2(end.linearisation.residual_mm, covariance), freedom
        )
        if not with_prior:  # with the prior, all readings may be far off
            region = region | find_regions(distance2 > DOWNWEIGHT_CHI2, states.q)
        basis = compute_basis_values(terms, states, observations.arm, reference_c, constants)
        if progress:
            left_um = compute_rms_um(end.linearisation.residual_mm)
            progress(f"round {round_}: {left_um:.2f} µm RMS, {steps} steps")
        robust = compute_redescending_weights(distance2, region)
        white = np.einsum(
            "nij,nj->ni", make_whitening(covariance, robust), end.linearisation.residual_mm
        )
        counts = compute_counts(posture, estimate_shared_part(white, posture, freedom))
        weight_after = counts * robust
        settled = _has_settled(before, weighing, joints, turned) and np.allclose(
            weight, weight_after, atol=0.05
        )
        if settled and not with_prior:
            break
        # Another round from the same point with the same weights would end at the same point.
        repeats = (
            stands
            and np.isclose(
                weighing.compute_typical_mm(joints[points], freedom[points]),
                before.reading_mm,
                rtol=1e-6,
            )
            and np.allclose(weight, weight_after, rtol=1e-6)
        )
        with_prior = with_prior and not settled and not repeats and round_ < rounds // 2
    assert end is not None  # at least one round
    # The weights are those of the previous round; one factor accounts for the remaining difference.
    equations = float((freedom * weight).sum())
    spare = max(equations + end.arm_problem.n_certified - fitted, 1.0)
    free = compute_fit_gauge(unknowns, constants, terms, basis, end.solution.scale)
    factor = end.arm_problem.cost / spare
    covariance = end.solution.covariance(free)
    covariance = (covariance + _compute_shared_covariance(end.arm_problem, covariance)) * factor
    deviation = np.sqrt(np.diag(covariance))[len(unknowns.constants) :]
    for i, u in zip(unknowns.terms, deviation, strict=True):
        terms[i] = terms[i].model_copy(update={"standard_uncertainty": float(u)})
    return Identification(
        observations=observations, reference_c=reference_c, constants=constants, terms=terms,
        unknowns=unknowns, solution=end.solution, linearisation=end.linearisation,
        arm_problem=end.arm_problem, noise=weighing, distance2=distance2, counts=counts,
        region=region, departure=x - start, covariance=covariance, variance_factor=factor,
        steps=steps, converged=end.converged,
    )  # fmt: skip


def _compute_shared_covariance(arm_problem: ArmAlone, covariance: F64) -> F64:
    """Return what *covariance* (C, C) lacks where sessions share a certificate.

    The certificate's error is the same in all of them, so it does not average out
    (docs/decisions/0023).
    """
    entry = arm_problem.certified_entries()
    entries, place = np.unique(entry, axis=0, return_inverse=True)
    if len(entries) == len(entry):
        return np.zeros_like(covariance)
    rows = arm_problem.certified_rows()
    together = np.zeros((len(entries), len(covariance)))
    np.add.at(together, place.ravel(), rows)
    together_covariance, rows_covariance = together @ covariance, rows @ covariance
    lacking: F64 = together_covariance.T @ together_covariance - rows_covariance.T @ rows_covariance
    return lacking


def compute_fit_gauge(
    unknowns: Unknowns, constants: F64, terms: Sequence[Term], basis: F64, scale: F64
) -> F64:
    """Compute the directions (C, k) that move no point in any posture.

    They are in unknowns over *scale* (C,). *basis* (n, T): the terms' values in the readings.
    """
    n_joints = ParameterLayout.from_count(len(constants)).n_joints
    rng = np.random.default_rng(0)
    # A term that is 0 in all drawn rows would seem to move nothing, so its extremes are included.
    ends = np.concatenate([basis.argmin(axis=0), basis.argmax(axis=0)])
    values = basis[np.append(ends, rng.integers(len(basis), size=GAUGE_POSTURES))]
    q = rng.uniform(-np.pi, np.pi, (len(values), n_joints))
    columns = compute_jacobian(q, compute_parameter_rows(constants, terms, values))[1]
    return compute_gauge(unknowns.columns(columns, values, terms), scale)


def _make_equal_noise(residual_mm: F64, freedom: I64) -> ReadingNoise:
    """Return the noise that weights all readings equally, as large as their median residual."""
    typical = compute_usual_square(np.sum(residual_mm**2, axis=1), freedom)
    return ReadingNoise(0.0, max(np.sqrt(typical), LEAST_MM))


def _estimate_noises(
    linearisation: Linearisation, whiten: F64, residual_share: F64, region: Mask, counts: F64
) -> ReadingNoise:
    """Estimate the noise of points, and separately that of orientations, after a round."""
    turned, points = linearisation.observations.turned, ~linearisation.observations.turned
    noise = estimate_noise(
        linearisation.residual_mm[points],
        linearisation.joints[points],
        whiten[points],
        residual_share[points],
        region[points],
        counts[points],
        linearisation.observations.freedom[points],
    )
    if not turned.any():
        return noise
    return estimate_turn_noise(
        noise,
        linearisation.residual_mm[turned],
        linearisation.joints[turned],
        residual_share[turned],
        counts[turned],
    )


def _has_settled(
    before: ReadingNoise, after: ReadingNoise, joint_columns: F64, turned: Mask
) -> bool:
    """Return whether the weights would change by less than five per cent."""
    sizes = [
        np.trace(noise.covariance(joint_columns, turned), axis1=1, axis2=2)
        for noise in (before, after)
    ]
    return bool(np.all(np.abs(sizes[1] / sizes[0] - 1.0) < 0.05))
