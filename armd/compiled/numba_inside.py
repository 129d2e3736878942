"""All that touches numba's inside, and nothing else of armd does: four patches, its events, its
level of optimisation, its ahead-of-time compiler.

Numba may change any of it without notice, so pyproject.toml has an upper bound for its version, and
tests/package/test_numba_inside.py says of each what changed. With ARMD_PLAIN_NUMBA=1 (anything but
empty) nothing here is used: functions are compiled by `numba.njit` in every process, and kept
nowhere. A library of compiled functions that was made before is still loaded: it needs no numba.
"""

from __future__ import annotations

import hashlib
import pickle
import tempfile
import warnings
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Protocol

import numba
import numpy as np
from numba import types
from numba.core.caching import FunctionCache
from numba.core.event import Event, Listener, register
from numba.core.types import Record
from numba.core.types.misc import unliteral

from armd.compiled import library
from armd.errors import BadInput

#: Nobody calls by C's convention: what would make it possible is not compiled.
OPTIONS: dict[str, Any] = {"no_cfunc_wrapper": True}
#: As `OPTIONS`, for what compiled functions alone call.
INLINED_OPTIONS: dict[str, Any] = {"no_cpython_wrapper": True}

_SCALARS = {"b1": types.boolean, "i8": types.int64, "f8": types.float64}


def keep_cache_in(folder: Path) -> None:
    """Make numba cache in *folder*: an unreadable file costs a compilation, and no more; records of
    different layouts have different names.

    Numba's default is `__pycache__` beside the source, which a service may not write to, and where
    what a called function was compiled to may be out of date.
    """
    numba.config.CACHE_DIR = str(folder)
    FunctionCache._guard_against_spurious_io_errors = _forgive
    # Numba names a record by a number that it counts up in each process. The cache holds functions
    # of many processes, where arms of other joint counts had the same number: one arm's samples
    # were then read by another's layout.
    type.__setattr__(Record, "mangling_args", property(_name_by_layout))


@contextmanager
def _forgive(_: FunctionCache) -> Iterator[None]:
    with suppress(OSError, EOFError, pickle.PickleError, ValueError, KeyError):
        yield


def _name_by_layout(record: Record) -> tuple[str, tuple[str, ...]]:
    return "Record", (hashlib.sha256(record.name.encode()).hexdigest(),)


def is_cached_in(folder: Path, dispatcher: Any) -> bool:
    """Whether numba keeps this function's code below *folder*."""
    return folder in Path(dispatcher.stats.cache_path).parents


def compile_once(dispatcher: Any) -> Any:
    """*dispatcher*, compiled once for all constants that compiled functions call it with.

    Numba would compile it anew for each of them. LLVM sees them too where it writes the function
    out, and that is where it matters.
    """
    template = dispatcher.get_call_template

    def widened(args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        named = {name: unliteral(kind) for name, kind in kws.items()}
        return template(tuple(unliteral(kind) for kind in args), named)

    dispatcher.get_call_template = widened
    return dispatcher


def call_at_first_compilation(say: Callable[[], None]) -> None:
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


@contextmanager
def skip_optimisation() -> Iterator[None]:
    """Within this `with`, functions are compiled in less time, for one call that says what their
    results are: `write_library` optimises all of them again, as a whole.

    Before anything else is compiled in this process: numba chooses how it writes machine code once.
    """
    level = numba.config.OPT
    numba.config.OPT = type(level)(0)
    try:
        yield
    finally:
        numba.config.OPT = level


def can_link() -> bool:
    """Whether a library can be made here: a compiler for C and C++ that also links, setuptools."""
    try:
        with _without_deprecation():
            from numba.pycc.platform import external_compiler_works
    except ImportError:  # setuptools, or a numba that has it no more
        return False
    return bool(external_compiler_works())


class Exportable(Protocol):
    """A function, what was called by the kinds of its arguments so far, and numba's dispatcher."""

    name: str
    entries: dict[tuple[Hashable, ...], Callable[..., Any]]

    @property
    def by_numba(self) -> Any: ...


def write_library(path: Path, functions: Sequence[Exportable]) -> None:
    """Write *functions*, for all kinds of arguments they were called with so far, to *path*.

    For any processor of this kind: what is delivered to another is the same, and so are results.
    Raises `BadInput` where it cannot be compiled or linked.
    """
    with _without_deprecation():
        from numba.pycc import CC
    from setuptools.errors import CCompilerError

    if not any(function.entries for function in functions):
        return  # one without functions would only be in the way of another
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        compiler = CC(path.name.partition(".")[0], source_module=__name__)
        compiler.output_dir, compiler.output_file = folder, path.name
        for function in functions:
            for kinds in function.entries:
                arguments = tuple(map(_numba_type, kinds))
                dispatcher = function.by_numba
                returned = dispatcher.overloads[arguments].signature.return_type
                forwarder = _forwarder(dispatcher, len(kinds))
                forwarder.releases = dispatcher.targetoptions.get("nogil", False)
                symbol = library.name_symbol(function.name, kinds)
                compiler.export(symbol, returned(*arguments))(forwarder)
        try:
            with _released():
                compiler.compile()
        except CCompilerError as error:  # Python's headers, a package of their own in Debian
            expected = "a compiler for C and C++, and Python's headers"
            raise BadInput(path, "library of compiled functions", str(error), expected) from error
        (Path(folder) / path.name).replace(path)  # whole, or not at all


@contextmanager
def _released() -> Iterator[None]:
    """Within this `with`, what is exported lets other threads run Python meanwhile if it has
    `releases`: numba's ahead-of-time compiler does that for no function."""
    with _without_deprecation():
        from numba.pycc import compiler
    compile_extra = compiler.compile_extra

    def compile_released(typing: Any, target: Any, function: Any, *rest: Any, **named: Any) -> Any:
        arguments, returned, flags = rest
        if function.releases:
            flags = flags.copy()
            flags.release_gil = True
        return compile_extra(typing, target, function, arguments, returned, flags, **named)

    compiler.compile_extra = compile_released
    try:
        yield
    finally:
        compiler.compile_extra = compile_extra


@contextmanager
def _without_deprecation() -> Iterator[None]:
    """Nothing replaces `numba.pycc` yet."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", numba.NumbaPendingDeprecationWarning)
        yield


def _forwarder(dispatcher: Any, n: int) -> Any:
    """A function of *n* arguments that calls it: the options it was compiled with stay its own."""
    names = ", ".join(f"a{i}" for i in range(n))
    return eval(f"lambda {names}: function({names})", {"function": dispatcher})


def _numba_type(kind: Hashable) -> Any:
    """Numba's type of what has this `library.describe_kind`."""
    match kind:
        case (np.dtype() as dtype, int(ndim), int(flags)):
            layout, aligned, readonly = (
                "C" if flags & 0x1 else "A",
                flags & 0x100,
                not flags & 0x400,
            )
            return types.Array(
                numba.from_dtype(dtype), ndim, layout, readonly, aligned=bool(aligned)
            )
        case (type() as made, tuple(kinds)):
            return types.NamedTuple(tuple(map(_numba_type, kinds)), made)
        case _:
            return _SCALARS[str(kind)]
