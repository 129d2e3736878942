"""What `armd calibrate` and `armd verify` take, and how that grows; as a user runs them.

Calibrations of more readings in as many placements, and of as many readings in more placements and
with fewer thermal models; a verification of one campaign. The floor of a calibration is `STEPS`
steps of least squares with everything in one dense matrix, normal equations by Cholesky's factor,
of as many rows and unknowns, and Arrow reading the tables alone; of both, numpy and scipy loaded.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv
from measured import measured
from scipy.linalg import cho_factor, cho_solve

from armd.simulator.campaigns.hidden import Design
from armd.simulator.hidden import generate_case

ARMD = [sys.executable, "-m", "armd"]
#: Sessions, each a placement, and articulations of each of its twenty balls.
SIZES = {
    "2000_readings": (20, 5),
    "20000_readings": (100, 10),
    "20000_readings_in_20_placements": (20, 50),
    "2000_readings_in_100_placements": (100, 1),
}
BALLS = 20
CONSTANTS, COEFFICIENTS, OF_A_PLACEMENT = 33, 24, 6
#: Steps of the descents of one calibration.
STEPS = 20
#: What grows, by which two calibrations tell it.
GROWTH = {
    "readings": ("2000_readings", "20000_readings_in_20_placements", 10),
    "placements": ("2000_readings", "2000_readings_in_100_placements", 5),
    "both": ("2000_readings", "20000_readings", 10),
    "unknowns": ("20000_readings_without_temperature", "20000_readings", 2.3),
}


def run() -> dict[str, dict[str, float]]:
    """By number of readings; powers of processor time, starting taken off, by what grows."""
    figures = {}
    with tempfile.TemporaryDirectory() as name:
        start_s = _start_s()
        for size, (sessions, articulations) in SIZES.items():
            folder = Path(name) / size
            design = Design(sessions=sessions, articulations=articulations, holdout=0)
            case = generate_case(folder, 4711, [], design)
            command = [*ARMD, "calibrate", *map(str, case.sessions), "--arm", str(case.arm)]
            command += ["-o", str(folder / "cal.json"), "--force", "-q"]
            floor_s = start_s + _reading_s(case.sessions)
            floor_s += STEPS * _dense_step_s(3 * sessions * BALLS * articulations, sessions)
            if size == "20000_readings":
                without = measured([*command, "--thermal", "off"])
                figures[f"{size}_without_temperature"] = without
            figures[size] = {**measured(command), "floor_s": floor_s}
        figures["power"] = {
            grows: math.log(
                (figures[more]["processor_s"] - start_s) / (figures[few]["processor_s"] - start_s)
            )
            / math.log(times)
            for grows, (few, more, times) in GROWTH.items()
        }
        figures["verify"] = {**_verified(Path(name) / "verify"), "floor_s": start_s}
    return figures


def shown(figures: Mapping[str, Any]) -> list[str]:
    """Processor time beside its floor, and below it the power with which it grows."""
    rows = [
        f"{name:38} {of['processor_s']:6.2f} s  floor {of.get('floor_s', math.nan):6.2f} s"
        for name, of in figures.items()
        if name != "power"
    ]
    return rows + [f"power of {name:29} {power:6.2f}" for name, power in figures["power"].items()]


def _verified(folder: Path) -> dict[str, float]:
    """Of one simulated campaign of all tests: 298 readings, by the nominal model."""
    simulate = [*ARMD, "simulate", "--session", "verify", "-o", str(folder), "--seed", "5", "-q"]
    measured(simulate)
    arm = str(folder / "arm.toml")
    return measured([*ARMD, "verify", str(folder / "verify"), "--arm", arm, "-q"])


def _start_s() -> float:
    """Processor seconds of Python that loads numpy and the parts of scipy that are needed."""
    program = "import numpy, scipy.optimize, scipy.spatial, pyarrow.csv"
    return measured([sys.executable, "-c", program])["processor_s"]


def _reading_s(sessions: list[Path]) -> float:
    began = time.process_time()
    for session in sessions:
        pyarrow.csv.read_csv(session / "readings.csv")
    return time.process_time() - began


def _dense_step_s(rows: int, placements: int) -> float:
    unknowns = CONSTANTS + COEFFICIENTS + OF_A_PLACEMENT * placements
    rng = np.random.default_rng(1)
    matrix, right = rng.normal(size=(rows, unknowns)), rng.normal(size=rows)
    began = time.process_time()
    cho_solve(cho_factor(matrix.T @ matrix), matrix.T @ right)
    return time.process_time() - began
