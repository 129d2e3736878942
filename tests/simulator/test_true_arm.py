"""The true arm's physics against hand calculations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects import (
    BendingLink,
    BowingLink,
    Distorted,
    EccentricDisc,
    Effect,
    ExpandingLink,
    Interpolation,
    LateLatch,
    LostIndex,
    MovingMount,
    OvalDisc,
    Play,
    SoftJoint,
    StretchedTape,
    WarmHousing,
    WobblingAxis,
)
from armd.simulator.truth.effects.effect import GRAVITY, Conditions, Masses
from armd.simulator.truth.heat import CAPACITY, SENSOR_LAG_S, TO_AIR, HeatField
from armd.simulator.truth.nominal import SELF_HEATING_W
from armd.simulator.truth.rotations import ARC_SECOND

DRAWN = TrueArm.default(deviation=0.0)
STRETCHED = np.zeros((1, 6))  # upper arm and forearm level, along x


def angle_error(effect: Effect, joint: int, phi: np.ndarray, **conditions: float) -> np.ndarray:
    """What the encoder of *joint* adds, in ″, with the joint at *phi*."""
    poses = np.zeros((len(phi), 6))
    poses[:, joint - 1] = phi
    still = Conditions.at_rest(len(phi), 6, **conditions)
    shown = DRAWN.with_effects(effect).encoder_angles(poses, still)
    assert np.array_equal(np.delete(shown, joint - 1, 1), np.delete(poses, joint - 1, 1))
    return (shown - poses)[:, joint - 1] / ARC_SECOND


def moved(effect: Effect, phi: np.ndarray, conditions: Conditions | None = None) -> np.ndarray:
    """Displacement of the tip by *effect*, mm."""
    conditions = conditions or Conditions.at_rest(len(phi), 6)
    return DRAWN.with_effects(effect).tip(phi, conditions) - DRAWN.tip(phi, conditions)


def test_the_drawing_arm_reaches_where_the_drawing_says() -> None:
    # Level: 520 + 460 + 120 + 110 along x; shoulder 130 aside; elbow's 40 and the tip's 45 up.
    tip = DRAWN.tip(STRETCHED, Conditions.at_rest(1, 6))
    assert tip == pytest.approx(np.array([[1210.0, -130.0, 280.0 + 40.0 + 45.0]]), abs=1e-9)


def test_an_arm_differs_from_its_drawing_by_tenths_and_hundredths() -> None:
    off = np.array([TrueArm.default(seed).rows - nominal.list_nominal_rows() for seed in range(50)])
    assert off[:, :, 1:3].std() == pytest.approx(0.3, rel=0.1)
    assert np.degrees(off[:, :, [0, 3]].std()) == pytest.approx(0.05, rel=0.1)


def test_a_link_grows_by_alpha_l_delta_t() -> None:
    warm = Conditions.at_rest(1, 6, link_c=np.array([20.0, 30.0, 20.0, 20.0, 20.0, 20.0]))
    grown = (DRAWN.tip(STRETCHED, warm) - DRAWN.tip(STRETCHED, Conditions.at_rest(1, 6)))[0]
    per_k = (130 * 23e-6 + 390 * 0.5e-6) / 520
    assert grown[0] == pytest.approx(520 * per_k * 10, rel=1e-9)
    assert grown[1] == pytest.approx(-130 * 23e-6 * 10, rel=1e-9)  # the shoulder's housing
    extra = moved(ExpandingLink(2, 4e-6), STRETCHED, warm)[0]
    assert extra[0] == pytest.approx(520 * 4e-6 * 10, rel=1e-4)


def test_eccentricity_is_412_arc_seconds_for_a_micrometre_on_a_millimetre() -> None:
    phi = np.linspace(-np.pi, np.pi, 721)
    error = angle_error(EccentricDisc(3, offset_um=2.0, direction=0.7), 3, phi)
    assert error.max() == pytest.approx(412.5 * 2.0 / 50.0, rel=1e-3)
    assert phi[error.argmax()] == pytest.approx(np.pi / 2 - 0.7, abs=0.01)
    # Half a millimetre is no longer a pure sine: the exact bearing has a second harmonic.
    strong = angle_error(EccentricDisc(3, 500.0, 0.0), 3, phi[:-1]) * ARC_SECOND
    second = 2 * np.mean(strong * np.sin(2 * phi[:-1]))
    assert second == pytest.approx((0.5 / 25.0) ** 2 / 2, rel=1e-3)


def test_an_oval_disc_errs_twice_a_turn() -> None:
    phi = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    error = angle_error(OvalDisc(2, 3.0, 0.4), 2, phi)
    spectrum = np.abs(np.fft.rfft(error)) / len(phi) * 2
    assert spectrum.argmax() == 2
    assert spectrum[2] == pytest.approx(3.0, rel=1e-3)
    assert np.delete(spectrum, 2).max() < 1e-3


def test_interpolation_errs_once_a_period() -> None:
    phi = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    spectrum = np.abs(np.fft.rfft(angle_error(Interpolation(1, 7, 2.0, 0.1), 1, phi))) / 360
    assert spectrum.argmax() == 7
    assert spectrum[7] == pytest.approx(2.0, rel=1e-3)


def test_a_distorted_shape_is_off_by_its_share() -> None:
    phi = np.linspace(-np.pi, np.pi, 720, endpoint=False)
    plain = EccentricDisc(3, 2.0, 0.7)
    off = angle_error(Distorted(plain, 0.3, 3, 0.4), 3, phi) - angle_error(plain, 3, phi)
    assert np.sqrt(np.mean(off**2)) == pytest.approx(0.3 * 16.5 / np.sqrt(2), rel=1e-3)


def test_a_tape_a_step_a_delay_and_a_warm_bracket() -> None:
    phi = np.array([-1.0, 0.5, 2.0])
    assert angle_error(StretchedTape(4, 5.0), 4, phi) == pytest.approx(5.0 * phi, rel=1e-4)
    assert angle_error(WarmHousing(5, 0.5), 5, phi, link_c=26.0) == pytest.approx(3.0, rel=1e-6)
    timed = Conditions.at_rest(3, 6)
    timed.time_s[:] = 0.0, 10.0, 20.0
    timed.rate[:, 0] = 0.1, 0.0, -1.0
    poses = np.zeros((3, 6))
    slipped = DRAWN.with_effects(LostIndex(1, 15.0, 10.0)).encoder_angles(poses, timed)
    assert slipped[:, 0] / ARC_SECOND == pytest.approx([0.0, 15.0, 15.0])
    late = DRAWN.with_effects(LateLatch(1, 80.0)).encoder_angles(poses, timed)
    assert late[:, 0] == pytest.approx([8e-6, 0.0, -8e-5])


def test_play_moves_the_tip_against_the_motion() -> None:
    conditions = Conditions.at_rest(2, 6)
    conditions.rate[:, 0] = 0.01, -0.01
    aside = moved(Play(1, 2.0), np.zeros((2, 6)), conditions)[:, 1]
    assert aside == pytest.approx([-1210 * 2 * ARC_SECOND, 1210 * 2 * ARC_SECOND], rel=1e-6)


def test_the_shoulder_carries_what_hangs_on_it() -> None:
    posture = DRAWN.posture(STRETCHED, Conditions.at_rest(1, 6))
    # Centres of mass of links 2 … 6 along x from the shoulder, m.
    levers = np.array([0.25, 0.55, 0.77, 1.0, 1.08])
    weights = GRAVITY * np.array([1.7, 0.9, 1.1, 0.5, 0.4])
    assert posture.torque(2)[0] == pytest.approx(-(weights * levers).sum(), rel=1e-9)
    loaded = DRAWN.with_payload(0.5).posture(STRETCHED, Conditions.at_rest(1, 6))
    more = loaded.torque(2)[0] - posture.torque(2)[0]
    assert more == pytest.approx(-0.5 * GRAVITY * 1.21, rel=1e-9)
    sag = moved(SoftJoint(2, 6e-6), STRETCHED)[0, 2]
    assert sag == pytest.approx(6e-6 * posture.torque(2)[0] * 1210.0, rel=1e-4)
    # Straight up nothing turns the shoulder except what stands off the line.
    upright = np.array([[0.0, np.pi / 2, 0.0, 0.0, 0.0, 0.0]])
    assert abs(DRAWN.posture(upright, Conditions.at_rest(1, 6)).torque(2)[0]) < 1.5


def test_a_link_sags_like_a_cantilever() -> None:
    """F L³/3EI for an end load, w L⁴/8EI for its own weight; slopes F L²/2EI and w L³/6EI."""
    flexibility, length = 8e-6, np.hypot(0.52, 0.13)  # L/EI in rad/Nm, m
    masses = DRAWN.masses
    rows = DRAWN.rows.copy()
    rows[2:, 1:3] = 0.0  # everything after the upper arm shrunk to its end: the tip is there
    weightless = Masses(np.zeros(6), masses.centre_mm)
    only_link = replace(weightless, kg=np.array([0.0, 1.7, 0.0, 0.0, 0.0, 0.0]))
    bare = replace(DRAWN, rows=rows, tip_offset=np.zeros(3), masses=only_link)
    sag = moved_by(bare, BendingLink(2, flexibility), STRETCHED)
    weight = 1.7 * GRAVITY
    assert sag[2] == pytest.approx(-1e3 * flexibility * weight * length**2 / 8, rel=1e-6)
    loaded = replace(bare, masses=replace(weightless, payload_kg=2.0))
    sag = moved_by(loaded, BendingLink(2, flexibility), STRETCHED)
    assert sag[2] == pytest.approx(-1e3 * flexibility * 2 * GRAVITY * length**2 / 3, rel=1e-6)
    # Held at the end of a lever in line with the beam, the weight adds its moment there, and the
    # slope carries the lever: (F L²/3 + F L l + F l²) L/EI.
    lever = 0.3
    posture = bare.posture(STRETCHED, Conditions.at_rest(1, 6))
    along = (posture.origin[2] - posture.origin[1])[0] / (1e3 * length)
    in_tip_frame = posture.rotation[-1][0].T @ along
    in_line = replace(loaded, tip_offset=1e3 * lever * in_tip_frame)
    sag = moved_by(in_line, BendingLink(2, flexibility), STRETCHED)
    expected = length**2 / 3 + length * lever + lever**2
    assert sag[2] == pytest.approx(-1e3 * flexibility * 2 * GRAVITY * expected, rel=1e-5)


def moved_by(arm: TrueArm, effect: Effect, phi: np.ndarray) -> np.ndarray:
    still = Conditions.at_rest(len(phi), 6)
    return (arm.with_effects(effect).tip(phi, still) - arm.tip(phi, still))[0]


def test_a_bowed_link_is_an_arc() -> None:
    warm = Conditions.at_rest(1, 6)
    warm.link_c[0, 3] += 2.0  # the forearm is 2 K warmer than the wrist
    # Forearm of 0.46 m, curvature 1.2e-4 rad/m/K: its end turns by κL and shifts by κL²/2.
    turn = 1.2e-4 * 2.0 * 0.46
    shift = np.linalg.norm(moved(BowingLink(4, 5, 1.2e-4, 0.3), STRETCHED, warm))
    beyond = np.array([230.0, 45.0])  # wrist and tip, along and across the forearm
    assert 0.5 * turn * 460 + turn * beyond[0] - turn * beyond[1] < shift
    assert shift < 0.5 * turn * 460 + turn * np.linalg.norm(beyond) + 1e-3
    assert not moved(BowingLink(4, 5, 1.2e-4, 0.3), STRETCHED).any()


@pytest.mark.parametrize("order", [1, 2])
def test_a_wobbling_axis_tilts_by_its_amplitude(order: int) -> None:
    phi = np.zeros((360, 6))
    phi[:, 0] = np.radians(np.arange(360))
    tilt = WobblingAxis(1, 3.0, 0.0, order, 0.2, 0.0)
    up = moved(tilt, phi)[:, 2]
    x, y, _ = DRAWN.tip(phi, Conditions.at_rest(360, 6)).T
    at = order * phi[:, 0] + 0.2
    lean = (np.cos(at) * y, np.cos(at) * y - np.sin(at) * x)[order - 1]
    assert up == pytest.approx(3 * ARC_SECOND * lean, abs=1e-7)
    run_out = np.linalg.norm(moved(WobblingAxis(1, 0.0, 5.0, order, 0.2, 0.0), phi), axis=1)
    assert run_out.max() == pytest.approx(5e-3, rel=1e-3)
    if order == 2:  # the axis circles: the same distance off everywhere
        assert run_out.min() == pytest.approx(5e-3, rel=1e-3)


def test_the_mount_creeps_or_steps() -> None:
    conditions = Conditions.at_rest(2, 6)
    conditions.time_s[:] = 0.0, 3600.0
    poses = np.zeros((2, 6))
    creep = moved(MovingMount((0.0, 0.0, 3.0), (0.0, 0.0, 5.0)), poses, conditions)
    assert not creep[0].any()
    assert creep[1] == pytest.approx([130 * 3 * ARC_SECOND, 1210 * 3 * ARC_SECOND, 5e-3], rel=1e-3)
    step = moved(MovingMount((0, 0, 0), (7.0, 0, 0), step_at_s=1800.0), poses, conditions)
    assert step[:, 0] == pytest.approx([0.0, 7e-3])


def test_heat_reaches_links_and_sensors_with_their_time_constants() -> None:
    field = HeatField(20.0)
    field.step(10.0, 20.0, SELF_HEATING_W)
    assert field.link_c - 20.0 == pytest.approx(10.0 * SELF_HEATING_W / CAPACITY, rel=1e-2)
    # In the end all the electronics' power leaves through the skins.
    field.settle(20.0, SELF_HEATING_W)
    assert TO_AIR @ (field.link_c - 20.0) == pytest.approx(SELF_HEATING_W.sum())
    # In air of another temperature all links together follow with about ΣC/ΣG.
    field = HeatField(20.0)
    constant = CAPACITY.sum() / TO_AIR.sum()
    field.step(constant, 30.0, 0.0)
    mean = (CAPACITY @ field.link_c) / CAPACITY.sum()
    assert mean == pytest.approx(20 + 10 * (1 - np.exp(-1)), abs=0.2)
    # On a slow ramp each sensor trails its link by rate × lag.
    for minute in range(120):
        field.step(60.0, 30.0 + 0.1 * minute, 0.0)
    before = field.link_c
    field.step(1.0, 30.0 + 12.0, 0.0)
    rate = field.link_c - before
    assert field.link_c - field.sensor_c == pytest.approx(rate * SENSOR_LAG_S, rel=0.05)


def test_one_long_step_equals_many_short_ones() -> None:
    lag = np.array([0.0, 900.0, 0, 0, 0, 0])
    long, short = HeatField(20.0, lag), HeatField(20.0, lag)
    long.step(3000.0, 27.0, SELF_HEATING_W)
    for _ in range(300):
        short.step(10.0, 27.0, SELF_HEATING_W)
    assert long.link_c == pytest.approx(short.link_c, abs=1e-9)
    assert long.sensor_c == pytest.approx(short.sensor_c, abs=1e-9)


def test_a_core_follows_its_shell_late() -> None:
    field = HeatField(20.0, np.array([0.0, 900.0, 0, 0, 0, 0]))
    for minute in range(360):
        field.step(60.0, 20.0 + 4.0 * minute / 60, 0.0)
    before = field.sensor_c[1]
    field.step(1.0, 20.0 + 24.0, 0.0)
    rate = field.sensor_c[1] - before
    # The sensor itself trails the shell by 20 s.
    assert field.sensor_c[1] - field.link_c[1] == pytest.approx(rate * 880.0, rel=0.02)
