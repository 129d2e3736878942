"""Compiled functions: from the library made in advance, or else compiled by numba.

Numba is imported when it is first needed. Where the library has all functions, as for a daemon, it
is not imported: numba and its compiler take 140 MB and half a second.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable
from typing import Any, TypeVar, cast

from armd.compiled import library
from armd.errors import BadInput

#: The advice where a service may not compile.
FOR_NUMBA = (
    "that it may, as this function is not in the library of compiled ones: "
    "MemoryDenyWriteExecute=no in the unit, as deploy/compiles.conf says it"
)

F = TypeVar("F", bound=Callable[..., Any])

#: `library.describe_kind` of each argument.
Kinds = tuple[Hashable, ...]

#: All compiled functions.
FUNCTIONS: list[Compiled] = []


class Compiled:
    """A function that is called with few combinations of argument types, compiled for each.

    Each call checks the types of its arguments, because machine code does not. Arguments that are
    the same objects as in the last call need no check. Numba's attributes of the function are
    looked up in `by_numba`. Calls for every live sample check once, by `settled`.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.name = f"{function.__module__}.{function.__qualname__}"
        self._options = options
        #: by the types of arguments so far
        self.entries: dict[Kinds, Callable[..., Any]] = {}
        #: arguments, their types, and the function called: one value, as other threads may call
        self._last: tuple[tuple[Any, ...], Kinds, Callable[..., Any]] = (), (), self._first
        FUNCTIONS.append(self)

    def __call__(self, *args: Any) -> Any:
        last, kinds, entry = self._last
        if len(args) == len(last):
            for value, before, expected_kind in zip(args, last, kinds, strict=True):
                if value is not before and library.describe_kind(value) != expected_kind:
                    break
            else:
                self._last = args, kinds, entry
                return entry(*args)
        return self._first(*args)

    def _first(self, *args: Any) -> Any:
        """Make a call with other types than the last one; or one by numba, which checks itself."""
        kinds = tuple(map(library.describe_kind, args))
        entry = self._entry(kinds)
        if entry is not self.__dict__.get("by_numba"):
            self._last = args, kinds, entry
        return entry(*args)

    def settled(self, *args: Any) -> Callable[..., Any]:
        """Return the function for arguments of these types, for a caller that never uses others.

        It does not check its arguments: for a live sample, a check costs as much as some calls.
        """
        return self._entry(tuple(map(library.describe_kind, args)))

    def _entry(self, kinds: Kinds) -> Callable[..., Any]:
        if kinds not in self.entries:
            compiled_entry = library.find(self.name, kinds)
            self.entries[kinds] = self.by_numba if compiled_entry is None else compiled_entry
        return self.entries[kinds]

    @functools.cached_property
    def by_numba(self) -> Any:
        """Numba's dispatcher of the function, which compiles it for any types of arguments.

        Raises `ModuleNotFoundError` where numba is not installed, `BadInput` where no machine code
        may be written to memory.
        """
        try:
            from armd.compiled import compiler
        except PermissionError as error:  # llvmlite tries it at its import
            obstacle = "that no machine code may be written to memory (MemoryDenyWriteExecute)"
            raise BadInput("numba", self.name, obstacle, FOR_NUMBA) from error

        while _SAY:
            compiler.call_at_compiling(_SAY.pop())
        return compiler.make_dispatcher(self.__wrapped__, self._options)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # Python asks every object for these
            raise AttributeError(name)
        return getattr(self.by_numba, name)


#: Functions for `compiler.call_at_compiling`, once there is a compiler.
_SAY: list[Callable[[], None]] = []


def call_at_compiling(say: Callable[[], None]) -> None:
    """Call *say* once, before a function is compiled that is not in the cache."""
    _SAY.append(say)


def jit(function: F) -> F:
    """Compile *function* at its first call; its type stays visible to the type checker.

    Division by zero gives infinity as in numpy, and a·b+c may become one fused operation.
    """
    return cast(F, Compiled(function, {}))


def select_compiled(function: Callable[..., Any], *args: Any) -> Callable[..., Any]:
    """Return `Compiled.settled` of a function under `jit`, whose type hides that method."""
    return cast(Compiled, function).settled(*args)


def unlocked(function: F) -> F:
    """Compile like `jit`, for work on many rows: other threads may run Python meanwhile."""
    return cast(F, Compiled(function, {"nogil": True}))


def inlined(function: F) -> F:
    """Compile like `jit`, for an inner loop: LLVM inlines it in the compiled functions that call
    it.

    A call passes each array as seven words, which takes as long as a loop over 64 samples.
    """
    return cast(F, Compiled(function, {"forceinline": True}))
