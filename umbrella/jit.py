"""Numba as armd uses it: compiled once, cached in a folder of armd's own."""

from __future__ import annotations

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


# Numba's default is __pycache__ beside the source, which a service may not write to.
numba.config.CACHE_DIR = str(cache_folder())


def jit(function: F) -> F:
    """Compile *function* at its first call; its type stays visible to the type checker.

    Division by zero gives infinity as in numpy, and a·b+c may become one fused operation.
    """
    compiled = numba.njit(cache=True, error_model="numpy", fastmath={"contract"})(function)
    return cast(F, compiled)
