"""How fast identification is, against scipy's least squares with a numerical Jacobian.

5000 readings in 20 placements at four temperatures; 33 constants and 24 thermal coefficients.
scipy gets the same compiled kinematics and the same problem, the 20 placements among its unknowns;
and once more an easier form, in which its residual function fits the placements in closed form and
it differentiates by the 57 unknowns only. All begin at the drawing and end at the same residual.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from scipy.optimize import least_squares
from threadpoolctl import threadpool_limits

from armd.compensation.estimate.noise.reading import ReadingNoise
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.placements.poses import compute_centres
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.fit import fit
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.parameters import ParameterLayout
from support.synthetic import arm as synthetic_arm
from support.synthetic import disturbed, session

TEMPERATURES_C = (15.0, 20.0, 25.0, 30.0)
ARCSEC = np.pi / 180 / 3600


def run(repeats: int = 3) -> dict[str, Any]:
    """Seconds (the best of *repeats* for ours), ratios, and residuals in µm."""
    with threadpool_limits(limits=1, user_api="blas"):
        return _run(repeats)


def _run(repeats: int) -> dict[str, Any]:
    rng = np.random.default_rng(1)
    arm = synthetic_arm()
    names = ParameterLayout(6).names[:33]
    lengths = make_length_terms(arm, [1, 2, 3, 4])
    terms = lengths[:24]
    truth = disturbed(arm, rng, 0.5)
    true_terms = [
        t.model_copy(update={"coefficient": 6e-3 / 10 ** t.basis[0].order}) for t in terms
    ]
    sessions = [
        session(
            arm, truth, rng, terms=true_terms, readings=1250, placements=5, targets=10,
            spread_mm=80.0,
            temperature_c=celsius, encoder_rad=0.5 * ARCSEC, name=f"{celsius}",
        )
        for celsius in TEMPERATURES_C
    ]  # fmt: skip
    observations = collect_observations(sessions, arm)
    unknowns = Unknowns(names, range(24))
    seconds = []
    for _ in range(repeats + 1):  # the first compiles or loads
        began = time.perf_counter()
        ours = fit(
            observations, arm.nominal(), terms, unknowns, 20.0,
            noise=ReadingNoise(0.0, 0.003), rounds=1,
        )  # fmt: skip
        seconds.append(time.perf_counter() - began)

    nominal = arm.nominal()
    basis = compute_basis_values(terms, observations.states, arm, 20.0, nominal)
    scale = unknowns.get_plausible(terms, basis)
    start = unknowns.values(nominal, terms)
    placements = len(observations.placement_names)

    def tip(scaled: np.ndarray) -> np.ndarray:
        constants, filled = unknowns.put(start + scaled * scale, nominal, terms)
        return compute_pose(
            observations.states.q, compute_parameter_rows(constants, filled, basis)
        )[0]

    begin = fit_poses(observations, tip(np.zeros(57)))
    centre = compute_centres(observations, begin.compute_target_points(observations))

    def with_placements(x: np.ndarray) -> np.ndarray:
        twist = x[57:].reshape(placements, 6)
        poses = begin.moved(centre, twist, np.zeros_like(begin.target_mm))
        return poses.residual(observations, tip(x[:57])).ravel()

    def closed_form(x: np.ndarray) -> np.ndarray:
        position = tip(x)
        return fit_poses(observations, position).residual(observations, position).ravel()

    result = {
        "readings": observations.n,
        "unknowns": len(unknowns.names),
        "placements": placements,
        "seconds": min(seconds[1:]),
        "rms_um": ours.rms_um,
        "mark_ratio": 20.0,
    }
    for name, residual, size in (
        ("scipy", with_placements, 57 + 6 * placements),
        ("scipy_closed_form_placements", closed_form, 57),
    ):
        began = time.perf_counter()
        theirs = least_squares(residual, np.zeros(size), ftol=1e-8, xtol=1e-10, gtol=1e-12)
        result[f"{name}_seconds"] = time.perf_counter() - began
        result[f"{name}_rms_um"] = 1e3 * float(np.sqrt(2 * theirs.cost / observations.n))
    result["ratio"] = result["scipy_seconds"] / result["seconds"]
    result["ratio_closed_form_placements"] = (
        result["scipy_closed_form_placements_seconds"] / result["seconds"]
    )
    return result
