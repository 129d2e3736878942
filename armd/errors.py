"""Bad input, said in one form everywhere: which file, where in it, found what, expected what."""

from __future__ import annotations

from pathlib import Path

from armd.printable import printable

#: Letters of each part of a message: all together they fit a screen.
MOST_LETTERS = 400


class ArmdError(Exception):
    """Base of every error armd raises on purpose; the command line prints no traceback for it."""


def cut(text: str) -> str:
    """*text*, or where it is too long to be read, its begin and end."""
    if len(text) <= MOST_LETTERS:
        return text
    return f"{text[: MOST_LETTERS - 100]} … {text[-90:]}"


class BadInput(ArmdError):
    """An input file or argument is wrong (exit code 2).

    Printed as ``armd: FILE: WHERE: found X, expected Y``: on one line and without anything that a
    terminal obeys, whatever the file held or a library said of it.
    """

    def __init__(self, file: str | Path, where: str, found: str, expected: str) -> None:
        self.file = str(file)
        self.where = where
        self.found = found
        self.expected = expected
        #: further faults of the same file, for those who want to hear all of them at once
        self.more: tuple[BadInput, ...] = ()
        said = f"{cut(where)}: found {cut(found)}, expected {cut(expected)}"
        super().__init__(printable(f"{cut(self.file)}: {said}"))


class NoAnswer(ArmdError, TimeoutError):
    """Nothing came of an arm within the time that was given."""


class Closed(ArmdError):
    """This program closed the connection to the arm and then used it."""
