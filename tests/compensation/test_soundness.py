"""Readings as they are written down in a workshop: what is mended, and that it is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.data.soundness.soundness import fit_to_identify, make_sound
from armd.compensation.diagnose.heldout.gain import compute_gain, limit_squares
from armd.compensation.diagnose.noise.variances import clip_gross
from armd.compensation.diagnose.problem.whitening import RestNoise
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model.arm import Arm
from support import synthetic

ARM = synthetic.arm()


def sessions(arm: Arm = ARM, count: int = 3) -> list[Session]:
    """Sessions four hours and three kelvin apart, in one of which it gets warmer."""
    found = []
    for i in range(count):
        rng = np.random.default_rng([7, i])
        one = synthetic.session(arm, arm.nominal(), rng, readings=30, name=f"session-{i + 1}")
        celsius = 18.0 + 3.0 * i + 0.01 * np.round(rng.normal(0.0, 2.0, (30, arm.n_joints)))
        celsius[:, :] += np.linspace(0.0, 4.0 * (i == 1), 30)[:, None]
        time_s = one.states.time_s[0] + 4 * 3600.0 * i + 20.0 * np.arange(30)
        found.append(replace(one, states=replace(one.states, temperature_c=celsius, time_s=time_s)))
    return found


def with_channel(session: Session, channel: int, values: np.ndarray | float) -> Session:
    celsius = session.states.temperature_c.copy()
    celsius[:, channel] = values
    return replace(session, states=replace(session.states, temperature_c=celsius))


def with_times(session: Session, time_s: np.ndarray) -> Session:
    return replace(session, states=replace(session.states, time_s=time_s))


def test_sound_sessions_stay_as_they_are() -> None:
    given = sessions()
    sound = make_sound(given, ARM)
    assert sound.remarks == ()
    assert sound.arm is ARM
    for before, after in zip(given, sound.sessions, strict=True):
        assert after is before


def test_rows_that_stand_twice_count_once_and_keep_their_numbers() -> None:
    one, *others = sessions()
    again = one.rows(np.array([*range(30), 4, 11]))
    again = replace(again, row=np.arange(32))
    sound = make_sound([again, *others], ARM)
    assert sound.sessions[0].n == 30
    assert list(sound.sessions[0].row) == list(range(30))
    (told,) = sound.remarks
    assert "session-1: 2 of 32 rows" in told and "row 31" in told


@pytest.mark.parametrize(
    ("values", "words"),
    [(np.nan, "has no value"), (85.0, "shows 85 °C"), (20.0, "shows 20 °C")],
)
def test_a_channel_that_shows_nothing_is_dropped_with_what_depends_on_it(
    values: float, words: str
) -> None:
    given = [with_channel(s, 2, values) for s in sessions()]
    sound = make_sound(given, ARM)
    (told,) = sound.remarks
    assert words in told and "Sensor t3" in told and "link 3" in told and "all sessions" in told
    for session in sound.sessions:
        assert session.lost == ("t3",) and session.lost_links == (3,)
        others = np.delete(session.states.temperature_c, 2, axis=1).mean(axis=1)
        np.testing.assert_allclose(session.states.temperature_c[:, 2], others)
    # Nothing live may ask a dead sensor: the link follows the others, in equal parts.
    weights = sound.arm.joint[2].weights
    assert "t3" not in weights
    assert sum(weights.values()) == pytest.approx(1.0)


def test_a_channel_that_stuck_half_way_is_lost_from_that_session_on_only() -> None:
    first, second, third = sessions()
    stuck = second.states.temperature_c[:, 2].copy()
    stuck[10:] = stuck[10]
    given = [first, with_channel(second, 2, stuck), with_channel(third, 2, stuck[10])]
    sound = make_sound(given, ARM)
    assert [s.lost for s in sound.sessions] == [(), ("t3",), ("t3",)]
    assert sound.sessions[0] is first
    assert sound.arm is ARM  # its own sensor was there when it was identified


def test_coarse_and_steady_channels_are_alive() -> None:
    """Steps of 0.0625 K in a room that keeps its temperature: hours of one value."""
    given = [
        replace(
            s,
            states=replace(
                s.states, temperature_c=np.round((20.0 + 0.2 * i + 0 * s.states.q) * 16) / 16
            ),
        )
        for i, s in enumerate(sessions())
    ]
    assert make_sound(given, ARM).remarks == ()


def test_a_clock_set_back_goes_on_and_sessions_that_overlap_are_told() -> None:
    first, second, third = sessions()
    time_s = second.states.time_s.copy()
    time_s[15:] -= 3600.0
    set_back = replace(with_times(second, time_s), placement=np.zeros(30, dtype=np.int64))
    sound = make_sound([first, set_back, third], ARM)
    assert (np.diff(sound.sessions[1].states.time_s) > 0).all()
    (told,) = sound.remarks
    assert "session-2: at row 16 the clock runs back by 60 min" in told

    late = with_times(third, third.states.time_s - 4 * 3600.0 + 300.0)
    (told,) = make_sound([first, second, late], ARM).remarks
    assert "session-3 begins" in told and "before session-2 ends" in told

    exchanged = (
        with_times(first, third.states.time_s),
        second,
        with_times(third, first.states.time_s),
    )
    assert all("was measured before" in told for told in make_sound(exchanged, ARM).remarks)


def test_gross_errors_neither_pull_the_fit_nor_count_as_noise() -> None:
    """Three in a hundred rests, a hundred times as far off as the others."""
    rng = np.random.default_rng(5)
    n, columns = 200, rng.normal(size=(600, 20))
    truth = rng.normal(size=20)
    residual = columns @ truth + rng.normal(size=600)
    gross = rng.choice(n, 6, replace=False)
    residual.reshape(n, 3)[gross] += 100.0 * rng.choice([-1.0, 1.0], (6, 3))

    def fit(some: np.ndarray, _: RestNoise) -> np.ndarray:
        return columns @ np.linalg.lstsq(columns, some, rcond=None)[0]

    # As a first estimate makes of it: ten times too wide.
    noise = RestNoise(17.0, 0.0, 0.0, 0.0, 17.0, np.tile(np.eye(3) / 17.0, (n, 1, 1)), np.empty(0))
    clipped = clip_gross(residual, noise, fit)
    assert np.std(clipped - columns @ truth) < 1.1
    assert np.abs(fit(clipped, noise) - columns @ truth).max() < 1.0


def test_gross_errors_do_not_outvote_all_other_readings() -> None:
    rng = np.random.default_rng(6)
    groups = np.repeat(np.arange(60), 5)
    before = 1.5 * rng.chisquare(3, 300)
    after = before / 1.5
    after[::40] = before[::40] = 1e4 * rng.uniform(0.5, 1.5, 8)
    after[::40] *= 1.0 + 0.01 * rng.normal(size=8)
    assert compute_gain(*limit_squares(before, after), groups).is_confirmed
    assert not compute_gain(*limit_squares(before, before[::-1]), groups).is_confirmed


def test_calibrate_takes_no_still_channel_for_a_temperature() -> None:
    given = sessions()
    one = [with_channel(given[0], 2, 85.0), *given[1:]]
    sound = fit_to_identify(one, ARM)
    assert sound.arm is ARM
    assert np.isnan(sound.sessions[0].states.temperature_c[:, 2]).all()
    assert sound.sessions[1] is given[1]
    (told,) = sound.remarks
    assert "session-1" in told
    none = fit_to_identify([with_channel(s, 2, 21.3) for s in given], ARM)
    others = [name for name in ARM.sensors if name != ARM.sensors[2]]
    assert none.arm.joint[2].weights == pytest.approx(dict.fromkeys(others, 1 / len(others)))
    gaps = np.where(np.arange(30) % 5 == 0, np.nan, given[0].states.temperature_c[:, 2])
    assert fit_to_identify([with_channel(given[0], 2, gaps), *given[1:]], ARM).remarks == ()


@pytest.mark.parametrize("stuck_at", [21.3, np.nan])
def test_calibrate_keeps_the_other_sensors_of_an_arm(stuck_at: float) -> None:
    """One dead channel of six; all links expand, by 20 µm a metre and kelvin."""
    terms = [
        term.model_copy(
            update={"coefficient": 2e-5 * ARM.nominal()[ARM.layout.index(term.parameter)]}
        )
        for term in make_length_terms(ARM, [1])
    ]
    measured = []
    for i, celsius in enumerate((14.0, 20.0, 26.0)):
        rng = np.random.default_rng([8, i])
        one = synthetic.session(
            ARM, ARM.nominal(), rng, terms=terms, readings=90, temperature_c=celsius,
            encoder_rad=3e-6, name=f"session-{i + 1}",
        )  # fmt: skip
        measured.append(with_channel(one, 2, stuck_at))
    result = calibrate(measured, ARM)
    assert result.thermal_order == 1
    assert any(ARM.sensors[2] in note for note in result.notes)
    assert result.heldout.rms_um < 6.0  # 12 with the stuck one as it stands, or without any


@pytest.mark.slow
def test_a_table_pasted_twice_calibrates_no_better() -> None:
    """Copies scatter no more than their originals, and know no more."""
    given = sessions()
    twice = [one.rows(np.tile(np.arange(one.n), 2)) for one in given]
    once, again = calibrate(given, ARM), calibrate(twice, ARM)
    assert again.fit.observations.n == once.fit.observations.n
    assert again.fit.covariance == pytest.approx(once.fit.covariance)
    assert sum("stand there twice" in note for note in again.notes) == len(given)
