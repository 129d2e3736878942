"""A check's few numbers say what all its readings say: against plain least squares over these."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armd.compensation.data.sessions.session import Session
from armd.compensation.effects.effect import Candidate, Column, tie
from armd.compensation.effects.location import joint
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.reduce import LENGTH_FLOOR_MM, reduce
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.model.calibration import Calibration, Noise
from armd.errors import BadInput
from support import synthetic
from support.drawn import drawn
from support.plain_kinematics import tip_pose

ARM = synthetic.arm()
NAMES = ARM.layout.names
ENCODER_RAD, READING_MM = 3e-6, 2e-3
#: What the causes below move, and by how much a unit of each.
MOVES = (("theta_3", 1.0), ("d_3", 1.0), ("a_4", 1.0))
CAUSES = [
    Cause(Candidate("a", joint(3), (Column("x", "rad", 1e-4, tie([MOVES[0]])),), ()), 0.5, 0.0),
    Cause(
        Candidate("b", joint(4), tuple(Column("x", "mm", 0.1, tie([m])) for m in MOVES[1:]), ()),
        0.5, 0.0,
    ),
]  # fmt: skip
SIZE = np.array([1e-5, 0.01, 0.01])


def calibration(**more: Any) -> Calibration:
    noise = Noise(encoder_rad=[ENCODER_RAD] * ARM.n_joints, reading_mm=READING_MM)
    return drawn(ARM, noise=noise, **more)


def check(**more: Any) -> Session:
    return synthetic.session(
        ARM, calibration().vector(ARM.n_joints), np.random.default_rng(2),
        **({"readings": 24, "placements": 2, "encoder_rad": 1e-5} | more),
    )  # fmt: skip


def tips(q: np.ndarray, off: dict[str, float]) -> np.ndarray:
    p = np.tile(calibration().vector(ARM.n_joints), (len(q), 1))
    for name, by in off.items():
        p[:, NAMES.index(name)] += by
    return tip_pose(q, p)[:, :3, 3]


def moved(q: np.ndarray, name: str) -> np.ndarray:
    h = 1e-6 if name.startswith("theta") else 1e-4
    return (tips(q, {name: h}) - tips(q, {name: -h})) / (2.0 * h)


class Plainly:
    """All rows of a check, whitened, and what may move them freely."""

    def __init__(self, session: Session, free_targets: bool) -> None:
        q, n = session.states.q, session.n
        covariance = np.tile(READING_MM**2 * np.eye(3), (n, 1, 1))
        for k in range(1, ARM.n_joints + 1):
            turn = moved(q, f"theta_{k}")
            covariance += ENCODER_RAD**2 * turn[:, :, None] * turn[:, None, :]
        self._white = np.linalg.inv(np.linalg.cholesky(covariance))
        position = tips(q, {})
        off, columns = np.zeros((n, 3)), []
        if free_targets:  # one placement: where each seat is says all
            for target in np.unique(session.target):
                own = session.target == target
                off[own] = position[own] - position[own].mean(axis=0)
                columns += [np.where(own[:, None], axis, 0.0) for axis in np.eye(3)]
        else:
            certified = np.array([target.position_mm for target in session.artefact.targets])
            for placement in np.unique(session.placement):
                own = session.placement == placement
                local = certified[session.target[own]]
                middle, there = local.mean(axis=0), position[own].mean(axis=0)
                turn = Rotation.align_vectors(position[own] - there, local - middle)[0]
                arm = turn.apply(local - middle)
                off[own] = position[own] - there - arm
                for axis in np.eye(3):
                    for move in (np.tile(axis, (own.sum(), 1)), np.cross(axis, arm)):
                        columns.append(np.zeros((n, 3)))
                        columns[-1][own] = move
        self.residual = self._rows(off)
        self.free = np.column_stack([self._rows(column) for column in columns])
        self.causes = np.column_stack([self._rows(moved(q, name)) for name, _ in MOVES])

    def _rows(self, of: np.ndarray) -> np.ndarray:
        return (self._white @ of[:, :, None]).ravel()

    def left(self, amplitudes: np.ndarray) -> float:
        """Sum of squares with the causes at work, all that is free at its best."""
        rows = self.residual + self.causes @ amplitudes
        return float(((rows - self.free @ np.linalg.lstsq(self.free, rows)[0]) ** 2).sum())


def sum_of_squares(found: Reduced, amplitudes: np.ndarray) -> float:
    return float(((found.residual + found.causes @ amplitudes) ** 2).sum())


@pytest.mark.parametrize("seats", [False, True])
def test_the_numbers_leave_what_all_rows_leave(seats: bool) -> None:
    session = check(known=not seats, placements=1 if seats else 2)
    found = reduce(session, ARM, calibration(), CAUSES)
    plain = Plainly(session, seats)
    assert len(found.residual) == 3 * session.n - np.linalg.matrix_rank(plain.free)
    rng = np.random.default_rng(1)
    for amplitudes in (np.zeros(3), *(SIZE * rng.normal(size=(4, 3)))):
        expected = plain.left(amplitudes)
        assert sum_of_squares(found, amplitudes) == pytest.approx(expected, rel=2e-3)
    assert found.readings == session.n and found.certified == (not seats,) * 4


def test_a_rest_read_twice_is_one_reading() -> None:
    once = check()
    rows = np.repeat(np.arange(once.n), 2)
    twice = replace(
        once,
        states=once.states.rows(rows),
        **{name: getattr(once, name)[rows] for name in ("placement", "target", "truth_mm",
                                                        "artefact_c", "row")},
    )  # fmt: skip
    one, two = (reduce(session, ARM, calibration(), CAUSES) for session in (once, twice))
    for amplitudes in (np.zeros(3), SIZE):
        expected = sum_of_squares(one, amplitudes)
        assert sum_of_squares(two, amplitudes) == pytest.approx(expected, rel=1e-6)


def test_a_certified_length_is_one_more_number_with_its_own_error() -> None:
    session = check(known=False, placements=1, distances=[(0, 1), (1, 2)])
    without = replace(session, artefact=session.artefact.model_copy(update={"distances": []}))
    some, fewer = (reduce(one, ARM, calibration(), CAUSES) for one in (session, without))
    assert len(some.residual) == len(fewer.residual) + 2
    own = [i for i, name in enumerate(some.known_names) if "distance" in name]
    assert [some.known_names[i] for i in own] == ["points distance 0", "points distance 1"]
    # An error of one standard deviation of the certificate, in units of the row's small noise;
    # of it no more shows than is not taken up by the seats.
    size = np.linalg.norm(some.error_columns[:, own], axis=0)
    assert (size < 0.001 / LENGTH_FLOOR_MM).all() and (size > 0.0).all()


def test_a_calibration_that_may_be_wrong_says_so_under_the_same_name_every_day() -> None:
    wrong = calibration(covariance_of=["d_3"], covariance=[[0.01**2]])
    found = reduce(check(uncertainty_mm=0.002), ARM, wrong, CAUSES)
    assert found.known_names[0] == "calibrated 0"
    assert found.error_columns[:, 0] == pytest.approx(0.01 * found.causes[:, 1], abs=1e-9)
    errors = [name for name in found.known_names if name != "calibrated 0"]
    assert errors == [f"points B{k} {axis}" for k in range(4) for axis in "xyz"]


def test_too_few_readings_are_refused() -> None:
    with pytest.raises(BadInput, match="4 readings, 2 numbers"):
        reduce(check(readings=4, placements=2), ARM, calibration(), CAUSES)
