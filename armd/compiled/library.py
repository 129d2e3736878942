"""The library of functions compiled ahead: machine code that needs no compiler to be loaded.

`armd.compiled.ahead` makes it, of every function that a daemon calls, for the kinds of arguments
that it calls them with. A function is found in it by its name and these kinds; where it is not,
numba compiles it (`armd.compiled.jit`).
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

#: Of numpy's flags of an array: contiguous in C's order (0x1), aligned (0x100), writeable (0x400).
LAYOUT = 0x501
#: Of a library, two that can be made beside each other: for live points, and for sessions.
PARTS = ("live", "sessions")
#: Scalars by what they become in a compiled function.
_SCALARS: dict[type, str] = {
    bool: "b1", np.bool: "b1", int: "i8", np.int64: "i8", float: "f8", np.float64: "f8",
}  # fmt: skip


def locate_cache() -> Path:
    """NUMBA_CACHE_DIR if set, else systemd's CACHE_DIRECTORY, else the user's cache folder."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        return Path(chosen).absolute()
    if chosen := os.environ.get("CACHE_DIRECTORY"):
        return Path(chosen.split(":")[0]) / "numba"  # systemd lists several with colons
    return Path(platformdirs.user_cache_dir("armd")) / "numba"


def locate_environment() -> Path | None:
    """Of this virtual environment: what lies there goes with the installation, whatever becomes of
    a cache. None outside of one."""
    return Path(sys.prefix) / "share" / "armd" if sys.prefix != sys.base_prefix else None


def is_usable(folder: Path) -> bool:
    """Whether files can be kept there; a user without a home has a path that begins with ~."""
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
    """What tells one state of the compiled functions' sources from another.

    Numba compiles a function anew when its own file has changed, not when a function it calls has
    changed in another file, or a constant: so every state of them all has a folder, and a library,
    of its own. Constants stand beside what is compiled, or in armd's own folder. Which calls a
    library is made for, `ahead` and `rehearsal` say.
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
    """The library's, for this state of the sources and this Python; or that of one of `PARTS`."""
    part = part and f"_{part}"
    return f"kernel_{hash_sources()}{part}{sysconfig.get_config_var('EXT_SUFFIX')}"


def list_places() -> tuple[Path, ...]:
    """Where the library or its parts may lie: delivered with armd, or made here."""
    folders = (Path(__file__).parents[1], *list_written_places())
    return tuple(folder / name_file(part) for folder in folders for part in ("", *PARTS))


def list_written_places() -> tuple[Path, ...]:
    """Where a library is kept that is made here: the first of them that can be written to."""
    environment = locate_environment()
    return (locate_cache(),) if environment is None else (environment, locate_cache())


def disable_library() -> None:
    """From here on nothing is found in a library: for one to be made."""
    global _without
    _without = True


#: With ARMD_WITHOUT_LIBRARY=1 (anything but empty) numba compiles all that is called: for tests,
#: and for one who suspects the library.
_without = bool(os.environ.get("ARMD_WITHOUT_LIBRARY"))


@functools.cache
def load_libraries() -> tuple[ModuleType, ...]:
    """The library, or its parts; none where there is none that this machine can load."""
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
    """The function *name* (module.function) for arguments so; None where no library has it."""
    as_exported = name_symbol(name, kinds)
    found_in = (library for library in load_libraries() if hasattr(library, as_exported))
    return next((getattr(library, as_exported) for library in found_in), None)


def describe_kind(value: Any) -> Hashable:
    """What a compiled function needs to know of an argument beforehand."""
    if type(value) is np.ndarray:
        return value.dtype, value.ndim, value.flags.num & LAYOUT
    if isinstance(value, tuple):
        return type(value), tuple(map(describe_kind, value))
    value_type: type = type(value)
    return _SCALARS.get(value_type, value_type)


def name_symbol(name: str, kinds: Hashable) -> str:
    """Under which the library has the function *name* (module.function) for arguments so."""
    digest = hashlib.sha256(_written(kinds).encode()).hexdigest()[:12]
    return f"{name.replace('.', '_')}_{digest}"


def _written(kinds: Hashable) -> str:
    """The same in every run of every numpy."""
    match kinds:
        case tuple():
            return f"({', '.join(map(_written, kinds))})"
        case np.dtype():
            return f"{kinds.str} {kinds.descr} {kinds.shape}"
        case type():
            return kinds.__name__
        case _:
            return str(kinds)
