"""Two tips in one session, or in two: which rows, how far, and nothing else is called so."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.identify.admission import find_second_group as module
from armd.compensation.identify.admission import group_fit
from armd.compensation.identify.admission.find_second_group import find_second_group
from armd.compensation.identify.admission.second_group import Differs, SecondGroup
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.identify.fit import Identification, fit
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model.terms import Term
from support import synthetic
from support.fitted import fit_constants
from support.selection import parametrize_default

ARM = synthetic.arm()
TRUTH = synthetic.disturbed(ARM, np.random.default_rng(11), 0.3)
MOVED_MM = np.array([5.6, 0.5, -5.6])
#: Rows of a session.
N = 120
#: Steel's or aluminium's growth of every length, per K.
GROWTH_PER_K = 23e-6
#: A fit to all readings, the whole fits of two causes, and each group alone.
MOST_FITS = 2 * group_fit.MOST_FITS + 2


def changed(**by: float) -> F64:
    constants = TRUTH.copy()
    for name, change in by.items():
        constants[ARM.layout.index(name)] += change
    return constants


OTHER_TIP = changed(**dict(zip(("tip_x", "tip_y", "tip_z"), MOVED_MM.tolist(), strict=True)))


def touched(constants: F64, name: str, seed: int = 5, **more: object) -> Session:
    rng = np.random.default_rng(seed)
    options = {"readings": N, "encoder_rad": 5e-6, **more}
    return synthetic.session(ARM, constants, rng, name=name, **options)  # type: ignore[arg-type]


def tracked(constants: F64, name: str = "S", seed: int = 3, n: int = N) -> Session:
    """Seen by a tracker with 10 µm of noise."""
    seen = synthetic.tracked(ARM, constants, np.random.default_rng(seed), readings=n)
    noise_mm = np.random.default_rng(seed + 100).normal(0.0, 0.01, seen.truth_mm.shape)
    return replace(seen, name=name, path=Path(name), truth_mm=seen.truth_mm + noise_mm)


def joined(one: Session, other: Session, rows: slice) -> Session:
    """*one*, with *rows* from *other* of the same artefact."""
    q, truth_mm = one.states.q.copy(), one.truth_mm.copy()
    q[rows], truth_mm[rows] = other.states.q[rows], other.truth_mm[rows]
    return replace(one, states=replace(one.states, q=q), truth_mm=truth_mm)


def half_tracked(constants: F64, rows: slice = slice(N // 2, None)) -> list[Session]:
    return [joined(tracked(TRUTH), tracked(constants), rows)]


def half_touched(constants: F64, **more: object) -> Session:
    one, other = (touched(values, "S", **more) for values in (TRUTH, constants))
    return joined(one, other, slice(N // 2, None))


def moved_base(by_mm: float, after: int, placements: int) -> list[Session]:
    """The truth of all rows *after* one lies elsewhere and is turned, in the artefact's frame."""
    seen = touched(TRUTH, "S", placements=placements) if placements else tracked(TRUTH)
    truth_mm = np.where(
        np.isfinite(seen.truth_mm), seen.truth_mm, seen.artefact.positions_mm()[seen.target]
    )
    turn = np.array([[1.0, -5e-4, 0.0], [5e-4, 1.0, 0.0], [0.0, 0.0, 1.0]])
    truth_mm[after:] = truth_mm[after:] @ turn.T + by_mm * np.array([0.6, 0.8, 0.0])
    return [replace(seen, truth_mm=truth_mm)]


def growth() -> list[Term]:
    drawn = ARM.nominal()
    return [
        term.model_copy(
            update={"coefficient": GROWTH_PER_K * drawn[ARM.layout.index(term.parameter)]}
        )
        for term in make_length_terms(ARM, [1])
    ]


def without_sensors(session: Session) -> Session:
    nothing = np.full_like(session.states.temperature_c, np.nan)
    return replace(session, states=replace(session.states, temperature_c=nothing))


def warm(name: str, celsius: float, known: bool) -> Session:
    seen = touched(TRUTH, name, terms=growth(), temperature_c=celsius)
    return seen if known else without_sensors(seen)


def warmed_up(known: bool) -> list[Session]:
    """One session, the second half of which is 20 K warmer."""
    cold, hot = warm("S", 15.0, True), warm("S", 35.0, True)
    one = joined(cold, hot, slice(N // 2, None))
    temperature_c = one.states.temperature_c.copy()
    temperature_c[N // 2 :] += 20.0
    one = replace(one, states=replace(one.states, temperature_c=temperature_c))
    return [one if known else without_sensors(one)]


def in_the_air(rows: Sequence[int]) -> list[Session]:
    (seen,) = moved_base(0.0, N, 3)
    seen.truth_mm[list(rows)] += 60.0
    return [seen]


def found_in(sessions: Sequence[Session]) -> SecondGroup | None:
    return find_second_group(sessions, fit_constants(collect_observations(sessions, ARM)))


def rows_of(group: SecondGroup) -> dict[str, list[int]]:
    return {one.path.name: list(one.rows) for one in group.sessions}


LATER = list(range(N // 2, N))
EVERY = list(range(N))
TWO_TIPS: dict[str, tuple[Callable[[], list[Session]], dict[str, list[int]]]] = {
    "half seen by a tracker": (lambda: half_tracked(OTHER_TIP), {"S": LATER}),
    "half on an artefact": (lambda: [half_touched(OTHER_TIP)], {"S": LATER}),
    "half on seats": (
        lambda: [half_touched(OTHER_TIP, known=False, distances=[(0, 1)])],
        {"S": LATER},
    ),
    "exchanged and back": (
        lambda: half_tracked(OTHER_TIP, slice(40, 75)),
        {"S": list(range(40, 75))},
    ),
    "the last ten rows": (
        lambda: half_tracked(OTHER_TIP, slice(110, None)),
        {"S": list(range(110, N))},
    ),
    "one of two sessions": (
        lambda: [touched(TRUTH, "S"), touched(OTHER_TIP, "U", 6)],
        {"U": EVERY},
    ),
    "half of one of three": (
        lambda: [touched(TRUTH, "R", 8), half_touched(OTHER_TIP), touched(TRUTH, "U", 6)],
        {"S": LATER},
    ),
    "every second of four": (
        lambda: [touched((TRUTH, OTHER_TIP)[k % 2], f"S{k}", k) for k in range(4)],
        {"S1": EVERY, "S3": EVERY},
    ),
    "in turn": (
        lambda: half_tracked(OTHER_TIP, slice(1, None, 2)),
        {"S": list(range(1, N, 2))},
    ),
}


@parametrize_default("case", TWO_TIPS)
def test_the_rows_of_another_tip_are_found_and_how_far_it_is(case: str) -> None:
    make, rows = TWO_TIPS[case]
    group = found_in(make())
    assert group is not None and group.differs is Differs.TIP
    assert rows_of(group) == rows
    # the last frame is the drawing's: up to 0.3° from the arm's own; a length knows no frame
    np.testing.assert_allclose(group.step_mm, MOVED_MM, atol=0.06)
    off_mm = abs(group.length_mm - np.linalg.norm(MOVED_MM))
    assert off_mm < 4 * group.length_uncertainty_mm < 0.05
    assert group.before_um > 1000.0 and group.after_um < 25.0  # the noise


def test_a_small_step_of_the_tip_is_found_above_the_noise() -> None:
    small = TRUTH + (OTHER_TIP - TRUTH) / 80.0
    group = found_in(half_tracked(small))
    assert group is not None and group.differs is Differs.TIP
    assert group.length_mm == pytest.approx(float(np.linalg.norm(MOVED_MM)) / 80.0, abs=0.01)


def test_the_uncertainty_of_a_late_group_is_that_of_its_readings() -> None:
    """It was 0 for a group that began after the first 200 rows."""
    (one, other) = (tracked(constants, n=400) for constants in (TRUTH, OTHER_TIP))
    group = found_in([joined(one, other, slice(300, None))])
    assert group is not None and rows_of(group) == {"S": list(range(300, 400))}
    least_mm = 0.01 / np.sqrt(100.0)  # 10 µm of noise in 100 readings of known place
    assert least_mm < group.length_uncertainty_mm < 3.0 * least_mm
    off_mm = abs(group.length_mm - np.linalg.norm(MOVED_MM))
    assert off_mm < 4.0 * group.length_uncertainty_mm


def test_readings_in_the_air_hide_no_tip() -> None:
    (session,) = half_tracked(OTHER_TIP)
    session.truth_mm[[3, 90]] += 100.0
    group = found_in([session])
    assert group is not None and rows_of(group) == {"S": LATER}


NO_TIP: dict[str, Callable[[], list[Session]]] = {
    "in order": lambda: [touched(TRUTH, "S"), touched(TRUTH, "U", 6)],
    "in order, by a tracker": lambda: [tracked(TRUTH)],
    "in the air": lambda: in_the_air([7, 50]),
    "six in the air, one after another": lambda: in_the_air(range(60, 66)),
    "another arm": lambda: [
        touched(TRUTH, "S"),
        touched(synthetic.disturbed(ARM, np.random.default_rng(77), 0.3), "U", 6),
    ],
    "a joint knocked": lambda: half_tracked(changed(theta_5=0.02)),
    "the last joint's zero": lambda: half_tracked(changed(theta_6=0.02)),
    "play in the last joint": lambda: half_tracked(changed(theta_6=0.01), slice(1, None, 2)),
    "warmer, no sensors": lambda: [warm("S", 15.0, False), warm("U", 35.0, False)],
    "warmer": lambda: [warm("S", 15.0, True), warm("U", 35.0, True)],
    "warmed up, no sensors": lambda: warmed_up(False),
    "warmed up": lambda: warmed_up(True),
}


@pytest.mark.parametrize("case", NO_TIP)
def test_nothing_else_is_called_another_tip(case: str) -> None:
    assert found_in(NO_TIP[case]()) is None


@pytest.mark.parametrize(("by_mm", "after", "placements"), [(2.0, 60, 0), (2.0, 80, 1)])
def test_a_base_that_moved_is_called_so(by_mm: float, after: int, placements: int) -> None:
    group = found_in(moved_base(by_mm, after, placements))
    assert group is not None and group.differs is Differs.PLACE
    assert rows_of(group) == {"S": list(range(after, N))}
    assert "another tip" not in group.in_words() and "base stood" in group.in_words()
    assert group.after_um < 25.0


def test_the_search_costs_a_few_fits_and_none_in_good_order(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fits: list[int] = []

    def counted(*values: object, **more: object) -> Identification:
        fits.append(1)
        return fit(*values, **more)  # type: ignore[arg-type]

    monkeypatch.setattr(module, "fit", counted)
    monkeypatch.setattr(group_fit, "fit", counted)
    assert found_in([tracked(TRUTH)]) is None and not fits
    assert found_in(half_tracked(OTHER_TIP)) is not None and len(fits) <= MOST_FITS


def test_the_certificate_names_it_and_guesses_nothing_else() -> None:
    result = calibrate(half_tracked(OTHER_TIP), ARM)
    certificate = result.certificate
    assert not certificate.granted
    assert "rows 61 to 120 of session S: measured with another tip" in certificate.reason
    assert "no set of constants" not in certificate.reason and "play" not in certificate.reason
    assert "delete rows 61 to 120 of session S or put" in certificate.next_step
    assert result.as_json()["second_group"]["sessions"] == [
        {"session": "S", "rows": [row + 1 for row in LATER]}
    ]


@pytest.mark.slow
def test_a_tip_is_not_taken_for_growth_where_its_session_is_warmer() -> None:
    """8 mm in 6 K are no growth: the thermal model took them up, and the certificate was granted
    with 14 µm on placements left out."""
    both = [
        touched(constants, name, seed, terms=growth(), temperature_c=celsius)
        for name, constants, seed, celsius in (
            ("S", TRUTH, 5, 20.0), ("U", OTHER_TIP, 6, 26.0),
        )
    ]  # fmt: skip
    certificate = calibrate(both, ARM).certificate
    assert not certificate.granted
    assert "session U: measured with another tip than the 120 other readings" in certificate.reason


def test_a_tip_that_grows_as_it_may_is_none() -> None:
    both = [
        touched(TRUTH, name, seed, terms=growth(), temperature_c=celsius)
        for name, seed, celsius in (("S", 5, 14.0), ("U", 6, 32.0))
    ]
    result = calibrate(both, ARM)
    assert result.certificate.granted and result.second_group is None
    assert result.as_json()["second_group"] is None


@pytest.mark.slow
def test_of_two_sessions_one_is_calibrated_alone() -> None:
    certificate = calibrate([touched(TRUTH, "S"), touched(OTHER_TIP, "U", 6)], ARM).certificate
    assert "session U: measured with another tip than the 120 other readings" in certificate.reason
    (command,) = re.findall("`(.*)`", certificate.next_step)
    assert command.startswith("armd calibrate S --arm ")
