"""Errors of bad input, in one form everywhere: file, place in it, found, expected."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from armd.printable import to_printable

#: The most letters in each part of a message: all parts fit on a screen.
MOST_LETTERS = 400
#: The most lines of a message.
MOST_LINES = 40


class ArmdError(Exception):
    """Base of every error that armd raises on purpose; the command line prints no traceback."""


def shorten_text(text: str, limit: int = MOST_LETTERS) -> str:
    """Return *text*; if it is too long, only its beginning and its end."""
    if len(text) <= limit:
        return text
    return f"{text[: limit - 100]} … {text[-90:]}"


def shorten_line(text: object, limit: int = MOST_LETTERS) -> str:
    """Return *text* on one line of a message, short, with control characters escaped.

    It is also short after escaping.
    """
    return shorten_text(to_printable(shorten_text(str(text), limit)), limit)


def shorten_lines(text: object) -> str:
    """Shorten a message that may have several lines."""
    lines = shorten_text(str(text), MOST_LINES * 4 * MOST_LETTERS).splitlines()
    omitted = [f"… {len(lines) - MOST_LINES} more lines"] if len(lines) > MOST_LINES else []
    return "\n".join(
        [*(shorten_line(line, 4 * MOST_LETTERS) for line in lines[:MOST_LINES]), *omitted]
    )


def describe_os_error(error: OSError) -> str:
    """Describe an error of the system: the file, and the reason."""
    problem = " ".join((error.strerror or str(error)).split())
    return f"{shorten_line(error.filename or 'the system')}: found {shorten_line(repr(problem))}"


class BadInput(ArmdError):
    """An input file or argument is wrong (exit code 2).

    Printed as ``armd: FILE: WHERE: found X, expected Y``: on one line and without control
    characters, whatever the file or the text of a library contained.
    """

    def __init__(self, file: str | Path, where: str, found: str, expected: str) -> None:
        self.file = str(file)
        self.where = where
        self.found = found
        self.expected = expected
        #: further faults of the same file, for programs that report all at once
        self.more: tuple[BadInput, ...] = ()
        parts = map(shorten_line, (self.file, where, found, expected))
        super().__init__("{}: {}: found {}, expected {}".format(*parts))


def join_faults(faults: Sequence[BadInput]) -> BadInput:
    """Return the first of several faults, with the others as its `more`."""
    worst, *further_faults = faults
    worst.more = tuple(further_faults)
    return worst


class NoAnswer(ArmdError, TimeoutError):
    """No answer of an arm within the time-out."""


class Closed(ArmdError):
    """This program closed the connection to the arm and then used it."""
