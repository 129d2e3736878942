"""The kernel's cache: kept where it can be; where it cannot, functions compile all the same."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import platformdirs
import pytest

from armd.compiled import library
from support.selection import parametrize_default

PROGRAM = """
from armd.compiled.jit import jit

@jit
def double(x):
    return 2.0 * x

assert double(2.0) == 4.0
print(double.stats.cache_path is not None, sum(double.stats.cache_hits.values()))
"""


def _run(folder: Path, cache: str, before: Callable[[], None] | None = None) -> tuple[str, str]:
    """Whether a function has a cache, and how often it was found in it."""
    program = folder / "program.py"
    program.write_text(PROGRAM)
    done = subprocess.run(
        [sys.executable, str(program)],
        env=os.environ | {"NUMBA_CACHE_DIR": cache, "ARMD_PLAIN_NUMBA": ""},
        cwd=folder,
        capture_output=True,
        text=True,
        preexec_fn=before,
    )
    assert done.stderr == ""
    cached, hits = done.stdout.split()
    return cached, hits


@pytest.mark.slow
def test_what_was_compiled_is_found_again(tmp_path: Path) -> None:
    cache = tmp_path / "cache"
    assert _run(tmp_path, str(cache)) == ("True", "0")
    assert _run(tmp_path, str(cache)) == ("True", "1")
    for damaged in (*cache.rglob("*.nbi"), *cache.rglob("*.nbc")):
        damaged.write_bytes(damaged.read_bytes()[: damaged.stat().st_size // 2])
    assert _run(tmp_path, str(cache)) == ("True", "0")


@parametrize_default("cache", ["/proc/none", "program.py"])
def test_without_a_cache_it_compiles_uncached(tmp_path: Path, cache: str) -> None:
    assert _run(tmp_path, cache) == ("False", "0")
    assert [path.name for path in tmp_path.iterdir()] == ["program.py"]


@pytest.mark.slow
def test_a_disk_that_is_full_later_is_no_matter(tmp_path: Path) -> None:
    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))  # more than that: EFBIG

    assert _run(tmp_path, str(tmp_path / "cache"), limit) == ("True", "0")
    assert _run(tmp_path, str(tmp_path / "cache")) == ("True", "0")


def test_a_user_without_a_home_has_no_cache(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("NUMBA_CACHE_DIR", "CACHE_DIRECTORY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(platformdirs, "user_cache_dir", lambda name: f"~/.cache/{name}")
    assert not library.is_usable(library.locate_cache())
