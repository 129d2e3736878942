"""A mutant in a copy of the sources, and the first of its tests that fails there."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import subprocess
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import count
from pathlib import Path

import pytest
from mutants.chosen import RUNNING, TESTS
from mutants.copies import Copy, make_library
from mutants.covering import TOOL
from mutants.mutant import Mutant, read_source

#: Of one test; one that the mutant keeps from ending is caught. And where numba compiles in it.
TEST_S, COMPILING_TEST_S = 120, 240
#: A list that grows for ever is caught before the machine is full.
MEMORY_BYTES = 8 * 2**30
#: How many tests run at once: most mutants are caught by one of the first.
BATCHES = (10, 60, 1000)
HASH = "from armd.compiled import library as it; print(it.hash_sources(), it.name_file())"

# No two states of a file have the same time, by which Python knows what it compiled of it.
_stamps = count(1)


class Trial:
    """Mutants one after the other in one copy."""

    def __init__(self, copy: Copy) -> None:
        self.copy = copy
        self._sources = self._hash_sources()

    def find_catching(self, tests: Sequence[str], compiles: bool = False) -> str:
        """The first test that fails, or empty; the sources as they are now."""
        begin = 0
        for size in BATCHES:
            if begin < len(tests):
                caught = self._run(tests[begin : begin + size], compiles)
                if caught:
                    return caught
            begin += size
        return ""

    @contextmanager
    def change(self, mutant: Mutant, is_compiled: bool) -> Iterator[str]:
        """The sources with the mutant in it; what became of the library of compiled functions.

        A library is found by a digest of the sources of compiled functions. Where the mutant is in
        what is compiled, another is made; where it only stands in such a file, the old one is
        found by the new digest.
        """
        path = self.copy.root / mutant.path
        content, times = path.read_bytes(), path.stat()
        text = mutant.apply_to(read_source(self.copy.root, mutant.path))
        path.write_bytes(text.encode())
        stamp_ns = times.st_mtime_ns + next(_stamps) * 10**9
        os.utime(path, ns=(stamp_ns, stamp_ns))
        new = self._hash_sources()
        try:
            yield self._replace_library(new, is_compiled)
        finally:
            path.write_bytes(content)
            os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
            if new and new != self._sources:
                (self.copy.library_folder / new[1]).unlink(missing_ok=True)
                shutil.rmtree(self.copy.compiled / new[0], ignore_errors=True)

    def _replace_library(self, new: Sequence[str], is_compiled: bool) -> str:
        if not new or new == self._sources:
            return ""
        if is_compiled:
            return "rebuilt" if make_library(self.copy) else "does not compile"
        folder = self.copy.library_folder
        shutil.copy(folder / self._sources[1], folder / new[1])
        with suppress(FileNotFoundError):
            shutil.copytree(self.copy.compiled / self._sources[0], self.copy.compiled / new[0])
        return "kept"

    def _hash_sources(self) -> tuple[str, ...]:
        """The digest and the library's file name; nothing where the package cannot be imported."""
        command, environment = [str(self.copy.python), "-I", "-c", HASH], self.copy.environment()
        try:
            done = subprocess.run(
                command, env=environment, capture_output=True, text=True, timeout=TEST_S
            )
        except subprocess.TimeoutExpired:
            return ()
        return tuple(done.stdout.split()) if done.returncode == 0 else ()

    def _run(self, tests: Sequence[str], compiles: bool) -> str:
        test_s = COMPILING_TEST_S if compiles else TEST_S
        with tempfile.TemporaryDirectory() as folder:
            chosen, running = Path(folder) / "chosen", Path(folder) / "running"
            chosen.write_text("\n".join(tests), encoding="utf-8")
            files = dict.fromkeys(test.partition("::")[0] for test in tests)
            words = ["-x", "-q", f"--timeout={test_s}", f"--basetemp={folder}/tmp", *files]
            environment = self.copy.environment(
                PYTHONPATH=str(TOOL), PYTHONDONTWRITEBYTECODE="1",
                **{TESTS: str(chosen), RUNNING: str(running)},
            )  # fmt: skip
            plugins = ["-p", "mutants.chosen", "-p", "no:cacheprovider"]
            with (Path(folder) / "log").open("w") as log:
                code = _run_alone(
                    [str(self.copy.python), "-m", "pytest", *plugins, *words],
                    self.copy.root, environment, 5 * test_s, log.fileno(),
                )  # fmt: skip
            if code in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED):
                return ""
            return running.read_text(encoding="utf-8") if running.exists() else "(pytest itself)"


def _run_alone(
    command: list[str], folder: Path, environment: dict[str, str], seconds: float, log: int
) -> int:
    """The exit code, or -9 after so many seconds; what it started ends with it."""
    with subprocess.Popen(
        command, cwd=folder, env=environment, stdin=subprocess.DEVNULL, stdout=log, stderr=log,
        start_new_session=True, preexec_fn=_limit_memory,
    ) as process:  # fmt: skip
        try:
            return process.wait(seconds)
        except subprocess.TimeoutExpired:
            return -9
        finally:
            with suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)


def _limit_memory() -> None:
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY_BYTES, MEMORY_BYTES))
