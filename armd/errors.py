"""Bad input, said in one form everywhere: which file, where in it, found what, expected what."""

from __future__ import annotations

from pathlib import Path

from armd.printable import to_printable

#: Letters of each part of a message: all together they fit a screen.
MOST_LETTERS = 400
#: Lines of a message.
MOST_LINES = 40


class ArmdError(Exception):
    """Base of every error armd raises on purpose; the command line prints no traceback for it."""


def shorten_text(text: str, limit: int = MOST_LETTERS) -> str:
    """*text*, or where it is too long to be read, its begin and end."""
    if len(text) <= limit:
        return text
    return f"{text[: limit - 100]} … {text[-90:]}"


def shorten_line(text: object, limit: int = MOST_LETTERS) -> str:
    """*text* on one line of a message: no character that a terminal obeys, and short when all
    those are written out."""
    return shorten_text(to_printable(shorten_text(str(text), limit)), limit)


def shorten_lines(text: object) -> str:
    """A message that may have several lines."""
    lines = shorten_text(str(text), MOST_LINES * 4 * MOST_LETTERS).splitlines()
    omitted = [f"… {len(lines) - MOST_LINES} more lines"] if len(lines) > MOST_LINES else []
    return "\n".join(
        [*(shorten_line(line, 4 * MOST_LETTERS) for line in lines[:MOST_LINES]), *omitted]
    )


def describe_os_error(error: OSError) -> str:
    """A refusal of the system as a message: the file, and what was found there."""
    problem = " ".join((error.strerror or str(error)).split())
    return f"{shorten_line(error.filename or 'the system')}: found {shorten_line(repr(problem))}"


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
        file, where, found, expected = map(shorten_line, (self.file, where, found, expected))
        super().__init__(f"{file}: {where}: found {found}, expected {expected}")


class NoAnswer(ArmdError, TimeoutError):
    """Nothing came of an arm within the time that was given."""


class Closed(ArmdError):
    """This program closed the connection to the arm and then used it."""
