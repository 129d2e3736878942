"""The library of functions compiled in advance: machine code that needs no compiler.

`armd.compiled.ahead` makes it, with every function that a daemon calls, for the types of its
arguments. A function is found by its name and these types. If it is missing, numba compiles it
(`armd.compiled.jit`).
"""

from __future__ import annotations

import functools
import hashlib
import os
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Hashable
from importlib.machinery import ExtensionFileLoader
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import platformdirs

#: Bits of numpy's flags of an array: C-contiguous (0x1), aligned (0x100), writeable (0x400).
LAYOUT = 0x501
#: The parts of a library that can be made in parallel: for live points, and for sessions.
PARTS = ("live", "sessions")
#: Python's and numpy's scalars, and their types in a compiled function.
_SCALARS: dict[type, str] = {
    bool: "b1", np.bool: "b1", int: "i8", np.int64: "i8", float: "f8", np.float64: "f8",
}  # fmt: skip


def locate_cache() -> Path:
    """Return NUMBA_CACHE_DIR if set, else systemd's CACHE_DIRECTORY, else the user's folder."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen).absolute()
    if chosen := os.environ.get("CACHE_DIRECTORY"):
        return Path(chosen.split(":")[0]) / "numba"  # systemd lists several with colons
    return Path(platformdirs.user_cache_dir("armd")) / "numba"


def locate_environment() -> Path | None:
    """Return the folder in this virtual environment; None outside of one.

    Files there belong to the installation, and stay if a cache is emptied.
    """
    return Path(sys.prefix) / "share" / "armd" if sys.prefix != sys.base_prefix else None


def is_usable(folder: Path) -> bool:
    """Return whether files can be kept there; without a home, a path begins with ~."""
    if not folder.is_absolute():
        return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder) as probe:
            probe.write(bytes(4096))
    except OSError:
        return False
    return True


@functools.cache
def hash_sources() -> str:
    """Hash the sources of the compiled functions.

    Numba compiles a function again when its own file has changed, but not when a called function in
    another file, or a constant, has changed. So every state of all sources has its own folder and
    library. Constants are in the files of compiled functions, or in armd's own folder. `ahead` and
    `rehearsal` define the calls for which a library is made.
    """
    rooms = Path(__file__).parents[1]
    deciding = ("compiler.py", "numba_inside.py", "ahead.py", "rehearsal.py")
    files = {Path(__file__).with_name(name) for name in deciding} | set(rooms.glob("*.py"))
    for room in ("drivers", "compensation", "daemon"):
        for file in (rooms / room).rglob("*.py"):
            source = file.read_bytes()
            if b"@jit" in source or b"@inlined" in source or b"@unlocked" in source:
                files |= {file} if file.parent == rooms / room else set(file.parent.glob("*.py"))
    digest = hashlib.sha256()
    for file in sorted(files):
        digest.update(file.read_bytes())
    return digest.hexdigest()[:12]


def name_file(part: str = "") -> str:
    """Name the library of these sources and this Python; or that of one of `PARTS`."""
    part = part and f"_{part}"
    return f"kernel_{hash_sources()}{part}{sysconfig.get_config_var('EXT_SUFFIX')}"


def list_places() -> tuple[Path, ...]:
    """List where the library or its parts may be: delivered with armd, or made here."""
    folders = (Path(__file__).parents[1], *list_written_places())
    return tuple(folder / name_file(part) for folder in folders for part in ("", *PARTS))


def list_written_places() -> tuple[Path, ...]:
    """List where a library may be written; the first writable folder gets it."""
    environment = locate_environment()
    return (locate_cache(),) if environment is None else (environment, locate_cache())


def disable_library() -> None:
    """Find nothing in a library from now on, because one is being made."""
    global _without
    _without = True


#: With ARMD_WITHOUT_LIBRARY=1 (anything but empty) numba compiles all called functions: for tests,
#: and to exclude the library as a cause of errors.
_without = bool(os.environ.get("ARMD_WITHOUT_LIBRARY"))


@functools.cache
def load_libraries() -> tuple[ModuleType, ...]:
    """Load the library, or its parts; none where this machine can load none."""
    parts: list[ModuleType] = []
    for path in list_places():
        if _without or not path.exists():
            continue
        try:
            name = path.name.partition(".")[0]
            spec = spec_from_file_location(name, path, loader=ExtensionFileLoader(name, str(path)))
            assert spec is not None and spec.loader is not None
            library = module_from_spec(spec)
            spec.loader.exec_module(library)
        except (ImportError, OSError):
            continue
        if path.name == name_file():
            return (library,)
        parts.append(library)
    return tuple(parts)


def find(name: str, kinds: Hashable) -> Callable[..., Any] | None:
    """Find the function *name* (module.function) for these argument types; None if missing."""
    as_exported = name_symbol(name, kinds)
    found_in = (library for library in load_libraries() if hasattr(library, as_exported))
    return next((getattr(library, as_exported) for library in found_in), None)


def describe_kind(value: Any) -> Hashable:
    """Return the type of an argument, as far as a compiled function depends on it."""
    if type(value) is np.ndarray:
        return value.dtype, value.ndim, value.flags.num & LAYOUT
    if isinstance(value, tuple):
        return type(value), tuple(map(describe_kind, value))
    value_type: type = type(value)
    return _SCALARS.get(value_type, value_type)


def name_symbol(name: str, kinds: Hashable) -> str:
    """Name the library's symbol of the function *name* (module.function) for these types."""
    digest = hashlib.sha256(_written(kinds).encode()).hexdigest()[:12]
    return f"{name.replace('.', '_')}_{digest}"


def _written(kinds: Hashable) -> str:
    """Write the types as text that is the same in every run and every numpy."""
    match kinds:
        case tuple():
            return f"({', '.join(map(_written, kinds))})"
        case np.dtype():
            return f"{kinds.str} {kinds.descr} {kinds.shape}"
        case type():
            return kinds.__name__
        case _:
            return str(kinds)
