"""Compiled functions: from the library that was made ahead; where it has none, by numba.

Numba is imported when it is first needed. Where the library has everything, as for a daemon, it is
not: numba and its compiler take 140 MB and half a second.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Hashable
from typing import Any, TypeVar, cast

from armd.compiled import library
from armd.errors import BadInput

#: What to do where a service may not compile.
FOR_NUMBA = (
    "that it may, as this function is not in the library of compiled ones: "
    "MemoryDenyWriteExecute=no in the unit, as deploy/compiles.conf says it"
)

F = TypeVar("F", bound=Callable[..., Any])

#: `library.describe_kind` of each argument.
Kinds = tuple[Hashable, ...]

#: All there are.
FUNCTIONS: list[Compiled] = []


class Compiled:
    """A function that is called with arguments of few kinds, compiled for each of them.

    Each call looks at the kinds of its arguments: machine code would take others for what it
    expects. Of those that are the last call's own, which most are, they are known. Numba's
    attributes of the function are looked up in `by_numba`. What is called for every live sample
    asks once, by `settled`.
    """

    def __init__(self, function: Callable[..., Any], options: dict[str, Any]) -> None:
        functools.update_wrapper(self, function)
        self.name = f"{function.__module__}.{function.__qualname__}"
        self._options = options
        #: by the kinds of arguments that there were so far
        self.entries: dict[Kinds, Callable[..., Any]] = {}
        #: arguments, their kinds, and what was called: one value, for calls from other threads
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
        """A call that differs from the last in kind; or one by numba, which looks by itself."""
        kinds = tuple(map(library.describe_kind, args))
        entry = self._entry(kinds)
        if entry is not self.__dict__.get("by_numba"):
            self._last = args, kinds, entry
        return entry(*args)

    def settled(self, *args: Any) -> Callable[..., Any]:
        """What calls with arguments of these kinds call; for one who never calls it with others.

        Nobody looks at its arguments: that costs a live sample as much as some of what is called.
        """
        return self._entry(tuple(map(library.describe_kind, args)))

    def _entry(self, kinds: Kinds) -> Callable[..., Any]:
        if kinds not in self.entries:
            compiled_entry = library.find(self.name, kinds)
            self.entries[kinds] = self.by_numba if compiled_entry is None else compiled_entry
        return self.entries[kinds]

    @functools.cached_property
    def by_numba(self) -> Any:
        """What numba makes of it, which compiles it for any kind of arguments.

        Raises `ModuleNotFoundError` where numba is not installed, `BadInput` where no machine code
        may be written to memory.
        """
        try:
            from armd.compiled import compiler
        except PermissionError as error:  # of llvmlite, which tries it when it is imported
            obstacle = "that no machine code may be written to memory (MemoryDenyWriteExecute)"
            raise BadInput("numba", self.name, obstacle, FOR_NUMBA) from error

        while _SAY:
            compiler.call_at_compiling(_SAY.pop())
        return compiler.make_dispatcher(self.__wrapped__, self._options)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # which Python asks for of any object
            raise AttributeError(name)
        return getattr(self.by_numba, name)


#: What `compiler.call_at_compiling` is to call, once there is a compiler.
_SAY: list[Callable[[], None]] = []


def call_at_compiling(say: Callable[[], None]) -> None:
    """Call *say* once, where a function is about to be compiled and not taken from the cache."""
    _SAY.append(say)


def jit(function: F) -> F:
    """Compile *function* at its first call; its type stays visible to the type checker.

    Division by zero gives infinity as in numpy, and a·b+c may become one fused operation.
    """
    return cast(F, Compiled(function, {}))


def select_compiled(function: Callable[..., Any], *args: Any) -> Callable[..., Any]:
    """`Compiled.settled` of a function under `jit`, whose type hides what it is."""
    return cast(Compiled, function).settled(*args)


def unlocked(function: F) -> F:
    """Like `jit`, for work on many rows: meanwhile other threads may run Python."""
    return cast(F, Compiled(function, {"nogil": True}))


def inlined(function: F) -> F:
    """Like `jit`, for an inner loop: LLVM writes it out wherever it is called, which compiled
    functions alone can do.

    A call passes each array as seven words, which takes as long as a loop over 64 samples does.
    """
    return cast(F, Compiled(function, {"forceinline": True}))
