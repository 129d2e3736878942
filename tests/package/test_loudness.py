"""-q and -v of every command: what is said beside the result, and where an error was found."""

from __future__ import annotations

import argparse
import logging
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from armd.daemon.cli import main, make_parsers
from armd.daemon.commands.groups import COMMANDS
from armd.simulator import options, sessions
from armd.terminal.loudness import OWN_FAULT
from armd.terminal.parser import Parser

ARM = """schema = "armd.arm/1"
serial_number = "A"
[[joint]]
d_mm = 100.0
alpha_deg = 90.0
[[joint]]
a_mm = 200.0
[[joint]]
a_mm = 200.0
[tip]
"""
LINE = re.compile(r"armd: +\d+\.\d\d s  \S.*")


def leaves(parser: Parser) -> Iterator[Parser]:
    for below in parser.subcommands.values():
        yield from leaves(below)
    if not parser.subcommands:
        yield parser


def test_every_command_takes_them_alike() -> None:
    _, commands = make_parsers(COMMANDS.keys() - {"simulate"})
    del commands["simulate"]  # a program of its own, with two command lines
    simulated = Parser()
    sessions.add_arguments(simulated)
    every = [leaf for one in commands.values() for leaf in leaves(one)]
    assert len(every) > len(commands)  # interim has two
    for parser in [*every, simulated, options.make_parser()]:
        names = {name: a.dest for a in parser.arguments for name in a.option_strings}
        assert names["-q"] == names["--quiet"] == "quiet", parser.prog
        assert names["-v"] == names["--verbose"] == "verbose", parser.prog


def test_not_both(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["check", "-q", "-v", "arm.toml"])
    assert ended.value.code == 2
    assert "-v/--verbose: not allowed with argument -q/--quiet" in capsys.readouterr().err


def test_verbose_says_files_and_steps_with_the_time(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arm = tmp_path / "arm.toml"
    arm.write_text(ARM)
    assert main(["check", str(arm)]) == 0
    plain = capsys.readouterr()
    assert plain.err == ""
    assert main(["check", str(arm), "--verbose"]) == 0
    loud = capsys.readouterr()
    assert loud.out == plain.out  # the result is the same
    lines = loud.err.splitlines()
    assert all(LINE.fullmatch(line) for line in lines), loud.err
    assert sum(f"reading {arm}, {len(ARM)} bytes" in line for line in lines) == 1
    assert re.search(r"end: \d+\.\d s of processor time, \d+ MB of memory$", lines[-1])
    times = [float(line.split()[1]) for line in lines]
    assert times == sorted(times)
    assert main(["check", str(arm)]) == 0
    assert capsys.readouterr().err == ""  # it ended with its command
    assert logging.getLogger("armd").handlers == []


@pytest.mark.slow
def test_each_step_once_and_what_was_written(tmp_path: Path) -> None:
    simulate = [sys.executable, "-m", "armd", "simulate", "--session", "isothermal", "-o", "m"]
    told = subprocess.run([*simulate, "-v"], cwd=tmp_path, capture_output=True, text=True).stderr
    lines = [line.split(" s  ", 1)[1] for line in told.splitlines()]
    assert lines[0] == "measuring with the simulated arm …"
    assert len(lines) == len(set(lines))
    for path in ("m/arm.toml", "m/first/session.toml", "m/first/readings.csv"):
        assert f"wrote {path}, {(tmp_path / path).stat().st_size} bytes" in lines


def test_an_error_answered_in_a_line_is_traced_with_verbose_only(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    absent = str(tmp_path / "absent.toml")
    assert main(["check", absent]) == 2
    answer = capsys.readouterr().err
    assert len(answer.splitlines()) == 1
    assert main(["check", absent, "-v"]) == 2
    traced = capsys.readouterr().err
    assert "Traceback" in traced and "check.py" in traced
    assert traced.endswith(answer)


@pytest.mark.parametrize("more", [[], ["-v"]])
def test_a_fault_of_armd_is_no_answer(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    more: list[str],
) -> None:
    def broken(namespace: argparse.Namespace) -> int:
        raise KeyError("nobody foresaw this")

    monkeypatch.setattr("armd.daemon.commands.setup.man.run", broken)
    assert main(["man", *more]) == OWN_FAULT  # not 1: "verified, and the answer is no"
    told = capsys.readouterr().err
    assert told.count("Traceback") == 1 and "in broken" in told
    assert told.splitlines()[-1].startswith("armd: KeyError: this is a fault of armd")
