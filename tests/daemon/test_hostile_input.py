"""What the fuzz found once, by the least input that does it."""

from __future__ import annotations

import io
import json
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fuzz.messages import ros2
from fuzz.network import arm_answering
from fuzz.recordings import frames, info, recording
from rich.console import Console

from armd import POINT, keys
from armd.daemon.bridges import lines
from armd.daemon.bridges.export.source import MeasurementLine
from armd.daemon.bridges.ros2 import urdf
from armd.daemon.bridges.tips import Tips
from armd.daemon.cli import main
from armd.daemon.commands.live.fleet import make_table
from armd.daemon.commands.screen import Screen
from armd.daemon.host.metrics import render
from armd.drivers.replay import raw
from armd.drivers.sample import RawFrame
from armd.errors import ArmdError
from armd.files.toml_text import format_toml
from armd.received import is_sound
from armd.simulator.__main__ import main as simulate
from support.careless_network import HEALTH, fleet_of
from support.small_arm_toml import ARM

TIPLESS = {"arm": {"tip": {"offset_mm": [0, 0, 9], "radius_mm": 3}}, "configuration": {"tips": {}}}


def shown(what: object) -> str:
    console = Console(file=io.StringIO(), width=200, force_terminal=False)
    console.print(what)
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


@pytest.mark.parametrize("change", [
    {"reason": "\ud800"}, {"drops": {"lost": "x\n1"}}, {"latency": {"p50": "x"}}, {"points": 3},
])  # fmt: skip
def test_health_that_nobody_can_write_on_is_malformed(change: dict[str, object]) -> None:
    assert not is_sound(keys.HEALTH, json.dumps(HEALTH | change).encode())


def test_half_a_character_that_is_no_escape_is_malformed() -> None:
    text = json.dumps(HEALTH | {"reason": "HERE"}).encode()
    assert not is_sound(keys.HEALTH, text.replace(b"HERE", b"\xed\xa0\x80"))


def test_a_fleet_shows_a_state_of_another_version_and_obeys_no_word() -> None:
    text = shown(make_table(fleet_of(HEALTH | {"state": "DANCING", "reason": "[/x]\x1b[2J"})))
    assert "DANCING" in text and "[/x]\\x1b[2J" in text and "\x1b" not in text


def test_the_screen_obeys_no_name_of_a_sensor() -> None:
    screen = Screen(arm_answering(b""), Console(file=io.StringIO()))
    screen._health = HEALTH | {"temperatures": {"[/x]\x1b[2J": 20.0}}
    text = shown(screen._panel(1.0))
    assert "[/x]\\x1b[2J 20.00" in text and "\x1b" not in text


def test_one_arm_without_counts_does_not_end_the_figures_of_all() -> None:
    text = render(fleet_of(HEALTH | {"serial": "of another key"}).healths())
    assert 'armd_state{serial="S",armd_state="READY"} 1' in text and "armd_points_total" not in text


def test_a_time_that_ros_cannot_write_is_told_by_the_bridges_own() -> None:
    ros2()._tell_health(HEALTH | {"stamp_ns": (1 << 63) - 1})


def test_a_variance_below_zero_is_no_uncertainty() -> None:
    point = np.zeros(1, POINT)[0]
    point["orientation"], point["covariance_mm2"] = [0, 0, 0, 1], [-1, 0, 0, 1, 0, 1]
    fields = lines.convert_point(point, Tips(TIPLESS), None, "S")
    assert fields is not None and np.isnan(fields["u_x_um"])
    assert ",,,," in lines.format_csv(fields)


@pytest.mark.parametrize("answer", [b"\xff", b"[]", b'{"constants": []}', b"[" * 3000])
def test_an_answer_that_is_no_calibration_is_refused(answer: bytes) -> None:
    with pytest.raises(ArmdError, match="expected armd's message of this key"):
        arm_answering(answer).calibration_file()


def test_a_refusal_is_no_longer_than_a_screen_and_obeyed_by_no_terminal() -> None:
    with pytest.raises(ArmdError) as refused:
        arm_answering(b"\x1b[2J\xff" + b"x" * 10_000, refuses=True).command("reload")
    assert "\\x1b[2J" in str(refused.value) and len(str(refused.value)) < 4000


@pytest.mark.parametrize("row", ["1,2", "1,2,3,4,5,6,7,8", "1,1e300,2,3,4,5"])
def test_a_row_of_another_length_is_refused(
    row: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "t.csv"
    table.write_text(f"stamp_ns,u_x_mm,x_mm,y_mm,z_mm,seq,flags\n{row}\n")
    assert main(["feature", "point", str(table)]) == 2
    assert f"{table}: the table: found" in capsys.readouterr().err


def test_a_recording_whose_info_names_no_tip_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "r.mcap"
    described = json.loads(info({"kind": "serial", "port": "x"}))
    del described["arm"]["tip"]
    path.write_bytes(recording(json.dumps(described).encode(), b"{}", frames(), {}))
    assert main(["export", str(path), "-o", str(tmp_path / "out.csv")]) == 2
    assert "info.json: arm, configuration.tips: found" in capsys.readouterr().err


@pytest.mark.parametrize("data", [b"[" * 100_000, b'{"seq": 1e999, "monotonic_ns": 1}'])
def test_a_recorded_point_that_is_none_is_refused(tmp_path: Path, data: bytes) -> None:
    """Nested deeply, or with a number that no integer is."""
    from armd.daemon.commands.service.replay import _compare

    message = SimpleNamespace(data=data)
    nested = SimpleNamespace(path=tmp_path, preamble=list, messages=lambda topics: [message])
    with pytest.raises(ArmdError, match="expected a point"):
        _compare(nested, np.zeros(0, POINT))  # type: ignore[arg-type]


def test_a_file_in_an_endpoints_place_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["status", "--endpoint", "/bar.toml"]) == 2
    assert "endpoint: found '/bar.toml', expected PROTOCOL/" in capsys.readouterr().err


def test_a_scenario_has_no_more_random_faults_than_memory(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.toml"
    path.write_text('schema = "armd.scenario/1"\nseconds = 1e12\nfaults_per_minute = 30\n')
    assert simulate(["--serial", "--scenario", str(path)]) == 2
    assert "expected 10000 faults at most" in capsys.readouterr().err


HIDDEN = "a\x1b[2J\u202eb"


def test_a_folder_may_have_any_name_and_messages_escape_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is the file system's, and its owner cannot always rename it: used, and shown escaped."""
    folder = tmp_path / HIDDEN
    folder.mkdir()
    (folder / "arm.toml").write_text(format_toml(ARM))
    assert main(["check", str(folder / "arm.toml")]) == 0
    said = "".join(capsys.readouterr())
    assert "a\\x1b[2J\\u202eb" in said and "\x1b" not in said and "\u202e" not in said


def test_a_urdfs_joint_may_have_any_name_and_arm_toml_carries_none_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its author's, and armd needs no name of a joint: the geometry counts."""
    text = urdf.write({"arm": ARM}, None, "S", "S_base").replace('"joint_2"', '"jo\u202eint"')
    (tmp_path / "a.urdf").write_text(text)
    out = tmp_path / "arm.toml"
    assert main(["import", str(tmp_path / "a.urdf"), "-o", str(out)]) == 0
    assert "\u202e" not in "".join(capsys.readouterr()) + out.read_text()
    assert main(["check", str(out)]) in (0, 2)  # the tip's radius is still to be written
    assert "\u202e" not in "".join(capsys.readouterr())


def test_a_point_whose_numbers_are_none_becomes_no_line() -> None:
    point = np.zeros(1, POINT)
    point["orientation"][0, 3] = 1.0
    tip = {"offset_mm": [0, 0, 0], "radius_mm": 1.0}
    tips = Tips({"arm": {"tip": tip}, "configuration": {"tips": {}}})
    for name in ("position_mm", "orientation"):
        bad = point.copy()
        bad[name][0, 1] = np.inf
        assert lines.convert_point(bad[0], tips, None, "S") is None
    point["correction_mm"][0, 2] = np.inf
    fields = lines.convert_point(point[0], tips, None, "S")
    assert fields is not None and json.loads(lines.format_jsonl(fields))["correction_mm"] is None


def test_a_raw_frame_of_before_1970_is_none() -> None:
    with pytest.raises(ValueError, match="a time of -1 ns"):
        raw.unpack(raw.pack(3, RawFrame(1, -1, "rx", b"xyz", "tty")))


@pytest.mark.parametrize("key", ["trigger", "tip", "calibration", "serial"])
def test_half_a_character_in_a_measurement_is_refused(key: str) -> None:
    content = {"seq": 1, "stamp_ns": 1, "position_mm": None, "flags": 0}
    MeasurementLine.model_validate({**content, key: "a"})
    with pytest.raises(ValueError, match=key):
        MeasurementLine.model_validate({**content, key: "\ud800"})


def test_a_length_that_no_arm_has_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "dh.csv").write_text("theta,d,a,alpha\n0,200," + "1" * 308 + ",90\n0,0,300,0\n")
    assert main(["init", str(tmp_path / "arm"), "--from", str(tmp_path / "dh.csv")]) == 2
    assert "a number of 1e+12 at most" in capsys.readouterr().err
