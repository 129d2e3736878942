"""Numba as armd uses it: compiles once, and caches in a folder of armd's own.

With ARMD_PLAIN_NUMBA=1 (anything but empty) it uses only documented functions, without a cache.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import numba

from armd.compiled.library import hash_sources, is_usable, locate_cache

FOLDER = locate_cache() / hash_sources()
PLAIN = bool(os.environ.get("ARMD_PLAIN_NUMBA"))
_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}

if PLAIN:
    _cached = False
else:
    from armd.compiled import numba_inside

    numba_inside.keep_cache_in(FOLDER)
    _cached = is_usable(FOLDER)


def keep_nothing() -> None:
    """Compile all functions from now on: cached ones cannot go into a library."""
    global _cached
    _cached = False


def make_dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    """Make numba's dispatcher of *function*, which compiles it at its first call."""
    if PLAIN:
        return numba.njit(**_OPTIONS, **options)(function)
    options = _OPTIONS | numba_inside.OPTIONS | options
    if options.get("forceinline"):
        options |= numba_inside.INLINED_OPTIONS
    if _cached:
        with suppress(RuntimeError):  # "cannot cache function": it has no source file
            dispatcher = numba.njit(cache=True, **options)(function)
            if numba_inside.is_cached_in(FOLDER, dispatcher):
                return numba_inside.compile_once(dispatcher)
    return numba_inside.compile_once(numba.njit(**options)(function))


def call_at_compiling(say: Callable[[], None]) -> None:
    """Call *say* once, before a function is compiled that is not in the cache."""
    if PLAIN:  # there is no cache then
        say()
    else:
        numba_inside.call_at_first_compilation(say)
