"""What armd changes in numba's inside still acts, each by what it is for; a failure says what
changed in numba. Then ARMD_PLAIN_NUMBA=1, which goes without any of it."""

from __future__ import annotations

import ast
import inspect
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from numba.core import itanium_mangler
from numba.core.caching import FunctionCache
from numba.core.types import Record

import armd
from armd.compiled import compiler

VERSION = f"numba {numba.__version__}"
pytestmark = pytest.mark.skipif(compiler.PLAIN, reason="nothing of numba's inside is used")


def test_an_unreadable_cache_is_forgiven() -> None:
    """`FunctionCache._guard_against_spurious_io_errors` surrounds loading and saving."""

    class Unreadable(FunctionCache):
        def __init__(self) -> None:
            pass

        def _load_overload(self, *_: object) -> None:
            raise EOFError

        def _save_overload(self, *_: object) -> None:
            raise OSError(28, "no space left on device")

    class Context:
        def refresh(self) -> None:
            pass

    changed = (
        f"{VERSION}: FunctionCache no longer loads and saves inside "
        "_guard_against_spurious_io_errors: a damaged cache or a full disk would stop armd"
    )
    try:
        loaded = Unreadable().load_overload(None, Context())
        Unreadable().save_overload(None, None)
    except (OSError, EOFError) as error:
        pytest.fail(f"{changed} ({error!r})")
    assert loaded is None, changed


def test_records_are_named_by_their_layout() -> None:
    """`Record.mangling_args` goes into the name of a machine function."""
    three, six = (numba.from_dtype(np.dtype([("count", "i8", (n,))])) for n in (3, 6))
    assert isinstance(three, Record) and isinstance(six, Record)
    names = [itanium_mangler.mangle("f", [record]) for record in (three, six)]
    changed = (
        f"{VERSION}: the name of a machine function does not come from Record.mangling_args: in a "
        "shared cache one arm's samples could be read by another arm's layout"
    )
    for name, record in zip(names, (three, six), strict=True):
        assert record.mangling_args[1][0] in name, changed
    assert names[0] != names[1], changed


def test_constants_compile_a_called_function_once() -> None:
    """`Dispatcher.get_call_template` is asked for the types of a call."""
    inner = compiler.make_dispatcher(lambda x: x + 1, {})

    def outer(x: int) -> int:
        return int(inner(1) + inner(2) + inner(x))

    called = compiler.make_dispatcher(outer, {})
    assert called(3) == 9
    assert len(inner.nopython_signatures) == 1, (
        f"{VERSION}: Dispatcher.get_call_template no longer decides what a called function is "
        f"compiled for ({len(inner.nopython_signatures)} signatures): each constant compiles anew"
    )


def test_a_compilation_is_an_event(monkeypatch: pytest.MonkeyPatch) -> None:
    """`numba.core.event` has one named "numba:compile". From the cache of a run before, none is."""
    monkeypatch.setattr(compiler, "_cached", False)
    said: list[str] = []
    compiler.call_at_compiling(lambda: said.append("compiling"))
    compiler.make_dispatcher(lambda x: x + 2, {})(1)
    assert said == ["compiling"], (
        f'{VERSION}: no event "numba:compile" at a compilation: nobody is told why it takes long'
    )


def test_the_ahead_of_time_compiler_is_there() -> None:
    """`numba.pycc`, deprecated, makes the library of compiled functions."""
    try:
        with pytest.warns(numba.NumbaPendingDeprecationWarning):
            for name in [name for name in sys.modules if name.startswith("numba.pycc")]:
                del sys.modules[name]
            from numba.pycc import CC
    except ImportError as error:
        pytest.fail(f"{VERSION}: numba.pycc is gone ({error}): no library can be made")
    missing = {"export", "compile", "output_dir", "output_file"} - set(dir(CC))
    assert not missing, f"{VERSION}: numba.pycc.CC has no {missing}: no library can be made"


def test_what_is_exported_releases_the_lock_if_it_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    from numba.core.compiler import Flags

    from armd.compiled import numba_inside

    with numba_inside._without_deprecation():
        from numba.pycc import compiler as ahead
    assert ahead.compile_extra, f"{VERSION}: numba.pycc has no compile_extra"
    given: list[Flags] = []
    monkeypatch.setattr(ahead, "compile_extra", lambda *some, **_: given.append(some[5]))
    flags = Flags()
    with numba_inside._released():
        for releases in (True, False):
            function = type("Forwarder", (), {"releases": releases})
            ahead.compile_extra(None, None, function, (), None, flags, locals={})
    assert [each.release_gil for each in given] == [True, False], f"{VERSION}: other flags"


def test_what_is_to_be_exported_is_not_optimised_before() -> None:
    """`numba.config.OPT` is read at each compilation, and has its property `is_opt_max`."""
    from armd.compiled import numba_inside

    def sum_up(values):  # type: ignore[no-untyped-def]
        total = 0.0
        for value in values:
            total += value
        return total

    def compile_now() -> str:
        function = numba.njit(sum_up)
        function(np.ones(3))
        return str(function.inspect_llvm(function.signatures[0]))

    changed = f"{VERSION}: numba.config.OPT no longer decides how well a function is compiled"
    with numba_inside.skip_optimisation():
        plain = compile_now()
    optimised = compile_now()
    assert plain.count(" = alloca") > 5 > optimised.count(" = alloca"), changed


def test_the_options_are_numbas() -> None:
    from armd.compiled import numba_inside

    for options in (numba_inside.OPTIONS, numba_inside.INLINED_OPTIONS):
        try:
            numba.njit(**options)(lambda x: x)
        except (KeyError, TypeError) as error:
            pytest.fail(f"{VERSION}: njit takes no {options} any more ({error})")


def test_one_file_touches_numbas_inside() -> None:
    """Others import `numba` itself, and of it what its reference documents."""
    root = Path(armd.__file__).parents[1]
    rooms = ("armd", "compensation", "daemon", "drivers", "simulator")
    touching = set()
    for path in (path for room in rooms for path in (root / room).rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "numba" in text else ():
            names = [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            names += [each.name for each in node.names] if isinstance(node, ast.Import) else []
            if any(name.startswith("numba.") for name in names):
                touching.add(path.name)
    assert touching == {"numba_inside.py"}
    assert "numba_inside" in inspect.getsource(compiler)


PLAIN = """
import sys
import numpy as np
from armd.compiled.jit import jit, inlined, unlocked
from armd.compiled import ahead

@inlined
def half(x):
    return x / 2

@unlocked
def halves(x):
    return half(x[0]["value"]) + half(1.0)

record = np.zeros(2, [("value", "f8")])
record["value"] = 3.0
assert halves(record) == 2.0
assert not ahead.can_link()
print(*(name for name in sys.modules if name == "armd.compiled.numba_inside" or "pycc" in name))
"""


@pytest.mark.slow
def test_plain_numba_uses_none_of_it_and_keeps_nothing(tmp_path: Path) -> None:
    (tmp_path / "plain.py").write_text(PLAIN)
    environment = {"ARMD_PLAIN_NUMBA": "1", "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    done = subprocess.run(
        [sys.executable, tmp_path / "plain.py"],
        env=os.environ | environment, capture_output=True, text=True,
    )  # fmt: skip
    assert (done.returncode, done.stderr, done.stdout) == (0, "", "\n")
    assert [path.name for path in tmp_path.iterdir()] == ["plain.py"]
