"""Tips: an offset found in a seat or on a sphere against a truth that is known, and its history."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import armd
from armd.compensation.identify.tip import fit_in_seat, fit_on_sphere
from armd.compensation.model.kinematics import compute_joint_jacobian, compute_pose
from armd.daemon.cli import main
from armd.daemon.files.kept_tips import load_active_tips, locate_tips_file
from armd.daemon.files.tip_history import locate_history_file, read_history
from armd.daemon.measure.in_use import MeasuredWith
from armd.daemon.measure.measuring import Measuring
from armd.daemon.measure.plan.kinds import make_plan
from armd.daemon.measure.plan.stations import Wishes
from armd.errors import BadInput
from support.pressed import pressed
from support.small_arm import small_arm

TRUE_MM = np.array([51.0, -2.0, 7.5])
SEAT_MM = np.array([300.0, 40.0, 80.0])
BALL_MM, SPHERE_MM = 1.5, 25.4


def in_seat(rng, n, noise_mm):
    """Last frames while the true tip stands in the seat, turned anyhow."""
    rotation = Rotation.random(n, random_state=rng).as_matrix()
    return SEAT_MM + rng.normal(0, noise_mm, (n, 3)) - rotation @ TRUE_MM, rotation


def on_sphere(rng, n, noise_mm):
    rotation = Rotation.random(n, random_state=rng).as_matrix()
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    away = SPHERE_MM / 2 + BALL_MM + rng.normal(0, noise_mm, (n, 1))
    return SEAT_MM + away * normal - rotation @ TRUE_MM, rotation


def test_without_noise_the_offset_is_the_true_one():
    rng = np.random.default_rng(1)
    seat = fit_in_seat(*in_seat(rng, 8, 0.0))
    np.testing.assert_allclose(seat.offset_mm, TRUE_MM, atol=1e-9)
    np.testing.assert_allclose(seat.centre_mm, SEAT_MM, atol=1e-9)
    sphere = fit_on_sphere(*on_sphere(rng, 15, 0.0), np.add(TRUE_MM, (3.0, -2.0, 4.0)), SPHERE_MM)
    np.testing.assert_allclose(sphere.offset_mm, TRUE_MM, atol=1e-7)
    np.testing.assert_allclose(sphere.centre_mm, SEAT_MM, atol=1e-7)
    assert sphere.radius_mm == pytest.approx(BALL_MM, abs=1e-7)
    assert max(seat.form_error_mm, sphere.form_error_mm) < 1e-7


@pytest.mark.parametrize("kind", ["seat", "sphere"])
def test_the_uncertainty_is_that_of_many_repetitions(kind):
    """The stated covariance against the scatter of 300 calibrations with fresh noise."""
    rng = np.random.default_rng(2)
    errors, stated = [], []
    for _ in range(300):
        if kind == "seat":
            found = fit_in_seat(*in_seat(rng, 12, 0.02))
        else:
            found = fit_on_sphere(*on_sphere(rng, 25, 0.02), TRUE_MM, SPHERE_MM)
        errors.append(found.offset_mm - TRUE_MM)
        stated.append(np.trace(found.covariance_mm2))
    real = float(np.mean(np.sum(np.square(errors), axis=1)))
    # Postures differ from try to try; the means agree within the tries' own scatter.
    assert 0.8 < np.mean(stated) / real < 1.25


def test_postures_too_alike_and_too_few_are_refused():
    rng = np.random.default_rng(3)
    turned = Rotation.from_rotvec(np.linspace(0, 0.5, 12)[:, None] * [0, 0, 1.0]).as_matrix()
    with pytest.raises(ArithmeticError, match="too alike"):
        fit_in_seat(SEAT_MM - turned @ TRUE_MM, turned)
    with pytest.raises(ArithmeticError, match="3 readings, expected at least 4"):
        fit_in_seat(*in_seat(rng, 3, 0.0))
    with pytest.raises(ArithmeticError, match="8 readings, expected at least 9"):
        fit_on_sphere(*on_sphere(rng, 8, 0.0), TRUE_MM, SPHERE_MM)


def arm_of_six():
    joint = {"a_mm": 200.0, "counts_per_turn": 1 << 20}
    alphas = (90.0, 0.0, 90.0, -90.0, 90.0, 0.0)
    joints = [joint | {"alpha_deg": alpha, "d_mm": 50.0} for alpha in alphas]
    return small_arm(joint=joints, temperature_sensor=[])


def measured(folder, offset_mm, noise_mm=0.002, seed=4, n=12):
    """A session of `armd measure tip`: the daemon believes arm.toml's offset, the tip is elsewhere.

    The seat is where the true tip stands: postures are solved for by hand (Gauss–Newton).
    """
    arm = arm_of_six()
    p = arm.nominal()
    true = p.copy()
    true[30:33] = offset_mm
    rng = np.random.default_rng(seed)
    goal = np.array([500.0, 100.0, 300.0])
    plan = make_plan("tip", arm, None, Wishes(repeats=n))
    with Measuring(folder, plan, MeasuredWith(arm, None, None, None)) as measuring:
        number = 0
        while not measuring.complete:
            q = rng.uniform(-2, 2, (1, 6))
            for _ in range(60):
                way = goal - compute_pose(q, true)[0]
                step = np.linalg.pinv(compute_joint_jacobian(q, true), rcond=1e-3) @ way[:, :, None]
                q = q + np.clip(step[:, :, 0], -0.3, 0.3)
            if np.linalg.norm(compute_pose(q, true)[0] - goal) > 1e-9:
                continue
            q += rng.normal(0, noise_mm / 500, q.shape)
            number += 1
            tip, rotation = compute_pose(q, p)
            orientation = Rotation.from_matrix(rotation[0]).as_quat().tolist()
            measurement = pressed(
                number, position_mm=tip[0].tolist(), standard_deviation_mm=None, approach=None,
                orientation=orientation, angles_rad=q[0].tolist(), rates_rad_s=None,
                temperatures_c={},
            )  # fmt: skip
            told = measuring.offer(measurement)
            assert told["event"] == "reading", told
        return measuring.state()["estimate"]


@pytest.fixture
def state(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))


def test_a_tip_is_calibrated_kept_and_warned_of_when_it_moved(tmp_path, state, capsys):
    estimate = measured(tmp_path / "first", [50.02, 0.01, -0.03])
    np.testing.assert_allclose(estimate["offset_mm"], [50.02, 0.01, -0.03], atol=0.02)
    out = tmp_path / "tip.json"
    code = main(["tip", "calibrate", str(tmp_path / "first"), "--name", "ruby", "--json", str(out)])
    said = capsys.readouterr().out
    assert code == 0 and "verdict       good" in said and "WARNING" not in said, said
    assert '[tips."ruby"]' in said
    result = json.loads(out.read_text())
    np.testing.assert_allclose(result["offset_mm"], [50.02, 0.01, -0.03], atol=0.02)
    # What the live engine estimated from published points is what the session gives.
    np.testing.assert_allclose(result["offset_mm"], estimate["offset_mm"], atol=1e-6)

    measured(tmp_path / "second", [50.02, 0.31, -0.03], seed=5)
    assert main(["tip", "calibrate", str(tmp_path / "second"), "--name", "ruby"]) == 0
    said = capsys.readouterr().out
    assert "WARNING       the offset moved by 0.3" in said
    assert result["measured"] in said  # since when
    kept = read_history("SMALL-1", "ruby")
    assert [round(entry["offset_mm"][1], 1) for entry in kept] == [0.0, 0.3]
    assert read_history("SMALL-1", "other") == []
    assert main(["tip", "history", "SMALL-1"]) == 0
    assert "2 calibrations" in capsys.readouterr().out


def test_a_doubtful_tip_says_why(tmp_path, state, capsys):
    measured(tmp_path / "loose", [50.0, 0.0, 0.0], noise_mm=1.0)
    assert main(["tip", "calibrate", str(tmp_path / "loose")]) == 1
    said = capsys.readouterr().out
    assert "doubtful" in said and "(k = 2) alone" in said and "a loose tip or seat" in said


class Daemon:
    """As far as putting a tip in force asks one."""

    serial = "SMALL-1"

    def __init__(self):
        self.asked = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        pass

    def command(self, name, /, **parameters):
        self.asked.append((name, parameters))
        return "tip ruby, as it was calibrated now"


def test_the_last_calibration_is_put_in_force_if_it_is_good(tmp_path, state, capsys, monkeypatch):
    daemon = Daemon()
    monkeypatch.setattr(armd, "connect", lambda *_: daemon)
    assert main(["tip", "apply", "ruby"]) == 2
    assert "tip 'ruby': found no calibration" in capsys.readouterr().err
    measured(tmp_path / "one", [50.0, 0.0, 0.0])
    command = ["tip", "calibrate", str(tmp_path / "one"), "--name", "ruby", "--apply"]
    assert main(command) == 0
    assert "SMALL-1: tip ruby, as it was calibrated now" in capsys.readouterr().out
    ((name, asked),) = daemon.asked
    offset_mm = read_history("SMALL-1", "ruby")[-1]["offset_mm"]
    assert (name, asked["name"], asked["radius_mm"]) == ("keep_tip", "ruby", "")
    assert [float(word) for word in asked["offset_mm"].split(",")] == offset_mm  # to the last bit
    # A doubtful one is kept in the history and goes nowhere else.
    measured(tmp_path / "loose", [50.0, 0.0, 0.0], noise_mm=1.0)
    assert main([*command[:2], str(tmp_path / "loose"), *command[3:]]) == 1
    assert main(["tip", "apply", "ruby"]) == 2
    assert "found a doubtful:" in capsys.readouterr().err
    assert len(daemon.asked) == 1


@pytest.mark.parametrize("content", ["{", "[]", '{"schema": "armd.tips/2"}', '{"tips": {"a": 1}}'])
def test_damaged_kept_tips_are_told(tmp_path, state, content):
    path = locate_tips_file("SMALL-1")
    path.parent.mkdir(parents=True)
    path.write_text(content)
    with pytest.raises(BadInput, match=str(path)):
        load_active_tips("SMALL-1", {})


def test_a_torn_history_keeps_what_is_whole(tmp_path, state, capsys):
    measured(tmp_path / "one", [50.0, 0.0, 0.0])
    main(["tip", "calibrate", str(tmp_path / "one")])
    with locate_history_file("SMALL-1").open("a") as file:
        file.write('{"schema": "armd.ti')
    main(["tip", "calibrate", str(tmp_path / "one")])
    assert len(read_history("SMALL-1")) == 2


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["use"], "armd tip use: found nothing, expected NAME [SERIAL]"),
        (["list", "A", "B"], "armd tip list: found A B, expected [SERIAL]"),
        (["calibrate"], "armd tip calibrate: found nothing, expected SESSION"),
        (["lst"], "found 'lst', expected one of list, use, calibrate, apply, history, or the NAME"),
        (["calibrate", "nowhere"], "arm.toml: found nothing, expected a session of `armd measure"),
    ],
)
def test_bad_usage(words, said, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["tip", *words]) == 2
    assert said in capsys.readouterr().err
