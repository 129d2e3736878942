"""Every command with every plausible wrong input: one line that tells it, exit 2, no traceback.

In this process: an exception that no command catches fails the test by itself.
"""

from __future__ import annotations

import contextlib
import datetime
import os
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.sessions.writing import write_session
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import save_calibration
from armd.daemon.cli import main
from armd.daemon.commands.groups import COMMANDS
from armd.simulator.__main__ import main as simulate
from support.drawn import drawn
from support.selection import parametrize_default

ARM = """
schema = "armd.arm/1"
serial_number = "TEST-1"
[[temperature_sensor]]
name = "t1"
"""
JOINT = """
[[joint]]
d_mm = {d}
a_mm = {a}
alpha_deg = {alpha}
counts_per_turn = 4096
temperature = "t1"
"""
CONFIG = """
schema = "armd.daemon/1"
arm = "arm.toml"
[driver]
kind = "serial"
port = "/dev/none"
"""


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with one file of each kind, all of them right."""
    folder = tmp_path_factory.mktemp("right")
    joints = [(200, 0, 90), (0, 300, 0), (0, 250, 90)]
    text = "".join(JOINT.format(d=d, a=a, alpha=alpha) for d, a, alpha in joints)
    (folder / "arm.toml").write_text(ARM + text + "[tip]\noffset_mm = [0.0, 0.0, 100.0]\n")
    (folder / "armd.toml").write_text(CONFIG)
    (folder / "mpe.toml").write_text('schema = "armd.mpe/1"\n[mpe]\ne_uni_mm = 0.03\n')
    (folder / "scenario.toml").write_text('schema = "armd.scenario/1"\n')
    (folder / "lerobot.json").write_text("{}")
    save_calibration(folder / "cal.json", drawn(load_arm(folder / "arm.toml")))
    measure(folder / "session", 12)
    return folder


def measure(folder: Path, n: int, **changes: object) -> None:
    """A session of *n* readings on one seat, of which columns may be changed."""
    rng = np.random.default_rng(3)
    content = {
        "schema": "armd.session/1",
        "arm": "TEST-1",
        "started": datetime.datetime(2026, 3, 1, 9, tzinfo=datetime.UTC),
        "artefact": {"name": "seat", "target": [{"name": "S1"}]},
    }
    columns: dict[str, object] = {
        "time_s": np.arange(n) * 2.0,
        "placement": ["P1"] * n,
        "target": ["S1"] * n,
        "t1": np.full(n, 20.0),
    }
    columns |= {f"q{k}": rng.uniform(-2, 2, n) for k in (1, 2, 3)}
    write_session(folder, content, columns | changes)  # type: ignore[arg-type]


@pytest.fixture
def folder(template: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the right files, which the command line is in."""
    for path in template.rglob("*"):
        target = tmp_path / path.relative_to(template)
        target.mkdir() if path.is_dir() else target.write_bytes(path.read_bytes())
    monkeypatch.chdir(tmp_path)
    return tmp_path


#: commands that are right, with their inputs and outputs in this folder
RIGHT = {
    "calibrate": "calibrate session --arm arm.toml -o out.json --json result.json --report r.html",
    "evaluate": "evaluate session --arm arm.toml --calibration cal.json --json result.json",
    "verify": "verify session --arm arm.toml --calibration cal.json --mpe mpe.toml"
    " --json result.json --report r.html",
    "diagnose": "diagnose session --arm arm.toml --calibration cal.json --json result.json"
    " --report r.html --extended out.json",
    "design": "design session --arm arm.toml --calibration cal.json -o poses.csv"
    " --json result.json --report r.html",
    "correct": "correct session/readings.csv --arm arm.toml --calibration cal.json -o points.csv",
    "check": "check arm.toml armd.toml cal.json mpe.toml",
    "check session": "check arm.toml session",
    "replay": "replay recording.mcap --check",
    "replayed": "replay recording.mcap --calibration cal.json -o points.csv",
    "run": "run armd.toml --allow-root",
    "accept": "accept armd.toml",
    "arm": "arm so101 -o out.toml",
    "lerobot": "arm import-lerobot lerobot.json -o out.toml",
    "simulate": "simulate --session demo -o sessions --truth-out truth.json",
    "so101": "simulate --session so101 -o sessions --truth-out truth.json",
    "wire": "simulate --serial --seconds 0.1 --scenario scenario.toml --truth truth.bin"
    " --fault-log faults.jsonl --arm-out out.toml",
}
INPUTS = (
    "arm.toml",
    "armd.toml",
    "cal.json",
    "mpe.toml",
    "scenario.toml",
    "session",
    "lerobot.json",
)
INPUTS += ("session/readings.csv", "recording.mcap")
OUTPUTS = ("out.json", "result.json", "r.html", "poses.csv", "points.csv", "out.toml", "sessions")
OUTPUTS += ("truth.json", "truth.bin", "faults.jsonl")


def fails(words: Sequence[str], capsys: pytest.CaptureFixture[str]) -> str:
    """The line with which a command refuses, which it must do with exit code 2."""
    code: object = None
    try:
        code = simulate(words[1:]) if words[0] == "simulate" else main(words)
    except SystemExit as end:  # argparse's way
        code = end.code
    told = capsys.readouterr()
    assert "Traceback" not in told.err
    allowed = (1, 2) if words[0] == "check" else (2,)  # its work is to find faults
    assert code in allowed, (code, told.err)
    lines = [line for line in told.err.splitlines() if line.startswith("armd")]
    assert lines, told.err
    assert all(len(line) < 1500 for line in lines)
    return lines[-1]


def make(path: Path, content: bytes | Callable[[Path], object]) -> None:
    if path.is_dir():
        for file in path.iterdir():
            file.unlink()
        path.rmdir()
    path.unlink(missing_ok=True)
    path.write_bytes(content) if isinstance(content, bytes) else content(path)


def _many(path: Path) -> None:
    path.write_text("[[joint]]\nd_mm = 1.0\n" * 5000)


WRONG: dict[str, bytes | Callable[[Path], object]] = {
    "nothing": lambda path: None,
    "empty": b"",
    "zeros": bytes(1000),
    "junk": bytes(range(256)) * 20,
    "text": "Dear Ann, ça va?\n".encode(),
    "latin": 'schema = "é"\n'.encode("latin-1"),
    "a list": b"[1, 2, 3]",
    "a number": b"17",
    "null": b"null",
    "deep": b"[" * 100_000,
    "deep table": b"a = " + b"[" * 100_000,
    "deep object": b'{"schema": "armd.calibration/1", "provenance": ' + b'{"a":' * 90_000,
    "digits": b'{"schema": "armd.calibration/1", "arm": ' + b"1" * 5000 + b"}",
    "toml digits": b'schema = "armd.arm/1"\nreference_temperature_c = ' + b"1" * 5000,
    "huge": b'schema = "armd.arm/1"\nreference_temperature_c = 1e999\n',
    "other schema": b'schema = "armd.other/1"\n',
    "other kind": b'{"schema": "armd.diagnosis/1"}',
    "schema is a list": b'schema = ["armd.arm/1"]\n',
    "many": _many,
    "wide cell": b"q1,q2,q3\n1,2,3\n" + b"9" * 20_000_000 + b",2,3\n",
    "header alone": b"time_s,placement,target,q1,q2,q3,t1\n",
    "ragged": b"time_s,placement,target,q1,q2,q3,t1\n0,P,S1,1,2\n",
    "half a recording": b"\x89MCAP0\r\n" + bytes(50),
    "a folder": Path.mkdir,
    "a pipe": os.mkfifo,
    "a loop": lambda path: path.symlink_to(path.name),
    "a device": lambda path: path.symlink_to("/dev/zero"),
}


@parametrize_default("name", RIGHT)
def test_a_wrong_file_in_place_of_each_input(
    folder: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    words = RIGHT[name].split()
    for position, word in enumerate(words):
        if word not in INPUTS:
            continue
        for wrong in WRONG:
            if (word, wrong) == ("scenario.toml", "empty"):
                continue  # a scenario of defaults
            for suffix in {Path(word).suffix, ""} if word != "session" else {""}:
                bad = folder / f"bad{suffix}"
                make(bad, WRONG[wrong])
                line = fails([*words[:position], str(bad), *words[position + 1 :]], capsys)
                assert "bad" in line or "recording.mcap" in line, (wrong, line)
                make(bad, lambda path: None)
        made = {path.name for path in folder.iterdir()} - {Path(name).parts[0] for name in INPUTS}
        assert not made, made


@pytest.mark.parametrize("name", RIGHT)
def test_an_output_that_cannot_be_or_may_not(
    folder: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    words = RIGHT[name].split()
    measure(folder / "measured" / "T14", 12)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    (folder / "link").symlink_to("arm.toml")
    for position, word in enumerate(words):
        if word not in OUTPUTS:
            continue
        folders = ("none/none", "arm.toml/none", "x" * 300, "arm.toml", "link")
        files = (*folders, "none/out", ".", "", "measured", "session/session.toml", "cal.json")
        for bad in folders if word == "sessions" else files:
            if (word, bad) in {("out.json", "cal.json"), ("sessions", "none/none")} or (
                bad == "cal.json" and bad not in words and word.endswith("json")
            ):
                continue  # may be written
            fails([*words[:position], bad, *words[position + 1 :]], capsys)
            after = {
                p: p.read_bytes() for p in folder.rglob("*") if p.is_file() and p.name != "link"
            }
            assert after == before, (word, bad)


SESSIONS: dict[str, dict[str, object]] = {
    "one reading": {"n": 1},
    "two readings": {"n": 2},
    "copies of one": {"n": 12, **{f"q{k}": np.full(12, 0.3 * k) for k in (1, 2, 3)}},
    "all zero": {"n": 12, **{f"q{k}": np.zeros(12) for k in (1, 2, 3)}},
    "no temperature": {"n": 12, "t1": np.full(12, np.nan)},
    "no time": {"n": 12, "time_s": np.full(12, np.nan)},
    "a placement each": {"n": 12, "placement": [f"P{i}" for i in range(12)]},
    "infinite": {"n": 12, "q1": np.full(12, np.inf)},
    "in Fahrenheit": {"n": 12, "t1": np.full(12, 300.0)},
    "of another target": {"n": 12, "target": ["none"] * 12},
}


POOR = [(name, kind) for name in ("calibrate", "evaluate", "verify") for kind in SESSIONS]
POOR += [(name, kind) for name in ("diagnose", "design") for kind in SESSIONS]
SLOW = ("no temperature", "no time")  # of which a diagnosis can be made
POOR = [(n, k) for n, k in POOR if n not in ("diagnose", "design") or k not in SLOW]


@pytest.mark.parametrize(("command", "kind"), POOR)
def test_a_session_that_holds_too_little(
    folder: Path, capsys: pytest.CaptureFixture[str], command: str, kind: str
) -> None:
    changes = dict(SESSIONS[kind])
    measure(folder / "poor", int(str(changes.pop("n"))), **changes)
    words = RIGHT[command].replace("session", "poor").replace(" --mpe mpe.toml", "").split()
    with contextlib.suppress(SystemExit):
        code = main(words)
    told = capsys.readouterr()
    assert "Traceback" not in told.err
    assert code in (0, 1, 2), told.err
    if code == 2:
        assert told.err.splitlines()[-1].startswith("armd: "), told.err


NUMBERS = ("-1", "0", "nan", "inf", "-inf", "x", "", "1e999", "1,5")
OPTIONS = [
    ("demo", "--seconds", set()),
    ("demo", "--seed", {"0"}),
    ("watch", "--seconds", set()),
    ("record", "--seconds", set()),
    ("stream", "--points", set()),
    ("design session --arm arm.toml", "--poses", set()),
    ("design --arm arm.toml", "--readings", set()),
    ("design --arm arm.toml", "--lowest", {"0", "-1"}),
    ("replay recording.mcap", "--speed", set()),
    ("calibrate session --arm arm.toml -o out.json", "--thermal", {"0"}),
    ("simulate --serial", "--seconds", set()),
    ("simulate --serial", "--seed", {"0"}),
    ("simulate --serial", "--rate", set()),
    ("simulate --serial", "--warm-up-k", {"0", "-1"}),
    ("simulate --serial", "--warm-up-s", set()),
    ("simulate --serial", "--ambient-c", {"0", "-1"}),
    ("simulate --serial", "--fault", set()),
    ("simulate --session demo -o sessions", "--seed", {"0"}),
    ("simulate --session demo -o sessions", "--noise", {"0"}),
    ("simulate --session demo -o sessions", "--plant", set()),
    ("correct session/readings.csv --arm arm.toml -o points.csv", "--started", set()),
    ("correct session/readings.csv --arm arm.toml -o points.csv", "--angle-unit", set()),
]


@pytest.mark.parametrize(("words", "option", "fine"), OPTIONS)
def test_a_number_that_cannot_be_meant(
    folder: Path, capsys: pytest.CaptureFixture[str], words: str, option: str, fine: set[str]
) -> None:
    for number in set(NUMBERS) - fine:
        fails([*words.split(), f"{option}={number}"], capsys)


@pytest.mark.parametrize("command", COMMANDS)
def test_words_that_do_not_belong(capsys: pytest.CaptureFixture[str], command: str) -> None:
    fails([command, "--none"], capsys)
    fails([command, "--help=1"], capsys)
    fails([command, "a", "b", "c", "--seconds"], capsys)
