"""Messages of a command beside its result, on standard error: progress and remarks."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console, RenderableType
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.status import Status

from armd.compiled.jit import call_at_compiling
from armd.terminal.loudness import LOG


class Aside(Console):
    """A console that is mute with -q. With -v nothing moves: each step is a line of the log."""

    def __init__(self, *, quiet: bool, verbose: bool) -> None:
        still = verbose or not sys.stderr.isatty()  # FORCE_COLOR, as in Jupyter, makes no terminal
        super().__init__(stderr=True, quiet=quiet, force_terminal=False if still else None)

    def status(self, status: RenderableType, **options: Any) -> Status:
        """Return the display of a step, as rich does."""
        return _Step(status, console=self, **options)


class _Step(Status):
    """A step whose text also goes to the log."""

    def __init__(self, status: RenderableType, **options: Any) -> None:
        super().__init__(status, **options)
        self._tell = _teller()
        self._tell(str(status))

    def update(self, status: RenderableType | None = None, **options: Any) -> None:
        """Update the display as rich does, and log the text."""
        if status is not None:
            self._tell(str(status))
        super().update(status, **options)


def _teller() -> Callable[[str], None]:
    """Return a function that logs each step once, ignoring numbers that count within it."""
    last: str | None = None

    def tell(text: str) -> None:
        nonlocal last
        shape = re.sub(r"\d+", "", text)
        if shape != last:
            LOG.info("%s", text)
        last = shape

    return tell


def make_aside(args: argparse.Namespace) -> Aside:
    """Make the console for the options -q and -v. Errors are printed elsewhere."""
    return Aside(quiet=args.quiet, verbose=args.verbose)


def report_compiling() -> None:
    """Print a line before functions are compiled: this takes longer than the work."""
    text = "armd: compiling for this machine, once: some 20 s of processor time"
    call_at_compiling(lambda: Console(stderr=True).print(text))


@contextmanager
def show_bar(console: Console, text: str) -> Iterator[Callable[[str, float], None]]:
    """Show a bar on a terminal only; yield a function that takes a text and a share."""
    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    tell = _teller()
    tell(text)
    with Progress(
        *columns,
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=console.quiet or not console.is_terminal,
    ) as progress:
        task = progress.add_task(text, total=1.0)

        def show_share(step: str, share: float) -> None:
            tell(step)
            progress.update(task, description=step, completed=share)

        yield show_share
