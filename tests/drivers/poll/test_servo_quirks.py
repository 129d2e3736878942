"""What servos do to people, done by the simulated line to the driver: one run of each family.

A busy machine loses answers, each of which is asked for again; so each fault lasts two rounds of
asking who is who, and what one answer costs, to the row, is in test_servo_driver.

| Quirk | Reported | Here, or where |
|---|---|---|
| a servo's answer is missing | lerobot #1252 | `missing_answer` |
| an answer comes a cycle late; echo; stale bytes; a flipped bit | DynamixelSDK | test_every_wire |
| positions beyond a turn, below 0 (phase bit 4) | lerobot #3373 | test_every_wire |
| 4095 → 0 within the travel; the sign in bit 15 | lerobot #2223 | test_unwrap; test_servo_codecs |
| another tool has changed the homing offset | lerobot #3348 | `homing_changed` |
| mixed firmware | lerobot | `mixed_firmware` |
| EEPROM locked: what is written is gone after a restart (Feetech) | lerobot | `servo_silent` |
| EEPROM refused while the torque is on (Dynamixel) | e-Manual | `torque_on` |
| silent for a second after a restart; an alert | e-Manual | test_every_wire |
| a servo that warms by 15 °C in ten minutes | SO-ARM100 #134 | test_coarse |
| Fast Sync Read unknown, or its chain broken | DynamixelSDK | test_servo_driver |
| no sync read at all | lerobot #1010 | test_servo_one_by_one |
"""

from __future__ import annotations

import re
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.sample import Event
from armd.drivers.table import open_driver
from armd.drivers.unwrap import load_compiled
from armd.simulator.live.faults import FAULTS as SIMULATED
from support.sampled import rows_of
from support.simulated_arm import simulated_arm

S = 1_000_000_000
#: name → when, for how long, joint
FAULTS = {
    "torque_on": (0.0, 8.0, 4),
    "mixed_firmware": (4.0, 6.0, 3),
    "missing_answer": (11.0, 0.0, 2),
    "homing_changed": (12.0, 7.0, 1),
    "servo_silent": (20.0, 1.0, 5),
}
LAST_S = 26.0
LOST = 0.1  # the share of rows in which a busy machine may lose a servo's answer
BUSY = 100  # cycles left out, of some ten thousand, and the machine is one
DELAY_US = 100  # the simulated servos have 0


class Run:
    """What the driver said of one life of the arm."""

    def __init__(self, family: str, folder) -> None:
        scenario = folder / "scenario.toml"
        scenario.write_text(
            "".join(
                f'[[fault]]\nname = "{name}"\nat_s = {at}\nduration_s = {lasts}\njoint = {joint}\n'
                for name, (at, lasts, joint) in FAULTS.items()
            )
        )
        load_compiled()
        options = ("--scenario", str(scenario))
        items = []
        with simulated_arm(folder, *options, wire=("--servo", family), seconds=LAST_S) as arm:
            config = ServoConfig(
                kind=family, port=arm.port, ids=[1, 2, 3, 4, 5], return_delay_us=DELAY_US
            )
            expected = Expectation("SIM-0001", 5, 5, (4096,) * 5)
            with closing(open_driver(config, expected)) as driver:
                while arm.process.poll() is None:
                    items += driver.read(0.05)
                    driver.take_raw()
            self.counters = driver.counters
            self.log = arm.events()
        self.events = [item for item in items if isinstance(item, Event)]
        self.samples = rows_of(items)

    def told(self, kind: str) -> list[str]:
        return [event.text for event in self.events if event.kind == kind]

    def during(self, fault: str, after_s: float = 0.0, until_s: float = 0.0):
        """Rows from *after_s* after its begin to *until_s* after its end."""
        at_ns = {
            line["event"]: line["monotonic_ns"] for line in self.log if line.get("fault") == fault
        }
        instants = self.samples["monotonic_ns"].astype(np.int64)
        inside = instants > at_ns["begin"] + after_s * S
        return self.samples[inside & (instants < at_ns["end"] + until_s * S)]


@pytest.fixture(scope="module", params=["feetech", "dynamixel"])
def run(request, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        # What one run remembers of its servos is not another one's.
        patch.setenv("STATE_DIRECTORY", str(tmp_path_factory.mktemp("state")))
        yield request.param, Run(request.param, tmp_path_factory.mktemp("run"))


def test_every_quirk_of_the_table_is_done_here_or_where_it_says():
    places = [line.split("|")[3] for line in __doc__.splitlines() if line.startswith("|")]
    faults = {name for place in places for name in re.findall("`([a-z_]+)`", place)}
    assert faults == set(FAULTS) and faults <= set(SIMULATED)
    files = {name for place in places for name in re.findall(r"test_\w+", place)}
    there = {file.stem for file in Path(__file__).parents[2].rglob("test_*.py")}
    assert len(files) >= 4 and files <= there


@pytest.mark.slow
@pytest.mark.crowd
def test_a_missing_answer_takes_no_other_away(run):
    family, line = run
    near = line.during("missing_answer", -0.05, 0.3)["joint_invalid"]
    assert np.count_nonzero(near & ~np.uint16(0b10)) <= 2 + LOST * len(near)
    if family == "dynamixel":  # it ended a chain of answers: all are asked again at once
        assert np.count_nonzero(near) <= 2 + LOST * len(near)
    else:  # of a moving arm, a busy machine leaves whole cycles out
        assert 0b10 in near or line.counters["untimed"] > BUSY
        assert line.counters["servo_2_missed"] >= 1


@pytest.mark.slow
@pytest.mark.crowd
def test_a_changed_homing_offset_is_found_by_asking_and_its_joint_is_invalid(run):
    """Each servo is asked who it is every three seconds, of six; an answer may be lost."""
    family, line = run
    register = {"feetech": 31, "dynamixel": 20}[family]
    (event,) = [e for e in line.events if e.kind == "offsets_changed" and "found 120" in e.text]
    expected = f"servo 1 (joint 1): homing offset (register {register}): found 120, expected 0"
    assert expected in event.text
    invalid = line.during("homing_changed", 6.5)["joint_invalid"]
    assert (invalid & 0b1 != 0).all()
    # Of half a second a busy machine may leave nearly all cycles out: the others since it was told.
    changed = line.during("homing_changed")
    others = changed["joint_invalid"][changed["monotonic_ns"] > event.monotonic_ns] & ~np.uint16(1)
    assert len(others) > BUSY and (others == 0).mean() > 1 - LOST


@pytest.mark.slow
@pytest.mark.crowd
def test_another_firmware_and_a_torque_that_is_on_are_told_and_taken_back(run):
    family, line = run
    versions = {"feetech": ("3.10", "3.11"), "dynamixel": ("45", "46")}[family]
    servo_3 = [text for text in line.told("servo") if text.startswith("servo 3 (joint 3)")]
    told = [text.rpartition(" ")[2] for text in servo_3]
    assert told == [versions[0], versions[1], versions[0]]
    (on,) = line.told("torque_on")
    assert on.startswith("servo 4 (joint 4): torque (register")
    assert line.told("torque_off") == ["servo 4 (joint 4): its torque is off now"]
    assert (line.during("mixed_firmware", 0.5)["joint_invalid"] == 0).mean() > 1 - LOST


@pytest.mark.slow
@pytest.mark.crowd
def test_what_an_eeprom_does_not_keep_is_told_once(run):
    """A Feetech that is locked obeys, and has forgotten it after a restart; a Dynamixel keeps it,
    but refuses while its torque is on."""
    family, line = run
    register, servo = {"feetech": (7, "5 (joint 5)"), "dynamixel": (9, "4 (joint 4)")}[family]
    assert line.told("write_refused") == [
        f"servo {servo}: return delay (register {register}): found 0, expected {DELAY_US}: "
        "it did not keep what was written"
    ]
    # A write whose answer is lost is sent again: nothing else goes to anybody.
    written = [(e["servo"], e["address"], *e["data"]) for e in line.log if e["event"] == "write"]
    assert set(written) == {(k, register, DELAY_US // 2) for k in range(1, 6)}
    assert len(written) <= 5 + 2
    assert (line.samples["joint_invalid"][-200:] == 0).mean() > 1 - LOST
