"""A real arm, diagnosed once; then something planted into what its encoders said."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import Calibration
from support.planting import ARC_SECOND, Effect, planted, rms_um, slip, wave


@pytest.fixture(scope="module")
def diagnosed(converted: Path) -> tuple[Arm, Calibration, Session]:
    """Series B: diagnosed on one half of its poses; the other half is what is measured since."""
    arm = load_arm(converted / "ur10" / "arm.toml")
    first = diagnose([load_session(converted / "ur10" / "B-train", arm)], arm)
    return arm, first.extended, load_session(converted / "ur10" / "B-heldout", arm)


def parts(
    since: Session, *effects: Effect, draw: int = 5
) -> tuple[list[Session], list[Session], Session]:
    """Two thirds to diagnose and the rest, effects planted into both; the rest as it was."""
    shown = np.random.default_rng(draw).permutation(since.n) < since.n * 2 // 3
    measured, fresh = (planted([since.rows(part)], *effects) for part in (shown, ~shown))
    return measured, fresh, since.rows(~shown)


def assert_mended(
    arm: Arm, fresh: list[Session], under: Calibration, extended: Calibration, healthy_um: float
) -> None:
    """Of the squares that an effect adds to the errors of readings, nine tenths go."""
    sick, mended = rms_um(fresh, arm, under), rms_um(fresh, arm, extended)
    assert sick**2 - mended**2 > 0.9 * (sick**2 - healthy_um**2)


def test_an_effect_is_in_what_is_diagnosed_and_in_what_is_held_out(converted: Path) -> None:
    """No reading in both, none lost, and nothing but the effect between planted and untouched."""
    arm = load_arm(converted / "ur10" / "arm.toml")
    since = load_session(converted / "ur10" / "B-heldout", arm)
    (measured,), (fresh,), untouched = parts(since, wave(1, 48.0, 4))
    instants = np.concatenate([measured.states.time_s, fresh.states.time_s])
    assert sorted(instants) == sorted(since.states.time_s) and len(set(instants)) == since.n
    change = (fresh.states.q - untouched.states.q) / ARC_SECOND
    expected = 48.0 * np.sin(4 * untouched.states.q[:, 0] - 0.4)
    assert np.allclose(change[:, 0], expected, atol=1e-6) and np.ptp(expected) > 48.0
    assert not change[:, 1:].any()


@pytest.mark.slow
def test_a_strong_wave_is_not_an_oval_disc_off_its_shape(
    diagnosed: tuple[Arm, Calibration, Session],
) -> None:
    """Four waves a turn, sixteen times the typical size, were an ellipticity with a shape of three
    times itself."""
    arm, extended, since = diagnosed
    measured, fresh, untouched = parts(since, wave(1, 48.0, 4))
    found = diagnose(measured, arm, extended)
    strongest = found.findings[0]
    assert strongest.candidate.place == ("encoder_periodic", "joint 1")
    assert ("order", 4.0, "1/turn") in strongest.candidate.setting
    assert strongest.probability > 0.95
    assert_mended(arm, fresh, extended, found.extended, rms_um([untouched], arm, extended))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(
    ("cause", "location"),
    [
        ("encoder_slip", "joint 3"),
        ("encoder_ellipticity", "joint 2"),
        ("geometry_shift", "joint 3"),
    ],
)
def test_a_real_arm_has_something_new(
    diagnosed: tuple[Arm, Calibration, Session], cause: str, location: str
) -> None:
    arm, extended, since = diagnosed
    moment = float(np.median(since.states.time_s))
    effects: dict[str, Effect] = {
        "encoder_slip": slip(3, 30.0, moment),
        "encoder_ellipticity": wave(2, 30.0, 2),
    }
    effect = [effects[cause]] if cause in effects else []
    under = extended
    if cause == "geometry_shift":  # all the same to the residuals: the calibration is off instead
        under = extended.model_copy(
            update={"constants": {**extended.constants, "a_3": extended.constants["a_3"] + 0.15}}
        )
    measured, fresh, untouched = parts(since, *effect)
    healthy = rms_um([untouched], arm, extended)
    found = diagnose(measured, arm, under)
    assert (cause, location) in [f.candidate.place for f in found.findings]
    assert_mended(arm, fresh, under, found.extended, healthy)
    assert max(gain.before_um - gain.after_um for gain in found.gains) > 1.0


@pytest.fixture(scope="module")
def seated(converted: Path) -> tuple[Arm, Calibration, Session]:
    """The Kinova, whose model misses its seats by 3 mm: one half of its readings, the other."""
    arm = load_arm(converted / "dinova_1" / "arm.toml")
    whole = load_session(converted / "dinova_1" / "seats", arm)
    one = np.random.default_rng(3).permutation(whole.n) < whole.n // 2
    first = diagnose([whole.rows(one)], arm)
    return arm, first.extended, whole.rows(~one)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "joint", "size", "order"),
    [("encoder_eccentricity", 4, 4000.0, 1), ("encoder_ellipticity", 2, 5400.0, 2)],
)
def test_a_degree_is_no_wonder_on_an_arm_of_degrees(
    seated: tuple[Arm, Calibration, Session], cause: str, joint: int, size: float, order: int
) -> None:
    """Over a hundred times what a fine arm's disc errs by.

    A third of readings that err by 3.4 mm tells the share of 2 mm that goes to a tenth; whether a
    mend is written may hang on the twelfth digit (a compiled library or none). So four random
    splits are pooled.
    """
    arm, extended, since = seated
    squares = []
    for draw in range(5, 9):
        measured, fresh, untouched = parts(since, wave(joint, size, order), draw=draw)
        found = diagnose(measured, arm, extended)
        assert [f.candidate.place for f in found.findings] == [(cause, f"joint {joint}")]
        if found.written:
            sessions = ((fresh, extended), (fresh, found.extended), ([untouched], extended))
            squares.append([rms_um(measured_since, arm, c) ** 2 for measured_since, c in sessions])
    assert len(squares) >= 3
    sick, mended, healthy = np.mean(squares, axis=0)
    assert sick - mended > 0.75 * (sick - healthy)
