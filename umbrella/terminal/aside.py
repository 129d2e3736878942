"""What a command says beside its result, on standard error: how far it is, and remarks."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from armd.compiled.jit import when_compiling


def add_quiet(parser: argparse.ArgumentParser) -> None:
    """The option -q."""
    parser.add_argument("-q", "--quiet", action="store_true", help="no progress, no remarks")


def aside(args: argparse.Namespace) -> Console:
    """Mute with -q. Errors are not said here."""
    return Console(stderr=True, quiet=args.quiet)


def tell_of_compiling() -> None:
    """One line before functions are compiled that no cache has: it takes longer than the work."""
    text = "armd: compiling for this machine, once: some 20 s of processor time"
    when_compiling(lambda: Console(stderr=True).print(text))


@contextmanager
def bar(console: Console, text: str) -> Iterator[Callable[[str, float], None]]:
    """A bar on a terminal, and nothing elsewhere; what it gives takes a text and a share."""
    columns = TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn()
    with Progress(
        *columns,
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=console.quiet or not console.is_terminal,
    ) as progress:
        task = progress.add_task(text, total=1.0)
        yield lambda said, share: progress.update(task, description=said, completed=share)
