"""`armd --help` and `python -m armd`: examples that are taken, exit codes that are returned."""

from __future__ import annotations

import argparse
import importlib
import inspect
import re
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from armd.daemon.cli import main, name_module
from armd.daemon.commands.groups import COMMANDS, GROUPS
from armd.daemon.commands.usage import USAGE
from armd.simulator import options
from armd.simulator.__main__ import make_sessions_parser

DOCS = Path(__file__).parents[3] / "docs"
VERBS = set(
    re.findall(
        r"\w+",
        "accept check choose compute correct describe find fit guide identify judge list"
        " make play print publish record reload run send serve show simulate watch write",
    )
)


def test_every_command_has_its_usage() -> None:
    assert set(COMMANDS) - {"simulate"} == set(USAGE)


@pytest.mark.parametrize("name", USAGE)
def test_the_examples_are_taken(name: str) -> None:
    module = importlib.import_module(name_module(name))
    for example in USAGE[name].examples:
        program, command, *words = shlex.split(example)
        assert (program, command) == ("armd", name)
        parser = argparse.ArgumentParser(exit_on_error=False)
        module.add_arguments(parser)
        parser.parse_args(words)
    assert (DOCS / USAGE[name].page).is_file()


@pytest.mark.parametrize("name", USAGE)
def test_who_may_answer_no_says_when(name: str) -> None:
    module = importlib.import_module(name_module(name))
    source = inspect.getsource(module)
    answers_no = re.search(r"return (1|0) (if .* )?else (1|0)\b|return 1\b", source) is not None
    assert answers_no == bool(USAGE[name].no)


def test_help_ends_with_all_of_it(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["verify", "--help"])
    assert ended.value.code == 0
    told = capsys.readouterr().out
    for words in (
        "example:\n  armd verify verify",
        "units:\n  mm",
        "  1  the arm",
        "docs/how-to/verify.md",
    ):
        assert words in told


@pytest.mark.parametrize("parser", [options.make_parser, make_sessions_parser])
def test_the_simulators_help_has_it_too(parser: Callable[[], argparse.ArgumentParser]) -> None:
    told = parser().format_help()
    for words in (
        "examples:\n  armd simulate",
        "units:\n  mm",
        "exit code:\n  0",
        "docs/how-to/sim",
    ):
        assert words in told
    live, measured, twin = (shlex.split(example)[2:] for example in options.USAGE.examples)
    options.make_parser().parse_args(live)
    options.make_parser().parse_args(twin)
    make_sessions_parser().parse_args(measured)
    assert (DOCS / options.USAGE.page).is_file()


def test_python_dash_m() -> None:
    told = subprocess.run([sys.executable, "-m", "armd", "--version"], capture_output=True)
    assert told.stdout.startswith(b"armd ") and told.returncode == 0


@pytest.mark.parametrize(
    ("words", "begin"),
    [("help", "usage: armd "), ("--help", "usage: armd "), ("help check", "usage: armd check"),
     ("-V", "armd ")],
)  # fmt: skip
def test_help_and_version_are_asked_for_by_any_name(
    words: str, begin: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as end:
        main(words.split())
    assert end.value.code == 0 and capsys.readouterr().out.startswith(begin)


def test_nothing_said_is_answered_with_the_help(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 2
    alone = capsys.readouterr()
    with pytest.raises(SystemExit):
        main(["--help"])
    assert alone.out == "" and alone.err == capsys.readouterr().out


def test_the_help_lists_each_command_once_in_its_group(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    told = capsys.readouterr().out
    headings = re.findall(r"^([a-z][a-z ]*):$", told, re.MULTILINE)
    assert headings == [*GROUPS, "options"] and max(map(len, told.splitlines())) < 80
    for title, names in GROUPS.items():
        block = told.partition(f"\n{title}:\n")[2].partition("\n\n")[0]
        assert re.findall(r"^  ([a-z0-9]+) ", block, re.MULTILINE) == list(names)


def test_each_line_of_the_help_begins_with_a_verb() -> None:
    first = {line.replace(",", "").split()[0] for line in COMMANDS.values()}
    assert first <= VERBS
