"""`make mutants SEED=421 CASES=200`: which fast test catches each of some drawn mutations.

The sources are those of HEAD, or of a revision: HEAD=rev. Each mutation is tried in a copy of
them, by the tests that run its line, the quickest first, until one fails. What was measured is kept
under .cache/mutants by commit; a run that was stopped continues, and tries those again whose tests
also failed without the mutation, as a busy machine makes them.

BEFORE=FILE takes the mutations of an earlier run's file, and tries those again whose catching test
is gone or changed since.
"""

from __future__ import annotations

import argparse
import os
import queue
import shutil
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

from hidden.frozen.revision import commit_of, is_dirty
from mutants.copies import Copy, make_copy, remove_copy
from mutants.covering import Covering, load_covering
from mutants.draw import draw_mutants
from mutants.judge import (
    GONE,
    SURVIVED,
    Verdict,
    judge,
    needs_trial,
    print_table,
    read_verdicts,
)
from mutants.mutant import Mutant, read_source
from mutants.trial import Trial
from mutants.value import write_values

ROOT = Path(__file__).parents[2]
CACHE = ROOT / ".cache/mutants"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--cases", type=int, required=True)
    parser.add_argument("--head", default="HEAD", help="the revision (default: %(default)s)")
    parser.add_argument("--before", type=Path, help="a file that an earlier run wrote")
    parser.add_argument("--values", type=Path, help="also write what each test covers, as CSV")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    args = parser.parse_args()
    if args.head == "HEAD" and is_dirty(ROOT):
        print("armd: files are changed that are not committed; HEAD is tried without them")
    commit = commit_of(ROOT, args.head)
    folder = CACHE / commit[:12]
    copies = [_make_new(commit, CACHE / "copies" / str(i)) for i in range(args.workers)]
    try:
        covering = load_covering(folder, copies[0], args.workers)
        if args.values:
            write_values(args.values, covering)
        earlier = {} if args.before is None else {
            verdict.mutant.name: verdict for verdict in read_verdicts(args.before)
        }  # fmt: skip
        mutants = [verdict.mutant for verdict in earlier.values()] if args.before else (
            draw_mutants(copies[0].root, args.seed, args.cases)
        )  # fmt: skip
        name = args.before.stem + "-again" if args.before else f"mutants-{args.seed}-{args.cases}"
        results = folder / f"{name}.jsonl"
        verdicts = _try_all(mutants, earlier, covering, copies, results)
    finally:
        for copy in copies:
            remove_copy(ROOT, copy)
    print_table(verdicts)
    print(f"\narmd: wrote {results}")
    lost = [one for one in verdicts if one.outcome == SURVIVED and one.mutant.name in earlier
            and earlier[one.mutant.name].outcome != SURVIVED]  # fmt: skip
    for verdict in lost:
        print(f"armd: caught before, by {earlier[verdict.mutant.name].test}: "
              f"{verdict.mutant.describe()}")  # fmt: skip
    return 1 if lost else 0


def _make_new(commit: str, root: Path) -> Copy:
    """A copy without what a run that was stopped left in it."""
    shutil.rmtree(root, ignore_errors=True)
    return make_copy(ROOT, commit, root)


def _try_all(
    mutants: list[Mutant],
    earlier: dict[str, Verdict],
    covering: Covering,
    copies: list[Copy],
    results: Path,
) -> list[Verdict]:
    """A verdict for each mutant, those of *results* included; each is written there at once."""
    verdicts = {one.mutant.name: one for one in read_verdicts(results)} if results.exists() else {}
    idle: queue.Queue[Trial] = queue.Queue()
    for copy in copies:
        idle.put(Trial(copy))
    writing = threading.Lock()

    def try_one(mutant: Mutant) -> None:
        trial = idle.get()
        try:
            verdict = _find_verdict(mutant, earlier.get(mutant.name), covering, trial)
        finally:
            idle.put(trial)
        with writing, results.open("a", encoding="utf-8") as file:
            file.write(verdict.to_json() + "\n")
            verdicts[mutant.name] = verdict
            place = f"{mutant.path}:{mutant.line}"
            print(f"{len(verdicts)} of {len(mutants)}: {verdict.outcome} {place} {verdict.test} "
                  f"({verdict.seconds:.0f} s)", file=sys.stderr, flush=True)  # fmt: skip

    missing = [
        mutant
        for mutant in mutants
        if mutant.name not in verdicts or verdicts[mutant.name].is_doubtful
    ]
    with ThreadPoolExecutor(len(copies)) as pool:
        list(pool.map(try_one, missing))
    ordered = [verdicts[mutant.name] for mutant in mutants]
    results.write_text("".join(f"{one.to_json()}\n" for one in ordered), encoding="utf-8")
    return ordered


def _find_verdict(
    mutant: Mutant, earlier: Verdict | None, covering: Covering, trial: Trial
) -> Verdict:
    root = trial.copy.root
    line = mutant.locate_in(read_source(root, mutant.path)) if (
        (root / mutant.path).is_file()
    ) else None  # fmt: skip
    if line is None:
        return Verdict(mutant, GONE)
    here = replace(mutant, line=line)
    if earlier is not None and not needs_trial(earlier, covering, root):
        return replace(earlier, mutant=here)
    return judge(here, covering, trial)


if __name__ == "__main__":
    sys.exit(main())
