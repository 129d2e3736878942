"""`make outsider CASES=n SEED=s`: n cases of each kind, of a generator that knows nothing of armd.

Each is written as a user's files, diagnosed by the command `armd diagnose`, and judged by the rules
of `judge.py`. The line of a case: the verdict; kind and seed; what was planted [its noise units,
clear of all that may absorb it]; what was said, with probabilities; the error on a session that
took no part under the model under test and under the extended one (and the noise alone). Of a
crowd each fault has its noise units clear of all that the others leave free, and clear of the
others as they are, and what was said of it; the last line counts them over all crowds. Of cases
without a calibration from before, the model under test is here `armd calibrate` of the same
sessions. `OUTSIDER_ARGS="--case disc 1000"` repeats one case; `--kinds`, only these; `--keep DIR`
keeps the folders.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from outsider.case import KINDS, Case, Truth, draw
from outsider.files import write
from outsider.judge import DUE_UNITS, VERDICTS, Tally, is_worse, judge, rightly_refused, tally

ARMD = Path(sys.executable).with_name("armd")
MOST_S = 600


@dataclass(frozen=True)
class Outcome:
    truth: Truth
    verdict: str
    said: str
    before_um: float
    after_um: float
    seconds: float  # of the diagnosis
    tally: Tally | None = None  # of a crowd

    @property
    def worse(self) -> bool:
        return is_worse(self.before_um, self.after_um)

    def line(self) -> str:
        truth = self.truth
        planted = f"{truth.cause} {truth.location} {truth.words}".strip() or "nothing"
        if self.tally:
            planted = "; ".join(
                f"{one.cause} {one.location} {one.words} [{one.noise_units:.1f}, "
                f"{one.plain_units:.1f}: {told or 'NOT TOLD'}]"
                for one, told in zip(truth.each, self.tally.told, strict=True)
            )
        model = "from before" if truth.held else "of the same"
        return (
            f"{self.verdict:14s} {truth.kind} {truth.seed}: {planted} [{truth.noise_units:.1f}], "
            f"{model} → {self.said or 'nothing'}; {self.before_um:.2f} → {self.after_um:.2f} µm "
            f"({truth.noise_um:.2f}){' WORSE' if self.worse else ''}, {self.seconds:.0f} s"
        )


class Failed(RuntimeError):
    """A command that ended with an error, and what it said."""


def armd(folder: Path, *words: str | Path) -> None:
    """Run the command in a case's folder; `Failed` with what it said if it fails."""
    environment = os.environ | {"OPENBLAS_NUM_THREADS": "1"}
    done = subprocess.run(
        [ARMD, *words], cwd=folder, env=environment, capture_output=True, text=True,
        timeout=MOST_S, check=False,
    )  # fmt: skip
    if done.returncode:
        raise Failed(f"armd {words[0]}: exit code {done.returncode}: {done.stderr[-2000:]}")


def diagnosed(kind: str, seed: int, folder: Path) -> Outcome:
    """One case: made in *folder*, which is empty, diagnosed and judged."""
    case = draw(kind, seed)
    write(case, folder)
    try:
        return _diagnosed(case, folder)
    except Failed as refused:
        if not rightly_refused(case.truth, str(refused)):
            raise
        return Outcome(case.truth, "right", "refused", np.nan, np.nan, 0.0)


def _diagnosed(case: Case, folder: Path) -> Outcome:
    sessions = sorted(path.name for path in folder.glob("session-*"))
    made_of = sorted(path.name for path in folder.glob("before-*")) or sessions
    armd(folder, "calibrate", *made_of, "--arm", "arm.toml", "-o", "before.json")
    given = ["--calibration", "before.json"] if case.truth.held else []
    started = time.perf_counter()
    armd(
        folder, "diagnose", *sessions, "--arm", "arm.toml", *given,
        "--json", "diagnosis.json", "--extended", "after.json",
    )  # fmt: skip
    seconds = time.perf_counter() - started
    report = json.loads((folder / "diagnosis.json").read_text())
    errors_um = []
    for model in ("before", "after"):
        armd(
            folder, "evaluate", "further", "--arm", "arm.toml",
            "--calibration", f"{model}.json", "--json", f"further-{model}.json",
        )  # fmt: skip
        errors_um.append(json.loads((folder / f"further-{model}.json").read_text())["rms_um"])
    said = "; ".join(_told(finding) for finding in report["findings"])
    verdict = judge(case.truth, report)
    told = tally(case.truth, report) if case.truth.each else None
    return Outcome(case.truth, verdict, said, *errors_um, seconds, told)


def _told(finding: dict[str, object]) -> str:
    where = finding["location"]
    if finding["cause"] == "unknown" or "time_s" in finding["depends_on"]:
        where = f"{where} in {', '.join(finding['depends_on'])}"
    return f"{finding['cause']} {where} {finding['probability']:.2f}"


def carry_out(task: tuple[str, int, Path | None]) -> Outcome | None:
    kind, seed, keep = task
    try:
        if keep:
            folder = keep / f"{kind}-{seed}"
            folder.mkdir(parents=True)
            return diagnosed(kind, seed, folder)
        with tempfile.TemporaryDirectory() as made:
            return diagnosed(kind, seed, Path(made))
    except Exception:
        print(f"failed: {kind} {seed}", file=sys.stderr)
        traceback.print_exc(limit=3, file=sys.stderr)
        return None


def table(outcomes: list[Outcome]) -> None:
    row = "{:12s} {:>6s}" + " {:>15s}" * (len(VERDICTS) + 1)
    print(row.format("kind", "cases", *VERDICTS, "worse"))
    for kind in (*KINDS, "all"):
        these = [o for o in outcomes if kind in (o.truth.kind, "all")]
        if these:
            count = Counter(o.verdict for o in these)
            figures = [*(count[verdict] for verdict in VERDICTS), sum(o.worse for o in these)]
            print(row.format(kind, str(len(these)), *map(str, figures)))


def crowds_line(outcomes: list[Outcome]) -> str:
    """What was said of all crowds; the gain is that of the noise, were all of it mended."""
    tallies = [(o.truth, o.tally) for o in outcomes if o.tally]
    named = {}
    for units in ("noise_units", "plain_units"):
        told = [
            relation
            for truth, each in tallies
            for one, relation in zip(truth.each, each.told, strict=True)
            if getattr(one, units) > DUE_UNITS
        ]
        named[units] = f"{told.count('own')} of {len(told)}"
        alike = f"{told.count('like')} by a like name, {told.count('near')} nearly"
    relations = [relation for _, each in tallies for relation, _ in each.relations]
    mended = sum(o.before_um - o.after_um for o in outcomes if o.tally)
    could = sum(o.before_um - o.truth.noise_um for o in outcomes if o.tally)
    return (
        f"effects named {named['noise_units']} over {DUE_UNITS:g} noise units "
        f"({named['plain_units']} by the plain ones; {alike}); "
        f"extra {relations.count('foreign')} in {len(tallies)} sets, "
        f"near {relations.count('near')}; "
        f"sure and wrong {sum(each.sure_and_wrong for _, each in tallies)} of {len(tallies)}; "
        f"worse {sum(o.worse for o in outcomes if o.tally)}; "
        f"gain {mended / could:.2f} of what the noise leaves"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=2, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=KINDS, metavar="KIND")
    parser.add_argument("--case", nargs=2, action="append", metavar=("KIND", "SEED"), help="only")
    parser.add_argument("--keep", type=Path, help="a folder for the cases' files")
    args = parser.parse_args()
    tasks = [
        (kind, 1000 * args.seed + j, args.keep) for j in range(args.cases) for kind in args.kinds
    ]
    if args.case:
        tasks = [(kind, int(seed), args.keep) for kind, seed in args.case]
    outcomes = []
    with multiprocessing.get_context("spawn").Pool(args.workers) as pool:
        for outcome in pool.imap_unordered(carry_out, tasks):
            if outcome is not None:
                outcomes.append(outcome)
                print(outcome.line(), flush=True)
    table(outcomes)
    if any(o.tally for o in outcomes):
        print(crowds_line(outcomes))
    if len(outcomes) < len(tasks):
        print(f"{len(tasks) - len(outcomes)} cases failed", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
