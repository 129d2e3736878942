"""A library of what was compiled in this process, linked by numba's ahead-of-time compiler."""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Hashable
from pathlib import Path
from typing import Any

import numba
import numpy as np
from numba import types

from armd.compiled import library
from armd.compiled.jit import FUNCTIONS
from armd.errors import BadInput

with warnings.catch_warnings():
    warnings.simplefilter("ignore", numba.NumbaPendingDeprecationWarning)  # nothing replaces it yet
    from numba.pycc import CC
    from numba.pycc.platform import external_compiler_works
    from setuptools.errors import CCompilerError

_SCALARS = {"b1": types.boolean, "i8": types.int64, "f8": types.float64}


def can_link() -> bool:
    """Whether there is a compiler for C and C++, which also links."""
    return bool(external_compiler_works())


def export(path: Path) -> None:
    """Every function, for all kinds of arguments it was called with so far, as *path*.

    For any processor of this kind: what is delivered to another is the same, and so are results.
    Raises `BadInput` where it cannot be compiled or linked.
    """
    if not any(function.entries for function in FUNCTIONS):
        return  # one without functions would only be in the way of another
    with tempfile.TemporaryDirectory(dir=path.parent) as folder:
        compiler = CC(path.name.partition(".")[0], source_module="armd.compiled.link")
        compiler.output_dir, compiler.output_file = folder, path.name
        for function in FUNCTIONS:
            for kinds in function.entries:
                arguments = tuple(map(_numba_type, kinds))
                dispatcher = function.by_numba
                returned = dispatcher.overloads[arguments].signature.return_type
                symbol = library.symbol(function.name, kinds)
                compiler.export(symbol, returned(*arguments))(_forwarder(dispatcher, len(kinds)))
        try:
            compiler.compile()
        except CCompilerError as error:  # Python's headers, a package of their own in Debian
            expected = "a compiler for C and C++, and Python's headers"
            raise BadInput(path, "library of compiled functions", str(error), expected) from error
        (Path(folder) / path.name).replace(path)  # whole, or not at all


def _forwarder(dispatcher: Any, n: int) -> Any:
    """A function of *n* arguments that calls it: the options it was compiled with stay its own."""
    names = ", ".join(f"a{i}" for i in range(n))
    return eval(f"lambda {names}: function({names})", {"function": dispatcher})


def _numba_type(kind: Hashable) -> Any:
    """Numba's type of what has this `library.kind`."""
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
