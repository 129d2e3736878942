"""How large a finding is said to be, where that is known in closed form."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.report.sizes import compute_tip_rms_um, is_size_known, measure_curve
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.effects.encoder.encoder_eccentricity import make_harmonic_columns

ORDERS = range(3, 9)
CURVE = Candidate(
    "encoder_periodic",
    location.joint(2),
    tuple(column for order in ORDERS for column in make_harmonic_columns(2, order, 1e-5)),
    ("q2",),
    (("highest order", 8.0, "1/turn"),),
)


def told(candidate: Candidate, amplitudes: np.ndarray, covariance: np.ndarray, **more: Any) -> Any:
    last = SimpleNamespace(
        findings=(candidate,), amplitudes=(amplitudes,), covariances=(covariance,),
        noise=SimpleNamespace(points=slice(None)), **more,
    )  # fmt: skip
    return SimpleNamespace(search=SimpleNamespace(last=last))


def test_a_size_is_known_when_it_is_twice_its_uncertainty() -> None:
    columns = (Column("mm", "mm", 1e-2), Column("rad", "rad", 1e-5))
    one = Candidate("tip_offset", location.TIP, columns, ())
    covariance = np.diag([1e-2, 1e-5]) ** 2
    assert is_size_known(told(one, np.array([2.1e-2, 0.0]), covariance), 0)
    assert not is_size_known(told(one, np.array([1.9e-2, 0.0]), covariance), 0)
    # What is uncertain in another direction than it lies does not matter.
    askew = np.diag([1e-2, 1e-2]) ** 2
    assert is_size_known(told(one, np.array([2.1e-2, 0.0]), askew), 0)


def wave(order: int, amplitude: float) -> np.ndarray:
    """Amplitudes of a curve that is one sine."""
    found = np.zeros(2 * len(ORDERS))
    found[2 * (order - 3)] = amplitude
    return found


def over(q_deg: np.ndarray) -> Any:
    q = np.radians(np.stack([0 * q_deg, q_deg], axis=1))
    states = SimpleNamespace(q=q)
    rests = SimpleNamespace(observations=SimpleNamespace(states=states))
    return SimpleNamespace(rests=rests)


def test_a_curve_is_told_by_its_root_mean_square_over_the_turn_and_its_strongest_order() -> None:
    """A sine's is its amplitude over √2, and known as well as that amplitude."""
    turn = over(np.arange(-180.0, 180.0))
    sigma = 2e-6
    covariance = sigma**2 * np.eye(2 * len(ORDERS))
    for order in (3, 5, 8):
        diagnosis = told(CURVE, wave(order, 3e-5), covariance, linear=turn)
        rms, uncertainty, strongest = measure_curve(diagnosis, 0)
        assert rms == pytest.approx(3e-5 / np.sqrt(2), rel=1e-9)
        assert uncertainty == pytest.approx(sigma / np.sqrt(2), rel=1e-9)
        assert strongest == order


def test_what_a_curve_does_where_the_joint_never_stood_does_not_count() -> None:
    """Over a twelfth of a turn a third wave is a quarter of itself: about its mean there."""
    seen = np.arange(0.0, 31.0)
    curve = 3e-5 * np.sin(3 * np.radians(seen))
    diagnosis = told(CURVE, wave(3, 3e-5), np.eye(12) * 1e-12, linear=over(np.repeat(seen, 4)))
    assert measure_curve(diagnosis, 0)[0] == pytest.approx(curve.std(), rel=1e-9)


def test_the_tip_moves_by_the_three_dimensional_root_mean_square() -> None:
    moves = np.array([[3e-3, 4e-3, 0.0], [0.0, 0.0, 0.0]])
    diagnosis = told(CURVE, wave(3, 0.0), np.eye(12), net_signature=lambda _index: moves)
    assert compute_tip_rms_um(diagnosis, 0) == pytest.approx(5.0 / np.sqrt(2))
