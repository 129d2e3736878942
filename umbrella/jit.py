"""Numba as armd uses it: compiled once, cached in a folder of armd's own."""

from __future__ import annotations

import hashlib
import os
import pickle
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import platformdirs
from numba.core.caching import FunctionCache

F = TypeVar("F", bound=Callable[..., Any])


def cache_folder() -> Path:
    """NUMBA_CACHE_DIR if set, else systemd's CACHE_DIRECTORY, else the user's cache folder."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen).absolute()
    if chosen := os.environ.get("CACHE_DIRECTORY"):
        return Path(chosen.split(":")[0]) / "numba"  # systemd lists several with colons
    return Path(platformdirs.user_cache_dir("armd")) / "numba"


def _sources() -> str:
    """What tells one state of the kernel's sources from another.

    Numba compiles a function anew when its own file has changed, not when a function it calls has
    changed in another file: so every state of them all has a folder of its own.
    """
    digest = hashlib.sha256()
    rooms = Path(__file__).parent
    for room in ("drivers", "compensation", "daemon"):
        for file in sorted((rooms / room).rglob("*.py")):
            source = file.read_bytes()
            if b"@jit" in source or b"@inlined" in source:
                digest.update(source)
    return digest.hexdigest()[:12]


def _usable(folder: Path) -> bool:
    """Whether the cache can be kept there; a user without a home has a path that begins with ~."""
    if not folder.is_absolute():
        return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(4096))
    except OSError:
        return False
    return True


@contextmanager
def _forgiving(_: FunctionCache) -> Iterator[None]:
    """A cache that cannot be read or written costs the time to compile, and nothing else."""
    with suppress(OSError, EOFError, pickle.PickleError, ValueError, KeyError):
        yield


# Numba's default is __pycache__ beside the source, which a service may not write to, and where
# what a called function was compiled to may be out of date.
FOLDER = cache_folder() / _sources()
numba.config.CACHE_DIR = str(FOLDER)
FunctionCache._guard_against_spurious_io_errors = _forgiving

_OPTIONS: dict[str, Any] = {"error_model": "numpy", "fastmath": {"contract"}}
_CACHED = _usable(FOLDER)


def _compiled(function: F, **options: Any) -> F:
    if _CACHED:
        with suppress(RuntimeError):  # "cannot cache function": it has no source file
            compiled = numba.njit(cache=True, **_OPTIONS, **options)(function)
            if FOLDER in Path(compiled.stats.cache_path).parents:
                return cast(F, compiled)
    return cast(F, numba.njit(**_OPTIONS, **options)(function))


def jit(function: F) -> F:
    """Compile *function* at its first call; its type stays visible to the type checker.

    Division by zero gives infinity as in numpy, and a·b+c may become one fused operation.
    """
    return _compiled(function)


def inlined(function: F) -> F:
    """Like `jit`, for an inner loop: LLVM writes it out wherever it is called.

    A call passes each array as seven words, which takes as long as a loop over 64 samples does.
    """
    return _compiled(function, forceinline=True)
