"""What is another in each session, against plain values session by session."""

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.effects import location
from armd.compensation.effects.by_session import (
    LEAST_SESSIONS,
    as_written,
    compute_values_by_session,
    is_by_session,
    make_session_functions,
)
from armd.compensation.effects.courses import is_drift
from armd.compensation.effects.effect import Candidate, Column, SessionFacts
from armd.compensation.effects.mechanical.geometry_shift import EFFECT as SHIFT
from armd.compensation.effects.setup.tip_offset import EFFECT as TIP
from armd.compensation.effects.unknown import remove_name
from support.whole_scene import whole_scene

HOUR_S = 3600.0
NAMES = ("monday", "tuesday, early", "tuesday, late", "friday")
VALUES = np.array([0.0, 21.0, 1.0, 24.0])
AFTER_H = 5.0  # of the last reading
WEIGHT = -0.5


@pytest.fixture(scope="module", params=["held", "free"])
def facts(request: pytest.FixtureRequest) -> SessionFacts:
    """Four sessions of two hours each, ten hours apart."""
    own = getattr(whole_scene(), request.param)
    start_s = own.start_unix_s
    begin = [start_s + 10.0 * HOUR_S * k for k in range(4)]
    sessions = tuple(
        (name, since, since + 2 * HOUR_S) for name, since in zip(NAMES, begin, strict=True)
    )
    return replace(own, sessions=sessions, end_unix_s=sessions[-1][2])


def within(facts: SessionFacts) -> np.ndarray:
    """(4, 3) three moments of each session: its first and last reading, and between."""
    return np.array([[since, (since + until) / 2, until] for _, since, until in facts.sessions])


def candidate(facts: SessionFacts) -> Candidate:
    columns = tuple(
        Column(f"z, {f.name}", "mm", 1.0, f.terms([("tip_z", WEIGHT)]))
        for f in make_session_functions(facts)
    )
    return Candidate("any", location.TIP, columns, ("time_s",))


def amplitudes(facts: SessionFacts) -> np.ndarray:
    """That make it VALUES: of each session by itself, or less the mean of those before."""
    if facts.has_fixed_constants:
        return VALUES
    return np.array([VALUES[k] - VALUES[:k].mean() for k in (1, 2, 3)])


def at(terms: object, time_s: np.ndarray) -> np.ndarray:
    return sum(term.coefficient * term.basis[0].evaluate_at_times(time_s) for term in terms)


def test_every_session_may_have_a_value_of_its_own_and_nothing_is_left_afterwards(
    facts: SessionFacts,
) -> None:
    own, times = candidate(facts), within(facts)
    told = VALUES if facts.has_fixed_constants else VALUES - VALUES.mean()
    moved = sum(
        amplitude * at(column.terms, times)
        for column, amplitude in zip(own.columns, amplitudes(facts), strict=True)
    )
    np.testing.assert_allclose(moved, WEIGHT * np.repeat(told[:, None], 3, axis=1), atol=1e-12)
    later = np.array([facts.end_unix_s + AFTER_H * HOUR_S])
    assert [float(at(column.terms, later)[0]) for column in own.columns] == pytest.approx(
        [0.0] * len(own.columns), abs=1e-12
    )


def test_no_session_is_likelier_to_stand_otherwise_than_another(facts: SessionFacts) -> None:
    """Divided by their sizes, functions of unit amplitudes are a rotation of the sessions', less
    their mean where constants have that."""
    functions = make_session_functions(facts)
    rows = np.array(
        [
            sum(share * factor.evaluate_at_times(within(facts)[:, 1]) for share, factor in f.pieces)
            / f.largest
            for f in functions
        ]
    )
    np.testing.assert_allclose(rows @ rows.T, np.eye(len(functions)), atol=1e-12)
    mean = rows.sum(axis=1)
    assert facts.has_fixed_constants or np.abs(mean).max() < 1e-12


def test_the_values_are_told_by_the_sessions_names(facts: SessionFacts) -> None:
    told, against = compute_values_by_session(candidate(facts), amplitudes(facts))
    first = 0 if facts.has_fixed_constants else 1
    assert [name for name, _ in told] == list(NAMES[first:])
    assert np.concatenate([own for _, own in told]) == pytest.approx((VALUES - VALUES[0])[first:])
    assert against == ("the calibration" if facts.has_fixed_constants else "the first session")


def test_written_constants_are_a_given_calibrations_or_the_middle_sessions(
    facts: SessionFacts,
) -> None:
    """0, 1, 21 and 24: the middle is between 1 and 21, the mean at 11.5."""
    own, values = candidate(facts), amplitudes(facts)
    (written,) = as_written(own, values, "any tip")
    constant = float(written.constant @ values)
    usual = 0.0 if facts.has_fixed_constants else 11.0 - 11.5
    assert written.parameter == "tip_z"
    assert constant == pytest.approx(WEIGHT * usual)
    told = VALUES if facts.has_fixed_constants else VALUES - VALUES.mean()
    moved = constant + at(written.terms, within(facts))
    np.testing.assert_allclose(moved, WEIGHT * np.repeat(told[:, None], 3, axis=1), atol=1e-12)
    later = np.array([facts.end_unix_s + AFTER_H * HOUR_S])
    assert constant + at(written.terms, later) == pytest.approx(WEIGHT * usual)
    assert len(written.terms) == len(NAMES) + 1


def test_columns_with_other_names_write_the_same(facts: SessionFacts) -> None:
    """A finding without a name calls its columns by the parameters that they move."""
    own, values = candidate(facts), amplitudes(facts)
    renamed = remove_name(own, replace(own, cause="unknown"))
    assert renamed.columns[0].name != own.columns[0].name
    (expected,), (written,) = as_written(own, values, "any"), as_written(renamed, values, "any")
    np.testing.assert_array_equal(written.constant, expected.constant)
    assert written.terms == expected.terms


def test_sessions_in_folders_of_one_name_are_listed_one_by_one(facts: SessionFacts) -> None:
    alike = [("measured", since, until) for _, since, until in facts.sessions]
    facts = replace(facts, sessions=tuple(alike))
    told, _ = compute_values_by_session(candidate(facts), amplitudes(facts))
    first = 0 if facts.has_fixed_constants else 1
    assert [name for name, _ in told] == ["measured"] * (4 - first)
    assert np.concatenate([own for _, own in told]) == pytest.approx((VALUES - VALUES[0])[first:])
    (along, _) = (c for c in TIP.candidates(facts) if is_by_session(c))
    assert "measured" in TIP.describe(along, np.zeros(len(along.columns)))


def test_two_sessions_are_a_step(facts: SessionFacts) -> None:
    assert (
        make_session_functions(replace(facts, sessions=facts.sessions[: LEAST_SESSIONS - 1])) == []
    )


def test_the_tip_along_the_stylus_is_told_in_words(facts: SessionFacts) -> None:
    """A drift, a step and a constant of the tip are not of this kind."""
    found = [c for c in TIP.candidates(facts) if is_by_session(c)]
    one, free = sorted(found, key=lambda c: len(c.columns))
    assert not any(map(is_drift, found))
    assert len(free.columns) == 3 * len(one.columns)
    lengths = [np.linalg.norm([t.coefficient for t in column.terms[:3]]) for column in one.columns]
    whole = [abs(column.terms[0].coefficient) for column in free.columns[::3]]
    assert lengths == pytest.approx(whole)
    said = TIP.describe(one, 1e-3 * amplitudes(facts))
    assert "along the stylus" in said
    assert "tuesday, early +21 µm, tuesday, late +1 µm, friday +24 µm against" in said
    far = np.zeros((len(free.columns) // 3, 3))
    far[:, 1] = -1e-3 * amplitudes(facts)
    assert "friday 24 µm against" in TIP.describe(free, far.ravel())


def test_a_zero_found_anew_before_each_session_is_told_in_words(facts: SessionFacts) -> None:
    """Of every joint but the last, whose zero moves the tip in its frame; in seconds of arc."""
    found = [c for c in SHIFT.candidates(facts) if is_by_session(c)]
    assert [str(c.location) for c in found] == [f"joint {k}" for k in range(1, 6)]
    said = SHIFT.describe(found[2], amplitudes(facts) * np.radians(1.0 / 3600.0))
    assert "the zero of joint 3 is another in each session" in said
    assert "tuesday, early +21″, tuesday, late +1.0″, friday +24″ against" in said
