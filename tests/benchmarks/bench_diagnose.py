"""How long `armd diagnose` takes, and which stage takes how much of it.

2000 readings in 20 placements, one disc off centre among them, against the whole catalogue; the
command as a user runs it, from start to end, on two cores. Then how each stage's processor time
grows, each measure doubled by itself: readings, sessions and joints.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from measured import measured

from armd.compensation.data.session import Session, load_session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.model.arm import Arm, load_arm
from armd.simulator.campaigns.hidden import Design
from armd.simulator.hidden import HiddenCase, generate_case
from armd.simulator.plants.plant import Plant
from support import synthetic

DESIGN = Design(sessions=20, holdout=0)
STAGES = ["model under test", "search", "gain"]
#: What is compared with what: (sessions, articulations of each of twenty balls).
GROWN = {"few": (8, 5), "readings": (8, 10), "sessions": (16, 5)}
JOINTS = (4, 8)
PLANT = Plant("encoder_eccentricity", "joint 3", 0.9)
CORES = 2
ARMD = [sys.executable, "-m", "armd"]


def run(repeats: int = 3) -> dict[str, Any]:
    """Seconds, the best of *repeats*; shares of the time of one run without import and reading."""
    with tempfile.TemporaryDirectory() as folder, _on_cores(CORES):
        case = generate_case(Path(folder), 4711, [PLANT], DESIGN)
        seconds = [
            _command(case, Path(folder)) for _ in range(repeats + 1)
        ]  # the first may compile
        imports_s = measured([*ARMD, "diagnose", "--help"])["seconds"]
        arm = load_arm(case.arm)
        sessions = [load_session(path, arm) for path in case.sessions]
        result, took = _by_stage(sessions, arm, time.perf_counter)
    return {
        "readings": sum(session.n for session in sessions),
        "placements": len(result.search.first.linear.rests.observations.placement_names),
        "candidates": len(result.search.signatures.candidates),
        "cores": min(CORES, len(os.sched_getaffinity(0))),
        "seconds": min(seconds[1:]),
        "imports_s": imports_s,
        "diagnosis_alone_seconds": sum(took.values()),
        "share": {stage: of / sum(took.values()) for stage, of in took.items()},
        "found": [" ".join(found.candidate.place) for found in result.found],
        "growth": growth(),
    }


def growth() -> dict[str, Any]:
    """Processor seconds of each stage, and the power of readings, sessions and joints with which it
    grows (1: in proportion)."""
    seconds: dict[str, dict[str, float]] = {}
    with tempfile.TemporaryDirectory() as folder, _on_cores(CORES):
        for name, (count, articulations) in GROWN.items():
            design = Design(sessions=count, articulations=articulations, holdout=0)
            case = generate_case(Path(folder) / name, 4711, [PLANT], design)
            arm = load_arm(case.arm)
            sessions = [load_session(path, arm) for path in case.sessions]
            seconds[name] = _by_stage(sessions, arm, time.process_time)[1]
    for n in JOINTS:
        arm, rng = synthetic.arm(n), np.random.default_rng(n)
        truth = synthetic.disturbed(arm, rng, 0.1)
        followed = [synthetic.tracked(arm, truth, rng, readings=400) for _ in range(4)]
        sessions = [
            replace(
                session, name=f"s{i}", truth_mm=session.truth_mm + rng.normal(0, 5e-3, (400, 3))
            )
            for i, session in enumerate(followed)
        ]
        seconds[f"{n}_joints"] = _by_stage(sessions, arm, time.process_time)[1]
    few, many = (f"{n}_joints" for n in JOINTS)
    pairs = {
        "readings": ("few", "readings"),
        "sessions": ("few", "sessions"),
        "joints": (few, many),
    }
    powers = {
        stage: {
            name: math.log2(seconds[large][stage] / seconds[small][stage])
            for name, (small, large) in pairs.items()
        }
        for stage in seconds["few"]
    }
    return {"processor_s": seconds, "power": powers}


def _by_stage(
    sessions: list[Session], arm: Arm, clock: Callable[[], float]
) -> tuple[Diagnosis, dict[str, float]]:
    """A diagnosis, and what each stage of it took by a *clock*."""
    marks: list[tuple[float, str]] = []
    result = diagnose(sessions, arm, progress=lambda text, _: marks.append((clock(), text)))
    ended = clock()
    begins = {text: when for when, text in reversed(marks)}  # where each was told first
    edges = [*(begins[stage] for stage in STAGES), ended]
    return result, {
        stage.replace(" ", "_"): end - begin
        for stage, begin, end in zip(STAGES, edges, edges[1:], strict=False)
    }


def _command(case: HiddenCase, folder: Path) -> float:
    command = [*ARMD, "diagnose", *map(str, case.sessions)]
    command += ["--arm", str(case.arm), "--json", str(folder / "out.json")]
    began = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - began


@contextmanager
def _on_cores(count: int) -> Iterator[None]:
    """This process and those it starts on so many cores at most."""
    before = os.sched_getaffinity(0)
    os.sched_setaffinity(0, sorted(before)[:count])
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)


if __name__ == "__main__":
    print(json.dumps(run(), indent=1))
