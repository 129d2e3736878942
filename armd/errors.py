"""Bad input, said in one form everywhere: which file, where in it, found what, expected what."""

from __future__ import annotations

from pathlib import Path


class ArmdError(Exception):
    """Base of every error armd raises on purpose; the command line prints no traceback for it."""


class BadInput(ArmdError):
    """An input file or argument is wrong (exit code 2).

    Printed as ``armd: FILE: WHERE: found X, expected Y``.
    """

    def __init__(self, file: str | Path, where: str, found: str, expected: str) -> None:
        self.file = str(file)
        self.where = where
        self.found = found
        self.expected = expected
        #: further faults of the same file, for those who want to hear all of them at once
        self.more: tuple[BadInput, ...] = ()
        super().__init__(f"{file}: {where}: found {found}, expected {expected}")


class NoAnswer(ArmdError, TimeoutError):
    """Nothing came of an arm within the time that was given."""
