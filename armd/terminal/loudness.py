"""How much a command says beside its result: less with -q, more with -v, of every command alike.

What -v says are the records of the logger "armd" from INFO on: whoever reads or writes a file,
connects or begins a step tells it there. A program that uses armd as a library hears them with
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
#: Errors that a command answers in one line; with -v their traceback stands before it.
ANSWERED = (ArmdError, OSError, MemoryError, ModuleNotFoundError)

#: Exit code where armd itself is at fault: never 1, which a script takes for an answer. EX_SOFTWARE
#: of sysexits.h.
OWN_FAULT = 70


def add_loudness(parser: argparse.ArgumentParser) -> None:
    """The options -q and -v, of *parser* or of each of the commands below it."""
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
    """While a command runs: with -v, what `LOG` is told stands on standard error."""
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
    """In words; "" on a system that does not tell (Windows)."""
    try:
        import resource
    except ImportError:
        return ""
    return f", {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB of memory"


def _once() -> Callable[[logging.LogRecord], bool]:
    """Of lines that are the same, the first: a file is looked into more often than once."""
    logged_texts: set[str] = set()

    def new(record: logging.LogRecord) -> bool:
        text = record.getMessage()
        is_new = text not in logged_texts
        logged_texts.add(text)
        return is_new

    return new


def report_own_fault(error: Exception, culprit: str = "armd") -> int:
    """For what nobody foresaw: its traceback, without -v too, for it may not come again.

    *culprit*: whose code it was."""
    traceback.print_exception(error)
    name = type(error).__name__
    print(
        f"armd: {name}: this is a fault of {culprit}, not of your files;"
        " please report the lines above",
        file=sys.stderr,
    )
    return OWN_FAULT


class _Line(logging.Formatter):
    """`armd:    0.41 s  read arm.toml, 2143 bytes`: seconds since the program was loaded."""

    def format(self, record: logging.LogRecord) -> str:
        line = f"armd: {record.relativeCreated / 1e3:7.2f} s  {to_printable(record.getMessage())}"
        if record.exc_info:
            line += "\n" + self.formatException(record.exc_info)
        return line
