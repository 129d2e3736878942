"""The operator who follows a plan: the true tip rests where the plan's targets truly are."""

from itertools import islice

import numpy as np
import pytest

from armd.errors import BadInput
from armd.simulator.__main__ import main
from armd.simulator.live.led import LedOperator, load_plan
from armd.simulator.live.physics import STEP_S, STEPS, generate_blocks
from armd.simulator.plants.live import plant_in_arm
from armd.simulator.servobus.arm import LIMITS_DEG, ServoArm
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects.effect import Conditions

RATE_HZ = 200
PLAN = """
schema = "armd.operator/1"
miss_um = 2.0
rest_s = 0.8
press_after_s = 0.6
haste = 2.0
start_s = 0.5

[[target]]
name = "B1"
[[target]]
name = "B2"
position_mm = [120.0, 0.0, 0.0]

[[visit]]
placement = "P1"
position_mm = [550.0, 0.0, 200.0]
rotation_deg = [0.0, 0.0, 90.0]
rounds = 2
[[visit]]
placement = "P2"
targets = ["B2"]
"""


def written(folder, text=PLAN):
    path = folder / "plan.toml"
    path.write_text(text)
    return load_plan(path)


def presses(arm, hand, seconds):
    """True tips (n, 3) and joint angles at the instants at which the button goes down."""
    life = list(
        islice(generate_blocks(arm, hand, RATE_HZ, 20.0, None), round(seconds / STEPS / STEP_S))
    )
    buttons = np.concatenate([block.buttons for block in life]).astype(int)
    tips = np.concatenate([block.tip_mm for block in life])
    shown = np.concatenate([block.encoder_rad for block in life])
    down = np.flatnonzero(np.diff(buttons, prepend=0) == 1)
    still = np.array([np.ptp(tips[i - RATE_HZ // 2 : i], axis=0).max() for i in down])
    assert np.all(still < 1e-4), "pressed in motion"
    return tips[down], shown[down]


def test_the_tip_rests_at_the_targets_in_their_order_and_misses_a_little(tmp_path):
    arm = TrueArm.default(3)
    tips, _ = presses(arm, LedOperator(arm, written(tmp_path), 3), 25.0)
    assert len(tips) >= 6
    # Turned by 90° about z, the second ball lies along y.
    b1, b2 = np.array([550.0, 0.0, 200.0]), np.array([550.0, 120.0, 200.0])
    missed = tips[:4] - [b1, b2, b1, b2]
    assert 0 < np.abs(missed).max() < 0.012
    assert np.linalg.norm(tips[4] - b2) > 1.0  # the second placement is the plan's own choice
    assert np.linalg.norm(tips[5] - b1) < 0.012  # and then it begins anew


def test_with_a_fault_the_tip_is_where_it_was_and_the_encoders_show_otherwise(tmp_path):
    led, healthy = written(tmp_path), TrueArm.default(3)
    sick = plant_in_arm(healthy, ["encoder_eccentricity@joint 3=2.0"], 3)
    tips, shown = presses(sick, LedOperator(sick, led, 3), 6.0)
    assert np.linalg.norm(tips[0] - [550.0, 0.0, 200.0]) < 0.012
    told = healthy.tip(shown, Conditions.at_rest(len(shown), 6))
    assert np.linalg.norm(told - tips, axis=1).max() > 0.02


@pytest.mark.parametrize("n", [3, 4, 5, 7, 9])
def test_arms_of_any_joints_are_led_and_planted_in(n, tmp_path):
    """Three joints reach a point in few postures: the hand comes back in one of them."""
    text = PLAN.replace("[550.0, 0.0, 200.0]", "[500.0, 0.0, 200.0]").replace(
        "2.0\nstart", "5.0\nstart"
    )
    arm = plant_in_arm(TrueArm.default(3, joints=n), [f"joint_backlash@joint {n}=2.0"], 3)
    low, high = nominal.get_limits_rad(n)
    tips, shown = presses(arm, LedOperator(arm, written(tmp_path, text), 3), 20.0)
    b1, b2 = np.array([500.0, 0.0, 200.0]), np.array([500.0, 120.0, 200.0])
    assert len(tips) >= 4 and np.abs(tips[:4] - [b1, b2, b1, b2]).max() < 0.012
    assert ((shown > low) & (shown < high)).all()
    if n > 3:
        assert np.ptp(shown[[0, 2]], axis=0).max() > 0.1  # another posture


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('targets = ["B2"]', 'targets = ["B9"]', "visit\\[2\\].targets: found 'B9'"),
        ("rest_s = 0.8", "rest_s = 0.5", "press_after_s below rest_s"),
        ("0.0, 0.0, 90.0", "0.0, 0.0, 1e308", "less than or equal to 3600"),
        ("rest_s = 0.8", "rest_s = 1e6", "less than or equal to 86400"),
        ("haste = 2.0", "hurry = 2.0", "hurry: found an unknown key"),
    ],
)
def test_a_bad_plan_is_refused(tmp_path, old, new, words):
    with pytest.raises(BadInput, match=words):
        written(tmp_path, PLAN.replace(old, new))


def test_what_cannot_be_reached_or_planted_is_refused(tmp_path):
    far = written(tmp_path, PLAN.replace("[550.0, 0.0, 200.0]", "[5500.0, 0.0, 200.0]"))
    with pytest.raises(BadInput, match=r"visit\[1\] P1: found fewer than 2 articulations"):
        LedOperator(TrueArm.default(), far, 1)
    with pytest.raises(BadInput, match="something beside the arm"):
        plant_in_arm(TrueArm.default(), ["sensor_offset@sensor t2=1.0"], 1)


def test_the_printed_arm_is_led_too_within_its_limits(tmp_path):
    text = PLAN.replace("[550.0, 0.0, 200.0]", "[220.0, 0.0, 60.0]").replace("miss_um = 2.0", "")
    led = written(tmp_path, text.partition('[[visit]]\nplacement = "P2"')[0])
    arm = ServoArm(2, 20.0, led=led)
    times = np.arange(0.0, 12.0, 0.01)
    down = np.flatnonzero(np.diff([arm.motion.pressed(t) for t in times], prepend=False))[::2]
    assert len(down) >= 4
    # Turned by 90° about z, the second ball lies along y.
    b1, b2 = np.array([220.0, 0.0, 60.0]), np.array([220.0, 120.0, 60.0])
    tips = arm.tips_mm(times[down])
    assert np.abs(tips[:4] - [b1, b2, b1, b2]).max() < 0.2  # its play, and the motors' warmth
    assert np.ptp(arm.tips_mm(times[down[0]] - np.arange(0.0, 0.5, 0.1)), axis=0).max() < 1e-2
    angles = np.degrees([[arm.motion.angle(k, t) for k in range(1, 6)] for t in times[down]])
    low, high = LIMITS_DEG.T
    assert ((angles > low) & (angles < high)).all() and np.ptp(angles, axis=0).max() > 20
    assert [arm.motion.pressed(t) for t in times[down]] == [True] * len(down)  # asked again


def test_a_microscribe_has_no_operator(tmp_path, capsys):
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    for options, words in (
        (["--microscribe", "--operator", str(plan)], "found --microscribe, expected --serial"),
        (["--servo", "feetech", "--plant", "encoder_slip@joint 1=1"], "expected --serial or --can"),
    ):
        assert main(options) == 2
        assert words in capsys.readouterr().err
