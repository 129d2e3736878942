"""How long `armd diagnose` takes, in how much memory, and which step of it grows fastest.

The command as a user runs it, from start to end, on one core: 600 to 20 000 readings in 6 to 100
placements, one disc off centre among them, against the whole catalogue. Then each step's processor
time as one measure grows by itself: readings, sessions and joints doubled.
"""

from __future__ import annotations

import json
import math
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from measured import measured, on_cores
from threadpoolctl import threadpool_limits

from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.model.arm import Arm, load_arm
from armd.simulator.campaigns.hidden import Design
from armd.simulator.hidden import HiddenCase, generate_case
from armd.simulator.plants.plant import Plant
from support import synthetic

#: Steps, by what `diagnose` calls them as it goes.
STEPS = ("model under test", "search", "gain", "held out")
PLANT = Plant("encoder_eccentricity", "joint 3", 0.9)
CORES = 1
#: Sessions, each a placement, and articulations of each of its twenty balls.
SIZES = {
    "600_readings": (6, 5),
    "2000_readings": (20, 5),
    "6000_readings": (30, 10),
    "20000_readings": (100, 10),
}
REPEATED = ("600_readings", "2000_readings")
GROWN = {"fewest": (8, 5), "readings": (8, 10), "sessions": (16, 5)}
JOINTS = (4, 8)
ARMD = [sys.executable, "-m", "armd"]


def run(repeats: int = 3) -> dict[str, Any]:
    """Of each size one run; of the small ones the best of *repeats*."""
    with tempfile.TemporaryDirectory() as name, on_cores(CORES):
        folder = Path(name)
        figures = {}
        for size, of_size in SIZES.items():
            case = _case(folder / size, *of_size)
            runs = repeats if size in REPEATED else 1
            figures[size] = min(
                (_command(case) for _ in range(runs)), key=lambda run: run["seconds"]
            )
        return {
            "cores": min(CORES, len(os.sched_getaffinity(0))),
            **figures,
            "imports_s": measured([*ARMD, "diagnose", "--help"])["seconds"],
            "growth": growth(folder),
        }


def growth(folder: Path) -> dict[str, Any]:
    """Of each size the processor seconds of each step and the peak in MB; and the power with which
    a step grows with each measure (1: in proportion)."""
    steps = {}
    for name, size in GROWN.items():
        steps[name] = _steps(str(_case(folder / name, *size).arm.parent))
    for n in JOINTS:
        steps[f"{n}_joints"] = _steps(str(n))
    pairs = {
        "readings": ("fewest", "readings"),
        "sessions": ("fewest", "sessions"),
        "joints": tuple(f"{n}_joints" for n in JOINTS),
    }
    powers = {
        step: {
            measure: math.log2(steps[large][step] / steps[small][step])
            for measure, (small, large) in pairs.items()
        }
        for step in (*STEPS, "peak_mb")
    }
    return {"steps": steps, "power": powers}


def shown(figures: Mapping[str, Any]) -> list[str]:
    """The growth as a table; below it which step grows fastest with what."""
    steps, power = figures["growth"]["steps"], figures["growth"]["power"]
    rows = [("", *STEPS, "peak MB")]
    rows += [
        (name, *(f"{of[step]:.2f} s" for step in STEPS), f"{of['peak_mb']:.0f}")
        for name, of in steps.items()
    ]
    rows += [
        (f"power of {measure}", *(f"{power[step][measure]:.1f}" for step in (*STEPS, "peak_mb")))
        for measure in power["peak_mb"]
    ]
    fastest = [
        f"{max(STEPS, key=lambda step: power[step][measure])} with {measure}"
        for measure in power["peak_mb"]
    ]
    lines = ["  ".join(f"{cell:18}" for cell in row).rstrip() for row in rows]
    return [*lines, f"grows fastest: {', '.join(fastest)}"]


def _case(folder: Path, sessions: int, articulations: int) -> HiddenCase:
    design = Design(sessions=sessions, articulations=articulations, holdout=0)
    return generate_case(folder, 4711, [PLANT], design)


def _command(case: HiddenCase) -> dict[str, float]:
    result = case.arm.parent / "out.json"
    command = [*ARMD, "diagnose", *map(str, case.sessions), "--arm", str(case.arm), "-q"]
    figures = measured([*command, "--json", str(result)])
    found = [(f["cause"], f["location"]) for f in json.loads(result.read_text())["findings"]]
    if (PLANT.cause, PLANT.location) not in found:
        raise AssertionError(f"{PLANT.cause} {PLANT.location} was not found among {found}")
    return figures


def _steps(of: str) -> dict[str, float]:
    """Processor seconds of each step and the peak in MB, in a process of its own."""
    command = [sys.executable, __file__, of]
    told = subprocess.run(command, check=True, capture_output=True, text=True, env=_environment())
    found: dict[str, float] = json.loads(told.stdout)
    return found


def _environment() -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))}


def _of_folder(folder: Path) -> tuple[list[Session], Arm]:
    arm = load_arm(folder / "arm.toml")
    return [load_session(path, arm) for path in sorted(folder.glob("session-*"))], arm


def _of_joints(n: int) -> tuple[list[Session], Arm]:
    """400 readings in each of four sessions of a tracker, with an arm of so many joints."""
    arm, rng = synthetic.arm(n), np.random.default_rng(n)
    truth = synthetic.disturbed(arm, rng, 0.1)
    followed = [synthetic.tracked(arm, truth, rng, readings=400) for _ in range(4)]
    noisy = [session.truth_mm + rng.normal(0, 5e-3, (400, 3)) for session in followed]
    return [
        replace(session, name=f"s{i}", truth_mm=truth_mm)
        for i, (session, truth_mm) in enumerate(zip(followed, noisy, strict=True))
    ], arm


def _measure(of: str) -> dict[str, float]:
    sessions, arm = _of_joints(int(of)) if of.isdigit() else _of_folder(Path(of))
    marks: dict[str, float] = {}
    with threadpool_limits(limits=1):
        diagnose(
            sessions, arm, progress=lambda text, _: marks.setdefault(text, time.process_time())
        )
    edges = [*(marks[step] for step in STEPS), time.process_time()]
    took = dict(zip(STEPS, np.diff(edges).tolist(), strict=True))
    peak_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {**took, "peak_mb": 1.024e-3 * peak_kb}


if __name__ == "__main__":
    print(json.dumps(_measure(sys.argv[1])))
