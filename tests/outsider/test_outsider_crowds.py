"""Several faults at once: how large each is beside the others, and what a report says of all."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from outsider.angles import ANGLES
from outsider.case import Case, Truth, draw
from outsider.crowds import free_shapes
from outsider.faults import FAULTS
from outsider.judge import judge, tally
from outsider.made_up import four_joints, scene
from outsider.run import Outcome, crowds_line
from outsider.scene import Fault, Scene
from outsider.seen import Seen
from outsider.test_outsider_judge import finding, truth

DISC = truth("", "encoder_eccentricity", "joint 3", "q3", plain_units=14.0)
PLAY = truth("", "joint_backlash", "joint 3", "w3", "q3", "time_s", plain_units=13.0)
WEAK = truth("", "gear_mesh", "joint 2", "q3", "q2", noise_units=7.9, plain_units=8.1)
OFFSET = truth("", "sensor_offset", "sensor t3", "t3",
               same_signal=(("geometry_shift", "joint 3"),))  # fmt: skip
CREEP = truth("", "geometry_shift", "joint 3", "time_s", needs="time_s")
ECCENTRIC = finding("encoder_eccentricity", "joint 3", 0.99, "q3")
BACKLASH = finding("joint_backlash", "joint 3", 0.97, "w3")
CREPT = finding("geometry_shift", "joint 3", 0.9, "time_s")


def crowd(*each: Truth) -> Truth:
    return truth("crowd", each=each)


@pytest.mark.parametrize(
    ("planted", "found", "told", "verdict"),
    [
        ((DISC, PLAY), [ECCENTRIC, BACKLASH], ("own", "own"), "right"),
        ((DISC, PLAY, WEAK), [ECCENTRIC, BACKLASH], ("own", "own", ""), "right"),
        ((DISC, PLAY), [BACKLASH], ("", "own"), "missed"),
        ((DISC, PLAY), [], ("", ""), "missed"),
        ((DISC, PLAY), [BACKLASH, finding("encoder_scale", "joint 3", 0.9, "q3")],
         ("near", "own"), "near"),
        ((DISC, PLAY), [ECCENTRIC, BACKLASH, finding("encoder_scale", "joint 3", 0.95, "q3")],
         ("own", "own"), "near but sure"),
        ((DISC, PLAY), [BACKLASH, finding("unknown", "-", 0.99, "q3")], ("like", "own"), "near"),
        ((DISC, PLAY), [ECCENTRIC, BACKLASH, finding("encoder_scale", "joint 2", 0.9, "q2")],
         ("own", "own"), "wrong"),
        ((DISC, PLAY), [finding("encoder_scale", "joint 2", 0.95, "q2")], ("", ""),
         "sure and wrong"),
        ((DISC, WEAK), [ECCENTRIC, finding("unknown", "-", 0.9, "q3", "q4")], ("own", ""), "wrong"),
        ((OFFSET, CREEP), [CREPT], ("", "own"), "missed"),  # its name says nothing of the offset
        ((OFFSET, CREEP), [CREPT, finding("geometry_shift", "joint 3", 0.99)], ("like", "own"),
         "near"),
    ],
)  # fmt: skip
def test_a_crowd_gets_its_verdict(
    planted: tuple[Truth, ...], found: list[dict[str, Any]], told: tuple[str, ...], verdict: str
) -> None:
    assert tally(crowd(*planted), {"findings": found}).told == told
    assert judge(crowd(*planted), {"findings": found}) == verdict


def outcome(planted: Truth, found: list[dict[str, Any]], before: float, after: float) -> Outcome:
    report = {"findings": found}
    return Outcome(
        planted, judge(planted, report), "", before, after, 1.0,
        tally(planted, report) if planted.each else None,
    )  # fmt: skip


def test_the_last_line_counts_what_is_due_in_all_crowds_and_nothing_else() -> None:
    """Of noise of 6 µm: 4 and 2 of 10 and 4 µm are mended, and one model is worse."""
    extra = finding("encoder_scale", "joint 4", 0.96, "q4")
    line = crowds_line(
        [
            outcome(crowd(DISC, PLAY, WEAK), [ECCENTRIC, extra], 16.0, 12.0),
            outcome(crowd(DISC, PLAY), [ECCENTRIC, BACKLASH], 10.0, 8.0),
            outcome(crowd(WEAK), [finding("gear_mesh", "joint 2", 0.9, "q3")], 6.0, 6.2),
            outcome(DISC, [], 100.0, 200.0),  # one fault: no crowd
        ]
    )
    assert line == (
        "effects named 3 of 4 over 8 noise units (4 of 6 by the plain ones; 0 by a like name, 0"
        " nearly); extra 1 in 3 sets, near 0; sure and wrong 1 of 3; worse 1; gain 0.41 of what the"
        " noise leaves"
    )


def held_case() -> Case:
    return draw("clean", 2)  # with four sessions from before


def disc_of(phase: float, place: Scene) -> Fault:
    """At joint 3, round, 10 µrad."""
    q = place.readings.q[:, 2]
    alter = place.at_joint(2, 1e-5 * np.sin(q - phase))
    return Fault("", "", (), alter, "", shapes=place.waves_at(2, (q,)))


@pytest.mark.slow
def test_a_disc_beside_one_of_any_phase_leaves_nothing() -> None:
    """Of the other as it is, a quarter turn ahead, it leaves nearly all."""
    case = held_case()
    place = Scene(case.machine, case.readings, case.readings.session >= 4, case.thing)
    seen = Seen(case.machine, case.readings, case.machine.seat_mm)
    one, other = disc_of(0.3, place), disc_of(0.3 + np.pi / 2, place)
    alone = seen.noise_units(one.alter)
    assert seen.noise_units(one.alter, free_shapes(other)) < 1e-3 * alone
    assert seen.noise_units(one.alter, [other.alter]) > 0.5 * alone


def test_what_a_joint_shows_goes_by_its_angle_or_its_own_warmth() -> None:
    """Bent by up to 5 % per rad and 2 % per K; twelve waves a turn are as many at either end."""
    q, warm = np.array([[-1.0] * 4, [0.0] * 4, [1.0] * 4]), np.array([[-5.0] * 4, [0] * 4, [5] * 4])
    place = replace(scene(q, four_joints(), warm=warm), joint=2)
    low, middle, high = gain = shown("gain", place)
    assert middle == 0 and high - low == pytest.approx(2) and abs(gain.sum()) < 0.1
    low, middle, high = shown("warmed", place)
    assert middle == 0 and high - low == pytest.approx(10) and 0 <= high + low <= 1
    turn = replace(scene(q * np.pi, four_joints()), joint=2)
    wave = shown("wave", turn)
    assert wave[0] == pytest.approx(wave[2]) and np.abs(wave).max() < 1.16


def shown(kind: str, place: Scene) -> np.ndarray[Any, np.dtype[np.float64]]:
    """(n,) by the encoder of joint 3, the only one that is wrong."""
    (fault,) = ANGLES[kind](np.random.default_rng(1), place)
    assert fault.location == "joint 3"
    assert not np.delete(fault.alter.encoder, 2, axis=1).any()
    return fault.alter.encoder[:, 2]


def test_a_fault_is_where_it_alone_may_be() -> None:
    place = scene(np.zeros((3, 4)), four_joints(), session=np.array([0, 0, 1]))
    place = replace(place, joint=1)
    for kind in ("disc", "play", "relax", "slip", "mesh"):
        (fault,) = FAULTS[kind](np.random.default_rng(2), place)
        assert fault.location == "joint 2"


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "seed"), [("crowd", 100), ("one_joint", 104)])
def test_each_of_a_crowd_is_due_and_has_a_cause_of_its_own(kind: str, seed: int) -> None:
    """Alone on the arm, each has at least the noise units that it has beside the others."""
    case = draw(kind, seed)
    each = case.truth.each
    assert (4 if kind == "crowd" else 3) <= len(each) <= 5
    assert len({one.cause for one in each}) == len(each)
    assert len({one.location for one in each} if kind == "one_joint" else {""}) == 1
    for one in each:
        assert 7.9 < one.noise_units < 40.1
        assert one.plain_units > 0.99 * one.noise_units
