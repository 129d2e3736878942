"""Numba as armd uses it: compiled once, cached in a folder of armd's own."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import platformdirs

F = TypeVar("F", bound=Callable[..., Any])


def cache_folder() -> Path:
    """NUMBA_CACHE_DIR if set, else systemd's CACHE_DIRECTORY, else the user's cache folder."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen)
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


# Numba's default is __pycache__ beside the source, which a service may not write to.
numba.config.CACHE_DIR = str(cache_folder() / _sources())


_OPTIONS: dict[str, Any] = {"cache": True, "error_model": "numpy", "fastmath": {"contract"}}


def jit(function: F) -> F:
    """Compile *function* at its first call; its type stays visible to the type checker.

    Division by zero gives infinity as in numpy, and a·b+c may become one fused operation.
    """
    return cast(F, numba.njit(**_OPTIONS)(function))


def inlined(function: F) -> F:
    """Like `jit`, for an inner loop: LLVM writes it out wherever it is called.

    A call passes each array as seven words, which takes as long as a loop over 64 samples does.
    """
    return cast(F, numba.njit(forceinline=True, **_OPTIONS)(function))
