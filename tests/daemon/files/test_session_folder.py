"""`armd record --session`: rests of a live arm become a session that the other commands take."""

import signal
import subprocess

import numpy as np
import pytest

from armd import Flag
from armd.compensation.data.sessions.session import load_session
from armd.compensation.model.arm import load_arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.cli import main
from armd.daemon.files.session_folder import SessionFolder, load_artefact
from armd.errors import BadInput
from support.pressed import pressed
from support.program import ARMD
from support.running_daemon import running_daemon
from support.simulated_arm import simulated_arm
from support.small_arm import small_arm

ARTEFACT = """
[artefact]
name = "beam"
expansion_per_k = 5e-7
[[artefact.target]]
name = "B1"
position_mm = [0.0, 0.0, 0.0]
[[artefact.target]]
name = "B2"
position_mm = [100.0, 0.0, 0.0]
"""


@pytest.mark.slow
def test_presses_over_the_wire_become_readings(tmp_path, capsys):
    folder, artefact = tmp_path / "T20", tmp_path / "beam.toml"
    artefact.write_text(ARTEFACT)
    with (
        simulated_arm(tmp_path, rate_hz=500) as arm,
        running_daemon(tmp_path, arm.port) as daemon,
        daemon.listen() as heard,
    ):
        # A daemon that begins within a rest cannot know from which side the tip came there.
        heard.wait_for(lambda: len(heard.points()) > 0)
        heard.wait_for(lambda: np.ptp(heard.points()["position_mm"], axis=0).max() > 1.0)
        command = [*ARMD, "record", "--session", str(folder)]
        command += ["--endpoint", daemon.endpoint, "--artefact", str(artefact)]
        command += ["--targets", "B2,B1", "--placement", "left"]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as recorder:
            assert recorder.stdout.readline().rstrip().endswith("first B2")
            told = [recorder.stdout.readline() for _ in range(2)]
            recorder.send_signal(signal.SIGINT)
            rest, _ = recorder.communicate(timeout=60)
        assert recorder.returncode == 0, (told, rest)
        measured = heard.json("measurement")

    assert [line.split()[1] for line in told] == ["B2:", "B1:"]
    assert main(["check", str(folder), str(arm.arm_toml)]) == 0, capsys.readouterr().err
    assert "columns not used" not in capsys.readouterr().out
    session = load_session(folder, load_arm(arm.arm_toml))
    assert [session.artefact.target_names[i] for i in session.target[:2]] == ["B2", "B1"]
    assert session.artefact.expansion_per_k == 5e-7 and session.placement_names == ["left"]

    # Each reading is one of the measurements that a subscriber saw: same instant, same place.
    stamps_s = np.array([m["stamp_ns"] for m in measured]) * 1e-9
    rows = np.abs(session.states.time_s[:, None] - stamps_s).argmin(axis=1)
    assert len(set(rows)) == session.n
    np.testing.assert_allclose(session.states.time_s, stamps_s[rows], rtol=0, atol=1e-5)
    tip_mm, _ = compute_pose(session.states.q, load_arm(arm.arm_toml).nominal())
    published_mm = np.array([measured[row]["position_mm"] for row in rows])
    np.testing.assert_allclose(tip_mm, published_mm, rtol=0, atol=1e-4)
    assert np.isfinite(session.states.temperature_c).all()
    assert np.isfinite(session.states.rate).all()
    np.testing.assert_allclose(np.linalg.norm(session.states.approach, axis=1), 1)


def reading(**changes):
    return pressed(0, **changes)


def recorded(path, *measurements, targets=("A", "B")):
    """The session and what the operator was told."""
    folder = SessionFolder(path, small_arm(), load_artefact(None, targets), targets, "1")
    told = [folder.take(measurement) for measurement in measurements]
    return load_session(path, small_arm()), told


def test_a_rest_of_one_sample_is_a_reading_whose_scatter_nobody_knows(tmp_path):
    session, told = recorded(tmp_path / "session", reading(count=1, standard_deviation_mm=None))
    assert session.n == 1
    assert told == ["A: one point, whose scatter nobody knows"]


def test_what_is_no_rest_is_left_out_and_its_target_stays_the_next(tmp_path):
    session, told = recorded(
        tmp_path / "session",
        reading(),
        reading(count=0, angles_rad=None, flags=int(Flag.INVALID)),
        reading(flags=int(Flag.AT_REST | Flag.TEMPERATURE_STALE)),
        reading(count=1, standard_deviation_mm=None, flags=0),
        reading(stamp_ns=1_800_000_060_250_000_000),
        reading(),
    )
    assert [line.split(",")[0] for line in told[1:4]] == ["left out"] * 3
    assert "invalid" in told[1] and "stale" in told[2] and "rested" in told[3]
    assert [session.artefact.target_names[i] for i in session.target] == ["A", "B", "A"]
    assert session.started_unix_s == 1_800_000_000
    np.testing.assert_allclose(session.states.time_s[:2] - 1_800_000_000, [0.25, 60.25])
    np.testing.assert_array_equal(session.states.q[0], [0.1, 0.2, 0.3])
    np.testing.assert_array_equal(session.states.temperature_c[0], [21.5, 21.6, np.nan])
    np.testing.assert_array_equal(session.states.approach[0], [0, 0, -1])


def test_an_unknown_direction_of_travel_is_not_made_up_from_rates(tmp_path):
    session, _ = recorded(tmp_path / "session", reading(approach=None))
    assert np.isnan(session.states.approach).all() and np.isnan(session.states.rate).all()


def test_without_an_artefact_it_is_one_seat():
    assert load_artefact(None, []).target_names == ["seat"]
    assert load_artefact(None, []).targets[0].position_mm is None


def test_refused(tmp_path, capsys):
    recorded(tmp_path / "session", reading())
    with pytest.raises(BadInput, match=r"found session\.toml, expected a new or empty folder"):
        recorded(tmp_path / "session", reading())
    (tmp_path / "beam.toml").write_text(ARTEFACT)
    beam = load_artefact(tmp_path / "beam.toml", [])
    with pytest.raises(BadInput, match="found 'B3', expected targets of the artefact: B1, B2"):
        SessionFolder(tmp_path / "other", small_arm(), beam, ["B1", "B3"], "1")
    assert main(["record", "--targets", "B1"]) == 2
    assert "--targets: found no --session" in capsys.readouterr().err
