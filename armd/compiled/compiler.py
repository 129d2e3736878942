"""Numba as armd uses it: compiled once, cached in a folder of armd's own."""

from __future__ import annotations

import hashlib
import pickle
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numba
from numba.core.caching import FunctionCache
from numba.core.event import Event, Listener, register
from numba.core.types import Record
from numba.core.types.misc import unliteral

from armd.compiled.library import cache_folder, sources, usable


@contextmanager
def _forgiving(_: FunctionCache) -> Iterator[None]:
    """A cache that cannot be read or written costs the time to compile, and nothing else."""
    with suppress(OSError, EOFError, pickle.PickleError, ValueError, KeyError):
        yield


# Numba's default is __pycache__ beside the source, which a service may not write to, and where
# what a called function was compiled to may be out of date.
FOLDER = cache_folder() / sources()
numba.config.CACHE_DIR = str(FOLDER)
FunctionCache._guard_against_spurious_io_errors = _forgiving


def _told_apart(record: Record) -> tuple[str, tuple[str, ...]]:
    return "Record", (hashlib.sha256(record.name.encode()).hexdigest(),)


# In the name of a machine function numba has a record as a number that it counted up in the process
# that compiled it. In the cache, functions of many processes stand together, where arms of other
# joint counts had the same number: one arm's samples were then read by another's layout.
type.__setattr__(Record, "mangling_args", property(_told_apart))

# Nobody calls by C's convention: what would make it possible is not compiled.
_OPTIONS: dict[str, Any] = {
    "error_model": "numpy",
    "fastmath": {"contract"},
    "no_cfunc_wrapper": True,
}
_cached = usable(FOLDER)


def keep_nothing() -> None:
    """From here on functions are compiled anew: one from the cache cannot go into a library."""
    global _cached
    _cached = False


def compiled(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Numba's dispatcher of *function*, which compiles it at its first call."""
    if _cached:
        with suppress(RuntimeError):  # "cannot cache function": it has no source file
            dispatcher = numba.njit(cache=True, **_OPTIONS, **options)(function)
            if FOLDER in Path(dispatcher.stats.cache_path).parents:
                return _once_for_all_constants(dispatcher)
    return _once_for_all_constants(numba.njit(**_OPTIONS, **options)(function))


def _once_for_all_constants(dispatcher: Any) -> Any:
    """Numba would compile it anew for each constant that a compiled function calls it with. LLVM
    sees them too where it writes the function out, and that is where it matters."""
    template = dispatcher.get_call_template

    def widened(args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        named = {name: unliteral(kind) for name, kind in kws.items()}
        return template(tuple(unliteral(kind) for kind in args), named)

    dispatcher.get_call_template = widened
    return dispatcher


def when_compiling(say: Callable[[], None]) -> None:
    """Call *say* once, where a function is about to be compiled and not taken from the cache."""
    register("numba:compile", _Once(say))


class _Once(Listener):  # type: ignore[misc]
    def __init__(self, say: Callable[[], None]) -> None:
        self._say: Callable[[], None] | None = say

    def on_start(self, event: Event) -> None:
        say, self._say = self._say, None
        if say is not None:
            say()

    def on_end(self, event: Event) -> None:
        pass
