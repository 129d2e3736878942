"""False alarms of the whole path: histories without a change, simulated, added and judged by the
command `armd interim add` itself."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout

from bench import Bench
from scipy.stats import beta

from armd.compensation.interim.checks.chain import REPORT
from armd.daemon.cli import main as main_command
from armd.simulator.campaigns import interim
from armd.simulator.measured.measuring import write_session
from armd.simulator.measured.noise import Noise


def whole_path(
    benches: Sequence[Bench], seed: int, checks: int, histories: int
) -> tuple[int, int, int]:
    """Alarms, checks watched and good checks called bad in *histories* of *checks* checks without
    a change. A history is watched until its first alarm; that one counts though it be withdrawn."""
    alarms = watched = bad = 0
    for number in range(histories):
        bench = benches[number % len(benches)]
        artefact = list(interim.ARTEFACTS)[number // len(benches) % len(interim.ARTEFACTS)]
        history = interim.CheckSeries(checks, artefact=artefact)
        result = _added(bench, history, 1000 * seed + 500 + number)
        over = [i for i, one in enumerate(result["checks"]) if one["statistic"] >= one["limit"]]
        called_bad = sum(one["verdict"] == "bad_check" for one in result["checks"])
        alarms += bool(over)
        watched += over[0] + 1 if over else checks
        bad += called_bad
        print(f"history {number}, {artefact}: alarm {over[:1]}, bad {called_bad}; "
              f"{alarms} in {watched}, {bad} called bad", file=sys.stderr, flush=True)  # fmt: skip
    return alarms, watched, bad


def interval(alarms: int, watched: int) -> tuple[float, float]:
    """Once in so many checks: the 95 % interval of *alarms* in *watched* (Clopper, Pearson)."""
    low = float(beta.ppf(0.975, alarms + 1, watched - alarms))
    high = float(beta.ppf(0.025, alarms, watched - alarms + 1)) if alarms else 0.0
    return 1.0 / low, 1.0 / high if high else float("inf")


def _added(bench: Bench, history: interim.CheckSeries, seed: int) -> dict:
    """What `armd interim add` reports of a history's checks."""
    folder = bench.folder / f"history-{seed}"
    sessions = []
    for measured in interim.measure_checks(history, bench.seed, Noise(), seed):
        sessions.append(folder / measured.plan.name)
        write_session(sessions[-1], measured)
    files = ("--arm", bench.folder / "arm.toml", "--calibration", bench.folder / "calibration.json")
    words = ["interim", "add", *sessions, *files, "--history", folder / "kept"]
    with redirect_stdout(sys.stderr):
        main_command([str(word) for word in words])
    found: dict = json.loads((folder / "kept" / REPORT).read_text())
    shutil.rmtree(folder)
    return found
