"""An arm of servos through the whole daemon: what a subscriber and a person hear of it; and arms of
five and of nine watched, measured, recorded, and replayed bit by bit."""

import json
import re
import signal
import subprocess
import time
from contextlib import contextmanager

import numpy as np
import pytest
import zenoh

from armd import Flag
from support.fake_servos import Dynamixel, FakeServos, Feetech
from support.program import ARMD, run_armd
from support.running_daemon import free_endpoint, running_daemon, write_config
from support.selection import parametrize_default

BUTTON = 20
NINE = (1, 2, 3, 4, 5, 7, 8, 9, 12)
BOTH = parametrize_default("family", [Feetech, Dynamixel], ids=lambda family: family.kind)
INVALID, WARNING, LOST = int(Flag.INVALID), int(Flag.JOINT_WARNING), int(Flag.SAMPLES_LOST)


def arm_toml(n, sensors=True):
    lines = ['schema = "armd.arm/1"', 'serial_number = "SERVO-1"', "reference_temperature_c = 20.0"]
    lines += [f'[[temperature_sensor]]\nname = "t{k}"' for k in range(1, n + 1) if sensors]
    for k in range(1, n + 1):
        lines.append(
            f"[[joint]]\ntheta_deg = 0.0\nd_mm = {50.0 if k == 1 else 0.0}\na_mm = 100.0\n"
            f"alpha_deg = {90.0 if k == 1 else 0.0}\nbeta_deg = 0.0\ncounts_per_turn = 4096\n"
            "min_deg = -180.0\nmax_deg = 180.0"
        )
        if sensors:
            lines.append(f'temperature = "t{k}"')
    return "\n".join([*lines, "[tip]\noffset_mm = [10.0, 0.0, 0.0]\nradius_mm = 1.0\n"])


@contextmanager
def measuring(servos, folder, ids, driver="", sensors=True):
    (folder / "arm.toml").write_text(arm_toml(len(ids), sensors))
    driver = f"baud = 1000000\nids = {list(ids)}\n{driver}"
    environment = {"STATE_DIRECTORY": str(folder / "state")}
    with (
        running_daemon(
            folder, str(servos.link), serial="SERVO-1", environment=environment,
            driver=driver, kind=servos.family.kind,
        ) as daemon,
        daemon.listen() as heard,
    ):  # fmt: skip
        yield daemon, heard


def state(heard):
    """(state, reason) told last."""
    told = heard.json("health")
    return (told[-1]["state"], told[-1]["reason"]) if told else ("", "")


def told(daemon, kind):
    """Texts of all events of a kind, also of those before anybody listened."""
    with daemon.session() as session:
        time.sleep(0.1)
        all_of_them = zenoh.ConsolidationMode.NONE
        replies = list(session.get("armd/SERVO-1/event", timeout=60.0, consolidation=all_of_them))
    events = [json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok]
    return " | ".join(event["text"] for event in events if event["kind"] == kind)


def accept(folder):
    environment = {"STATE_DIRECTORY": str(folder / "state")}
    return run_armd("accept", folder / "armd.toml", env=environment)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("family", "ids"),
    [
        pytest.param(Feetech, (1, 2, 3), id="three-feetech"),
        pytest.param(Dynamixel, NINE, id="nine-dynamixel"),
        pytest.param(Dynamixel, (1, 2, 3), id="three-dynamixel"),
        pytest.param(Feetech, (1, 2, 3, 4, 5), id="five-feetech"),
        pytest.param(Dynamixel, (1, 2, 3, 4, 5, 6, 7), id="seven-dynamixel"),
        pytest.param(Feetech, NINE, id="nine-feetech"),
    ],
)
def test_points_of_few_and_of_many_joints(tmp_path, family, ids):
    with (
        FakeServos(family, tmp_path, ids) as servos,
        measuring(servos, tmp_path, ids) as (daemon, heard),
    ):
        heard.wait_for(lambda: len(heard.points()) > 300)
        points = heard.points()
        assert (points["flags"] & int(Flag.CLOCK) == 0).all()
        good = points["flags"] & (INVALID | LOST) == 0
        # These servos are late where the machine stands still: each flag has its cause counted.
        told = len(heard.json("health"))
        heard.wait_for(lambda: len(heard.json("health")) > told + 1)
        drops = heard.json("health")[-1]["drops"]
        assert np.count_nonzero(~good) <= drops["lost"] + drops["missed"]
        points = points[good]
        straight_mm = 100.0 * len(ids) + 10.0
        assert np.allclose(points["position_mm"], [straight_mm, 0.0, 50.0])
        # Joint 2 up by a quarter turn: all that follows points upwards.
        servos.move(ids[1], 2048 + 1024)
        mark = len(heard.points()) + 300
        heard.wait_for(lambda: len(heard.points()) > mark)
        last_mm = heard.points()["position_mm"][-1]
        assert np.allclose(last_mm, [100.0, 0.0, 50.0 + straight_mm - 100.0])
        heard.wait_for(lambda: state(heard)[0] in ("READY", "WARMING"))
        assert daemon.stop()[0] == 0
    assert not servos.writes


@pytest.mark.slow
def test_changed_offsets_void_the_geometry_until_accepted(tmp_path):
    with FakeServos(Feetech, tmp_path) as servos:
        with measuring(servos, tmp_path, (1, 2, 3)) as (daemon, heard):
            heard.wait_for(lambda: len(heard.points()) > 100)
            assert (heard.points()["flags"] & INVALID == 0).all()
            daemon.stop()
        Feetech.put_homing(servos.registers[2], -120)
        with measuring(servos, tmp_path, (1, 2, 3)) as (daemon, heard):
            heard.wait_for(lambda: len(heard.points()) > 300)
            assert (heard.points()["flags"] & INVALID != 0).all()
            heard.wait_for(lambda: state(heard)[0] == "NOT_READY")
            words = "servo 2 (joint 2): homing offset (register 31): found -120, expected 0"
            heard.wait_for(lambda: words in state(heard)[1])
            assert words in told(daemon, "offsets_changed")
            done = accept(tmp_path)
            assert done.returncode == 0, done.stderr
            assert "servo 2: homing offset -120, before 0" in done.stdout
            accepted_ns = time.monotonic_ns()
            heard.wait_for(lambda: heard.points()["flags"][-1] & INVALID == 0)
            points = heard.points()
            first = points["monotonic_ns"][points["flags"] & INVALID == 0][0]
            assert (first - accepted_ns) * 1e-9 < 2.0
        remembered = json.loads((tmp_path / "state/servos-SERVO-1.json").read_text())
        assert remembered["accepted"]["2"]["homing_offset"] == -120


def test_accepting_nothing_says_so(tmp_path):
    (tmp_path / "arm.toml").write_text(arm_toml(3))
    write_config(tmp_path, "/dev/null", free_endpoint(), driver="ids = [1, 2, 3]", kind="feetech")
    done = accept(tmp_path)
    assert done.returncode == 2 and "found no servo, expected those of a connection" in done.stderr


@pytest.mark.slow
@BOTH
def test_torque_and_trouble_are_told_in_words(tmp_path, family):
    with FakeServos(family, tmp_path) as servos:
        servos.registers[2][family.torque] = 1
        with measuring(servos, tmp_path, (1, 2, 3)) as (daemon, heard):
            heard.wait_for(lambda: state(heard)[1] == "servo 2 (joint 2): its torque is on")
            assert state(heard)[0] == "DEGRADED"
            assert "servo 2 (joint 2)" in told(daemon, "torque_on")
            servos.registers[2][family.torque] = 0
            heard.wait_for(lambda: heard.events("torque_off"))
            servos.registers[3][70] = 0x20
            servos.errors[3] = 0x20 if family is Feetech else 0x80
            heard.wait_for(lambda: heard.points()["flags"][-1] & WARNING)
            assert np.isfinite(heard.points()["position_mm"][-1]).all()
            heard.wait_for(
                lambda: "overload" in " ".join(e["text"] for e in heard.events("servo_warning"))
            )
            servos.errors[3] = 0
            heard.wait_for(lambda: not heard.points()["flags"][-1] & WARNING)
    assert not servos.writes


@pytest.mark.slow
def test_a_missing_id_is_named_and_its_rows_are_invalid(tmp_path):
    with FakeServos(Feetech, tmp_path, (1, 2, 3)) as servos:
        servos.silent.add(3)
        with measuring(servos, tmp_path, (1, 2, 3)) as (daemon, heard):
            heard.wait_for(lambda: len(heard.points()) > 50)
            assert (heard.points()["flags"] & INVALID != 0).all()
            assert "servo 3 (joint 3): found no answer" in told(daemon, "servo_missing")
            heard.wait_for(lambda: "servo 3 (joint 3) does not answer" in state(heard)[1])
            servos.silent.clear()
            heard.wait_for(lambda: heard.points()["flags"][-1] & INVALID == 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("family", "ids"),
    [
        pytest.param(Feetech, (1, 2, 3, 4, 5), id="five-feetech"),
        pytest.param(Dynamixel, NINE, id="nine-dynamixel"),
    ],
)
def test_watched_measured_recorded_and_replayed(tmp_path, family, ids):
    recording = tmp_path / "arm.mcap"
    trigger = f"rate_hz = 100\ntrigger = {{ id = {BUTTON}, pressed_below = 1900 }}\n"
    with (
        FakeServos(family, tmp_path, (*ids, BUTTON)) as servos,
        measuring(servos, tmp_path, ids, trigger) as (daemon, heard),
    ):
        heard.wait_for(lambda: len(heard.points()) > 20)
        to_file = ["record", "--endpoint", daemon.endpoint, "-o", str(recording)]
        with subprocess.Popen([*ARMD, *to_file], stdout=subprocess.PIPE, text=True) as recorder:
            assert recorder.stdout is not None
            assert "recording" in recorder.stdout.readline()
            for step in range(10):  # all joints, a count or two each time
                for servo in ids:
                    servos.move(servo, 2048 + 2 * step)
                mark = len(heard.points()) + 2
                heard.wait_for(lambda mark=mark: len(heard.points()) > mark)
            at_rest = int(Flag.AT_REST)
            heard.wait_for(lambda: heard.points()["flags"][-1] & at_rest)
            servos.move(BUTTON, 1500)
            heard.wait_for(lambda: heard.json("measurement"))
            servos.move(BUTTON, 2300)
            servos.move(ids[0], 2100)  # what is compared begins after 1.5 s
            end_ns = heard.points()["monotonic_ns"][-1] + 2_500_000_000
            heard.wait_for(lambda: heard.points()["monotonic_ns"][-1] > end_ns)
            recorder.send_signal(signal.SIGINT)
            out, _ = recorder.communicate(timeout=60)
        assert recorder.returncode == 0, out
        watched = run_armd("watch", "--json", "--seconds", "1", "--endpoint", daemon.endpoint)
        measurement = heard.json("measurement")[0]
        assert daemon.stop()[0] == 0
    assert watched.returncode == 0, watched.stderr
    told = [json.loads(line) for line in watched.stdout.splitlines()]
    assert told
    angles_rad = np.array(measurement["angles_rad"])
    assert angles_rad.shape == (len(ids),)
    assert np.allclose(angles_rad, 18 * 2 * np.pi / 4096)
    assert measurement["flags"] & INVALID == 0
    checked = run_armd("replay", recording, "--check")
    assert checked.returncode == 0, checked.stdout + checked.stderr
    assert int(re.search(r"(\d+) points bit-identical, 0 different", checked.stdout)[1]) > 50
