"""How long `armd diagnose` takes, and which stage takes how much of it.

2000 readings in 20 placements, one disc off centre among them, against the whole catalogue; the
command as a user runs it, from start to end, on two cores.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from armd.compensation.data.session import load_session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.model.arm import load_arm
from armd.simulator.campaigns.hidden import Design
from armd.simulator.hidden import HiddenCase, generate_case
from armd.simulator.plants.plant import Plant

DESIGN = Design(sessions=20, holdout=0)
PLANT = Plant("encoder_eccentricity", "joint 3", 0.9)
CORES = 2


def run(repeats: int = 3) -> dict[str, Any]:
    """Seconds, the best of *repeats*; shares of the time of one run without import and reading."""
    with tempfile.TemporaryDirectory() as folder, _on_cores(CORES):
        case = generate_case(Path(folder), 4711, [PLANT], DESIGN)
        seconds = [
            _command(case, Path(folder)) for _ in range(repeats + 1)
        ]  # the first may compile
        arm = load_arm(case.arm)
        sessions = [load_session(path, arm) for path in case.sessions]
        marks: list[tuple[float, str]] = []
        result = diagnose(
            sessions, arm, progress=lambda text, _: marks.append((time.perf_counter(), text))
        )
        ended = time.perf_counter()
    begins = {text: when for when, text in reversed(marks)}  # where each was told first
    stages = ["model under test", "search", "gain"]
    edges = [*(begins[stage] for stage in stages), ended]
    whole = edges[-1] - edges[0]
    return {
        "readings": sum(session.n for session in sessions),
        "placements": len(result.search.first.linear.rests.observations.placement_names),
        "candidates": len(result.search.signatures.candidates),
        "cores": min(CORES, len(os.sched_getaffinity(0))),
        "seconds": min(seconds[1:]),
        "diagnosis_alone_seconds": whole,
        "share": {
            stage.replace(" ", "_"): (end - begin) / whole
            for stage, begin, end in zip(stages, edges, edges[1:], strict=False)
        },
        "found": [" ".join(found.candidate.place) for found in result.found],
    }


def _command(case: HiddenCase, folder: Path) -> float:
    command = [sys.executable, "-m", "armd.daemon.cli", "diagnose", *map(str, case.sessions)]
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
