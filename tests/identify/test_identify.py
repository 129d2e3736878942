"""Identification: the truth comes back, its uncertainty is right, what is unknown is named."""

from __future__ import annotations

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.estimate.gauge import describe_unidentifiable
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import Identification
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.parameters import ParameterLayout
from support import synthetic
from support.fitted import fit_constants
from support.synthetic import disturbed, session, tracked

ARM = synthetic.arm()
ARCSEC = np.pi / 180 / 3600


def known_directions(found: Identification) -> np.ndarray:
    return found.solution.directions[:, found.solution.is_known]


@pytest.mark.parametrize("n_joints", [3, 6, 7, 9])
def test_a_noise_free_fit_returns_the_truth(n_joints: int) -> None:
    rng = np.random.default_rng(n_joints)
    arm = synthetic.arm(n_joints)
    truth = disturbed(arm, rng)  # up to 1 mm and 0.5° off
    found = fit_constants(
        collect_observations([tracked(arm, truth, rng, readings=40 * n_joints)], arm)
    )
    names = found.unknowns.names
    error = found.unknowns.values(found.constants, []) - found.unknowns.values(truth, [])
    identifiable = np.abs(found.solution.null).max(axis=1) < 1e-6
    assert identifiable.sum() >= 4 * n_joints - 6
    for name, e, wanted in zip(names, error, identifiable, strict=True):
        size = 100.0 if parameters.find_unit(name) == "mm" else 1.0
        assert not wanted or abs(e) < 1e-6 * size, name
    # Combinations that are identifiable return too: the arm measures like the true one elsewhere.
    fresh = collect_observations([tracked(arm, truth, rng)], arm)
    assert evaluate_model(fresh, found.constants, [], 20.0).distance_um.max() < 1e-3


def test_thermal_coefficients_return_too() -> None:
    rng = np.random.default_rng(5)
    truth = disturbed(ARM, rng)
    terms = make_length_terms(ARM, [1, 2])
    lengths = dict(zip(ParameterLayout(6).names, ARM.nominal().tolist(), strict=True))
    true_terms = [
        term.model_copy(
            update={
                "coefficient": (abs(lengths[term.parameter]) + 10)
                * (2e-5 if term.basis[0].order == 1 else 1e-8)
            }
        )
        for term in terms
    ]
    sessions = [
        session(ARM, truth, rng, terms=true_terms, readings=100, temperature_c=t, name=f"{t}")
        for t in (15.0, 20.0, 26.0, 31.0)
    ]
    found = fit_constants(collect_observations(sessions, ARM), terms)
    for term, true in zip(found.terms, true_terms, strict=True):
        # The tip's axes turn with θ of the last joint, which is not identifiable.
        if not term.parameter.startswith("tip"):
            assert term.coefficient == pytest.approx(true.coefficient, rel=1e-6)
    fresh = session(ARM, truth, rng, terms=true_terms, readings=60, temperature_c=23.0)
    residual = evaluate_model(
        collect_observations([fresh], ARM), found.constants, found.terms, 20.0
    )
    assert residual.distance_um.max() < 1e-3


@pytest.mark.slow
def test_normalised_errors_have_unit_variance_over_100_seeds() -> None:
    rng = np.random.default_rng(11)
    truth = disturbed(ARM, rng, 0.1)
    clean = collect_observations([session(ARM, truth, rng, readings=120, targets=6)], ARM)
    normalised = []
    for seed in range(100):
        noise = np.random.default_rng(1000 + seed)
        q = clean.states.q + ARCSEC * noise.normal(size=clean.states.q.shape)
        found = fit_constants(replace(clean, states=replace(clean.states, q=q)))
        scale, known = found.solution.scale, known_directions(found)
        error = found.unknowns.values(found.constants, []) - found.unknowns.values(truth, [])
        covariance = known.T @ (found.covariance / np.outer(scale, scale)) @ known
        along = known.T @ (error / scale)
        normalised.append(np.linalg.solve(np.linalg.cholesky(covariance), along))
    # 100 seeds × 21 directions: the mean square of unit normals lies within 0.1 at 3 sigma.
    assert np.mean(np.array(normalised) ** 2) == pytest.approx(1.0, abs=0.1)


# An arm of n general joints has 4 n + 3 constants (θ, d, a, α, tip). Two of them, θ₁ and d₁, only
# move it as a whole; of the last joint's four and the tip's three only three place the tip.
# What remains is 4 n − 3, and one less where nothing certified tells a length.
LENGTH, NO_LENGTH = 4 * 6 - 3, 4 * 6 - 4
KINDS = {
    "four certified points": ({"targets": 4}, LENGTH),
    "three certified points, one placement": ({"targets": 3, "placements": 1}, LENGTH),
    "two certified points": ({"targets": 2}, LENGTH),
    "one certified point": ({"targets": 1, "placements": 1}, NO_LENGTH),
    "one seat": ({"targets": 1, "placements": 1, "known": False}, NO_LENGTH),
    "seats only": ({"targets": 4, "known": False}, NO_LENGTH),
    "seats with one distance": ({"known": False, "distances": [(0, 1)]}, LENGTH),
    "distances only": ({"known": False, "distances": [(0, 1), (1, 2), (2, 3)]}, LENGTH),
}


@pytest.mark.parametrize("noise", [0.0, 2.0])
@pytest.mark.parametrize("kind", list(KINDS))
def test_rank_equals_theory(kind: str, noise: float) -> None:
    settings, rank = KINDS[kind]
    rng = np.random.default_rng(1)
    truth = disturbed(ARM, rng)
    measured = session(ARM, truth, rng, readings=240, encoder_rad=noise * ARCSEC, **settings)
    found = fit_constants(collect_observations([measured], ARM))
    assert found.converged
    assert found.solution.rank == rank
    words = describe_unidentifiable(found.solution.null, found.unknowns.names, ARM)
    assert len(words) == len(found.unknowns.names) - rank
    assert any(line.startswith("theta_1: moving the whole arm") for line in words)
    assert any(line.startswith("d_1: moving the whole arm") for line in words)
    assert sum("place the same point" in line for line in words) == 4
    assert sum("scale of the arm" in line for line in words) == LENGTH - rank
    # What is not known stays near the drawing: the arm keeps its size.
    assert np.abs(found.constants - ARM.nominal()).max() < 5.0


def test_hayati_replaces_d_between_parallel_axes() -> None:
    content = ARM.model_dump(by_alias=True)
    content["joint"][1] |= {"alpha_deg": 0.5, "a_mm": 300.0}
    arm = Arm.model_validate(content)
    rng = np.random.default_rng(3)
    truth = disturbed(arm, rng)
    truth[ParameterLayout(6).index("beta_2")] = 0.003
    truth[ParameterLayout(6).index("d_2")] = arm.nominal()[ParameterLayout(6).index("d_2")]
    found = fit_constants(collect_observations([session(arm, truth, rng, readings=300)], arm))
    assert found.solution.rank == LENGTH
    assert found.constants[ParameterLayout(6).index("beta_2")] == pytest.approx(0.003, rel=1e-6)


def test_outliers_are_found_and_do_not_matter() -> None:
    rng = np.random.default_rng(21)
    truth = disturbed(ARM, rng, 0.3)
    measured = session(ARM, truth, rng, readings=240, encoder_rad=ARCSEC)
    wrong = rng.choice(240, 8, replace=False)
    measured.states.q[wrong, 2] += 3e-4  # about 0.2 mm at the tip
    found = fit_constants(collect_observations([measured], ARM))
    assert set(wrong) == set(found.outliers.tolist())
    along = known_directions(found).T @ (
        (found.unknowns.values(found.constants, []) - found.unknowns.values(truth, []))
        / found.solution.scale
    )
    sigma = 1 / found.solution.singular_values[found.solution.is_known]
    assert np.abs(along / sigma).max() < 5


def test_a_certified_position_s_uncertainty_shows_in_the_result() -> None:
    rng = np.random.default_rng(31)
    truth = disturbed(ARM, rng, 0.3)

    def uncertainty(position_mm: float) -> float:
        again = np.random.default_rng(32)
        measured = session(
            ARM, truth, again, encoder_rad=ARCSEC, readings=240, uncertainty_mm=position_mm
        )
        found = fit_constants(collect_observations([measured], ARM))
        length = found.unknowns.names.index("d_3")
        return float(np.sqrt(found.covariance[length, length]))

    assert uncertainty(0.05) > 3 * uncertainty(0.0)


def test_a_fit_s_arrays_go_with_it() -> None:
    """Were there a circle, they would stay until Python looks for circles: of 20,000 readings all
    steps' arrays stayed, a gigabyte."""
    rng = np.random.default_rng(51)
    found = fit_constants(
        collect_observations([session(ARM, disturbed(ARM, rng), rng, readings=90)], ARM)
    )
    columns = weakref.ref(found.arm_problem.columns)
    gc.disable()
    try:
        del found
        assert columns() is None
    finally:
        gc.enable()


def test_poses_of_an_unweighted_fit_are_its_minimum() -> None:
    """No small change of a pose or a seat lowers the sum of squares that `fit_poses` found."""
    rng = np.random.default_rng(51)
    truth = disturbed(ARM, rng)
    observations = collect_observations([session(ARM, truth, rng, readings=90, known=False)], ARM)
    basis = compute_basis_values([], observations.states, ARM, 20.0, ARM.nominal())
    position = compute_pose(
        observations.states.q, compute_parameter_rows(ARM.nominal(), [], basis)
    )[0]
    poses = fit_poses(observations, position)
    least = np.sum(poses.residual(observations, position) ** 2)
    for _ in range(20):
        moved = poses.moved(
            np.zeros((3, 3)), 1e-3 * rng.normal(size=(3, 6)), 1e-3 * rng.normal(size=(4, 3))
        )
        assert np.sum(moved.residual(observations, position) ** 2) > least
