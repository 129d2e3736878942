"""Guided measuring: whatever happens in whatever order, the session is what the log says."""

import json
import os
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from armd import Flag
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.session import load_session
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.measure.in_use import MeasuredWith, write_arm_toml
from armd.daemon.measure.log import NAME
from armd.daemon.measure.measuring import Measuring
from armd.daemon.measure.plan.kinds import make_plan
from armd.daemon.measure.plan.stations import KINDS, Wishes
from armd.errors import BadInput
from armd.files.schema import parse_toml, validate
from support.pressed import pressed
from support.small_arm import small_arm

ARM = small_arm()
IN_USE = MeasuredWith(ARM, None, None, None)
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
    tip, rotation = compute_pose(q[None], ARM.nominal())
    measured = pressed(
        number, position_mm=list(map(float, tip[0] if point_mm is None else point_mm)),
        orientation=Rotation.from_matrix(rotation[0]).as_quat().tolist(), angles_rad=q.tolist(),
    )  # fmt: skip
    return measured | changes


def at(ball, number, off_mm=0.0, placement="P1"):
    """At a ball; in placement P1 the beam stands 400 mm lower than in others."""
    where = TURN.apply(BALLS[ball]) + ORIGIN + [off_mm, 0.0, 0.0 if placement == "P1" else 400.0]
    return press(number, where)


def beam_plan(**wishes):
    return make_plan("artefact", ARM, BEAM, Wishes(**wishes))


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


def test_a_press_that_was_not_heard_shifts_the_next_one_and_the_way_out_is_told(tmp_path):
    """B1 and B2 were pressed, B2 unheard; then B3, which is taken for B2 by a coarse arm."""
    with Measuring(tmp_path / "beam", beam_plan(placements=["P1"], near_mm=40.0), IN_USE) as it:
        it.offer(at("B1", 1))
        assert it.offer(at("B3", 2))["target"] == "B2"
        first, second = it.offer(at("B3", 3)), it.offer(at("B3", 4))
        assert first["text"] == "this is B2, and B3 is asked for"
        assert "if it is B3, a press was not heard" in second["text"]
        assert second["text"].endswith("delete the reading of B2")
        it.delete_last()
        assert [it.offer(at(ball, n))["event"] for n, ball in ((5, "B2"), (6, "B3"))] == (
            ["reading", "reading"]
        )


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


@pytest.mark.parametrize(
    ("since", "event"),
    [({"still_s": 0.8}, "reading"), ({"still_s": 1.2}, "refused"), ({}, "refused")],
)
def test_an_arm_of_three_joints_comes_back_to_the_same_angles(tmp_path, since, event):
    """It holds its tip in a seat in one posture alone, and a servo's counts are the same again."""
    plan = make_plan("seats", ARM, None, Wishes(targets=["S1"], repeats=2))
    with Measuring(tmp_path / "seat", plan, IN_USE) as measuring:
        assert measuring.offer(press(1, q=[0.1, 0.2, 0.3]))["event"] == "reading"
        told = measuring.offer(press(2, q=[0.1, 0.2, 0.3], **since))
        assert told["event"] == event and told.get("reason") in (None, "unmoved")


def test_a_second_ball_not_as_far_from_the_first_as_certified_is_recognised_and_refused(tmp_path):
    with Measuring(tmp_path / "beam", beam_plan(), IN_USE) as measuring:
        measuring.offer(at("B1", 1))
        told = measuring.offer(at("B3", 2))
        assert told["reason"] == "too_far"
        assert "90.0 mm from B1, where B2 is 120.0 mm" in told["text"]
        assert told["text"].endswith("as far as B3 is")


def test_which_of_two_readings_is_wrong_is_told_by_pressing_again(tmp_path):
    """The first was pressed in the air: whatever comes after contradicts it."""
    with Measuring(tmp_path / "beam", beam_plan(placements=["P1"]), IN_USE) as measuring:
        measuring.offer(at("B1", 1, off_mm=-40.0))
        once = measuring.offer(at("B2", 2))
        assert once["reason"] == "too_far"
        assert "this press, or the reading of B1, is not where it should be" in once["text"]
        elsewhere = measuring.offer(at("B2", 3, off_mm=30.0))
        assert "this press, or" in elsewhere["text"]
        measuring.offer(at("B2", 4))
        again = measuring.offer(at("B2", 5, off_mm=0.1))
        assert "the reading of B1 is the wrong one, delete it" in again["text"]
        measuring.delete_last()
        for number, ball in enumerate(BALLS, 6):
            assert measuring.offer(at(ball, number))["event"] == "reading"


def test_of_three_balls_the_one_that_contradicts_both_others_is_named(tmp_path):
    """B1 was 59 mm off, and yet as far from B2 as certified: all three are needed."""
    with Measuring(tmp_path / "beam", beam_plan(placements=["P1"]), IN_USE) as measuring:
        seen = {ball: TURN.apply(BALLS[ball]) + ORIGIN for ball in BALLS}
        across = TURN.apply([120.0 * (1 - np.cos(0.5)), 0.0, 120.0 * np.sin(0.5)])
        measuring.offer(press(1, seen["B1"] + across))
        assert measuring.offer(at("B2", 2))["event"] == "reading"
        told = measuring.offer(at("B3", 3))
        assert "mm from B1, where B3 is 90.0 mm from it" in told["text"]
        assert "the reading of B1, is not where" in told["text"]
        assert "reading of B1 is the wrong one" in measuring.offer(at("B3", 4))["text"]


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
    plan = make_plan("verify", ARM, None, Wishes(tests=["spat"]))
    with Measuring(tmp_path / "spat", plan, IN_USE) as measuring:
        for number in range(1, 11):
            assert measuring.offer(press(number, [400.0, 0.0, 0.0]))["event"] == "reading"
        told = measuring.offer(press(11, [400.0, 0.0, 0.1]))
        assert told["reason"] == "too_far" and "this is SPAT1" in told["text"]
        assert measuring.offer(press(12, [0.0, 400.0, 0.0]))["target"] == "SPAT2"


def test_where_the_arm_is_judged_its_calibration_must_hold_and_stay(tmp_path):
    plan = make_plan("verify", ARM, None, Wishes())
    with Measuring(tmp_path / "spat", plan, IN_USE) as measuring:
        outside = press(1, flags=int(Flag.AT_REST | Flag.TEMPERATURE_RANGE))
        assert measuring.offer(outside)["reason"] == "temperature"
        assert measuring.offer(press(2, calibration="ab" * 8))["reason"] == "changed"
        told = measuring.offer(press(3, tip_offset_mm=[50.0, 0.0, 0.2]))
        assert told["text"] == "the tip was calibrated anew since the session began"
        assert measuring.offer(press(3, tip_offset_mm=[50.0, 0.0, 0.0]))["event"] == "reading"
    other = MeasuredWith(ARM, None, "ab" * 8, None)
    with pytest.raises(BadInput, match="begun with another calibration"):
        Measuring(tmp_path / "spat", plan, other)
    # Where it is calibrated, both are what is wanted.
    with Measuring(tmp_path / "seat", make_plan("seats", ARM, None, Wishes()), IN_USE) as measuring:
        assert measuring.offer(outside | {"calibration": "ab" * 8})["event"] == "reading"


def plan_of_kind(kind, folder):
    """A plan of each kind that there is."""
    if kind == "poses":
        balls = [TURN.apply(BALLS[name]) + ORIGIN for name in ("B2", "B1", "B3", "B1")]
        poses_table(folder / "poses.csv", [reaching(ball, [20.0, 30.0, -40.0]) for ball in balls])
        return make_plan(kind, ARM, BEAM, Wishes(poses=folder / "poses.csv"))
    wishes = {
        "seats": Wishes(targets=["S1", "S2"], repeats=3),
        "artefact": Wishes(placements=["P1", "1"], repeats=1),
        "verify": Wishes(tests=["spat"]),
        "tip": Wishes(repeats=5),
        "interim": Wishes(targets=["S1", "S2"], repeats=3),
        "repeatability": Wishes(repeats=5),
    }
    return make_plan(kind, ARM, BEAM if kind == "artefact" else None, wishes[kind])


def there(target, number, placement):
    """Pressed where a target is: balls of the beam, and seats 200 mm apart."""
    if target in BALLS:
        return at(target, number, placement=placement)
    seats = ["seat", "S1", "S2", "SPAT1", "SPAT2", "SPAT3"]
    return press(number, [300.0, 200.0 * seats.index(target), 50.0])


STEPS = st.lists(
    st.sampled_from(
        ["press", "press", "press", "wrong", "moving", "delete", "again", "skip", "warm"]
    ),
    max_size=25,
)


@pytest.mark.slow
@settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    kind=st.sampled_from(KINDS),
    steps=STEPS,
    kills=st.sets(st.integers(0, 25), max_size=3),
    torn=st.binary(max_size=8),
)
@example(kind="poses", steps=["press"] * 6 + ["delete", "again", "press"], kills={3}, torn=b"{")
def test_any_order_of_things_gives_the_session_that_the_log_says(
    tmp_path, kind, steps, kills, torn
):
    folder = tmp_path / os.urandom(6).hex()
    plan = plan_of_kind(kind, tmp_path)
    measuring = Measuring(folder, plan, IN_USE)
    model: list[tuple[str, str, float]] = []  # placement, target, stamp: an independent account
    for number, step in enumerate(steps, 1):
        following = measuring.state()["next"]
        match step:
            case "press":
                wanted = following or {"target": plan.stations[0].target, "placement": "1"}
                target = wanted["target"]
                told = measuring.offer(there(target, number, wanted["placement"]))
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
            case "warm":
                measuring.set_artefact_c(20.0 + 0.1 * number)
        if number in kills:  # nothing is closed in order; a torn line may be left behind
            seen = measuring.state()
            measuring._log.close()
            with (folder / NAME).open("ab") as log:
                log.write(torn.replace(b"\n", b""))
            (folder / "readings.csv").unlink(missing_ok=True)
            measuring = Measuring.resume(folder, IN_USE)
            assert measuring.state() == seen
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
        Measuring(
            tmp_path / "beam", plan, MeasuredWith(small_arm(serial_number="X"), None, None, None)
        )
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "session.toml").write_text("")
    with pytest.raises(BadInput, match=r"found session\.toml"):
        Measuring(tmp_path / "other", plan, IN_USE)
    (tmp_path / "arms").mkdir()
    (tmp_path / "arms" / "arm.toml").write_text("# typed by somebody")
    with pytest.raises(BadInput, match=r"found arm\.toml, expected a new folder"):
        Measuring(tmp_path / "arms", plan, IN_USE)
    assert [path.name for path in (tmp_path / "arms").iterdir()] == ["arm.toml"]
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
        measuring.set_artefact_c(20.5)
        measuring.offer(at("B2", 2))
    with Measuring.resume(tmp_path / "beam", IN_USE) as measuring:
        measuring.offer(at("B3", 3))  # it holds beyond an interruption, until another is read
        measuring.set_artefact_c(None)
        measuring.offer(at("B1", 4))
    found = load_session(tmp_path / "beam", ARM).artefact_c
    np.testing.assert_array_equal(found, [np.nan, 20.5, 20.5, np.nan])


def test_a_posture_unlike_those_measured_is_proposed_and_reaches_the_ball(tmp_path):
    with Measuring(tmp_path / "beam", beam_plan(placements=["P1"]), IN_USE) as measuring:
        for number, ball in enumerate(("B1", "B2", "B3"), 1):
            measuring.offer(at(ball, number))
        following = measuring.state()["next"]
    tip, _ = compute_pose(np.radians([following["posture_deg"]]), ARM.nominal())
    np.testing.assert_allclose(tip[0], following["position_mm"], atol=0.5)
    assert following["why"]


POSES = """\
pose,x_mm,y_mm,z_mm,q1_deg,q2_deg,q3_deg,approach_joint_1,approach_joint_2,approach_joint_3,a_c
{rows}"""


def poses_table(path, postures_deg):
    """A table of `armd design -o`, in its columns: the tips are where the arm has them."""
    tips, _ = compute_pose(np.radians(postures_deg), ARM.nominal())
    rows = "".join(
        f"{i},{','.join(f'{v:.1f}' for v in (*tip, *posture))},+,-,+,25.0\n"
        for i, (tip, posture) in enumerate(zip(tips, postures_deg, strict=True), 1)
    )
    path.write_text(POSES.format(rows=rows))
    return tips


def reaching(point_mm, near_deg):
    """Joint angles that bring the tip to a point (SciPy's least squares), and those near them."""

    def away(q):
        return compute_pose(q[None], ARM.nominal())[0][0] - point_mm

    found = least_squares(away, np.radians(near_deg), xtol=1e-14, ftol=1e-14)
    assert np.linalg.norm(found.fun) < 1e-6
    return np.degrees(found.x)


def test_each_pose_of_a_design_goes_to_the_ball_that_suits_it(tmp_path):
    """The design's tips are where the balls of a beam can be: it is put there, ball by ball."""
    order = ["B3", "B1", "B2", "B1", "B3"]
    balls = [TURN.apply(BALLS[name]) + ORIGIN for name in order]
    postures = [reaching(ball, [20.0 + 5 * i, 30.0, -40.0]) for i, ball in enumerate(balls)]
    poses_table(tmp_path / "poses.csv", postures)
    plan = make_plan("poses", ARM, BEAM, Wishes(poses=tmp_path / "poses.csv"))
    assert [station.target for station in plan.stations] == order
    first = plan.stations[0].how
    assert "turning joints 1 up, 2 down, 3 up; at a 25.0 °C" in first
    for name, ball in BALLS.items():  # where to put it, for a person: to the millimetre
        x, y, z = TURN.apply(ball) + ORIGIN
        told = [float(v) for v in first.partition(f"{name} near [")[2].partition("]")[0].split(",")]
        assert told == pytest.approx([x, y, z], abs=1.0)
    # It stands elsewhere: the posture shown reaches the ball where it is, near the design's.
    moved = Rotation.from_euler("z", 2, degrees=True)
    with Measuring(tmp_path / "posed", plan, IN_USE) as measuring:
        for number, ball in enumerate(balls[:3], 1):
            told = measuring.offer(press(number, moved.apply(ball)))
            assert told["event"] == "reading", told
        following = measuring.state()["next"]
    tip, _ = compute_pose(np.radians([following["posture_deg"]]), ARM.nominal())
    np.testing.assert_allclose(tip[0], moved.apply(balls[3]), atol=0.5)
    assert np.abs(np.array(following["posture_deg"]) - postures[3]).max() < 15.0


def test_two_seats_are_to_stand_where_their_poses_are_and_are_gone_to_in_turn(tmp_path):
    """As `armd interim report --poses` proposes them."""
    seats = validate("two", {"name": "two", "target": [{"name": n} for n in "AB"]}, Artefact)
    points = [TURN.apply(BALLS[name]) + ORIGIN for name in ("B2", "B3", "B2", "B3")]
    postures = [reaching(at, [20.0 + 5 * i, 30.0, -40.0]) for i, at in enumerate(points)]
    poses_table(tmp_path / "poses.csv", postures)
    plan = make_plan("poses", ARM, seats, Wishes(poses=tmp_path / "poses.csv"))
    assert [station.target for station in plan.stations] == ["A", "B", "A", "B"]
    near = dict(re.findall(r"(\w) near \[(.*?)\] mm", plan.stations[0].how))
    for name, at in zip("AB", points[:2], strict=True):
        assert [float(v) for v in near[name].split(",")] == pytest.approx(at, abs=1.0)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("x_mm", "x", "header: found no column x_mm"),
        (",30.0,", ",much,", "line 2, q2_deg: found 'much', expected a number"),
        (",30.0,", ",nan,", "line 2, q2_deg: found 'nan'"),
    ],
)
def test_a_table_that_is_no_design_is_refused(tmp_path, old, new, said):
    path = tmp_path / "poses.csv"
    poses_table(path, [[20.0, 30.0, -40.0]])
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(BadInput, match=re.escape(said)):
        make_plan("poses", ARM, None, Wishes(poses=path))


def test_arm_toml_says_the_same_again():
    arm = small_arm(gravity=[0.0, 1.0, 0.0])
    joint = arm.joint[0].model_copy(update={"temperature": {"a": 0.5, "b": 0.5}})
    arm = arm.model_copy(update={"joint": [joint, *arm.joint[1:]]})
    assert parse_toml("arm.toml", write_arm_toml(arm).encode(), type(arm)) == arm


def test_repeatability_comes_back_to_the_same_posture(tmp_path):
    """The posture is the first visit's. A servo that comes back to the count is a new visit if the
    tip was moved since, and the same one if it was not; in other kinds it is the same."""
    joint = {"a_mm": 100.0, "counts_per_turn": 4096, "min_deg": -170.0, "max_deg": 170.0}
    arm = small_arm(joint=[joint] * 5)
    in_use = MeasuredWith(arm, None, None, None)
    place = (300.0, 20.0, 100.0)
    q = np.array([0.1, 0.2, 0.3, 0.4, 0.5])
    for kind, wanted in (("repeatability", "reading"), ("seats", "refused")):
        plan = make_plan(kind, arm, None, Wishes(repeats=3))
        with Measuring(tmp_path / kind, plan, in_use) as measuring:
            first = press(1, place, angles_rad=q.tolist(), rates_rad_s=[0.0] * 5)
            assert measuring.offer(first)["event"] == "reading"
            still = press(2, place, still_s=1e6, angles_rad=q.tolist(), rates_rad_s=[0.0] * 5)
            assert measuring.offer(still)["reason"] == "unmoved"
            back = press(3, place, still_s=0.7, angles_rad=q.tolist(), rates_rad_s=[0.0] * 5)
            assert measuring.offer(back)["event"] == wanted
            following = measuring.state()["next"]
        if kind == "repeatability":
            assert following["posture_deg"] == pytest.approx(np.degrees(q).tolist())
