"""Encoders that differ from armd's own simulated ones, as makers build them (tests/field)."""

import os
import subprocess
import sys
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from armd.drivers.can.driver import CanDriver
from armd.drivers.can.objects import EncoderLayout
from armd.drivers.can.setup.mapping import find_layout
from armd.drivers.can.setup.sdo import NodeRefused
from armd.drivers.config import CanConfig
from armd.drivers.identity import Expectation
from armd.drivers.sample import Event
from support.selection import parametrize_default

QUIRKS = Path(__file__).parents[2] / "field" / "can-encoders" / "quirk_can.py"
N, TURN = 6, 1 << 23


@contextmanager
def quirky_arm(folder, quirk, *options):
    command = [sys.executable, str(QUIRKS), "--can", "socketcand", "--seconds", "30", *options]
    environment = os.environ | {"QUIRK": quirk}
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, text=True, env=environment, cwd=folder
    ) as arm:
        try:
            yield int(arm.stdout.readline().rsplit(":")[-1])
        finally:
            arm.terminate()


def drive(port, seconds, until, counts_per_turn=None, **keys):
    """Samples and events of the driver until *until* of these holds, *seconds* at the most."""
    config = CanConfig(
        kind="can", interface="socketcand", host="127.0.0.1", port=port, channel="can0",
        rate_hz=200, **keys,
    )  # fmt: skip
    driver = CanDriver(config, Expectation("SIM-0001", N, N, (counts_per_turn,) * N))
    driver.open()
    items, end_s = [], time.monotonic() + seconds
    try:
        while time.monotonic() < end_s:
            items += driver.read(0.1)
            samples = [item for item in items if isinstance(item, np.ndarray)]
            events = [item for item in items if isinstance(item, Event)]
            if until(samples, events):
                return samples, events
    finally:
        driver.close()
    pytest.fail(f"{len(samples)} samples, events {[event.text for event in events]}")


def valid(samples):
    return sum(int((each["joint_invalid"] == 0).sum()) for each in samples)


def measures(samples, events):
    return valid(samples) >= 20


def has(kind):
    return lambda samples, events: any(event.kind == kind for event in events)


@parametrize_default(
    ("quirk", "counts_per_turn", "limited"),
    [
        # CiA 406's simpler class: no scaling, no alarms, no warnings; its position alone is mapped.
        ("class_c1", None, ["(6503) in TPDO1: they are not to be had by SDO either"]),
        ("bare_c1", TURN, [f"(6501): the {TURN} of arm.toml are taken unchecked"]),
        ("no_rtr", None, []),
        ("no_serial", None, ["1018:4"]),
        ("no_alarm_map", None, ["6503"]),
        ("fixed_map", None, ["6503"]),
    ],
)
def test_an_encoder_of_another_maker_is_read_and_what_it_lacks_is_named(
    tmp_path, quirk, counts_per_turn, limited
):
    with quirky_arm(tmp_path, quirk) as port:
        samples, events = drive(port, 10.0, measures, counts_per_turn)
    assert "arm SIM-0001: all 6 encoders identified" in [event.text for event in events]
    named = [event.text for event in events if event.kind == "encoder_limited"]
    assert len(named) == N * len(limited)
    assert all(words in text for text in named for words in limited)
    assert not [event for event in events if event.severity == "error"]
    counts = np.concatenate([each["count"][each["joint_invalid"] == 0] for each in samples])
    assert np.abs(np.diff(counts, axis=0)).max() < TURN / 20  # a hand moves it, nothing jumps


@pytest.mark.slow
@pytest.mark.parametrize(
    ("quirk", "keys", "said"),
    [
        ("bare_c1", {}, "6501, counts per turn: found none, expected counts_per_turn in arm.toml"),
        ("no_serial", {"encoder_serial_numbers": list(range(406001, 406007))},
         "serial number (object 1018:4): found none, expected 40600"),
    ],
)  # fmt: skip
def test_what_is_demanded_and_missing_makes_a_foreign_arm(tmp_path, quirk, keys, said):
    with quirky_arm(tmp_path, quirk) as port:
        samples, events = drive(port, 10.0, has("foreign_arm"), **keys)
    assert said in next(event.text for event in events if event.kind == "foreign_arm")
    assert valid(samples) == 0


@pytest.mark.slow
def test_an_alarm_that_is_in_no_process_data_makes_its_joint_invalid(tmp_path):
    with quirky_arm(tmp_path, "fixed_map", "--fault", "joint_invalid@8:3") as port:
        samples, events = drive(port, 60.0, has("joint_valid"))
    invalid = np.concatenate([each["joint_invalid"] for each in samples])
    assert set(np.unique(invalid)) == {0, 0b10}
    alarms = [event for event in events if event.kind == "joint_invalid"]
    assert [event.detail["joint"] for event in alarms] == [2]
    assert "alarm" in alarms[0].text


POSITION, ALARMS, SPEED = 0x60040020, 0x65030010, 0x60300110


@pytest.mark.parametrize(
    ("found", "layout"),
    [
        ([POSITION, ALARMS], EncoderLayout(6, 0, 4)),
        ([POSITION], EncoderLayout(4, 0, None)),
        ([ALARMS, POSITION], EncoderLayout(6, 2, 0)),
        ([POSITION, SPEED, ALARMS], EncoderLayout(8, 0, 6)),
    ],
)
def test_position_and_alarms_are_taken_from_where_the_mapping_has_them(found, layout):
    assert find_layout(found) == layout


@pytest.mark.parametrize("found", [[], [SPEED], [0x60040010], [0x65040001, POSITION]])
def test_a_mapping_without_a_whole_position_is_refused_by_name(found):
    with pytest.raises(NodeRefused, match=r"object 1A00, mapping of TPDO1: found .*expected 6004"):
        find_layout(found)
