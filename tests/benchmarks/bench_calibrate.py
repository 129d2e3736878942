"""How long `armd calibrate` takes for few and for many readings, and in how much memory.

The command as a user runs it: 2000 readings in 20 placements, 20 000 in 100. The floor is one step
of least squares with everything in one dense matrix: normal equations by Cholesky's factor, of as
many rows and unknowns; a calibration takes several, and tries models against each other.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from measured import measured
from scipy.linalg import cho_factor, cho_solve

from armd.simulator.campaigns.hidden import Design
from armd.simulator.hidden import generate_case

#: Sessions, each a placement, and articulations of each of its twenty balls.
SIZES = ((20, 5), (100, 10))
BALLS = 20
CONSTANTS, COEFFICIENTS, OF_A_PLACEMENT = 33, 24, 6


def run() -> dict[str, dict[str, float]]:
    """By number of readings."""
    figures = {}
    with tempfile.TemporaryDirectory() as name:
        for sessions, articulations in SIZES:
            folder = Path(name) / str(sessions)
            design = Design(sessions=sessions, articulations=articulations, holdout=0)
            case = generate_case(folder, 4711, [], design)
            command = [sys.executable, "-m", "armd", "calibrate", *map(str, case.sessions)]
            command += ["--arm", str(case.arm), "-o", str(folder / "cal.json"), "-q"]
            readings = sessions * BALLS * articulations
            figures[f"{readings}_readings"] = {
                **measured(command),
                "floor_s": _dense_step_s(3 * readings, sessions),
            }
    return figures


def _dense_step_s(rows: int, placements: int) -> float:
    unknowns = CONSTANTS + COEFFICIENTS + OF_A_PLACEMENT * placements
    rng = np.random.default_rng(1)
    matrix, right = rng.normal(size=(rows, unknowns)), rng.normal(size=rows)
    began = time.perf_counter()
    cho_solve(cho_factor(matrix.T @ matrix), matrix.T @ right)
    return time.perf_counter() - began


if __name__ == "__main__":
    print(json.dumps(run(), indent=1))
