"""What is told of findings: under which name, beside whom; shapes; curves; who joins."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.constants import CURVE_POINTS, SHAPE_OFF
from armd.compensation.diagnose.diagnosis import Finding, Rival
from armd.compensation.diagnose.fitting.curves import as_curve, list_orders
from armd.compensation.diagnose.report.advice import is_alike, propose_experiment
from armd.compensation.diagnose.scoring.shape import is_shape, locate_shape, make_shape
from armd.compensation.diagnose.search.findings import _withdraw_names as withdraw_names
from armd.compensation.diagnose.search.findings import find_likelier_rival
from armd.compensation.diagnose.search.findings import find_nearest_step as nearest
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, join_finding
from armd.compensation.effects.encoder.encoder_eccentricity import make_harmonic_columns
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.curve import evaluate_curve
from armd.compensation.model.pose_factors import Curve, Harmonic
from support.small_fit import candidate

NAMED = candidate("encoder_scale", 3)
OTHER = candidate("encoder_eccentricity", 3)


def unknown(joint: int, *variables: str) -> Candidate:
    where = location.parameter(joint, f"d_{joint}({', '.join(variables)})")
    return Candidate("unknown", where, (Column("d", "mm", 1.0),), variables)


def finding(of: Candidate, probability: float = 0.9, statistic: float = 50.0, rivals=()) -> Finding:
    told = tuple(Rival(c, share, 10.0) for c, share in rivals)
    return Finding(of, 1e-9, statistic, probability, told, ())


def test_a_name_stays_where_nothing_is_likelier() -> None:
    found = finding(NAMED, 0.6, rivals=[(OTHER, 0.3), (unknown(3, "q3"), 0.1)])
    assert withdraw_names([found]) == (found,)
    assert find_likelier_rival(found) is None


def test_a_likelier_rival_takes_the_name_and_the_probability_is_of_either() -> None:
    found = finding(NAMED, 0.3, rivals=[(replace(OTHER, depends_on=("q3", "t1")), 0.6)])
    (told,) = withdraw_names([found])
    assert told.candidate.cause == "unknown"
    assert told.candidate.depends_on == ("q3", "t1")
    assert told.probability == pytest.approx(0.9)
    shares = [(rival.candidate.cause, rival.probability) for rival in told.rivals]
    assert shares == [("encoder_eccentricity", 0.6), ("encoder_scale", 0.3)]  # none is kept back
    assert told.is_of_several_names and not found.is_of_several_names


def test_an_unknown_structure_that_is_likelier_takes_it_too() -> None:
    strange = unknown(2, "q2", "q3")
    (told,) = withdraw_names([finding(NAMED, 0.05, rivals=[(strange, 0.9)])])
    assert told.candidate.cause == "unknown" and not told.is_of_several_names
    assert set(told.candidate.depends_on) == {"q2", "q3"}


def test_a_finding_takes_the_place_of_those_it_contains() -> None:
    first, both = (
        make_harmonic_columns(2, 3, 1.0),
        make_harmonic_columns(2, 3, 1.0) + make_harmonic_columns(2, 4, 1.0),
    )
    one = Candidate("encoder_periodic", location.joint(2), first, ("q2",))
    more = Candidate("encoder_periodic", location.joint(2), both, ("q2",))
    assert join_finding([one, NAMED], more) == [NAMED, more]
    assert join_finding([NAMED], one) == [NAMED, one]


def test_what_an_experiment_need_not_part() -> None:
    assert is_alike(NAMED, replace(NAMED, columns=()))
    assert is_alike(unknown(1, "q1"), unknown(2, "q1"))
    assert not is_alike(NAMED, OTHER) and not is_alike(unknown(1, "q1"), unknown(1, "q2"))


def test_a_shape_is_the_signature_times_harmonics_of_the_joints_at_its_place() -> None:
    own = Candidate(
        "encoder_eccentricity", location.joint(2), make_harmonic_columns(2, 1, 1.0), ("q2",)
    )
    shape = make_shape(own, np.array([3.0, 4.0]), 6)
    assert shape is not None and is_shape(shape) and shape.location == locate_shape(own)
    assert len(shape.columns) == 4 and shape.depends_on == ("q2",)
    arm: Any = SimpleNamespace(sensors=[])
    q = np.random.default_rng(1).uniform(-3, 3, (50, 6))
    states: Any = SimpleNamespace(n=50, q=q)

    def moved(column: Column) -> np.ndarray:
        values = compute_basis_values(column.terms, states, arm, 20.0, np.zeros(39))
        return values @ [term.coefficient for term in column.terms]

    signature = 3.0 * moved(own.columns[0]) + 4.0 * moved(own.columns[1])
    expected = np.sqrt(2.0) * signature * np.sin(q[:, 1])
    np.testing.assert_allclose(moved(shape.columns[0]), expected)
    assert {column.prior_sd for column in shape.columns} == {SHAPE_OFF}
    assert make_shape(shape, np.ones(4), 6) is None  # a shape has none of its own
    shifted = Candidate("geometry_shift", location.joint(2), own.columns[:1], ())
    assert make_shape(shifted, np.ones(1), 6) is None  # one number, whatever the angle
    tip = Candidate("tip_offset", location.TIP, own.columns, ())
    of_tip = make_shape(tip, np.ones(2), 6)
    assert of_tip is not None and of_tip.depends_on == ("q5", "q6")


def test_a_curve_is_its_harmonics_where_the_joint_stood_and_their_mean_elsewhere() -> None:
    columns = tuple(c for order in (3, 4) for c in make_harmonic_columns(2, order, 1.0))
    curve = Candidate("encoder_periodic", location.joint(2), columns, ("q2",))
    assert list_orders(curve) == [3, 4]
    values = np.array([1.0, -0.5, 0.3, 2.0])
    q = np.zeros((100, 6))
    q[:, 1] = np.linspace(0.5, 2.0, 100)
    term = as_curve(curve, values, q)
    (factor,) = term.basis
    assert isinstance(factor, Curve) and factor.joint == 2 and term.parameter == "theta_2"
    assert len(factor.values) == CURVE_POINTS
    orders = [(column.terms[0].basis[0], column.terms[0].coefficient) for column in columns]
    expected = np.zeros(100)
    for (wave, weight), value in zip(orders, values, strict=True):
        assert isinstance(wave, Harmonic)
        turn = np.sin if wave.kind == "sin" else np.cos
        expected += value * weight * turn(wave.order * q[:, 1])
    at = evaluate_curve(factor.values, q[:, 1])
    # Where the mean begins, a step, the spline swings by half a per cent of the curve.
    largest = np.abs(expected).max()
    np.testing.assert_allclose(at, expected, atol=5e-3 * largest)
    np.testing.assert_allclose(at[5:-5], expected[5:-5], atol=1e-4 * largest)
    unseen = np.array(factor.values)[200:300]
    assert np.ptp(unseen) == 0.0 and abs(unseen[0]) < np.abs(expected).max()


def test_a_rival_step_is_taken_nearest_to_the_instant_between_those_of_the_grid() -> None:
    def step(at: float, finest: bool = False) -> Candidate:
        return Candidate(
            "encoder_slip",
            location.joint(1),
            (Column("step", "rad", 1e-5),),
            ("time_s",),
            (("instant", at, "s (Unix)"),),
            refine=None
            if finest
            else lambda: [step(at + by, True) for by in (-40.0, -20.0, 20.0, 40.0)],
        )

    grid = [step(1000.0), step(1100.0), step(1200.0)]
    assert nearest(1083.0, grid).setting[0][1] == 1080.0
    assert nearest(1101.0, grid).setting[0][1] == 1100.0


def test_where_something_is_left_the_next_experiment_does_not_say_that_nothing_is() -> None:
    search = SimpleNamespace(
        facts=SimpleNamespace(timed=True, rates=True), untold=(), remaining_depends_on=("q3", "t3")
    )
    usual = {"search": search, "findings": (), "outliers": ()}
    left: Any = SimpleNamespace(**usual, significant_rest=True)
    assert propose_experiment(left).startswith("What is left goes with q3, t3")
    nothing: Any = SimpleNamespace(**usual, significant_rest=False)
    assert propose_experiment(nothing).startswith("Nothing significant is left to find")
