"""armd.toml: what stops start-up, in which words, with exit code 2 and nothing published."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from armd import BadInput
from armd.daemon import cli
from armd.daemon.config import load_config
from armd.daemon.network.session import open_session
from armd.drivers.config import ReplayConfig
from support.program import run_armd
from support.running_daemon import free_endpoint
from support.selection import parametrize_default

ARM = """
schema = "armd.arm/1"
serial_number = "SMALL-1"
[[joint]]
counts_per_turn = 1024
[[joint]]
counts_per_turn = 1024
[[joint]]
counts_per_turn = 1024
"""
GOOD = """
schema = "armd.daemon/1"
arm = "arm.toml"
[driver]
kind = "serial"
port = "/dev/nothing"
"""


def write(folder: Path, config: str, arm: str = ARM) -> Path:
    (folder / "arm.toml").write_text(arm)
    (folder / "armd.toml").write_text(config)
    return folder / "armd.toml"


def test_four_lines_are_enough_and_stay_on_loopback(tmp_path):
    config = load_config(write(tmp_path, GOOD))
    assert config.arm.serial_number == "SMALL-1"
    assert config.calibration is None
    assert config.file.zenoh.listen == ["tcp/127.0.0.1:7447"]
    assert not config.file.commands.enabled and config.file.metrics is None


def test_paths_are_relative_to_the_file_and_the_serial_wire_alone_limits_a_number_to_16(tmp_path):
    name = "A-robot-with-a-long-name-0123456789"
    replay = GOOD.replace('"serial"', '"replay"').replace("port", "file").replace("/dev/", "")
    config = load_config(write(tmp_path, replay, ARM.replace("SMALL-1", name)))
    assert config.arm.serial_number == name
    assert isinstance(config.driver, ReplayConfig)
    assert config.driver.file == str(tmp_path / "nothing")


@parametrize_default(
    ("line", "said"),
    [
        ("colour = 1", "driver.colour: found an unknown key, expected one of the documented keys"),
        ("baud = 'fast'", "driver.baud: found 'fast', expected a valid integer"),
        ("baud = -1", "driver.baud: found -1, expected greater than or equal to 9600"),
        ("[zenoh]\nlisten = ['7447']", "zenoh.listen[1]: found '7447', expected"),
        (
            "[zenoh]\nmode = 'star'",
            "zenoh.mode: found 'star', expected 'peer', 'client' or 'router'",
        ),
        ("[zenoh]\nconfig = 'x'\nmode = 'peer'", "zenoh.mode: found this key, expected"),
        ("[limits]\ntemperature_hold_s = 0", "limits.temperature_hold_s: found 0, expected"),
        ("[limits]\ntemperature_hold_s = nan", "limits.temperature_hold_s: found nan, expected"),
        ("[health]\nforeign_arm = 'eat'", "health.foreign_arm: found 'eat', expected 'wait' or"),
        ("[commands]\nenabled = 1", "commands.enabled: found 1, expected a valid boolean"),
        ("[metrics]\nport = 70000", "metrics.port: found 70000, expected"),
        ("[measure]", "measure: found an unknown key, expected one of the documented keys"),
        ("[tips.a]\noffset_mm = [1, 2]", "tips.a.offset_mm[3]: found nothing, expected this key"),
        ("kind = 'x'", "TOML: found Cannot overwrite a value"),
    ],
    default=4,
)
def test_the_file_and_the_key_are_named(tmp_path, capsys, line, said):
    config = write(tmp_path, GOOD + line + "\n")
    assert cli.main(["run", str(config)]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith(f"armd: {config}: {said}")
    assert err.count("\n") == 1


@pytest.mark.parametrize(
    ("config", "arm", "said"),
    [
        (GOOD.replace('"serial"', '"usb"'), ARM, "armd.toml: driver.kind: found 'usb', expected"),
        (GOOD.replace("port", "# port"), ARM, "armd.toml: driver.port: found nothing, expected"),
        (GOOD.replace("armd.daemon/1", "x"), ARM, "armd.toml: schema: found 'x', expected"),
        (GOOD.replace("arm.toml", "leg.toml"), ARM, "leg.toml: the file: found nothing, expected"),
        (
            GOOD,
            ARM.replace("SMALL-1", "URDF-of-seventeen"),
            "arm.toml: serial_number: found 17 characters, expected 16 at most, which the serial",
        ),
        (GOOD, ARM.replace("SMALL-1", "A/B"), "arm.toml: serial_number: found 'A/B', expected"),
        (GOOD, ARM[:-24], "arm.toml: joint[3].counts_per_turn: found nothing, expected a number"),
        (GOOD.replace("[driver]", 'calibration = "c.json"\n[driver]'), ARM, "c.json: the file: "),
    ],
)
def test_what_the_configuration_names_must_fit(tmp_path, capsys, config, arm, said):
    assert cli.main(["run", str(write(tmp_path, config, arm))]) == 2
    err = capsys.readouterr().err
    assert err.startswith(f"armd: {tmp_path}/{said}")


def test_no_traceback_from_the_command_line(tmp_path):
    done = run_armd("run", tmp_path / "none.toml")
    expected = f"armd: {tmp_path}/none.toml: the file: found nothing, expected an existing file\n"
    assert (done.returncode, done.stdout, done.stderr) == (2, "", expected)


def test_an_endpoint_in_use_is_named(tmp_path):
    endpoint = free_endpoint()
    config = load_config(write(tmp_path, GOOD + f'[zenoh]\nlisten = ["{endpoint}"]\n'))
    session = open_session(config)
    try:
        with pytest.raises(BadInput, match=r"zenoh\.listen: found .*Address already in use"):
            open_session(config)
    finally:
        session.close()


def test_a_whole_zenoh_configuration_instead(tmp_path):
    endpoint = free_endpoint()
    zenoh_config = {"mode": "router", "listen": {"endpoints": [endpoint]}}
    (tmp_path / "zenoh.json5").write_text(json.dumps(zenoh_config))
    config = load_config(write(tmp_path, GOOD + '[zenoh]\nconfig = "zenoh.json5"\n'))
    open_session(config).close()
    (tmp_path / "zenoh.json5").write_text("{ mode: 'star' }")
    with pytest.raises(BadInput, match=r"zenoh\.json5: the file: found .*expected a Zenoh"):
        open_session(config)
