"""`make hidden-compare BASE=REV [KIND=PATTERN] [CASES=n]`: two revisions over the frozen cases.

Both run through the command line, each from its own files, one thread a process. KIND has
patterns of kinds, such as `*thermal*,clean`; CASES is how many of each kind at most. What a
revision answered is kept under .cache/hidden/results by its commit and the digest of the case's
files, so a second comparison, or one that was stopped, runs only what is missing. HEAD=REV takes
another revision than the checked-out one. `--list` prints the kinds.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
from hidden.frozen.case import digest, read_truth
from hidden.frozen.freeze import (
    CACHE,
    CHECKSUMS,
    COUNTS,
    ROOT,
    Wanted,
    differing_from_record,
    draw_missing,
    wanted_cases,
)
from hidden.frozen.revision import Revision, check_out, commit_of, is_dirty
from hidden.frozen.run import Ran, run_case
from hidden.frozen.score import Line, Score, compare, score

Task = tuple[Revision, Path, Path]  # revision, case, file of the result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--base", default="", help="the revision to compare with")
    parser.add_argument("--head", default="HEAD")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--kinds", default="*", help="patterns, separated by commas")
    parser.add_argument("--cases", type=int, help="of each kind at most")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--list", action="store_true", help="print the kinds and stop")
    args = parser.parse_args()
    if args.list:
        print("\n".join(f"{kind:14s} {count}" for kind, count in COUNTS.items()))
        return 0
    revisions = [check_out(ROOT, commit_of(ROOT, name), CACHE / "revisions")
                 for name in ([args.base] if args.base else []) + [args.head]]  # fmt: skip
    if args.head == "HEAD" and is_dirty(ROOT):
        print("armd: files are changed that are not committed; HEAD is compared without them")
    cases, folder = wanted_cases(args.kinds, args.cases), CACHE / str(args.seed)
    if not cases:
        sys.exit(f"armd: --kinds: found {args.kinds!r}, expected patterns of kinds: see --list")
    answers = find_answers(revisions, cases, args.seed, args.workers)
    scores = [
        {case: score(read_truth(folder / case.name), each[case.name]) for case in cases}
        for each in answers
    ]
    _print(revisions, cases, folder, scores)
    return 0


def find_answers(
    revisions: list[Revision], cases: list[Wanted], seed: int, workers: int
) -> list[dict[str, Ran]]:
    """What each revision answers to the cases of a seed, by the case's name; the cases are drawn
    where they are missing. Raises `SystemExit` for one that is not as recorded."""
    folder = CACHE / str(seed)
    differing = differing_from_record(seed, draw_missing(cases, seed, folder, workers))
    if differing:
        sys.exit(f"armd: {folder}: {differing[0]} is not as {CHECKSUMS.name} has it; "
                 f"make hidden-freeze SEED={seed} ANEW=1")  # fmt: skip
    digests = {case.name: digest(folder / case.name, truth=False) for case in cases}
    return [_find_answers(one, cases, folder, digests, workers) for one in revisions]


def _find_answers(
    revision: Revision,
    cases: list[Wanted],
    folder: Path,
    digests: Mapping[str, str],
    workers: int,
) -> dict[str, Ran]:
    """What a revision answers to each case, by the case's name; taken from the cache or run."""
    results = CACHE / "results" / revision.commit
    results.mkdir(parents=True, exist_ok=True)
    files = {case.name: results / f"{digests[case.name][:24]}.json" for case in cases}
    tasks: list[Task] = [
        (revision, folder / case.name, files[case.name])
        for case in cases
        if not files[case.name].exists()
    ]
    if tasks:
        with multiprocessing.get_context("spawn").Pool(workers) as pool:
            for i, name in enumerate(pool.imap_unordered(_run, tasks), 1):
                line = f"\r{revision.short}: {i} of {len(tasks)} run, {name:20s}"
                print(line, end="", file=sys.stderr, flush=True)
        print(file=sys.stderr)
    return {name: Ran(**json.loads(path.read_text())) for name, path in files.items()}


def _run(task: Task) -> str:
    revision, case, result = task
    ran = run_case(revision, case, CACHE / "compiled" / revision.commit)
    part = result.with_suffix(f".{os.getpid()}")
    part.write_text(json.dumps(asdict(ran)), encoding="utf-8")
    part.replace(result)
    return case.name


def _print(
    revisions: list[Revision],
    cases: list[Wanted],
    folder: Path,
    scores: list[dict[Wanted, Score]],
) -> None:
    names = [revision.short for revision in revisions]
    kinds = list(dict.fromkeys(case.kind for case in cases))
    print(f"{'':44s} {names[0]:>9s} {names[-1]:>9s}   {'change, 95 %':>16s}")
    for title, chosen in [*((kind, {kind}) for kind in kinds), ("all kinds", set(kinds))]:
        own = [case for case in cases if case.kind in chosen]
        pairs = [(scores[0][case], scores[-1][case]) for case in own]
        for i, line in enumerate(compare(pairs, np.random.default_rng(0))):
            print(_row(f"{title} ({len(own)})" if i == 0 else "", line))
    if len(revisions) < 2:
        return
    print("\nAnswers that changed, and what they were:")
    for case in cases:
        before, after = scores[0][case], scores[1][case]
        if before.answer != after.answer:
            print(f"{_mark(before, after)} {case.name}: {read_truth(folder / case.name).words}")
            print(f"     {names[0]}: {before.answer}\n     {names[1]}: {after.answer}")


def _row(title: str, line: Line) -> str:
    return f"{title:18s} {line.name:25s} {line.before:>9s} {line.after:>9s}   {line.interval:>16s}"


def _mark(before: Score, after: Score) -> str:
    """+ or − where a name or a foreign finding makes the answer better or worse."""
    change = (after.named - after.foreign) - (before.named - before.foreign)
    return "+" if change > 0 else "−" if change < 0 else " "


if __name__ == "__main__":
    sys.exit(main())
