"""`make hidden-ablation SEEDS=421,… [CASES=n]`: what each rule of the diagnosis is good for.

The frozen cases are diagnosed once with all rules watched, and those in which a rule changed
something once more without it. An answer is better if more of what is due is named, or less that is
foreign; where names are equal, if the model that is written errs by over 2 % less on further
readings. `--most` bounds how many cases are run without a rule, drawn by a seed of its own. Answers
are kept under .cache/hidden/ablation by commit, so that a run which was stopped goes on.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import json
import multiprocessing
import os
import resource
import shutil
import sys
import time
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from hidden.frozen.case import Truth, read_truth
from hidden.frozen.freeze import CACHE, ROOT, wanted_cases
from hidden.frozen.revision import commit_of
from hidden.frozen.rules import RULES
from hidden.frozen.run import Ran, Refused, copy_case, diagnose_and_evaluate, make_given
from hidden.frozen.score import WORSE, score
from hidden.frozen.switches import Rule, switch_off, watch
from hidden.frozen.variations import list_variations

from armd.files.writing import write_whole

MOST_S = 900
DRAWN_BY = 44
COLUMNS = ("changed", "run", "other", "better", "worse")


@dataclass(frozen=True)
class Task:
    case: Path
    rule: str  # "": none is off, and all are watched
    answers: Path  # their folder


@dataclass(frozen=True)
class Answer:
    """What a diagnosis answered, and how often each rule changed something."""

    ran: Ran
    changed: Mapping[str, int]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", default="421", help="of frozen cases, separated by commas")
    parser.add_argument("--kinds", default="*", help="patterns, separated by commas")
    parser.add_argument("--cases", type=int, help="of each kind at most")
    parser.add_argument("--most", type=int, default=20, help="cases without a rule at most")
    parser.add_argument("--rules", nargs="*", help="their names; without, all")
    parser.add_argument("--csv", type=Path, help="a table whose rows of these rules are replaced")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    args = parser.parse_args()
    answers = CACHE / "ablation" / commit_of(ROOT, "HEAD")[:12]
    cases = [
        CACHE / seed / wanted.name
        for seed in args.seeds.split(",")
        for wanted in wanted_cases(args.kinds, args.cases)
        if (CACHE / seed / wanted.name).exists()
    ]
    whole = find_answers([Task(case, "", answers) for case in cases], args.workers)
    with_all = {task.case: answer for task, answer in whole.items()}
    rules = [rule for rule in RULES if not args.rules or rule.name in args.rules]
    tasks = [
        Task(case, rule.name, answers)
        for rule in rules
        for case in draw_cases(rule, with_all, args.most)
    ]
    without = find_answers(tasks, args.workers)
    rows = count_rows(rules, with_all, without)
    print("\n".join([*make_table(rows), *list_changes(with_all, without)]))
    if args.csv:
        write_rows(args.csv, rows)
    return 0


def draw_cases(rule: Rule, with_all: Mapping[Path, Answer], most: int) -> list[Path]:
    """Of the cases in which a rule changed something, at most so many."""
    changed = [case for case, one in with_all.items() if rule.always or one.changed.get(rule.name)]
    rng = np.random.default_rng([DRAWN_BY, zlib.crc32(rule.name.encode())])
    return [changed[i] for i in sorted(rng.permutation(len(changed))[:most])]


def find_answers(tasks: Sequence[Task], workers: int) -> dict[Task, Answer]:
    """Each task's answer, taken from the cache or run."""
    missing = [task for task in tasks if not _file(task).exists()]
    if missing:
        _import_all()
        began = time.monotonic()
        with multiprocessing.get_context("fork").Pool(workers, maxtasksperchild=1) as pool:
            for i, task in enumerate(pool.imap_unordered(_run, missing), 1):
                left = (time.monotonic() - began) / i * (len(missing) - i) / 60
                print(f"\r{i} of {len(missing)}, {left:.0f} min left, {task.case.name:14s} "
                      f"{task.rule[:40]:40s}", end="", file=sys.stderr, flush=True)  # fmt: skip
        print(file=sys.stderr)
    return {task: _read(_file(task)) for task in tasks}


def find_kept_answers(folder: Path) -> dict[str, Answer]:
    """The answers to a case that are kept, by the rule that was left out; "": by none."""
    keys = {_key(rule.name): rule.name for rule in RULES} | {_key(""): ""}
    paths = [path for path in folder.glob("*.json") if path.stem in keys]
    return {keys[path.stem]: _read(path) for path in paths}


def _file(task: Task) -> Path:
    return task.answers / f"{task.case.parent.name}-{task.case.name}" / f"{_key(task.rule)}.json"


def _key(rule: str) -> str:
    return "".join(c if c.isalnum() else "-" for c in rule) or "all"


def _read(path: Path) -> Answer:
    data = json.loads(path.read_text(encoding="utf-8"))
    return Answer(Ran(**data["ran"]), data["changed"])


def _import_all() -> None:
    """Import what a diagnosis imports, so that a forked process need not."""
    import armd.compensation.diagnose.diagnose
    import armd.daemon.commands.offline.calibrate
    import armd.daemon.commands.offline.diagnose
    import armd.daemon.commands.offline.evaluate  # noqa: F401


def _run(task: Task) -> Task:
    """In a process of its own: what is switched off stays off."""
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_S, MOST_S + 5))
    _import_all()
    truth, counts = read_truth(task.case), Counter[str]()
    is_diagnosed = truth.given == "diagnose"
    with copy_case(task.case) as folder, contextlib.chdir(folder):
        try:
            if not is_diagnosed:
                _make_given_once(_file(task).with_name("given.json"), truth)
            _prepare(task.rule, counts)
            if is_diagnosed:  # by the same rules as what follows
                make_given(_run_here, Path(), truth)
            ran = diagnose_and_evaluate(_run_here, Path(), truth)
        except Refused as refused:
            ran = Ran(refused=str(refused), failed=refused.failed)
    _file(task).parent.mkdir(parents=True, exist_ok=True)
    write_whole(_file(task), json.dumps({"ran": asdict(ran), "changed": dict(counts)}))
    return task


def _make_given_once(kept: Path, truth: Truth) -> None:
    """The case's calibration, which no rule of a diagnosis changes."""
    if kept.exists():
        shutil.copy(kept, "given.json")
        return
    make_given(_run_here, Path(), truth)
    kept.parent.mkdir(parents=True, exist_ok=True)
    write_whole(kept, Path("given.json").read_bytes())


def _prepare(rule_name: str, counts: Counter[str]) -> None:
    """Switch the rule of that name off; without a name, watch all."""
    if rule_name:
        every = (*RULES, *list_variations())
        switch_off(next(rule for rule in every if rule.name == rule_name))
    else:
        watch(RULES, counts)


def _run_here(*words: str) -> float:
    """Processor seconds of a command of armd in this process and folder; raises `Refused` if it
    ends with an error."""
    from armd.daemon.cli import main as armd

    began = time.process_time()
    with (
        Path("output.txt").open("w") as out,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(out),
    ):
        code = armd(list(words))
    if code:
        raise Refused.from_output(words[0], Path(), code)
    return time.process_time() - began


def count_rows(
    rules: Sequence[Rule], with_all: Mapping[Path, Answer], without: Mapping[Task, Answer]
) -> dict[str, dict[str, int]]:
    """Of each rule that was switched off: in how many cases it changes something, how many of them
    were run without it, how many of those answers are others, and better or worse with it."""
    rows = {}
    for rule in rules:
        runs = {task.case: one for task, one in without.items() if task.rule == rule.name}
        marks = Counter(judge(case, with_all[case].ran, one.ran) for case, one in runs.items())
        changed = sum(rule.always or bool(one.changed.get(rule.name)) for one in with_all.values())
        if runs or not changed:
            rows[rule.name] = {
                "changed": changed, "run": len(runs), "other": len(runs) - marks["="],
                "better": marks["+"], "worse": marks["-"],
            }  # fmt: skip
    return rows


def make_table(rows: Mapping[str, Mapping[str, int]]) -> list[str]:
    """The rows as text."""
    lines = [f"{'rule':50s}" + "".join(f"{column:>8s}" for column in COLUMNS)]
    for name, row in rows.items():
        lines.append(f"{name:50s}" + "".join(f"{row[column]:8d}" for column in COLUMNS))
    return lines


def list_changes(with_all: Mapping[Path, Answer], without: Mapping[Task, Answer]) -> list[str]:
    """The answers that are better or worse with a rule, and what they are without."""
    lines = []
    for task, one in without.items():
        mark = judge(task.case, with_all[task.case].ran, one.ran)
        if mark in "+-":
            truth = read_truth(task.case)
            lines += [
                f"{mark} {task.rule}: {task.case.parent.name} {task.case.name}",
                f"     with: {score(truth, with_all[task.case].ran).answer}",
                f"  without: {score(truth, one.ran).answer}",
            ]
    return lines


def write_rows(path: Path, rows: Mapping[str, Mapping[str, int]]) -> None:
    """Replace these rules' rows of a table, and leave those of others, which may be gone."""
    known: dict[str, Mapping[str, object]] = {}
    if path.exists():
        with path.open(encoding="utf-8", newline="") as file:
            known = {row["rule"]: row for row in csv.DictReader(file)}
    present = {rule.name for rule in RULES}
    known |= {name: {"rule": name, **row} for name, row in rows.items()}
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, ["rule", *COLUMNS, "kept"], lineterminator="\n")
        writer.writeheader()
        for name, row in known.items():
            writer.writerow({**row, "kept": "yes" if name in present else "no"})


def judge(case: Path, with_it: Ran, without: Ran) -> str:
    """+ where the answer is better with the rule than without, - where worse, ~ where another,
    and = where it is the same."""
    truth = read_truth(case)
    a, b = score(truth, with_it), score(truth, without)
    by_names = (a.named - a.foreign - a.sure_and_wrong - a.failed) - (
        b.named - b.foreign - b.sure_and_wrong - b.failed
    )
    if by_names:
        return "+" if by_names > 0 else "-"
    if with_it.after_um is not None and without.after_um is not None:
        if without.after_um > WORSE * with_it.after_um:
            return "+"
        if with_it.after_um > WORSE * without.after_um:
            return "-"
    return "=" if a.answer == b.answer else "~"


if __name__ == "__main__":
    sys.exit(main())
