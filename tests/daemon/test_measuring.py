"""Guided measuring: whatever happens in whatever order, the session is what the log says."""

import json
import os

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from small_arm import small_arm

from armd import Flag
from armd.compensation.data.session import load_session
from armd.compensation.data.session_format import Artefact
from armd.compensation.model.kinematics import forward
from armd.daemon.measure.in_use import InUse, arm_toml
from armd.daemon.measure.kinds import plan_of
from armd.daemon.measure.log import NAME
from armd.daemon.measure.measuring import Measuring
from armd.daemon.measure.stations import Wishes
from armd.errors import BadInput
from armd.schema import parse_toml, validate

ARM = small_arm()
IN_USE = InUse(ARM, None, None, None)
BALLS = {"B1": (0.0, 0.0, 0.0), "B2": (120.0, 0.0, 0.0), "B3": (0.0, 90.0, 0.0)}
BEAM = validate(
    "beam",
    {
        "name": "beam",
        "target": [{"name": n, "position_mm": p} for n, p in BALLS.items()],
    },
    Artefact,
)
#: Where the beam stands: in reach of the small arm, turned.
TURN = Rotation.from_euler("xyz", [20, 10, 70], degrees=True)
ORIGIN = np.array([350.0, 150.0, 100.0])


def press(number, point_mm=None, q=None, **changes):
    """A measurement as the daemon publishes it, at rest at a point; angles that differ."""
    q = np.array([0.1 + 0.01 * number, 0.2, 0.3]) if q is None else np.asarray(q)
    tip, rotation = forward(q[None], ARM.nominal())
    return {
        "trigger": "button",
        "seq": 1000 * number,
        "stamp_ns": 1_800_000_000_250_000_000 + number * 10**9,
        "count": 251,
        "flags": int(Flag.AT_REST),
        "position_mm": list(map(float, tip[0] if point_mm is None else point_mm)),
        "standard_deviation_mm": [0.001, 0.002, 0.002],
        "orientation": Rotation.from_matrix(rotation[0]).as_quat().tolist(),
        "angles_rad": q.tolist(),
        "rates_rad_s": [1e-12, -1e-12, 1e-12],
        "approach": [0.0, 0.0, -1.0],
        "temperatures_c": {"a": 21.5, "b": 21.6, "c": None},
        "calibration": None,
        "tip": None,
    } | changes


def at(ball, number, off_mm=0.0, placement="P1"):
    """At a ball; in another placement than P1 the beam stands 400 mm higher."""
    where = TURN.apply(BALLS[ball]) + ORIGIN + [off_mm, 0.0, 0.0 if placement == "P1" else 400.0]
    return press(number, where)


def beam_plan(**wishes):
    return plan_of("artefact", ARM, BEAM, Wishes(**wishes))


def targets_on_disk(folder):
    session = load_session(folder, ARM)
    return [session.artefact.target_names[i] for i in session.target]


def test_a_measurement_is_led_from_ball_to_ball(tmp_path):
    plan = beam_plan(placements=["P1"], repeats=2)
    with Measuring(tmp_path / "beam", plan, IN_USE) as measuring:
        asked = []
        for number in range(1, 7):
            following = measuring.state()["next"]
            asked.append(following["target"])
            told = measuring.offer(at(following["target"], number))
            assert told["event"] == "reading", told
            assert told["done"] == number and told["wanted"] == 6
        assert asked == ["B1", "B2", "B3"] * 2
        assert measuring.complete and measuring.state()["next"] is None
        assert measuring.offer(at("B1", 8))["reason"] == "complete"
    assert targets_on_disk(tmp_path / "beam") == asked


def test_where_the_next_ball_is_becomes_known_and_how_far_it_is(tmp_path):
    with Measuring(tmp_path / "beam", beam_plan(placements=["P1"]), IN_USE) as measuring:
        for number, ball in enumerate(("B1", "B2", "B3"), 1):
            # Two points of a beam do not tell where a third one off their line is.
            assert measuring.state()["next"]["position_mm"] is None
            measuring.offer(at(ball, number))
        there = TURN.apply(BALLS["B1"]) + ORIGIN
        following = measuring.state([there[0] + 3.0, there[1] + 4.0, there[2]])["next"]
        np.testing.assert_allclose(following["position_mm"], there, atol=1e-9)
        assert following["distance_mm"] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("wrong", "reason", "words"),
    [
        (at("B2", 9), "too_far", "this is B2"),
        (at("B1", 9, off_mm=7.0), "too_far", "7.0 mm from B1, more than 5 mm"),
        (press(9, flags=0, count=1, standard_deviation_mm=None), "moving", "rested"),
        (
            press(9, count=0, angles_rad=None, flags=int(Flag.INVALID), position_mm=None),
            "invalid",
            "invalid",
        ),
        (press(9, flags=int(Flag.AT_REST | Flag.TEMPERATURE_STALE)), "temperature", "stale"),
        (at("B3", 3), "twice", "has been taken"),
        (at("B1", 3) | {"seq": 5}, "unmoved", "not moved"),
        ({"what": "is this"}, "invalid", "no measurement"),
        (press(9, position_mm=[float("nan")] * 3), "invalid", "no measurement"),
        (press(9, q=[0.1, 0.2, 0.3]) | {"angles_rad": [0.1, 0.2]}, "invalid", "no measurement"),
    ],
)
def test_refused_with_its_reason_and_nothing_changes(tmp_path, wrong, reason, words):
    with Measuring(tmp_path / "beam", beam_plan(placements=["P1"]), IN_USE) as measuring:
        for number, ball in enumerate(("B1", "B2", "B3"), 1):
            measuring.offer(at(ball, number))
        before = measuring.state()
        told = measuring.offer(wrong)
        assert (told["event"], told["reason"]) == ("refused", reason)
        assert words in told["text"]
        assert measuring.state() == before | {"refusals": {reason: 1}}
    assert targets_on_disk(tmp_path / "beam") == ["B1", "B2", "B3"]


def test_the_second_ball_must_be_as_far_from_the_first_as_certified(tmp_path):
    with Measuring(tmp_path / "beam", beam_plan(), IN_USE) as measuring:
        measuring.offer(at("B1", 1))
        told = measuring.offer(at("B3", 2))
        assert told["reason"] == "too_far"
        assert "90.0 mm from B1, where B2 is 120.0 mm" in told["text"]


def test_an_artefact_must_be_moved_to_its_next_placement(tmp_path):
    with Measuring(tmp_path / "beam", beam_plan(repeats=1), IN_USE) as measuring:
        for number, ball in enumerate(BALLS, 1):
            measuring.offer(at(ball, number))
        told = measuring.offer(at("B2", 4))
        assert told["reason"] == "too_far"
        assert told["text"] == "this is B2 in P1: the artefact has not been moved"
        assert measuring.offer(press(5, [0.0, 500.0, 0.0]))["placement"] == "P2"


def test_a_seat_is_not_where_another_is(tmp_path):
    """Pressed once too often at the first one: not the first reading of the second."""
    plan = plan_of("verify", ARM, None, Wishes(tests=["spat"]))
    with Measuring(tmp_path / "spat", plan, IN_USE) as measuring:
        for number in range(1, 11):
            assert measuring.offer(press(number, [400.0, 0.0, 0.0]))["event"] == "reading"
        told = measuring.offer(press(11, [400.0, 0.0, 0.1]))
        assert told["reason"] == "too_far" and "this is SPAT1" in told["text"]
        assert measuring.offer(press(12, [0.0, 400.0, 0.0]))["target"] == "SPAT2"


def test_where_the_arm_is_judged_its_calibration_must_hold_and_stay(tmp_path):
    plan = plan_of("verify", ARM, None, Wishes())
    with Measuring(tmp_path / "spat", plan, IN_USE) as measuring:
        outside = press(1, flags=int(Flag.AT_REST | Flag.TEMPERATURE_RANGE))
        assert measuring.offer(outside)["reason"] == "temperature"
        assert measuring.offer(press(2, calibration="ab" * 8))["reason"] == "changed"
        assert measuring.offer(press(3))["event"] == "reading"
    other = InUse(ARM, None, "ab" * 8, None)
    with pytest.raises(BadInput, match="begun with another calibration"):
        Measuring(tmp_path / "spat", plan, other)
    # Where it is calibrated, both are what is wanted.
    with Measuring(tmp_path / "seat", plan_of("seats", ARM, None, Wishes()), IN_USE) as measuring:
        assert measuring.offer(outside | {"calibration": "ab" * 8})["event"] == "reading"


STEPS = st.lists(
    st.sampled_from(["press", "press", "press", "wrong", "moving", "delete", "again", "skip"]),
    max_size=25,
)


@settings(max_examples=20, deadline=None, suppress_health_check=list(HealthCheck))
@given(steps=STEPS, kills=st.sets(st.integers(0, 25), max_size=3), torn=st.binary(max_size=8))
def test_any_order_of_things_gives_the_session_that_the_log_says(tmp_path, steps, kills, torn):
    folder = tmp_path / os.urandom(6).hex()
    plan = beam_plan(placements=["P1", "P2"], repeats=1)
    measuring = Measuring(folder, plan, IN_USE)
    model: list[tuple[str, str, float]] = []  # placement, target, stamp: an independent account
    for number, step in enumerate(steps, 1):
        following = measuring.state()["next"]
        match step:
            case "press":
                target = following["target"] if following else "B1"
                placement = following["placement"] if following else "P1"
                told = measuring.offer(at(target, number, placement=placement))
                assert (told["event"] == "reading") == (following is not None), told
                if following:
                    model.append((following["placement"], target, number))
            case "wrong":
                assert measuring.offer({"seq": number})["event"] == "refused"
            case "moving":
                assert measuring.offer(press(number, flags=0))["event"] == "refused"
            case "delete":
                assert measuring.delete_last()["event"] == ("deleted" if model else "nothing")
                model = model[:-1]
            case "again":
                measuring.again()
            case "skip":
                measuring.skip()
        if number in kills:  # nothing is closed in order; a torn line may be left behind
            seen = measuring.state()
            measuring._log.close()
            with (folder / NAME).open("ab") as log:
                log.write(torn.replace(b"\n", b""))
            (folder / "readings.csv").unlink(missing_ok=True)
            measuring = Measuring.resume(folder, IN_USE)
            assert measuring.state() == seen | {"artefact_c": None}
    measuring.close()
    lines = [json.loads(line) for line in (folder / NAME).read_text().splitlines()]
    numbers = [line["number"] for line in lines if line.get("what") == "reading"]
    assert numbers == list(range(1, len(numbers) + 1))
    if not model:
        assert not (folder / "readings.csv").exists()
        return
    session = load_session(folder, ARM)
    first_s = min(stamp for *_, stamp in model)
    found = [
        (session.placement_names[p], session.artefact.target_names[t], s - 1_800_000_000)
        for p, t, s in zip(session.placement, session.target, session.states.time_s, strict=True)
    ]
    assert [row[:2] for row in found] == [row[:2] for row in model]
    np.testing.assert_allclose(
        [row[2] for row in found], [stamp + 0.25 for *_, stamp in model], atol=1e-6
    )
    assert session.started_unix_s == 1_800_000_000 + first_s


def test_one_writer_at_a_time_and_one_plan(tmp_path):
    plan = beam_plan()
    with Measuring(tmp_path / "beam", plan, IN_USE) as measuring:
        measuring.offer(at("B1", 1))
        with pytest.raises(BadInput, match="another armd measuring"):
            Measuring(tmp_path / "beam", plan, IN_USE)
    with pytest.raises(BadInput, match="begun with another plan"):
        Measuring(tmp_path / "beam", beam_plan(repeats=7), IN_USE)
    with pytest.raises(BadInput, match="begun with another arm"):
        Measuring(tmp_path / "beam", plan, InUse(small_arm(serial_number="X"), None, None, None))
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "session.toml").write_text("")
    with pytest.raises(BadInput, match=r"found session\.toml"):
        Measuring(tmp_path / "other", plan, IN_USE)
    with pytest.raises(BadInput, match=r"found no measuring\.jsonl"):
        Measuring.resume(tmp_path / "other", IN_USE)


def test_a_log_that_was_edited_is_refused_by_line(tmp_path):
    with Measuring(tmp_path / "beam", beam_plan(), IN_USE) as measuring:
        for number, ball in enumerate(("B1", "B2", "B3"), 1):
            measuring.offer(at(ball, number))
    path = tmp_path / "beam" / NAME
    lines = path.read_text().splitlines(keepends=True)
    path.write_text("".join(lines[:2] + lines[3:]))
    with pytest.raises(BadInput, match="line 3: found ValueError: reading 3 after 1"):
        Measuring.resume(tmp_path / "beam", IN_USE)
    path.write_text("".join([*lines[:2], "{]\n", *lines[2:]]))
    with pytest.raises(BadInput, match="line 3: found no JSON"):
        Measuring.resume(tmp_path / "beam", IN_USE)


def test_the_artefacts_temperature_goes_with_the_readings(tmp_path):
    with Measuring(tmp_path / "beam", beam_plan(), IN_USE) as measuring:
        measuring.offer(at("B1", 1))
        measuring.artefact_c = 20.5
        measuring.offer(at("B2", 2))
    np.testing.assert_array_equal(load_session(tmp_path / "beam", ARM).artefact_c, [np.nan, 20.5])


def test_a_posture_unlike_those_measured_is_proposed_and_reaches_the_ball(tmp_path):
    with Measuring(tmp_path / "beam", beam_plan(placements=["P1"]), IN_USE) as measuring:
        for number, ball in enumerate(("B1", "B2", "B3"), 1):
            measuring.offer(at(ball, number))
        following = measuring.state()["next"]
    tip, _ = forward(np.radians([following["posture_deg"]]), ARM.nominal())
    np.testing.assert_allclose(tip[0], following["position_mm"], atol=0.5)
    assert following["why"]


def test_arm_toml_says_the_same_again():
    arm = small_arm(gravity=[0.0, 1.0, 0.0])
    joint = arm.joint[0].model_copy(update={"temperature": {"a": 0.5, "b": 0.5}})
    arm = arm.model_copy(update={"joint": [joint, *arm.joint[1:]]})
    assert parse_toml("arm.toml", arm_toml(arm).encode(), type(arm)) == arm
