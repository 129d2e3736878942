"""The paper's method (eqs. 12–15): identify at each temperature, then regress each constant.

P(T) = P_ref + C + Σ A_m ΔT^m. P_ref is the value identified at the temperature nearest the
reference, and ΔT is counted from that temperature. The offset C is 0 unless requested.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.compensation.estimate.linear.solution import Solution
from armd.compensation.estimate.linearise import linearise
from armd.compensation.estimate.noise.reading import estimate_noise, make_whitening
from armd.compensation.estimate.noise.robust import (
    compute_mahalanobis2,
    compute_redescending_weights,
    to_three_components,
)
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.arm_alone import ArmAlone
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import Identification
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term


def make_regression(
    temperature_c: F64, order: int, offset: bool, reference_c: float
) -> tuple[float, F64]:
    """Return the temperature from which ΔT counts, and a linear map (order + 1, G).

    The map leads from a constant's values at *temperature_c* (G,) to its polynomial: P_ref + C,
    then A_1, A_2, …
    """
    nearest = int(np.argmin(np.abs(temperature_c - reference_c)))
    powers = np.vander(temperature_c - temperature_c[nearest], order + 1, increasing=True)
    if offset:
        return float(temperature_c[nearest]), np.linalg.pinv(powers)
    through = np.eye(len(temperature_c))[nearest]
    slopes = np.linalg.pinv(powers[:, 1:]) @ (np.eye(len(temperature_c)) - through)
    return float(temperature_c[nearest]), np.vstack([through, slopes])


def fit_regression(
    around: Identification,
    identified: Sequence[Solution],
    temperature_c: F64,
    weights: dict[str, float],
    order: int,
    offset: bool,
) -> Identification:
    """Return the calibration that the regression gives.

    *identified*: changes of the constants of *around*, one solution per temperature (G,), which is
    the mean over the sensors that *weights* names.
    """
    from_c, linear = make_regression(temperature_c, order, offset, around.reference_c)
    polynomial = linear @ np.array([solution.known_step for solution in identified])
    names = list(around.unknowns.constants)
    # θ₁ and d₁ move every placement alike, so no reading determines their expansion.
    moving = [i for i, name in enumerate(names) if name not in ("theta_1", "d_1")]
    covariances = np.array([solution.compute_known_covariance() for solution in identified])
    covariance = np.einsum("rg,sg,gij->risj", linear, linear, covariances)
    places = [(m, i) for m in range(1, order + 1) for i in moving]
    chosen = [*range(len(names)), *(len(names) * m + i for m, i in places)]
    covariance = covariance.reshape(2 * [len(names) * (order + 1)])[np.ix_(chosen, chosen)]
    # What no temperature determines keeps the value and the uncertainty of the common fit.
    unsure = around.covariance - around.solution.compute_known_covariance() * around.variance_factor
    covariance[: len(names), : len(names)] += unsure[: len(names), : len(names)]
    deviation = np.sqrt(np.diag(covariance))[len(names) :]
    terms = [
        Term(
            parameter=names[i],
            coefficient=float(polynomial[m, i]),
            standard_uncertainty=float(u),
            basis=[Temperature(weights=weights, order=m, reference_c=from_c)],
        )
        for (m, i), u in zip(places, deviation, strict=True)
    ]
    constant_unknowns = Unknowns(names)
    x = constant_unknowns.values(around.constants, []) + polynomial[0]
    constants, _ = constant_unknowns.put(x, around.constants, [])
    return _refit_poses(replace(around, covariance=covariance), constants, terms)


def _refit_poses(around: Identification, constants: F64, terms: list[Term]) -> Identification:
    """Return a fit with given constants (P,) and terms, in which only poses are fitted."""
    observations, reference_c = around.observations, around.reference_c
    poses = evaluate_model(observations, constants, terms, reference_c).poses
    linearisation = linearise(observations, constants, terms, poses, reference_c)
    joints = linearisation.joints
    residual_share = around.arm_problem.compute_residual_share(around.solution.root)
    noise = estimate_noise(
        linearisation.residual_mm,
        joints,
        around.arm_problem.whitening,
        residual_share,
        around.region,
        around.counts,
        observations.freedom,
    )
    covariance = noise.covariance(joints)
    distance2 = to_three_components(
        compute_mahalanobis2(linearisation.residual_mm, covariance), observations.freedom
    )
    unknowns = Unknowns(around.unknowns.constants, range(len(terms)))
    scale = unknowns.get_plausible(terms, linearisation.basis)
    arm_problem = ArmAlone(
        linearisation,
        make_whitening(
            covariance, around.counts * compute_redescending_weights(distance2, around.region)
        ),
        unknowns.columns(linearisation.jacobian, linearisation.basis, terms),
    )
    solution = arm_problem.solve(scale, np.zeros(len(scale)))
    return replace(
        around,
        constants=constants,
        terms=terms,
        unknowns=unknowns,
        linearisation=linearisation,
        noise=noise,
        arm_problem=arm_problem,
        distance2=distance2,
        solution=solution,
    )
