"""The verbosity of all commands: fewer messages with -q, more with -v.

-v prints the records of the logger "armd" from INFO on: every file read or written, connection and
step is logged there. A program that uses armd as a library gets them with
`logging.basicConfig(level=logging.INFO)`.
"""

from __future__ import annotations

import argparse
import logging
import sys
import time
import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from armd.errors import ArmdError
from armd.printable import to_printable
from armd.terminal.parser import Parser

LOG = logging.getLogger("armd")
#: Errors that a command reports in one line; with -v their traceback comes before it.
ANSWERED = (ArmdError, OSError, MemoryError, ModuleNotFoundError)

#: Exit code of a fault of armd itself: EX_SOFTWARE of sysexits.h. It is never 1, which scripts take
#: for an answer.
OWN_FAULT = 70


def add_loudness(parser: argparse.ArgumentParser) -> None:
    """Add the options -q and -v to *parser*, or to each of the commands below it."""
    if isinstance(parser, Parser) and parser.subcommands:
        for below in parser.subcommands.values():
            add_loudness(below)
        return
    either = parser.add_mutually_exclusive_group()
    either.add_argument("-q", "--quiet", action="store_true", help="no progress, no remarks")
    either.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="say on standard error, with the time, each step, file and connection; at an error,"
        " where in armd it was found",
    )


@contextmanager
def show_log(args: argparse.Namespace) -> Iterator[None]:
    """Print the records of `LOG` on standard error while a command with -v runs."""
    if not args.verbose or sys.stderr is None:
        yield
        return
    handler = logging.StreamHandler(sys.stderr)
    handler.setFormatter(_Line())
    handler.addFilter(_once())
    before = LOG.level
    LOG.addHandler(handler)
    LOG.setLevel(logging.INFO)
    try:
        yield
    except ANSWERED:
        LOG.info("an error, found here:", exc_info=True)
        raise
    finally:
        LOG.info("end: %.1f s of processor time%s", time.process_time(), _most_memory())
        LOG.removeHandler(handler)
        LOG.setLevel(before)


def _most_memory() -> str:
    """Return the largest memory in words; "" where the system has no figure (Windows)."""
    try:
        import resource
    except ImportError:
        return ""
    return f", {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB of memory"


def _once() -> Callable[[logging.LogRecord], bool]:
    """Return a filter that passes each text once: a file may be opened several times."""
    logged_texts: set[str] = set()

    def new(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        is_new = text not in logged_texts
        logged_texts.add(text)
        return is_new

    return new


def report_own_fault(error: Exception, culprit: str = "armd") -> int:
    """Report an unexpected error with its traceback, also without -v: it may not recur.

    *culprit*: the owner of the faulty code.
    """
    traceback.print_exception(error)
    name = type(error).__name__
    print(
        f"armd: {name}: this is a fault of {culprit}, not of your files;"
        " please report the lines above",
        file=sys.stderr,
    )
    return OWN_FAULT


class _Line(logging.Formatter):
    """`armd: 0.41 s read arm.toml, 2143 bytes`: seconds since the program was loaded."""

    def format(self, record: logging.LogRecord) -> str:
        line = f"armd: {record.relativeCreated / 1e3:7.2f} s  {to_printable(record.getMessage())}"
        if record.exc_info:
            line += "\n" + self.formatException(record.exc_info)
        return line
