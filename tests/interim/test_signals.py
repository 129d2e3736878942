"""What a reading sees under a calibration, against the plain chain of matrices and differences."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.effects.effect import Column, tie
from armd.compensation.interim.checks.signals import LEAST_MM, USUAL_MM, Signals
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term
from support import synthetic
from support.drawn import drawn
from support.plain_kinematics import tip_pose
from support.readings import states_of

ARM = synthetic.arm()
NAMES = ARM.layout.names
PER_K = Temperature(weights={"t3": 1.0})
WARM = Term(parameter="d_3", basis=[PER_K], coefficient=0.02)


def states(seed: int = 0, n: int = 5) -> States:
    rng = np.random.default_rng(seed)
    q = rng.uniform(-2.0, 2.0, (n, ARM.n_joints))
    celsius = rng.uniform(15.0, 30.0, q.shape)
    time_s = 1.7e9 + np.arange(n)
    return states_of(q, temperature_c=celsius, time_s=time_s, series=np.arange(n))


def calibration(arm: Arm = ARM, **more: object) -> Calibration:
    return drawn(arm, terms=[WARM], **more)


def tips(at: States, off: dict[str, np.ndarray | float]) -> np.ndarray:
    """Tips (n, 3) mm by the plain chain, with the term, parameters *off* by so much."""
    p = np.tile(calibration().vector(ARM.n_joints), (at.n, 1))
    p[:, NAMES.index("d_3")] += 0.02 * (at.temperature_c[:, 2] - 20.0)
    for name, by in off.items():
        p[:, NAMES.index(name)] += by
    return tip_pose(at.q, p)[:, :3, 3]


def moved(at: States, name: str, by: np.ndarray | float = 1.0) -> np.ndarray:
    """(n, 3) by central differences, per unit."""
    h = 1e-6 if NAMES.index(name) in range(5 * ARM.n_joints) and name[:2] in ("th", "al") else 1e-4
    ahead, back = tips(at, {name: h * np.asarray(by)}), tips(at, {name: -h * np.asarray(by)})
    return (ahead - back) / (2.0 * h)


def test_the_tip_is_where_the_plain_chain_has_it() -> None:
    at = states()
    seen = Signals(at, ARM, calibration())
    assert seen.position_mm == pytest.approx(tips(at, {}), abs=1e-9)
    assert seen.complete.all()


def test_a_column_is_all_its_terms_by_their_coefficients_and_bases() -> None:
    at = states()
    both = Column("both", "rad", 1.0, (*tie([("theta_2", 1.0), ("a_4", -3.0)]),))
    grown = Column("grown", "mm/K", 1.0, tie([("d_3", 2.0)], PER_K))
    found = Signals(at, ARM, calibration()).compute_motions([both, grown])
    expected = moved(at, "theta_2") - 3.0 * moved(at, "a_4")
    assert found[:, :, 0] == pytest.approx(expected, rel=1e-5, abs=1e-4)
    expected = 2.0 * moved(at, "d_3") * (at.temperature_c[:, 2] - 20.0)[:, None]
    assert found[:, :, 1] == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_a_calibrations_covariance_moves_the_tip_as_it_says() -> None:
    at = states()
    rng = np.random.default_rng(1)
    size = np.array([2e-5, 0.03, 0.004])  # rad, mm, mm/K: far apart
    root = size[:, None] * rng.normal(size=(3, 3))
    given = calibration(covariance_of=["theta_2", "a_4", "term 0"], covariance=root @ root.T)
    warmth = (at.temperature_c[:, 2] - 20.0)[:, None]
    columns = np.stack([moved(at, "theta_2"), moved(at, "a_4"), moved(at, "d_3") * warmth], axis=2)
    by_root = Signals(at, ARM, given).compute_calibration_motions().reshape(3 * at.n, -1)
    expected = columns.reshape(-1, 3) @ root
    assert by_root @ by_root.T == pytest.approx(expected @ expected.T, rel=1e-4, abs=1e-10)


def test_a_direction_without_variance_stays_without() -> None:
    at = states()
    given = calibration(covariance_of=["a_4", "d_4"], covariance=[[4.0, 0.0], [0.0, 0.0]])
    by_root = Signals(at, ARM, given).compute_calibration_motions().reshape(3 * at.n, -1)
    along = 2.0 * moved(at, "a_4").reshape(-1, 1)
    assert by_root @ by_root.T == pytest.approx(along @ along.T, rel=1e-5, abs=1e-6)
    assert Signals(at, ARM, calibration()).compute_calibration_motions().shape == (at.n, 3, 0)


@pytest.mark.parametrize("encoder_rad", [[3e-6, 1e-6, 2e-6, 4e-6, 5e-6, 6e-6], [3e-6]])
def test_the_whitener_makes_the_noise_one_of_unit_variance(encoder_rad: list[float]) -> None:
    at = states()
    noise = {"encoder_rad": encoder_rad, "reading_mm": 0.002}
    whitener = Signals(at, ARM, calibration(noise=noise)).compute_whitener()
    covariance = np.tile(0.002**2 * np.eye(3), (at.n, 1, 1))
    for k, size in enumerate(encoder_rad, 1):  # of joints that the file does not name: none
        turn = moved(at, f"theta_{k}")
        covariance += size**2 * turn[:, :, None] * turn[:, None, :]
    white = whitener @ covariance @ whitener.transpose(0, 2, 1)
    assert white == pytest.approx(np.tile(np.eye(3), (at.n, 1, 1)), abs=1e-6)


def test_a_calibration_that_says_nothing_of_noise_is_taken_for_a_usual_one() -> None:
    at = states()
    silent = Signals(at, ARM, calibration()).compute_whitener()
    assert silent == pytest.approx(np.tile(np.eye(3) / USUAL_MM, (at.n, 1, 1)))
    exact = Signals(at, ARM, calibration(noise={"encoder_rad": [1e-12]})).compute_whitener()
    assert exact == pytest.approx(np.tile(np.eye(3) / LEAST_MM, (at.n, 1, 1)), rel=1e-3, abs=1.0)


def test_a_reading_that_lacks_what_the_model_needs_is_told() -> None:
    at = states()
    at.temperature_c[1, 2] = np.nan  # the term's own sensor
    at.temperature_c[3, 0] = np.nan  # one that no term asks
    assert Signals(at, ARM, calibration()).complete.tolist() == [True, False, True, True, True]
