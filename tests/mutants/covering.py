"""Which fast tests run a line, in their own process or in one that they start.

Measured once for a commit, under .cache/mutants: `make test`'s tests under coverage, by
`mutants.contexts`.
"""

from __future__ import annotations

import json
import subprocess
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import coverage
from mutants.contexts import CONTEXT, FOLDER
from mutants.copies import Copy
from mutants.draw import ROOMS
from mutants.mutant import Mutant
from mutants.names import Names

TOOL = Path(__file__).parents[1]  # what PYTHONPATH has, for `-p mutants.…`
#: The parts of `make test`: what `-m` takes.
PARTS = ("not slow and not serial", "serial and not slow")
SETTINGS = """[run]
source = {source}
context = ${{{context}-}}
data_file = {data}
parallel = true
concurrency = thread
sigterm = true
patch = _exit, fork, execv
"""


@dataclass
class Covering:
    """The lines of a commit, and the tests that run them."""

    lines: coverage.CoverageData
    root: Path  # of the copy that was measured
    names: Names
    seconds: Mapping[str, float]  # of each test that passed
    failed: set[str]
    users: Mapping[str, list[str]]  # of each fixture that several tests share
    _by_line: dict[str, dict[int, list[str]]] = field(default_factory=dict)

    def find_tests(self, mutant: Mutant) -> set[str]:
        """The tests that run the mutant's lines, or lines that use what they define."""
        owner = self.names.owner(mutant.path, mutant.line)
        if owner is None:
            return set()
        if owner.names:
            parts = self.names.stand_in(mutant.path, owner)
            return {test for path, lines in parts for test in self.run(path, lines)}
        exact = self.run(mutant.path, range(mutant.line, mutant.last_line + 1))
        return exact or self.run(mutant.path, owner.lines)

    def run(self, path: str, lines: Iterable[int]) -> set[str]:
        """The tests that run one of these lines."""
        by_line = self._read(path)
        return {
            test
            for line in lines
            for context in by_line.get(line, ())
            for test in self.users.get(context, (context,))
            if test in self.seconds
        }

    def _read(self, path: str) -> dict[int, list[str]]:
        if path not in self._by_line:
            self._by_line[path] = self.lines.contexts_by_lineno(str(self.root / path))
        return self._by_line[path]

    @cached_property
    def without_test(self) -> set[str]:
        """Contexts that are neither a test nor a fixture: what they ran counts for nobody."""
        tests = self.seconds.keys() | self.failed | self.users.keys() | {""}
        return set(self.lines.measured_contexts()) - tests


def load_covering(folder: Path, copy: Copy, workers: int) -> Covering:
    """That of the copy's commit, kept in *folder*; measured where nothing is there."""
    if not (folder / "lines").exists():
        _measure(folder, copy, workers)
    lines = coverage.CoverageData(basename=str(folder / "lines"))
    lines.read()
    record = json.loads((folder / "tests.json").read_text(encoding="utf-8"))
    failed = set(record["failed"])
    users = defaultdict(list)
    for test, fixtures in record["fixtures"].items():
        for fixture in fixtures:
            users[fixture].append(test)
    seconds = {test: s for test, s in record["seconds"].items() if test not in failed}
    return Covering(lines, Path(record["root"]), Names(copy.root), seconds, failed, users)


def _measure(folder: Path, copy: Copy, workers: int) -> None:
    (folder / "data").mkdir(parents=True, exist_ok=True)
    settings = folder / "coverage.ini"
    source = "".join(f"\n    {copy.root / room}" for room in ROOMS)
    data = folder / "data/lines"
    settings.write_text(SETTINGS.format(source=source, context=CONTEXT, data=data))
    environment = copy.environment(
        PYTHONPATH=str(TOOL), COVERAGE_PROCESS_START=str(settings), **{FOLDER: str(folder)}
    )
    for part in PARTS:
        print(f"armd: which lines each test runs: {part}", flush=True)
        command = [str(copy.python), "-m", "pytest", "-q", "-p", "mutants.contexts", "-m", part]
        options = ["-n", str(workers), "--dist", "loadfile", "--no-loadscope-reorder"]
        subprocess.run([*command, *options], cwd=copy.root, env=environment, check=False)
    combine(folder, copy)


def combine(folder: Path, copy: Copy) -> None:
    """Make one file of what the processes wrote."""
    record = {"root": str(copy.root), "fixtures": {}, "seconds": {}, "failed": []}
    for path in folder.glob("tests-*.json"):
        part = json.loads(path.read_text(encoding="utf-8"))
        record["fixtures"] |= part["fixtures"]
        record["seconds"] |= part["seconds"]
        record["failed"] += part["failed"]
    (folder / "tests.json").write_text(json.dumps(record), encoding="utf-8")
    together = coverage.Coverage(
        data_file=str(folder / "data/lines"), config_file=False, messages=False
    )
    together.combine([str(folder / "data")], keep=True)
    together.save()
    (folder / "data/lines").replace(folder / "lines")


def order_tests(tests: Iterable[str], seconds: Mapping[str, float]) -> list[str]:
    """The quickest of each file, quickest first; then the second of each; and so on."""
    by_file: defaultdict[str, list[str]] = defaultdict(list)
    for test in sorted(tests, key=lambda one: (seconds[one], one)):
        by_file[test.partition("::")[0]].append(test)
    ranked = [(rank, seconds[test], test) for each in by_file.values()
              for rank, test in enumerate(each)]  # fmt: skip
    return [test for *_, test in sorted(ranked)]
