"""`make hidden-sensitivity SEEDS=421,…`: what the diagnosis answers with another constant.

Each constant that decides is halved and doubled, and the same frozen cases are diagnosed with each
value. Three of four were chosen because a rule changed their answer (`make hidden-ablation` at the
same commit), one of four is an arm with nothing wrong, and all are short: counts are no rates, and
so few clean arms say nothing of false alarms in a hundred. `--most` bounds them, drawn by a seed of
its own.
"""

from __future__ import annotations

import argparse
import csv
import os
import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from hidden.frozen.ablation import Answer, Task, find_answers, find_kept_answers, judge
from hidden.frozen.freeze import CACHE, ROOT
from hidden.frozen.revision import commit_of, is_dirty
from hidden.frozen.variations import WAYS, list_constants, list_variations

DRAWN_BY = 44
MOST_CASE_S = 6.0  # processor seconds of a case's diagnosis: each is made over a hundred times
CLEAN_SHARE = 4  # one of so many has nothing wrong
#: A value other than the one that is there: how many answers it changes, for the better, the worse.
MARKS = ("other", "better", "worse")
COLUMNS = ("constant", "value", *(f"{way}_{mark}" for way in WAYS for mark in MARKS), "cases")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="421", help="of frozen cases, separated by commas")
    parser.add_argument("--most", type=int, default=12, help="cases at most")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these constants; without, all",
                        choices=[constant.name for constant in list_constants()])  # fmt: skip
    parser.add_argument("--csv", type=Path, help="where the table is written")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    args = parser.parse_args()
    answers = CACHE / "ablation" / commit_of(ROOT, "HEAD")[:12]
    cases = draw_cases(answers, args.seeds.split(","), args.most)
    if not cases:
        sys.exit(f"armd: {answers}: found no case in which a rule decided, expected those of "
                 "make hidden-ablation at this commit")  # fmt: skip
    if is_dirty(ROOT):
        print("armd: files are changed that are not committed; answers are kept as of HEAD")
    names = [c.name for c in list_constants() if not args.only or c.name in args.only]
    rules = [rule for rule in list_variations() if rule.name.split()[0] in names]
    with_all = find_answers([Task(case, "", answers) for case in cases], args.workers)
    tasks = [Task(case, rule.name, answers) for rule in rules for case in cases]
    varied = find_answers(tasks, args.workers)
    rows = count_rows(names, {task.case: one for task, one in with_all.items()}, varied)
    print("\n".join(make_table(rows)))
    if args.csv:
        write_rows(args.csv, rows)
    return 0


def draw_cases(answers: Path, seeds: Sequence[str], most: int) -> list[Path]:
    """Short cases, at most so many: whose answer some rule changes, and of arms with no cause."""
    decided, clean = list[Path](), list[Path]()
    for folder in sorted(answers.glob("*")):
        seed, _, name = folder.name.partition("-")
        by_rule = find_kept_answers(folder)
        if seed not in seeds or "" not in by_rule:
            continue
        case, answer = CACHE / seed / name, by_rule.pop("")
        if answer.ran.refused or answer.ran.diagnose_s > MOST_CASE_S:
            continue
        if name.startswith(("clean", "o-clean")):
            clean.append(case)
        elif any(judge(case, answer.ran, without.ran) != "=" for without in by_rule.values()):
            decided.append(case)
    n_clean = most // CLEAN_SHARE
    rng = np.random.default_rng(DRAWN_BY)
    return [
        group[i]
        for group, n in ((decided, most - n_clean), (clean, n_clean))
        for i in sorted(rng.permutation(len(group))[:n])
    ]


def count_rows(
    names: Sequence[str], as_it_is: Mapping[Path, Answer], varied: Mapping[Task, Answer]
) -> list[dict[str, object]]:
    """Of each constant, how many answers are others with another value, and better or worse."""
    values, rows = {c.name: c.value for c in list_constants()}, []
    for name in names:
        row: dict[str, object] = {"constant": name, "value": values[name]}
        for way in WAYS:
            runs = {task.case: one for task, one in varied.items() if task.rule == f"{name} {way}"}
            marks = Counter(judge(case, as_it_is[case].ran, one.ran) for case, one in runs.items())
            counts = (len(runs) - marks["="], marks["-"], marks["+"])  # + is better as it is
            row |= {f"{way}_{mark}": n for mark, n in zip(MARKS, counts, strict=True)}
            row["cases"] = len(runs)
        rows.append(row)
    return rows


def make_table(rows: Sequence[Mapping[str, object]]) -> list[str]:
    """The rows as text."""
    cells = [list(COLUMNS), *([str(row[column]) for column in COLUMNS] for row in rows)]
    widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
    return ["  ".join(map(str.ljust, line, widths)).rstrip() for line in cells]


def write_rows(path: Path, rows: Sequence[Mapping[str, object]]) -> None:
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    sys.exit(main())
