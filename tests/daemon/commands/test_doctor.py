"""`armd doctor`: each thing that can stand in the way is told with what mends it."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
import tty
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import serial

from armd.daemon import cli
from armd.daemon.commands.setup import doctor
from armd.daemon.config import load_config
from armd.daemon.doctor.examine import diagnose_port
from armd.daemon.doctor.expected import compare
from armd.daemon.doctor.finding import PortReport
from armd.daemon.doctor.machine import ThisMachine, list_can_buses
from armd.drivers.config import ServoConfig
from armd.simulator.servobus.arm import make_arm_toml
from support.pty_link import PtyLink
from support.running_daemon import free_endpoint, write_config
from support.selection import parametrize_default
from support.simulated_arm import simulated_arm
from support.standing_servos import FakeServos, sts3215, xl330


def _doctor(port: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    capsys.readouterr()
    code = cli.main(["doctor", "--port", port, "--json"])
    said = json.loads(capsys.readouterr().out)
    assert said["ok"] == (code == 0)
    return code, said["ports"][0]


def _kinds(report: dict[str, Any]) -> set[str]:
    return {finding["kind"] for finding in report["findings"]}


@pytest.mark.serial
def test_six_good_servos_are_well(capsys: pytest.CaptureFixture[str]) -> None:
    with FakeServos("feetech", {i: sts3215() for i in range(1, 7)}) as bus:
        code, report = _doctor(bus.port, capsys)
    assert code == 0, report["findings"]
    assert report["protocol"] == "feetech" and report["baud"] == 1_000_000
    assert [servo["id"] for servo in report["servos"]] == [1, 2, 3, 4, 5, 6]
    assert report["servos"][0] == {
        "id": 1,
        "model": 777,
        "firmware": "3.10",
        "homing_offset": -85,
        "reversed": False,
        "mode": 0,
        "torque": False,
        "return_delay_us": 0,
        "offset_in_force": True,
        "divider": 1,
    }
    assert report["rate_hz"] > 20
    assert bus.writes == []  # it changes nothing


@pytest.mark.serial
def test_what_is_wrong_with_servos_is_told_and_how_to_mend_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    tables = {i: sts3215() for i in (1, 2, 4, 6)}
    tables[5] = sts3215(firmware=(3, 9), torque=1, delay=250)
    with FakeServos("feetech", tables) as bus:
        found = diagnose_port(bus.port, ThisMachine())
    doctor._print([found], True)
    report = found.as_json()
    assert bus.writes == []
    assert _kinds(report) == {"missing_id", "mixed_firmware", "torque_on", "return_delay"}
    texts = {finding["kind"]: finding["text"] for finding in report["findings"]}
    assert texts["missing_id"] == "servo 3 does not answer, and 6 is the last that does"
    mixed = "mixed firmware (register 0): servo 5 has 3.9, the other STS3215 3.10"
    assert texts["mixed_firmware"] == mixed
    assert texts["torque_on"].startswith("torque (register 40) is on at servo 5")
    assert texts["return_delay"] == "servo 5 waits 500 µs before each answer: 0.5 ms a cycle"
    printed = capsys.readouterr().out
    assert "do: return_delay_us = 0 under [driver]" in printed
    assert "do: torque_off = true under [driver]" in printed


def test_servos_are_held_against_armd_toml(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A missing id at the end of the row, which the line alone cannot tell, and one too many."""
    (tmp_path / "arm.toml").write_text(make_arm_toml("SO-101"))
    keys = "baud = 500000\nids = [1, 2, 3, 4, 7]\ntemperature_ids = [2, 3, 4, 7, 9]"
    with FakeServos("feetech", {i: sts3215() for i in (1, 2, 3, 4, 6)}) as bus:
        config = write_config(tmp_path, bus.port, free_endpoint(), driver=keys, kind="feetech")
        capsys.readouterr()
        code = cli.main(["doctor", "--config", str(config), "--json"])
    (report,) = json.loads(capsys.readouterr().out)["ports"]
    assert code == 1
    told = [finding["text"] for finding in report["findings"]]
    assert f"servo 7 (joint 5) of {config}: found no answer, expected one" in told
    assert f"servo 9 (temperature_ids) of {config}: found no answer, expected one" in told
    speaks = f"{config}: driver.baud: found 500000, and servos that speak at 1000000"
    assert speaks in told
    assert f"servo 6 answers, and {config} does not name it" in report["facts"]
    assert bus.writes == []


@pytest.mark.slow
@pytest.mark.serial
def test_dynamixel_as_from_the_factory(capsys: pytest.CaptureFixture[str]) -> None:
    with FakeServos("dynamixel", {i: xl330() for i in range(11, 17)}) as bus:
        code, report = _doctor(bus.port, capsys)
    assert code == 1 and bus.writes == []
    assert report["protocol"] == "dynamixel"
    assert [servo["id"] for servo in report["servos"]] == [11, 12, 13, 14, 15, 16]
    assert _kinds(report) == {"return_delay"}  # and no id is missing before 11
    assert "XL330-M288, firmware 52" in str(report["facts"])
    assert "3.0 ms a cycle" in str(report["findings"])


def test_servos_that_cannot_be_used_are_named(capsys: pytest.CaptureFixture[str]) -> None:
    """One of the SCS series, one that answers pings alone, one that misses answers."""
    tables = {i: sts3215() for i in range(1, 5)}
    tables[2][3:5] = (1284).to_bytes(2, "little")
    tables[3] = bytearray(20)  # too short for what it is asked
    with FakeServos("feetech", tables, weak=4) as bus:
        found = diagnose_port(bus.port, ThisMachine())
    doctor._print([found], True)
    assert bus.writes == []
    told = [(finding.kind, finding.text) for finding in found.findings]
    assert {kind for kind, _ in told} == {"servo_refused", "unreadable", "lost_answers"}
    texts = [text for _, text in told]
    assert any(text.startswith("servo 2: model (register 3): found 1284") for text in texts)
    assert "servo 3 answers a ping, but not what it is" in texts
    assert any(text.startswith("servo 4 answered ") for text in texts)
    printed = capsys.readouterr().out
    assert all(f"do: {finding.mend}" in printed for finding in found.findings)


@pytest.mark.slow
@pytest.mark.serial
def test_a_servo_that_speaks_at_another_rate_is_found(capsys: pytest.CaptureFixture[str]) -> None:
    """In the gap of a row: it was new, and still has the factory's rate."""
    tables = {i: sts3215() for i in (1, 2, 4, 3)}
    with FakeServos("feetech", tables, baud=115_200, odd=3) as bus:
        code, report = _doctor(bus.port, capsys)
    assert code == 1 and bus.writes == []
    (finding,) = report["findings"]
    assert finding["kind"] == "other_baud"
    assert finding["text"] == "servo 3 answers at 115200 baud, the others at 1000000"
    assert finding["mend"] == "set its rate to 1000000 with the maker's tool"


@pytest.mark.slow
@pytest.mark.serial
@pytest.mark.parametrize("family", ["feetech", pytest.param("dynamixel", marks=pytest.mark.slow)])
@parametrize_default("fault", ["servo_alert", "echo", "stale_bytes"])
def test_a_line_with_a_fault_has_the_servos_that_it_has(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], family: str, fault: str
) -> None:
    with simulated_arm(
        tmp_path, "--fault", f"{fault}@0:90", wire=("--servo", family), seconds=60
    ) as arm:
        code, report = _doctor(arm.port, capsys)
    assert [servo["id"] for servo in report["servos"]] == [1, 2, 3, 4, 5, 6]
    hears_itself = "the adapter hears what it says, and armd passes over that"
    assert (hears_itself in report["facts"]) == (fault == "echo")
    assert code == (fault == "servo_alert")
    assert _kinds(report) == ({"servo_alert"} if fault == "servo_alert" else set())
    if fault == "servo_alert":
        assert report["findings"][0]["text"] == "servo 2 complains of: overload"


def test_several_that_are_missing_are_one_finding(capsys: pytest.CaptureFixture[str]) -> None:
    with FakeServos("feetech", {i: sts3215() for i in (1, 3, 8)}) as bus:
        _, report = _doctor(bus.port, capsys)
    (text,) = [f["text"] for f in report["findings"] if f["kind"] == "missing_id"]
    assert text == "servos 2, 4 to 7 do not answer, and 8 is the last that does"


def test_another_kind_of_servo_than_the_files_is_told_with_the_key(tmp_path: Path) -> None:
    (tmp_path / "arm.toml").write_text(make_arm_toml("SO-101"))
    own = {"driver": "ids = [1, 2, 3, 4, 5]", "kind": "dynamixel"}
    config = write_config(tmp_path, "/dev/ttyACM0", free_endpoint(), **own)
    driver = load_config(config).file.driver
    assert isinstance(driver, ServoConfig)
    report = PortReport("/dev/ttyACM0", protocol="feetech", baud=1_000_000)
    compare(report, config, driver)
    (finding,) = report.findings
    assert finding.kind == "other_kind"
    assert finding.text == f"{config}: driver.kind: found dynamixel, and feetech servos on the line"
    assert finding.mend == f'kind = "feetech" under [driver] of {config}'
    other = PortReport("/dev/ttyACM0", protocol="microscribe", baud=115_200)
    compare(other, config, driver)
    told = "driver.kind: found dynamixel, and a MicroScribe on the line"
    assert other.findings[0].text == f"{config}: {told}"


@pytest.mark.slow
def test_another_device_and_another_program_on_the_port_are_told(
    capsys: pytest.CaptureFixture[str],
) -> None:
    bus = PtyLink(Path(tempfile.mkdtemp()) / "port")
    stop = threading.Event()

    def talk() -> None:
        while not stop.wait(0.05):
            with suppress(BlockingIOError):
                os.write(bus.master, b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9*47\r\n")

    talking = threading.Thread(target=talk)
    talking.start()
    code, report = _doctor(str(bus.link), capsys)
    stop.set()
    talking.join()
    (finding,) = report["findings"]
    assert code == 1 and finding["kind"] == "no_answer"
    assert finding["text"].endswith("bytes of something else came: another device?")
    with serial.Serial(str(bus.link), exclusive=True):
        code, report = _doctor(str(bus.link), capsys)
    bus.unplug()
    (finding,) = report["findings"]
    assert code == 1 and finding["kind"] == "port_held"
    assert finding["mend"] == f"sudo fuser -v {bus.link} names it: end it"


@pytest.mark.slow
def test_a_port_where_nobody_answers_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    with FakeServos("feetech", {}) as bus:
        code, report = _doctor(bus.port, capsys)
    (finding,) = report["findings"]
    assert code == 1 and finding["kind"] == "no_answer"
    assert finding["text"].endswith("it is a pseudo-terminal")
    assert finding["mend"].startswith("start the program that is to speak at its other end")


def test_an_arm_of_our_own_wire_is_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with simulated_arm(tmp_path, seconds=20) as arm:
        code, report = _doctor(arm.port, capsys)
        arm.stop()
    assert code == 0 and report["protocol"] == "serial"
    assert "arm SIM-0001 at" in str(report["facts"])


@pytest.mark.slow
def test_a_microscribe_is_known(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with simulated_arm(tmp_path, wire=("--microscribe",), seconds=60) as arm:
        code, report = _doctor(arm.port, capsys)
        # Nothing is left behind: the next program begins its session as the first one did.
        assert cli.main(["arm", "microscribe", "--port", arm.port]) == 0
        arm.stop()
    assert code == 0 and report["protocol"] == "microscribe"
    assert 'serial_number = "40937"' in capsys.readouterr().out


@pytest.mark.slow
def test_an_adapter_that_hears_itself_is_no_arm(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A half-duplex adapter gives back whatever it is told, IMMC too; the servos are switched
    off."""
    line, stop = PtyLink(tmp_path / "port"), threading.Event()

    def echo() -> None:
        while not stop.wait(0.001):
            with suppress(BlockingIOError):
                os.write(line.master, os.read(line.master, 4096))

    adapter = threading.Thread(target=echo)
    adapter.start()
    try:
        code, report = _doctor(str(line.link), capsys)
    finally:
        stop.set()
        adapter.join()
        line.unplug()
    assert code == 1 and report["protocol"] == "" and _kinds(report) == {"no_answer"}
    assert "hears what it says" in report["findings"][0]["text"]


def test_a_port_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    code, report = _doctor("/dev/ttyUSB_none", capsys)
    assert code == 1 and _kinds(report) == {"no_port"}


def test_what_is_no_serial_port_is_called_what_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Nobody is told to end the programs that hold /dev/null: all of them do."""
    (tmp_path / "file").touch()
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "pty").symlink_to("/dev/pts/98765")
    (tmp_path / "stale").symlink_to("ttyUSB9")
    own = "give the arm's own port: `ls -l /dev/serial/by-id` names what is plugged in"
    said = {
        "/dev/null": ("is another kind of device, no serial port", own),
        tmp_path / "file": ("is a file, no serial port", own),
        tmp_path / "pipe": ("is a pipe, no serial port", own),
        tmp_path: ("is a folder, no serial port", own),
        tmp_path / "pty": ("points to /dev/pts/98765, which is gone", "pseudo-terminal again"),
        tmp_path / "stale": ("points to ttyUSB9, which is gone", "give its present port"),
        tmp_path / "loop": ("Too many levels of symbolic links", f"namei -l {tmp_path / 'loop'}"),
    }
    for port, (words, mend) in said.items():
        code, report = _doctor(str(port), capsys)
        (finding,) = report["findings"]
        assert code == 1 and finding["text"].startswith(f"{port} "), finding
        assert finding["text"].endswith(words) and mend in finding["mend"], finding
    command = [sys.executable, "-m", "armd", "doctor", "--port", "/dev/null"]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    lines = ["/dev/null", "  ✗ /dev/null is another kind of device, no serial port"]
    assert ended.stdout.splitlines() == [*lines, f"    do: {own}"]
    assert ended.returncode == 1 and not ended.stderr


def test_the_screen_in_front_of_a_person_is_not_asked() -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    try:
        for port in (os.ttyname(slave), "/dev/tty"):
            command = [sys.executable, "-m", "armd", "doctor", "--json", "--port", port]
            subprocess.run(command, stdin=slave, stdout=slave, timeout=60, check=False)
            said = ""
            while not said.rstrip().endswith("\n}"):
                said += os.read(master, 4096).decode()
            (finding,) = json.loads(said)["ports"][0]["findings"]
            assert finding["kind"] == "no_serial_port"
    finally:
        os.close(master)
        os.close(slave)


def test_a_port_that_goes_away_while_it_is_asked_is_told(
    capsys: pytest.CaptureFixture[str],
) -> None:
    master, slave = os.openpty()
    tty.setraw(slave)
    port = os.ttyname(slave)

    def pull() -> None:
        os.read(master, 1)  # the first question
        os.close(master)

    pulling = threading.Thread(target=pull)
    pulling.start()
    code, report = _doctor(port, capsys)
    pulling.join()
    os.close(slave)
    (finding,) = report["findings"]
    assert code == 1 and finding["kind"] == "gone" and "went away" in finding["text"]


# --- the machine ---------------------------------------------------------------------------------


def _machine(tmp_path: Path, uid: int = 0) -> tuple[ThisMachine, Path]:
    port = tmp_path / "dev/ttyUSB0"
    port.parent.mkdir()
    port.touch()
    for name in ("sys", "proc"):
        (tmp_path / name).mkdir()
    return ThisMachine(tmp_path / "sys", tmp_path / "proc", uid, {uid}), port


def _process(tmp_path: Path, number: int, name: str, holds: Path | None) -> None:
    folder = tmp_path / "proc" / str(number)
    (folder / "fd").mkdir(parents=True)
    (folder / "comm").write_text(f"{name}\n")
    if holds is not None:
        (folder / "fd/7").symlink_to(holds)


def test_a_latency_timer_of_16_ms_is_told(tmp_path: Path) -> None:
    machine, port = _machine(tmp_path)
    timer = tmp_path / "sys/bus/usb-serial/devices/ttyUSB0/latency_timer"
    timer.parent.mkdir(parents=True)
    timer.write_text("16\n")
    report = PortReport(str(port))
    assert machine.examine(port, report)  # slow, but it works
    (finding,) = report.findings
    assert finding.kind == "latency_timer" and f"echo 1 | sudo tee {timer}" in finding.mend
    timer.write_text("1\n")
    well = PortReport(str(port))
    assert machine.examine(port, well) and not well.findings


def test_a_port_without_permission_names_its_group(tmp_path: Path) -> None:
    machine, port = _machine(tmp_path, uid=54321)
    port.chmod(0o660)
    report = PortReport(str(port))
    assert not machine.examine(port, report)
    (finding,) = report.findings
    assert finding.kind == "permission" and finding.mend.startswith("sudo usermod -aG root 54321")
    ours = ThisMachine(machine.sys, machine.proc, 54321, {port.stat().st_gid})
    assert ours.examine(port, PortReport(str(port)))


def test_modem_manager_and_others_that_hold_the_port_are_named(tmp_path: Path) -> None:
    machine, port = _machine(tmp_path)
    _process(tmp_path, 7, "ModemManager", None)
    report = PortReport(str(port))
    assert machine.examine(port, report) and not report.findings
    assert "ModemManager runs" in str(report.facts)
    _process(tmp_path, 8, "ModemManager", port)
    _process(tmp_path, 9, "lerobot", port)
    report = PortReport(str(port))
    assert not machine.examine(port, report)
    mend = {finding.kind: finding.mend for finding in report.findings}
    assert mend["modem_manager"] == "sudo systemctl disable --now ModemManager"
    assert mend["port_held"] == "end it: kill 9"


def test_a_can_bus_that_is_down_is_told(tmp_path: Path) -> None:
    for name, kind, flags in (("can0", 280, 0x80), ("can1", 280, 0x81), ("eth0", 1, 0x81)):
        folder = tmp_path / "class/net" / name
        folder.mkdir(parents=True)
        (folder / "type").write_text(f"{kind}\n")
        (folder / "flags").write_text(f"{flags:#x}\n")
    down, up = list_can_buses(tmp_path)
    assert up.name == "can1" and not up.findings
    assert down.findings[0].mend == "sudo ip link set can0 up type can bitrate 1000000"


@pytest.mark.slow
@pytest.mark.serial
def test_servos_of_protocol_1_are_told_from_feetechs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Their pings are the same packets."""
    for kind, model in (("dynamixel1", 29), ("feetech", 777)):
        with simulated_arm(tmp_path, wire=("--servo", kind)) as arm:
            code, report = _doctor(arm.port, capsys)
        assert code == 0, report["findings"]
        assert report["protocol"] == kind and report["baud"] == 1_000_000
        assert report["servos"][0]["model"] == model
        assert [servo["id"] for servo in report["servos"]] == [1, 2, 3, 4, 5, 6]
        said = " ".join(report["facts"])
        assert ("read one by one" in said) == (kind == "dynamixel1")
        assert report["rate_hz"] > 20
