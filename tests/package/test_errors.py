"""Messages of bad input: on a screen, whatever a file or the system had in it."""

from __future__ import annotations

import errno

import pytest

from armd.daemon import cli
from armd.errors import MOST_LETTERS, MOST_LINES, ArmdError, BadInput
from armd.terminal.parser import Parser

#: Ten letters each when written out, and nothing that a terminal may be sent.
INVISIBLE = "\U000e0001\x1b]0;owned\x07" * 3000
A_SCREEN = 5 * MOST_LETTERS


def raising(error: Exception) -> pytest.MonkeyPatch:
    def run(arguments: object) -> int:
        raise error

    patch = pytest.MonkeyPatch()
    patch.setattr(cli, "_run", run)
    return patch


@pytest.mark.parametrize(
    "error",
    [
        BadInput(INVISIBLE, INVISIBLE, INVISIBLE, INVISIBLE),
        ArmdError(f"endpoint: found {INVISIBLE}"),
        OSError(errno.ENOENT, "No such file or directory", INVISIBLE),
        OSError(errno.EIO, INVISIBLE),
        OSError(INVISIBLE),
    ],
    ids=["bad input", "another of armd's", "a file of the system", "its words", "no number"],
)
def test_every_message_fits_a_screen_after_its_characters_are_written_out(
    error: Exception, capsys: pytest.CaptureFixture[str]
) -> None:
    patch = raising(error)
    try:
        assert cli.main(["check"]) == 2
    finally:
        patch.undo()
    said = capsys.readouterr().err
    assert said.startswith("armd: ") and said.count("\n") == 1 and len(said) < A_SCREEN
    assert said.rstrip("\n").isprintable()


def test_a_message_of_many_lines_is_cut(capsys: pytest.CaptureFixture[str]) -> None:
    patch = raising(ArmdError("\n".join(f"line {i}" for i in range(1000))))
    try:
        assert cli.main(["check"]) == 2
    finally:
        patch.undo()
    said = capsys.readouterr().err.splitlines()
    assert len(said) == MOST_LINES + 1 and said[-1] == f"… {1000 - MOST_LINES} more lines"


@pytest.mark.parametrize("option", [f"--no{INVISIBLE}", "--number=1" + "0" * 9999 + "x"])
def test_a_message_of_the_command_line_fits_a_screen(
    capsys: pytest.CaptureFixture[str], option: str
) -> None:
    parser = Parser(prog="armd check")
    parser.add_argument("--number", type=float)
    with pytest.raises(SystemExit) as ended:
        parser.parse_args([option])
    said = capsys.readouterr().err
    assert ended.value.code == 2 and len(said) < A_SCREEN and said.rstrip("\n").isprintable()
