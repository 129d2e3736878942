"""What workshops do, and what is wrong around an arm: by hand, and in the files."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from outsider.around import AROUND
from outsider.case import Case, draw
from outsider.chain import F64
from outsider.faults import FAULTS
from outsider.files import write
from outsider.judge import judge
from outsider.made_up import four_joints, scene

from support.selection import parametrize_default

COLD_TO_WARM = np.arange(4.0)


def rows_of(folder: Path) -> list[dict[str, str]]:
    with (folder / "readings.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def apart(points: F64) -> F64:
    """(n, n) distances."""
    return np.linalg.norm(points[:, None] - points[None], axis=2)


def busy(case: Case) -> F64:
    """(n,) rows at which something is touched off its place."""
    return np.abs(case.alter.target).max(axis=1) > 0


def test_another_alloy_grows_from_the_middle() -> None:
    lever = np.outer([100.0, -100, 0, 50], [1.0, 0, 0])
    (fault,) = AROUND["alloy"](
        np.random.default_rng(1), scene(np.zeros((4, 4)), four_joints(), lever=lever,
                                        artefact_k=COLD_TO_WARM)
    )  # fmt: skip
    np.testing.assert_allclose(np.abs(fault.alter.target[:, 0]), [0, 100, 0, 150])


def test_one_target_stands_farther_out_wherever_the_artefact_lies() -> None:
    lever = np.array([[100.0, 0, 0], [0, 100, 0], [0, 0, 0], [0, 0, 0]])
    target = np.array([1, 1, 0, 0])
    (fault,) = AROUND["certificate"](
        np.random.default_rng(1), scene(np.zeros((4, 4)), four_joints(), lever=lever, target=target)
    )  # fmt: skip
    assert fault.location == "target B2"
    np.testing.assert_allclose(fault.alter.target, lever / 100)


def test_a_table_tips_towards_the_weight() -> None:
    """Link 2, of 1 kg and 200 mm, starts 10 mm along x: its weight stands 110 mm out, and turns the
    table about +y, which lowers what is out along +x; a quarter turn of the base, about −x."""
    q = np.zeros((2, 4))
    q[1, 0] = np.pi / 2
    (fault,) = AROUND["table"](np.random.default_rng(3), scene(q, four_joints()))
    tilt = fault.alter.base[:, 3:]
    assert tilt[0, 1] > 0 and tilt[1, 0] < 0
    assert not fault.alter.base[:, :3].any()


def test_a_replaced_encoder_is_as_it_was_before() -> None:
    session = np.repeat([0, 1], [40, 1])  # the last one is not diagnosed
    case = scene(np.zeros((41, 4)), four_joints(), session=session)
    (fault,) = AROUND["replaced"](np.random.default_rng(1), case)
    shown = np.abs(fault.alter.encoder).max(axis=1)
    first = int(np.flatnonzero(shown)[0])
    assert 10 < first < 30 and (shown[first:] > 0).all()


@pytest.mark.slow
def test_what_nobody_soaked_is_off_most_as_a_session_begins() -> None:
    case = draw("unsoaked", 2)
    (row,) = np.flatnonzero(case.readings.session == case.plan.before)[:1]
    lever, off = case.readings.lever[row], case.alter.target[row]
    np.testing.assert_allclose(np.cross(lever, off), 0, atol=1e-9)
    grown = np.linalg.norm(off) / np.linalg.norm(lever) / 11.5e-6
    assert 0.9 < grown < 4.0
    assert not busy(case)[case.readings.session == case.plan.sessions - 1].any()


@pytest.mark.slow
def test_an_operator_presses_by_one_length_and_not_in_the_last_session() -> None:
    case = draw("pressed", 2)
    last = case.plan.sessions - 2
    assert not busy(case)[case.readings.session >= last].any()
    pressed = np.linalg.norm(case.alter.target[busy(case)], axis=1)
    np.testing.assert_allclose(pressed, pressed[0])
    assert 0.01 < pressed[0] < 0.03


@parametrize_default("seed", [0, 2, 4])
def test_targets_counted_backwards_are_the_artefacts_own(seed: int) -> None:
    """What is touched has the distances of the numbers counted backwards, grown by its warmth."""
    case = draw("numbered", seed)
    rows = busy(case)
    assert len(np.unique(case.readings.placement[rows])) == 1
    touched = case.readings.goal[rows] + case.alter.target[rows]
    backwards = case.thing.points[::-1][case.readings.target[rows]]
    np.testing.assert_allclose(apart(touched), apart(backwards), atol=0.02)
    assert np.linalg.norm(case.alter.target[rows], axis=1).max() < 5.0


@pytest.mark.slow
def test_a_tracker_sees_the_points_rigidly_and_metres_away(tmp_path: Path) -> None:
    case = draw("tracker", 2)
    first = case.readings.placement == case.readings.placement[0]
    assert case.tracked_mm is not None
    seen = case.tracked_mm[first]
    np.testing.assert_allclose(apart(seen), apart(case.readings.goal[first]), atol=1e-6)
    assert np.linalg.norm(seen, axis=1).min() > 1000
    write(case, tmp_path)
    assert "position_mm" not in (tmp_path / "further" / "session.toml").read_text()
    x = [float(row["x_mm"]) for row in rows_of(tmp_path / "before-1")]
    np.testing.assert_allclose(x, case.tracked_mm[case.readings.session == 0, 0], atol=1e-5)


@pytest.mark.slow
def test_a_coarse_encoder_shows_whole_steps(tmp_path: Path) -> None:
    case = draw("coarse", 0)
    write(case, tmp_path)
    shown = np.array([float(row["q2"]) for row in rows_of(tmp_path / "further")])
    if 'angle_unit = "deg"' in (tmp_path / "further" / "session.toml").read_text():
        shown = np.radians(shown)
    steps = shown / case.step_rad
    np.testing.assert_allclose(steps, np.round(steps), atol=1e-3)
    assert 5e-5 < case.step_rad < 1e-4


@pytest.mark.slow
def test_links_follow_the_air_that_one_sensor_reads(tmp_path: Path) -> None:
    case = draw("ambient", 0)
    shown = case.readings.warm + case.alter.sensor
    np.testing.assert_allclose(shown, np.tile(shown[:, :1], shown.shape[1]))
    behind = case.readings.warm + case.alter.link - shown
    begin = np.flatnonzero(np.diff(case.readings.session, prepend=-1))
    np.testing.assert_allclose(behind[begin], 0, atol=1e-12)
    write(case, tmp_path)
    assert (tmp_path / "arm.toml").read_text().count("[[temperature_sensor]]") == 1
    assert "t2" not in rows_of(tmp_path / "further")[0]


@pytest.mark.slow
def test_placements_may_be_of_5_12_and_all_other_readings_at_three_targets() -> None:
    case = draw("uneven", 0)
    first = case.readings.only(case.readings.session == 0)
    assert np.bincount(first.placement)[:2].tolist() == [5, 12]
    assert all(len(np.unique(first.target[first.placement == p])) == 3 for p in range(3))


@pytest.mark.slow
def test_a_room_is_kept_within_a_kelvin() -> None:
    case = draw("narrow", 0)
    air = [
        case.readings.artefact_k[case.readings.session == session].mean()
        for session in range(case.plan.sessions)
    ]
    assert 0.3 < np.ptp(air) < 2.0


@pytest.mark.slow
@parametrize_default("kind", ["latched", "glitch"])
def test_few_rows_are_off_by_far(kind: str) -> None:
    case = draw(kind, 2)
    off = np.abs(case.alter.encoder).max(axis=1)
    assert 0 < np.mean(off > 0) < 0.1
    assert off.max() > 10 * case.machine.encoder_rad


@pytest.mark.slow
def test_a_hand_and_a_disc_at_once() -> None:
    case = draw("hand", 2)
    assert case.truth.cause == "encoder_eccentricity"
    assert case.alter.encoder.any() and busy(case).any()


@pytest.mark.slow
def test_what_is_true_of_a_mess_counts_for_nothing() -> None:
    said = {"cause": "tip_offset", "location": "tip", "probability": 1.0, "depends_on": ["time_s"]}
    other = said | {"cause": "encoder_slip", "location": "joint 2"}
    unknown = said | {"cause": "unknown", "location": "-"}
    pressed = draw("pressed", 2).truth
    assert judge(pressed, {"findings": []}) == "right"
    assert judge(pressed, {"findings": [said]}) == "right"
    assert judge(pressed, {"findings": [said, other]}) == "sure and wrong"
    assert judge(pressed, {"findings": [unknown]}) == "sure and wrong"
    unsoaked = draw("unsoaked", 2).truth
    assert judge(unsoaked, {"findings": [unknown]}) == "right"
    assert judge(unsoaked, {"findings": [unknown | {"depends_on": ["time_s", "q2"]}]}) != "right"


@pytest.mark.slow
def test_a_rest_read_four_times_has_one_posture_and_one_seat(tmp_path: Path) -> None:
    case = draw("repeats", 0)
    first = case.readings.only(case.readings.placement == 0)
    postures = np.unique(first.q, axis=0)
    assert len(postures) == -(-len(first.q) // 4)
    np.testing.assert_allclose(np.diff(first.time_s[:4]), 1.0)
    write(case, tmp_path)
    rows = rows_of(tmp_path / "session-1")[:8]
    shown = np.array([[float(row[f"q{k}"]) for k in (1, 2, 3)] for row in rows])
    if 'angle_unit = "deg"' in (tmp_path / "further" / "session.toml").read_text():
        shown = np.radians(shown)
    np.testing.assert_allclose(shown[1:4], np.tile(shown[0], (3, 1)), atol=1e-4)
    assert np.abs(shown[4] - shown[0]).max() > 1e-2


@pytest.mark.slow
def test_a_room_for_calibrating_shows_no_growth_and_the_shop_floor_does() -> None:
    case = draw("shop_floor", 0)
    air = np.array(
        [case.readings.artefact_k[case.readings.session == s].mean()
         for s in range(case.plan.sessions - 1)]
    )  # fmt: skip
    assert case.truth.held and case.plan.before == 4
    assert np.ptp(air[:4]) < 2.0 < 4.0 < np.ptp(air[4:])


@pytest.mark.slow
def test_another_artefact_was_longer_before_the_calibration_only() -> None:
    case = draw("another", 0)
    before = case.readings.session < case.plan.before
    assert not case.alter.target[~before].any()
    lever, off = case.readings.lever[before], case.alter.target[before]
    share = (lever * off).sum(axis=1) / (lever**2).sum(axis=1)
    np.testing.assert_allclose(share, share[0])
    assert 1e-5 < abs(share[0]) < 4e-5


@pytest.mark.slow
def test_rates_and_masses_that_nobody_wrote_down(tmp_path: Path) -> None:
    for kind in ("unsigned", "bare"):
        (tmp_path / kind).mkdir()
        write(draw(kind, 0), tmp_path / kind)
    assert "w1" not in rows_of(tmp_path / "unsigned" / "further")[0]
    assert "mass_kg" not in (tmp_path / "bare" / "arm.toml").read_text()
    assert draw("unsigned", 0).alter.encoder.any()


def test_on_a_wall_a_link_falls_sideways() -> None:
    """Link 2, 200 mm along x of the base, under gravity along y."""
    flat = replace(scene(np.zeros((1, 4)), four_joints()), down=(0.0, 1.0, 0.0))
    (fault,) = FAULTS["sag"](np.random.default_rng(1), flat)
    np.testing.assert_allclose(fault.alter.shift[0, 1], [0, 1, 0], atol=1e-12)
    assert "q1" in fault.depends_on
