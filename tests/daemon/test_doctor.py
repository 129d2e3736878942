"""`armd doctor`: each thing that can stand in the way is told with what mends it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from simulated_arm import simulated_arm
from standing_servos import FakeServos, sts3215, xl330

from armd.daemon import cli
from armd.daemon.commands import doctor
from armd.daemon.doctor.examine import examine_port
from armd.daemon.doctor.finding import Patient
from armd.daemon.doctor.machine import Machine, can_buses
from armd.simulator.servobus.arm import arm_toml


def _doctor(port: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any]]:
    capsys.readouterr()
    code = cli.main(["doctor", "--port", port, "--json"])
    said = json.loads(capsys.readouterr().out)
    assert said["ok"] == (code == 0)
    return code, said["ports"][0]


def _kinds(patient: dict[str, Any]) -> set[str]:
    return {finding["kind"] for finding in patient["findings"]}


def test_six_good_servos_are_well(capsys: pytest.CaptureFixture[str]) -> None:
    with FakeServos("feetech", {i: sts3215() for i in range(1, 7)}) as bus:
        code, patient = _doctor(bus.port, capsys)
    assert code == 0, patient["findings"]
    assert patient["protocol"] == "feetech" and patient["baud"] == 1_000_000
    assert [servo["id"] for servo in patient["servos"]] == [1, 2, 3, 4, 5, 6]
    assert patient["servos"][0] == {
        "id": 1,
        "model": 777,
        "firmware": "3.10",
        "homing_offset": -85,
        "reversed": False,
        "mode": 0,
        "torque": False,
        "return_delay_us": 0,
    }
    assert patient["rate_hz"] > 20
    assert bus.writes == []  # it changes nothing


def test_what_is_wrong_with_servos_is_told_and_how_to_mend_it(
    capsys: pytest.CaptureFixture[str],
) -> None:
    tables = {i: sts3215() for i in (1, 2, 4, 6)}
    tables[5] = sts3215(firmware=(3, 9), torque=1, delay=250)
    with FakeServos("feetech", tables) as bus:
        found = examine_port(bus.port, Machine())
    doctor._print([found], True)
    patient = found.as_json()
    assert bus.writes == []
    assert _kinds(patient) == {"missing_id", "mixed_firmware", "torque_on", "return_delay"}
    texts = {finding["kind"]: finding["text"] for finding in patient["findings"]}
    assert texts["missing_id"] == "servo 3 does not answer, and 6 is the last that does"
    assert texts["mixed_firmware"] == "mixed firmware: servo 5 has 3.9, the other STS3215 3.10"
    assert texts["torque_on"].startswith("torque is on at servo 5")
    assert texts["return_delay"] == "servo 5 waits 500 µs before each answer: 0.5 ms a cycle"
    printed = capsys.readouterr().out
    assert "mend: return_delay_us = 0 under [driver]" in printed
    assert "mend: torque_off = true under [driver]" in printed


def test_servos_are_held_against_armd_toml(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A missing id at the end of the row, which the line alone cannot tell, and one too many."""
    (tmp_path / "arm.toml").write_text(arm_toml("SO-101"))
    config = tmp_path / "armd.toml"
    with FakeServos("feetech", {i: sts3215() for i in (1, 2, 3, 4, 6)}) as bus:
        config.write_text(
            'schema = "armd.daemon/1"\narm = "arm.toml"\n[driver]\nkind = "feetech"\n'
            f'port = "{bus.port}"\nbaud = 500000\nids = [1, 2, 3, 4, 7]\n'
            "temperature_ids = [2, 3, 4, 7, 9]\n"
        )
        capsys.readouterr()
        code = cli.main(["doctor", "--config", str(config), "--json"])
    (patient,) = json.loads(capsys.readouterr().out)["ports"]
    assert code == 1
    told = [finding["text"] for finding in patient["findings"]]
    assert f"servo 7 (joint 5) of {config}: found no answer, expected one" in told
    assert f"servo 9 (temperature_ids) of {config}: found no answer, expected one" in told
    speaks = f"{config}: driver.baud: found 500000, and servos that speak at 1000000"
    assert speaks in told
    assert f"servo 6 answers, and {config} does not name it" in patient["facts"]
    assert bus.writes == []


def test_dynamixel_as_from_the_factory(capsys: pytest.CaptureFixture[str]) -> None:
    with FakeServos("dynamixel", {i: xl330() for i in range(11, 17)}) as bus:
        code, patient = _doctor(bus.port, capsys)
    assert code == 1 and bus.writes == []
    assert patient["protocol"] == "dynamixel"
    assert [servo["id"] for servo in patient["servos"]] == [11, 12, 13, 14, 15, 16]
    assert _kinds(patient) == {"return_delay"}  # and no id is missing before 11
    assert "XL330-M288, firmware 52" in str(patient["facts"])
    assert "3.0 ms a cycle" in str(patient["findings"])


def test_an_arm_of_our_own_wire_is_known(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with simulated_arm(tmp_path, seconds=20) as arm:
        code, patient = _doctor(arm.port, capsys)
        arm.stop()
    assert code == 0 and patient["protocol"] == "serial"
    assert "arm SIM-0001 at" in str(patient["facts"])


@pytest.mark.slow
def test_a_microscribe_is_known(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with simulated_arm(tmp_path, wire=("--microscribe",), seconds=60) as arm:
        code, patient = _doctor(arm.port, capsys)
        arm.stop()
    assert code == 0 and patient["protocol"] == "microscribe"


def test_a_port_that_is_not_there(capsys: pytest.CaptureFixture[str]) -> None:
    code, patient = _doctor("/dev/ttyUSB_none", capsys)
    assert code == 1 and _kinds(patient) == {"no_port"}


# --- the machine ---------------------------------------------------------------------------------


def _machine(tmp_path: Path, uid: int = 0) -> tuple[Machine, Path]:
    port = tmp_path / "dev/ttyUSB0"
    port.parent.mkdir()
    port.touch()
    for name in ("sys", "proc"):
        (tmp_path / name).mkdir()
    return Machine(tmp_path / "sys", tmp_path / "proc", uid, {uid}), port


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
    patient = Patient(str(port))
    assert machine.examine(port, patient)  # slow, but it works
    (finding,) = patient.findings
    assert finding.kind == "latency_timer" and f"echo 1 | sudo tee {timer}" in finding.mend
    timer.write_text("1\n")
    well = Patient(str(port))
    assert machine.examine(port, well) and not well.findings


def test_a_port_without_permission_names_its_group(tmp_path: Path) -> None:
    machine, port = _machine(tmp_path, uid=54321)
    port.chmod(0o660)
    patient = Patient(str(port))
    assert not machine.examine(port, patient)
    (finding,) = patient.findings
    assert finding.kind == "permission" and finding.mend.startswith("sudo usermod -aG root 54321")
    ours = Machine(machine.sys, machine.proc, 54321, {port.stat().st_gid})
    assert ours.examine(port, Patient(str(port)))


def test_modem_manager_and_others_that_hold_the_port_are_named(tmp_path: Path) -> None:
    machine, port = _machine(tmp_path)
    _process(tmp_path, 7, "ModemManager", None)
    patient = Patient(str(port))
    assert machine.examine(port, patient) and not patient.findings
    assert "ModemManager runs" in str(patient.facts)
    _process(tmp_path, 8, "ModemManager", port)
    _process(tmp_path, 9, "lerobot", port)
    patient = Patient(str(port))
    assert not machine.examine(port, patient)
    mend = {finding.kind: finding.mend for finding in patient.findings}
    assert mend["modem_manager"] == "sudo systemctl disable --now ModemManager"
    assert mend["port_held"] == "end it: kill 9"


def test_a_can_bus_that_is_down_is_told(tmp_path: Path) -> None:
    for name, kind, flags in (("can0", 280, 0x80), ("can1", 280, 0x81), ("eth0", 1, 0x81)):
        folder = tmp_path / "class/net" / name
        folder.mkdir(parents=True)
        (folder / "type").write_text(f"{kind}\n")
        (folder / "flags").write_text(f"{flags:#x}\n")
    down, up = can_buses(tmp_path)
    assert up.name == "can1" and not up.findings
    assert down.findings[0].mend == "sudo ip link set can0 up type can bitrate 1000000"
