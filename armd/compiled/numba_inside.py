"""All uses of numba's internals: patches, events, optimisation level, ahead-of-time compiler.

There are four patches. Numba may change any of it without notice, so pyproject.toml has an upper
bound for its version, and tests/package/test_numba_inside.py reports each change. With
ARMD_PLAIN_NUMBA=1 (anything but empty) nothing here is used: `numba.njit` compiles functions in
every process, and nothing is kept. A library of compiled functions that was made before is still
loaded: it needs no numba.
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

#: No function is called from C, so no wrapper for it is compiled.
OPTIONS: dict[str, Any] = {"no_cfunc_wrapper": True}
#: Further options of functions that only compiled functions call.
INLINED_OPTIONS: dict[str, Any] = {"no_cpython_wrapper": True}

_SCALARS = {"b1": types.boolean, "i8": types.int64, "f8": types.float64}


def keep_cache_in(folder: Path) -> None:
    """Make numba cache in *folder*, and name records of different layouts differently.

    An unreadable file costs a compilation, and no more. Numba's default is `__pycache__` beside the
    source. A service may not write to it, and the code of called functions in it may be out of
    date.
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
    """Return whether numba keeps this function's code below *folder*."""
    return folder in Path(dispatcher.stats.cache_path).parents


def compile_once(dispatcher: Any) -> Any:
    """Return *dispatcher*, changed so that constants as arguments do not compile it again.

    Numba would compile it for each constant. LLVM still knows the constants where it inlines the
    function, and only there they matter.
    """
    template = dispatcher.get_call_template

    def widened(args: tuple[Any, ...], kws: dict[str, Any]) -> Any:
        named = {name: unliteral(kind) for name, kind in kws.items()}
        return template(tuple(unliteral(kind) for kind in args), named)

    dispatcher.get_call_template = widened
    return dispatcher


def call_at_first_compilation(say: Callable[[], None]) -> None:
    """Call *say* once, before a function is compiled that is not in the cache."""
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
    """Compile functions in less time within this `with`, for one call of each.

    The call determines the types of their results; `write_library` then optimises all of them
    together. It must come before any other compilation in this process, because numba chooses only
    once how to write machine code.
    """
    level = numba.config.OPT
    numba.config.OPT = type(level)(0)
    try:
        yield
    finally:
        numba.config.OPT = level


def can_link() -> bool:
    """Return whether a library can be made here: needs a C and C++ compiler, and setuptools."""
    try:
        with _without_deprecation():
            from numba.pycc.platform import external_compiler_works
    except ImportError:  # setuptools is missing, or numba no longer has it
        return False
    return bool(external_compiler_works())


class Exportable(Protocol):
    """A function, its calls by argument types so far, and numba's dispatcher."""

    name: str
    entries: dict[tuple[Hashable, ...], Callable[..., Any]]

    @property
    def by_numba(self) -> Any: ...


def write_library(path: Path, functions: Sequence[Exportable]) -> None:
    """Write *functions*, for all argument types they were called with so far, to *path*.

    The code is for any processor of this kind: it and its results are the same on each. Raises
    `BadInput` where it cannot be compiled or linked.
    """
    with _without_deprecation():
        from numba.pycc import CC
    from setuptools.errors import CCompilerError

    if not any(function.entries for function in functions):
        return  # an empty library would hide another one
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
        except CCompilerError as error:  # e.g. Python's headers, which Debian packages separately
            expected = "a compiler for C and C++, and Python's headers"
            raise BadInput(path, "library of compiled functions", str(error), expected) from error
        (Path(folder) / path.name).replace(path)  # complete, or not at all


@contextmanager
def _released() -> Iterator[None]:
    """Let exported functions with `releases` run beside Python threads, within this `with`.

    Numba's ahead-of-time compiler does that for no function.
    """
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
    """Ignore the deprecation of `numba.pycc`, which nothing replaces yet."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", numba.NumbaPendingDeprecationWarning)
        yield


def _forwarder(dispatcher: Any, n: int) -> Any:
    """Make a function of *n* arguments that calls *dispatcher*, which keeps its own options."""
    names = ", ".join(f"a{i}" for i in range(n))
    return eval(f"lambda {names}: function({names})", {"function": dispatcher})


def _numba_type(kind: Hashable) -> Any:
    """Return numba's type of a value with this `library.describe_kind`."""
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
