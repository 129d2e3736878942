"""What each fast test function covers, and what of it no other covers, as a table."""

from __future__ import annotations

import csv
from collections import defaultdict
from functools import cache
from pathlib import Path

import numpy as np
from mutants.covering import Covering
from mutants.functions import TestFunction, read_functions, split_test
from mutants.names import Source

HEADER = (
    "file", "function", "lines", "seconds", "covered_lines", "unique_lines", "fewest_other_tests",
)  # fmt: skip


def write_values(path: Path, covering: Covering) -> None:
    """One row for a function, all its parameters together; lines of functions alone count.

    `fewest_other_tests` is how many other functions cover the least covered of its lines; empty
    where it covers none.
    """
    seconds: defaultdict[tuple[str, str], float] = defaultdict(float)
    for test, spent_s in covering.seconds.items():
        seconds[split_test(test)] += spent_s
    functions = sorted(seconds)
    covered = _find_covered(covering, functions)
    counts = covered.sum(axis=0, dtype=np.int64)
    read = cache(lambda file: read_functions(covering.names.root / file))
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(HEADER)
        for (test_file, name), row in zip(functions, covered, strict=True):
            function: TestFunction | None = read(test_file).get(name)
            unique = int((counts[row] == 1).sum())
            fewest = int(counts[row].min()) - 1 if row.any() else ""
            writer.writerow([
                test_file, name, function.count if function else "",
                f"{seconds[test_file, name]:.3f}", int(row.sum()), unique, fewest,
            ])  # fmt: skip


def _find_covered(covering: Covering, functions: list[tuple[str, str]]) -> np.ndarray:
    """Whether each function (row) covers each line of the packages."""
    index = {function: i for i, function in enumerate(functions)}
    columns: list[np.ndarray] = []
    for path, source in covering.names.sources.items():
        for tests in _list_by_line(covering, path, source):
            if tests:
                column = np.zeros(len(functions), dtype=bool)
                column[[index[split_test(test)] for test in tests]] = True
                columns.append(column)
    return np.stack(columns, axis=1)


def _list_by_line(covering: Covering, path: str, source: Source) -> list[set[str]]:
    lines = [covering.run(path, [line]) for line in sorted(source.in_functions())]
    for name, starts in source.compiled_statements().items():
        owner = next(one for one in source.owners.values() if one.names == (name,))
        parts = covering.names.stand_in(path, owner)
        tests = {test for other, span in parts for test in covering.run(other, span)}
        lines += [tests] * len(starts)
    return lines
