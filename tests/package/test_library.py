"""What a compiled function is called with decides what runs: the library's machine code only for
the kinds of arguments it was made for, numba for all others, a sentence where there is neither."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import pytest

from armd.compiled import library
from armd.compiled.jit import Compiled

F8 = np.zeros((3, 4))
RECORD = np.zeros(2, [("a", "f8"), ("b", "i4", (3,))])


class Pair(NamedTuple):
    first: Any
    second: Any


class Other(NamedTuple):
    first: Any
    second: Any


#: No two of these are one to machine code.
DIFFERENT = [
    F8, F8.astype("f4"), F8.astype(">f8"), F8.astype("i8"), F8[0], F8[None], F8.T,
    RECORD, RECORD[["a"]], np.zeros(2, [("a", "f8"), ("b", "i4", (2,))]),
    np.zeros(2, [("a", "f8"), ("c", "i4", (3,))]), np.frombuffer(bytes(96)).reshape(3, 4),
    np.frombuffer(bytearray(97), offset=1).reshape(3, 4),
    1, 1.0, True, None, "1", (F8, 1), (1, F8), Pair(F8, 1), Other(F8, 1),
]  # fmt: skip


def test_what_machine_code_must_tell_apart_has_kinds_and_symbols_of_its_own() -> None:
    kinds = [library.describe_kind(value) for value in DIFFERENT]
    assert len(set(kinds)) == len(DIFFERENT)
    assert len({library.name_symbol("f", (kind,)) for kind in kinds}) == len(DIFFERENT)


@pytest.mark.parametrize(
    ("one", "same"),
    [
        (F8, np.ones((7, 9))),
        (1, np.int64(-3)),
        (1.0, np.float64(2)),
        (True, np.bool(False)),
        (F8.T, F8[:, ::2]),
    ],
)
def test_what_is_one_to_machine_code_is_one_kind(one: object, same: object) -> None:
    assert library.describe_kind(one) == library.describe_kind(same)


def added(a: Any, b: Any) -> Any:
    return a[0] + b


def with_library(monkeypatch: pytest.MonkeyPatch, *arguments: Any) -> tuple[Compiled, list[Any]]:
    """`added`, and what a library that has it for these arguments was called with."""
    calls: list[Any] = []
    compiled = Compiled(added, {})
    symbol = library.name_symbol(compiled.name, tuple(map(library.describe_kind, arguments)))

    def machine_code(*args: Any) -> str:
        calls.append(args)
        return "library"

    monkeypatch.setattr(
        library,
        "load_libraries",
        lambda: (SimpleNamespace(), SimpleNamespace(**{symbol: machine_code})),
    )
    monkeypatch.setattr(Compiled, "by_numba", lambda *_: "numba")
    return compiled, calls


def test_other_arguments_never_reach_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever was called before: the last call's arguments again, some of them, or others."""
    compiled, calls = with_library(monkeypatch, F8, 1)
    rng = np.random.default_rng(5)
    values = [*DIFFERENT, F8.copy(), 2]
    for _ in range(3000):
        args = tuple(values[k] for k in rng.integers(len(values), size=rng.integers(1, 4)))
        wanted = tuple(map(library.describe_kind, args)) == (
            library.describe_kind(F8),
            library.describe_kind(1),
        )
        assert compiled(*args) == ("library" if wanted else "numba")
        if rng.random() < 0.5:
            assert compiled(F8, 1) == "library"
    assert len(calls) > 100


def test_settled_nobody_looks_at_the_arguments(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is what a call would have called, in the library or by numba."""
    compiled, calls = with_library(monkeypatch, F8, 1)
    call, other = compiled.settled(F8, 1), compiled.settled(F8, 1.0)
    assert calls == []
    looked: list[Any] = []
    monkeypatch.setattr(library, "describe_kind", lambda value: looked.append(value))
    assert call(F8.copy(), 2) == "library" and other(F8, 1.0) == "numba"
    assert looked == []


def test_an_array_that_is_no_more_needed_is_let_go_where_numba_looks_itself() -> None:
    compiled = Compiled(added, {})
    compiled(np.ones(3), 2.0)
    assert compiled._last[0] == ()


def test_without_library_and_numba_it_says_what_to_install(tmp_path: Path) -> None:
    for name in ("numba", "scipy"):
        (tmp_path / f"{name}.py").write_text(f"raise ModuleNotFoundError('no', name={name!r})")
    program = (
        "import sys; sys.path.insert(0, sys.argv.pop(1)); from armd.daemon.cli import main;"
        "sys.exit(main(sys.argv[1:]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, tmp_path, "calibrate", "nowhere"],
        capture_output=True, text=True,
    )  # fmt: skip
    assert done.returncode == 2
    install = f"armd: scipy: found no such package; this needs it: {sys.executable} -m pip install "
    assert done.stderr.startswith(install) and "scipy" in done.stderr.removeprefix(install)
    assert "armd" not in done.stderr.removeprefix(install)  # no index has it


def test_a_damaged_library_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert library.list_places()[-1].parent == tmp_path
    library.list_places()[-1].write_bytes(b"\x7fELF and no more")
    program = (
        "import json; from armd.compiled import library;"
        "library.list_places = lambda: [library.locate_cache() / library.name_file()];"
        "print(json.dumps(library.load_libraries()))"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert json.loads(done.stdout) == [], done.stderr
