"""`make hidden CASES=n SEED=s`: a fresh Monte Carlo of hidden effects, and the table of marks.

`HIDDEN_ARGS="--case pair 1010003"` repeats one case as its line names it; `--kinds` runs some kinds
only, CASES of each; `--save FILE` keeps the raw outcomes, one JSON object per line.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import drifts
import numpy as np
import strangers
from cases import NOISES, run_case
from doubts import draw_doubtful, settle
from marks_table import Asked, Case, Outcome, table, tell
from messy import MessOutcome, run_mess, table_of_mess
from strangers import run_strange

from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.simulator.measured.mess import KINDS as MESSES
from armd.simulator.plants.causes import CAUSES
from armd.simulator.plants.draw import draw_plant
from armd.simulator.plants.plant import Plant, list_columns

#: One cause; two or three; one outside the catalogue; clean data of each noise; one cause whose
#: shape is DISTORTION off the catalogue's; one that the data leave in doubt, and the experiment
#: that armd proposes; something that drifts, and slow noise without; readings as a workshop
#: leaves them; strangers, crowds, third times, real arms. All but the first have a quarter of the
#: cases.
KINDS = (
    "single", "pair", "unknown", "gaussian", "heavy tails", "slow drift", "distorted", "doubt",
    *drifts.KINDS, *MESSES, *strangers.KINDS, "tails that last",
)  # fmt: skip  # a new kind comes last: its number is in the seeds of its cases
DISTORTION = 0.3
#: Causes that act through the posture, whose shape the simulator can bend.
DISTORTABLE = (
    "encoder_eccentricity", "encoder_ellipticity", "encoder_periodic", "encoder_scale",
    "encoder_slip", "joint_backlash", "axis_wobble", "joint_compliance", "link_bending",
    "probing_force", "thermal_gradient", "joint_thermal", "time_skew", "tip_offset",
)  # fmt: skip


@dataclass(frozen=True)
class Task:
    kind: str  # one of KINDS
    seed: int


def plants_for(task: Task) -> list[Plant]:
    rng = np.random.default_rng([task.seed, 0xD1A6])
    match task.kind:
        case "single":
            return [draw_plant(rng, factor=float(np.exp(rng.uniform(-1.2, 0.7))))]
        case "pair":
            causes = [c for c in CAUSES if c not in ("unknown", "outliers")]
            picked = rng.choice(causes, int(rng.integers(2, 4)), replace=False)
            return [draw_plant(rng, [str(cause)]) for cause in picked]
        case "unknown":
            return [draw_plant(rng, ["unknown"], float(np.exp(rng.uniform(-0.7, 0.7))))]
        case "distorted":
            plant = draw_plant(rng, DISTORTABLE, float(np.exp(rng.uniform(-0.7, 1.1))))
            return [replace(plant, detail={**plant.detail, "distortion": DISTORTION})]
    return []


def carry_out(task: Task) -> Case | None:
    """One task; a failure is told and counted, not hidden."""
    try:
        if task.kind in drifts.KINDS:
            return drifts.run_drift(task.kind, task.seed)
        if task.kind in strangers.KINDS:
            return run_strange(task.kind, task.seed)
        if task.kind in MESSES:
            return run_mess(task.kind, task.seed)
        return ask(task) if task.kind == "doubt" else judge(task)
    except Exception:
        traceback.print_exc(file=sys.stderr)
        return None


def ask(task: Task) -> Asked:
    case = draw_doubtful(np.random.default_rng([task.seed, 0xD1A6]))
    started = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        before, settled = settle(Path(folder), task.seed, case)
    plant = case.plant
    return Asked(
        task.kind,
        task.seed,
        case.reason,
        (plant.cause, plant.location, plant.size),
        _said(before),
        settled.doubt.words if settled else "",
        settled.proposal if settled else "",
        _said(settled.after) if settled else (),
        settled is not None and settled.resolved,
        time.perf_counter() - started,
    )


def _said(diagnosis: Diagnosis) -> tuple[tuple[str, str, float], ...]:
    return tuple((*found.candidate.place, found.probability) for found in diagnosis.findings)


def judge(task: Task) -> Outcome:
    plants = plants_for(task)
    noise = NOISES.get(task.kind, NOISES["gaussian"])
    judged = run_case(task.seed, plants, noise)
    places = [f.candidate.place for f in judged.diagnosis.findings]
    if judged.diagnosis.outliers and noise.tails != "t3":  # there they are true
        places.append(("outliers", "rows"))
    return Outcome(
        task.kind,
        task.seed,
        tuple((p.cause, p.location, p.size) for p in plants),
        judged.snr,
        judged.named,
        judged.among,
        tuple(places),
        judged.false_causes,
        judged.unknown,
        tuple(list_columns(plants[0])) if task.kind == "unknown" else (),
        judged.errors,
        judged.before_um,
        judged.after_um,
        judged.oracle_um,
        (*(f.p_value for f in judged.diagnosis.findings), judged.diagnosis.search.remaining_p),
        judged.seconds,
    )


def tasks_of(args: argparse.Namespace) -> list[Task]:
    """The cases asked for; a case's seed says all of it, whatever else runs."""
    if args.case:
        return [Task(kind, int(seed)) for kind, seed in args.case]
    few = args.cases if args.kinds else args.cases // 4
    return [
        Task(kind, 1_000_000 * args.seed + 10_000 * i + j)
        for i, kind in enumerate(KINDS)
        if not args.kinds or kind in args.kinds
        for j in range(args.cases if kind == "single" else few)
    ]


def main(run: Callable[[Task], Case | None] = carry_out) -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=40, help="single causes; others follow")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--kinds", nargs="+", choices=KINDS, metavar="KIND", help="only these")
    parser.add_argument("--case", nargs=2, action="append", metavar=("KIND", "SEED"), help="only")
    parser.add_argument("--save", type=Path, help="raw outcomes, a JSON object per line")
    args = parser.parse_args()
    tasks = tasks_of(args)
    outcomes: list[Case] = []
    with multiprocessing.get_context("spawn").Pool(args.workers) as pool:
        for outcome in pool.imap_unordered(run, tasks):
            if outcome is not None:
                outcomes.append(outcome)
                print(tell(outcome), flush=True)
                if args.save:
                    with args.save.open("a") as file:
                        print(json.dumps(asdict(outcome)), file=file)
    table(outcomes)
    table_of_mess([o for o in outcomes if isinstance(o, MessOutcome)])
    if len(outcomes) < len(tasks):
        print(f"{len(tasks) - len(outcomes)} cases failed", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    sys.exit(main())
