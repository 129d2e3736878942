"""The history of interim checks: whole or not at all, whatever the order, and damage is told."""

from __future__ import annotations

import argparse
import datetime
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from armd import __version__
from armd.compensation.interim.checks import appending
from armd.compensation.interim.checks.chain import REPORT
from armd.compensation.interim.checks.columns import list_causes
from armd.compensation.interim.report import watch_memory
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import Calibration, Noise, name_constants, save_calibration
from armd.daemon.commands.offline import interim
from armd.errors import BadInput
from armd.files.writing import write_whole
from armd.simulator.sessions import add_arguments
from armd.simulator.sessions import run as simulate
from armd.simulator.truth.arm import Materials, TrueArm
from armd.terminal.loudness import add_loudness
from support.drawn import drawn
from support.program import ARMD
from support.selection import parametrize_default

DAYS = 8


def measured(folder: Path, *options: str) -> Path:
    parser = argparse.ArgumentParser()
    add_arguments(parser)
    words = ["--session", "interim", "-o", str(folder), "--seed", "6", "--days", str(DAYS)]
    assert simulate(parser.parse_args([*words, *options])) == 0
    return folder


def true_calibration(folder: Path) -> Path:
    """What a perfect calibration at the reference would be; the arm's warmth is beyond it."""
    from armd.simulator.truth.true_values import list_true_constants, list_true_expansion

    arm = load_arm(folder / "arm.toml")
    true = TrueArm.default(6)
    terms = [
        {
            "parameter": name,
            "basis": [{"kind": "temperature", "weights": {sensor: 1.0}}],
            "coefficient": rate,
        }
        for name, sensor, rate in list_true_expansion(true)
    ]
    constants = name_constants(arm.nominal(), arm.n_joints) | list_true_constants(true)
    noise = Noise(encoder_rad=[2.4e-6] * 6, reading_mm=5e-4)
    calibration = drawn(
        arm, created="2026-03-04T00:00:00+00:00", constants=constants, terms=terms, noise=noise
    )
    assert isinstance(true.materials, Materials)
    return save_calibration(folder / "calibration.json", calibration).path


@pytest.fixture(scope="module")
def checks(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = measured(
        tmp_path_factory.mktemp("checks"),
        *("--plant", "encoder_slip@joint 3=15@6", "--bad", "dirty-seat@3"),
    )
    true_calibration(folder)
    return folder


def run(*words: str | Path) -> int:
    parser = argparse.ArgumentParser()
    interim.add_arguments(parser)
    add_loudness(parser)
    return interim.run(parser.parse_args([str(word) for word in words]))


def files_of(checks: Path) -> list[str | Path]:
    return ["--arm", checks / "arm.toml", "--calibration", checks / "calibration.json"]


def add(checks: Path, history: Path, *days: int) -> int:
    sessions = [checks / f"day-{day:02}" for day in days]
    return run("add", *sessions, *files_of(checks), "--history", history)


def dated(checks: Path, folder: Path, started: datetime.datetime) -> Path:
    """The check of day 5 as *folder*, which says that it was started then."""
    file = Path(shutil.copytree(checks / "day-05", folder)) / "session.toml"
    text = re.sub("(?m)^started = .*$", f"started = {started:%Y-%m-%dT%H:%M:%SZ}", file.read_text())
    file.write_text(text)
    return folder


def contents(folder: Path) -> dict[Path, bytes]:
    return {p: p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def run_without_privilege(*words: object) -> subprocess.CompletedProcess[str]:
    """`armd interim`; root without its privilege to write everywhere."""
    command = [*ARMD, "interim", *map(str, words)]
    if os.geteuid() == 0:
        bounds = "--bounding-set=-dac_override,-dac_read_search"
        command = ["setpriv", bounds, "--inh-caps=-all", *command]
    return subprocess.run(command, capture_output=True, text=True, timeout=200)


@pytest.fixture(scope="module")
def kept(checks: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    history = tmp_path_factory.mktemp("kept") / "history"
    assert add(checks, history, *range(1, DAYS + 1)) == 1
    return history


@pytest.fixture
def copy(kept: Path, tmp_path: Path) -> Iterator[Path]:
    yield Path(shutil.copytree(kept, tmp_path / "history"))


def reported(history: Path) -> dict:
    return json.loads((history / REPORT).read_text())


@pytest.mark.slow
def test_a_slip_and_a_bad_check_are_told(kept: Path) -> None:
    result = reported(kept)
    assert result["schema"] == "armd.interim/1" and result["state"] == "changed"
    assert [check["name"] for check in result["checks"]] == [f"day-{d:02}" for d in range(1, 9)]
    verdicts = [check["verdict"] for check in result["checks"]]
    assert verdicts == ["in_control"] * 2 + ["bad_check"] + ["in_control"] * 2 + ["changed"] * 3
    (change,) = result["changes"]
    assert (change["cause"], change["location"]) == ("encoder_slip", "joint 3")
    assert change["probability"] > 0.9 and not change["gradual"]
    low, high = change["between"]
    # Day 6 begins on March 10 at 9:00 UTC; the check of day 5 is the last that it was not in.
    assert "2026-03-09T09:0" <= low < "2026-03-10T09:00:00Z" <= high < "2026-03-10T10"
    assert (kept / change["calibration_from"]).is_file()


@pytest.mark.slow
def test_how_to_correct_what_was_measured_since_is_said(
    copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("report", "--history", copy) == 1
    told = capsys.readouterr().out
    (change,) = reported(copy)["changes"]
    said = (
        f"--calibration {copy / 'calibration-1.json'} --since {change['between'][0]} -o again.csv"
    )
    assert f"armd recorrect MEASUREMENTS --arm ARM.toml {said}" in told


@pytest.mark.slow
def test_the_order_of_adding_does_not_matter(checks: Path, kept: Path, tmp_path: Path) -> None:
    history = tmp_path / "backwards"
    add(checks, history, 8, 3)
    add(checks, history, 6, 1, 2, 7, 5, 4)
    assert reported(history) == reported(kept)
    name = reported(kept)["changes"][0]["calibration_from"]
    assert (history / name).read_bytes() == (kept / name).read_bytes()


@pytest.mark.slow
def test_what_is_remembered_of_earlier_checks_decides_nothing(copy: Path) -> None:
    """The report is the same with it, without it, and where it says something else."""
    told = reported(copy)
    watched = copy / watch_memory.WATCHED
    data = json.loads(watched.read_text())
    (epoch,) = data["epochs"]
    assert 0 < len(epoch["checks"]) < DAYS
    assert run("report", "--history", copy) == 1
    assert reported(copy) == told
    epoch["looks"][0]["statistic"][0] = 3.0
    for text in (json.dumps(data), "{"):
        watched.write_text(text)
        assert run("report", "--history", copy) == 1
        assert reported(copy) == told
    watched.unlink()
    assert run("report", "--history", copy) == 1
    assert reported(copy) == told
    assert watched.is_file()


@pytest.mark.slow
def test_before_the_change_the_state_is_in_control(checks: Path, tmp_path: Path) -> None:
    assert add(checks, tmp_path / "h", 1, 2, 3, 4, 5) == 0
    result = reported(tmp_path / "h")
    assert result["state"] == "in_control" and result["changes"] == []
    assert result["checks"][2]["verdict"] == "bad_check"


def refused(history: Path, words: str, call: object) -> None:
    """*call* raises `BadInput` that says *words*, and the history is as it was."""
    before = contents(history)
    with pytest.raises(BadInput, match=words):
        call()  # type: ignore[operator]
    assert contents(history) == before


def test_a_check_is_kept_once(checks: Path, copy: Path) -> None:
    refused(copy, "when check day-04 was started", lambda: add(checks, copy, 4))


def test_another_arm_is_refused(checks: Path, copy: Path, tmp_path: Path) -> None:
    other = tmp_path / "other"
    shutil.copytree(checks, other)
    for file in (other / "arm.toml", other / "day-04" / "session.toml"):
        file.write_text(file.read_text().replace("SIM-0001", "SIM-0002"))
    calibration = json.loads((other / "calibration.json").read_text())
    del calibration["content_sha256"]
    calibration["arm"] = "SIM-0002"
    save_calibration(other / "calibration.json", Calibration.model_validate(calibration))
    refused(copy, "SIM-0002.*SIM-0001", lambda: add(other, copy, 4))


def test_a_clock_set_back_is_told(checks: Path, copy: Path, tmp_path: Path) -> None:
    """A check that says it was measured while another one was."""
    at = tomllib.loads((checks / "day-05" / "session.toml").read_text())["started"]
    again = dated(checks, tmp_path / "again", at + datetime.timedelta(seconds=50))
    refused(copy, "clock set back", lambda: run("add", again, *files_of(checks), "--history", copy))


@pytest.mark.slow
def test_a_check_dated_after_now_is_refused_unless_it_is_wanted(
    checks: Path, copy: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock of this computer, or the one that dated the check, is wrong; a day is too much, and
    a few minutes are what clocks are apart."""
    late = dated(checks, tmp_path / "late", datetime.datetime(2026, 4, 1, 9))
    now = datetime.datetime(2026, 3, 31, 9, tzinfo=datetime.UTC).timestamp()
    monkeypatch.setattr(interim.time, "time", lambda: now)
    refused(
        copy,
        "late/session.toml: started: found readings until 2026-04-01.*clock says 2026-03-31T09:00",
        lambda: run("add", late, *files_of(checks), "--history", copy),
    )
    assert run("add", late, *files_of(checks), "--history", copy, "--future") == 1
    assert reported(copy)["last_check"] == "2026-04-01T09:00:00Z"
    monkeypatch.setattr(interim.time, "time", lambda: now + 86400.0 - 120.0)
    assert run("add", late, *files_of(checks), "--history", tmp_path / "new") == 0


@pytest.mark.slow
def test_a_check_dated_before_the_last_one_is_told_and_judged_by_its_date(
    checks: Path, kept: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Added late, or of a clock set back: nobody can tell from the check, so a person is asked."""
    history = tmp_path / "history"
    add(checks, history, 1, 2, 3, 4)
    add(checks, history, 7, 8)
    assert "clock" not in capsys.readouterr().err  # in order of time there is nothing to say
    add(checks, history, 5)
    told = capsys.readouterr()
    assert re.search(
        r"day-05 \(2026-03-09T09:\S+Z\) is dated before the last check of the", told.err
    )
    assert "the history, day-08 (2026-03-12T09:" in told.err
    assert "If measured after that check, a clock was set back" in told.err
    assert "clock" not in told.out
    again = shutil.copytree(history, tmp_path / "again")
    add(checks, again, 6)
    assert "day-06 (2026-03-10T09:" in capsys.readouterr().err
    assert reported(again) == reported(kept)


@pytest.mark.slow
def test_this_computers_clock_set_back_since_the_last_adding_is_refused(
    checks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    history, now = tmp_path / "history", time.time()
    add(checks, history, 1, 2)
    words = "add", checks / "day-03", *files_of(checks), "--history", history
    monkeypatch.setattr(interim.time, "time", lambda: now - 3600.0)
    said = "history.jsonl: line 2, added: found check day-02 added at .*clock says.*--future"
    refused(history, said, lambda: run(*words))
    assert run(*words, "--future") == 0
    assert [check["name"] for check in reported(history)["checks"]][-1] == "day-03"
    # Two computers' clocks are never quite alike.
    monkeypatch.setattr(interim.time, "time", lambda: now - 300.0)
    assert add(checks, history, 4) == 0


def test_a_torn_session_is_refused_and_nothing_begun(
    checks: Path, copy: Path, tmp_path: Path
) -> None:
    torn = Path(shutil.copytree(checks / "day-05", tmp_path / "torn"))
    file = torn / "readings.csv"
    file.write_bytes(file.read_bytes()[:-40])
    refused(copy, "found", lambda: run("add", torn, *files_of(checks), "--history", copy))
    with pytest.raises(BadInput):
        run("add", torn, *files_of(checks), "--history", tmp_path / "new")
    assert not (tmp_path / "new").exists()


@pytest.mark.parametrize(
    ("name", "old", "new"),
    [
        ("history.jsonl", '"name": "day-04"', '"name": "day-44"'),
        ("checks/*day-04/readings.csv", "P1,", "P2,"),
        ("checks/*day-04/statistics.json", "{", " {"),
    ],
)
def test_damage_is_told_and_nothing_lost(copy: Path, name: str, old: str, new: str) -> None:
    """Of lines that are missing or torn `test_chain` knows."""
    (file,) = copy.glob(name)
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new, 1))
    refused(copy, "found", lambda: run("report", "--history", copy))


@pytest.mark.slow
def test_a_check_that_a_power_cut_left_unfinished_is_begun_anew(
    checks: Path, kept: Path, tmp_path: Path
) -> None:
    """Its folder is there and no line tells of it; then there is a line, and the head is behind."""
    history = tmp_path / "h"
    add(checks, history, 1, 2)
    whole = {name: (history / name).read_bytes() for name in ("history.jsonl", "head.json")}
    add(checks, history, 4)
    complete = reported(history)
    for name, data in whole.items():
        (history / name).write_bytes(data)
    (next(history.glob("checks/*day-04")) / "readings.csv").write_text("torn")
    add(checks, history, 4)
    assert reported(history) == complete
    (history / "head.json").write_bytes(whole["head.json"])
    assert run("report", "--history", history) == 0
    assert reported(history) == complete


@pytest.mark.slow
def test_a_history_kept_with_another_catalogue_is_judged_by_todays(
    checks: Path, kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Statistics name columns by their order: of other causes they would be another's."""
    history = tmp_path / "history"
    with monkeypatch.context() as other:
        other.setattr(interim, "list_causes", lambda *of: list_causes(*of)[::-1])
        assert add(checks, history, *range(1, DAYS + 1)) == 1
    ours, theirs = reported(kept), reported(history)
    assert [c["verdict"] for c in theirs["checks"]] == [c["verdict"] for c in ours["checks"]]
    for key in ("cause", "location", "between", "gradual"):
        assert theirs["changes"][0][key] == ours["changes"][0][key]
    told = [[check["statistic"] for check in one["checks"]] for one in (ours, theirs)]
    assert told[1] == pytest.approx(told[0], abs=1e-3)  # but for the digits that a file keeps


@pytest.mark.slow
def test_a_head_without_a_line_is_a_history_not_begun(checks: Path, tmp_path: Path) -> None:
    history = tmp_path / "history"
    history.mkdir()
    head = {"schema": "armd.interim.head/1", "checks": 0, "sha256": "0" * 64}
    (history / "head.json").write_text(json.dumps(head))  # killed right after it was written
    assert add(checks, history, 1) == 0
    (history / "history.jsonl").unlink()  # a history that was there is another matter
    with pytest.raises(BadInput, match="nothing"):
        run("report", "--history", history)


@pytest.mark.slow
def test_a_writer_killed_at_any_moment_leaves_the_history_of_before_or_of_after(
    checks: Path, tmp_path: Path
) -> None:
    words = [str(checks), str(tmp_path / "history"), "60", "7"]
    script = Path(__file__).parent / "killed_writer.py"
    done = subprocess.run(
        [sys.executable, script, *words], capture_output=True, text=True, timeout=200
    )
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["killed"] >= 20, told  # while it wrote, not before or after


def test_an_empty_folder_is_a_history_not_begun(checks: Path, tmp_path: Path) -> None:
    for folder in (tmp_path / "nowhere", tmp_path):
        with pytest.raises(BadInput, match="no checks"):
            run("report", "--history", folder)
    assert add(checks, tmp_path, 1) == 0


def test_a_file_is_no_history(checks: Path, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    for call in (lambda: run("report", "--history", tmp_path / "file"),
                 lambda: add(checks, tmp_path / "file", 1)):  # fmt: skip
        refused(tmp_path, "file: the history: found a file, expected a folder", call)


@parametrize_default("place", ["", "checks"])
@pytest.mark.slow
def test_a_folder_without_the_right_to_write_is_named(checks: Path, kept: Path, tmp_path: Path,
                                                      place: str) -> None:  # fmt: skip
    history = Path(shutil.copytree(kept, tmp_path / "history"))
    (history / place).chmod(0o555)
    day = dated(checks, tmp_path / "day-09", datetime.datetime(2026, 3, 13, 9))
    before = contents(history)
    done = run_without_privilege("add", day, *files_of(checks), "--history", history)
    assert done.returncode == 2, done.stderr
    where = history / place if place else history
    assert f"armd: {where}: the folder: found no permission to write in it" in done.stderr
    assert contents(history) == before


@pytest.mark.slow
@parametrize_default(("file", "after"), [("statistics.json", 1), ("history.jsonl", 0)])
def test_a_full_disk_keeps_nothing_half(
    checks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, file: str, after: int
) -> None:
    """The room ends at a check's statistics, the second check's, or at the line itself."""
    history = tmp_path / "history"
    add(checks, history, 1)
    before = contents(history)
    left = [after]

    def full(path: str | Path, content: bytes | str) -> None:
        if Path(path).name == file:
            if not left[0]:
                raise BadInput(path, "the file", "no space left on its disk", "room for it")
            left[0] -= 1
        write_whole(path, content)

    monkeypatch.setattr(appending, "write_whole", full)
    with pytest.raises(BadInput, match="no space left"):
        add(checks, history, 2, 4)
    assert contents(history) == before
    assert [p.name for p in (history / "checks").iterdir() if "day-01" not in p.name] == []
    monkeypatch.undo()
    assert add(checks, history, 2, 4) == 0


@pytest.mark.slow
def test_no_room_for_the_report_says_that_the_check_is_kept(
    checks: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    history = tmp_path / "history"

    def full(path: str | Path, content: bytes | str) -> None:
        raise BadInput(path, "the file", "no space left on its disk", "room for it")

    monkeypatch.setattr(interim, "write_changed", full)
    with pytest.raises(BadInput, match="the checks are kept: armd interim report judges them"):
        add(checks, history, 1)
    monkeypatch.undo()
    assert run("report", "--history", history) == 0


@pytest.mark.slow
def test_a_history_that_cannot_be_written_is_reported(kept: Path) -> None:
    """An archive, another one's share: what is known already need not be written again."""
    kept.chmod(0o555)
    try:
        done = run_without_privilege("report", "--history", kept)
    finally:
        kept.chmod(0o755)
    assert done.returncode == 1, done.stderr
    assert "the index of joint 3 slipped" in done.stdout


@pytest.mark.slow
def test_two_that_add_at_once_wait_for_each_other(checks: Path, kept: Path, tmp_path: Path) -> None:
    """Different checks are both kept; the same check is kept by one, and the other is refused."""
    history = tmp_path / "history"

    def adding(*days: int) -> subprocess.Popen[str]:
        sessions = [checks / f"day-{day:02}" for day in days]
        words = [*ARMD, "interim", "add", *sessions, *files_of(checks), "--history", history]
        return subprocess.Popen([*map(str, words)], stderr=subprocess.PIPE, text=True)

    both = [adding(1, 3, 5, 7), adding(2, 4, 6, 8)]
    told = [(one.communicate(timeout=200)[1], one.returncode) for one in both]
    assert all(code in (0, 1) for _, code in told), told
    assert run("report", "--history", history) == 1
    assert reported(history) == reported(kept)
    shutil.rmtree(history)
    both = [adding(3), adding(3)]
    told = [(one.communicate(timeout=200)[1], one.returncode) for one in both]
    assert sorted(code for _, code in told) == [0, 2], told
    assert any("when check day-03 was started" in said for said, _ in told)
    assert run("report", "--history", history) == 0
    assert [check["name"] for check in reported(history)["checks"]] == ["day-03"]


def test_the_page_names_units_and_the_change(kept: Path, tmp_path: Path) -> None:
    assert run("report", "--history", kept, "--report", tmp_path / "r.html") == 1
    page = (tmp_path / "r.html").read_text()
    assert "encoder slip, joint 3" in page and "µm RMS" in page and "check started, UTC" in page


@pytest.mark.slow
def test_the_page_says_who_measured_what_with_which_arm(checks: Path, tmp_path: Path) -> None:
    day = Path(shutil.copytree(checks / "day-01", tmp_path / "day-01"))
    text = (day / "session.toml").read_text()
    (day / "session.toml").write_text(f'operator = "A. Body"\n{text}')
    files = [checks / "arm.toml", checks / "calibration.json"]
    run("add", day, "--arm", files[0], "--calibration", files[1], "--history", tmp_path / "h")
    assert run("report", "--history", tmp_path / "h", "--report", tmp_path / "r.html") == 0
    page = (tmp_path / "r.html").read_text()
    for told in ("A. Body", load_arm(files[0]).serial_number, f"armd {__version__}", "day-01"):
        assert f">{told}" in page, told
    for file in [*files, day / "session.toml", day / "readings.csv"]:
        assert hashlib.sha256(file.read_bytes()).hexdigest() in page, file
