"""`armd measure` on arms of servos with five and with seven joints, over the wire."""

from __future__ import annotations

import csv
import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from programs import program
from so101 import ARMD

from armd.daemon.cli import main
from support.running_daemon import free_endpoint

SEAT_MM = (220.0, -60.0, 90.0)
HAND = """\
schema = "armd.operator/1"
rest_s = 1.6
press_after_s = 1.2
haste = 2.0
start_s = 6.0

[[visit]]
placement = "P1"
rounds = 12
position_mm = [0.0, 0.0, 0.0]
"""


def measured(tmp_path: Path, family: str, n: int, seat: str, *measure: str) -> list[dict[str, Any]]:
    """`armd measure` on a simulated arm of *n* servos that goes to one seat again and again."""
    plan = tmp_path / "plan.toml"
    plan.write_text(f'{HAND}\n[[target]]\nname = "{seat}"\nposition_mm = {list(SEAT_MM)}\n')
    endpoint = free_endpoint()
    port, config = tmp_path / "port", tmp_path / "armd.toml"
    config.write_text(
        f'schema = "armd.daemon/1"\narm = "arm.toml"\n[driver]\nkind = "{family}"\n'
        f'port = "{port}"\nbaud = 1000000\nids = {list(range(1, n + 1))}\n'
        f"temperature_ids = {list(range(2, n + 2))}\n"
        f"trigger = {{ id = {n + 1}, pressed_below = 1900 }}\n[zenoh]\nlisten = ['{endpoint}']\n"
    )
    simulate = ["simulate", "--servo", family, "--joints", str(n), "--link", str(port)]
    simulate += ["--arm-out", str(tmp_path / "arm.toml"), "--operator", str(plan)]
    common = ["--endpoint", endpoint, "--json", "--seconds", "120"]
    with (
        program([*ARMD, *simulate, "--seconds", "200"], tmp_path / "arm.log"),
        program([*ARMD, "run", str(config)], tmp_path / "daemon.log", "armd: ready"),
    ):
        done = subprocess.run(
            [*ARMD, "measure", *measure, *common], capture_output=True, text=True, check=False
        )
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, (done.stderr, told)
    return told


@pytest.mark.slow
@pytest.mark.parametrize(("family", "n"), [("feetech", 5), ("dynamixel", 7)])
def test_seats_are_measured_with_any_number_of_joints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, family: str, n: int
) -> None:
    """Nominal geometry: a reading is where the seat is to within what the arm's making leaves. One
    seat, and two more presses than are asked for: of the first ones nobody may hear yet."""
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    options = ["--targets", "S1", "--repeats", "4", "--then", "none", "-o", str(tmp_path / "seats")]
    told = measured(tmp_path, family, n, "S1", "seats", *options)
    readings = [line for line in told if line["event"] == "reading"]
    assert len(readings) == 4 and told[-1]["finished"]
    away_mm = [np.subtract(reading["position_mm"], SEAT_MM) for reading in readings]
    assert np.linalg.norm(away_mm, axis=1).max() < 10.0


@pytest.mark.slow
def test_a_seat_is_visited_and_its_repeatability_follows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The result is that of the positions that were told, by numpy."""
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    out, visits = tmp_path / "visits", 8
    options = ["--repeats", str(visits), "-o", str(out)]
    told = measured(tmp_path, "feetech", 5, "seat", "repeatability", *options)
    readings = [line for line in told if line["event"] == "reading"]
    assert len(readings) == visits and told[-1]["finished"]
    (result,) = [line for line in told if line["event"] == "result"]
    assert "armd feature repeatability" in result["command"]
    assert "3-D standard deviation of 8 visits" in result["output"]
    found = json.loads((out / "repeatability.json").read_text())
    assert found["n"] == visits
    assert "<svg" in (out / "repeatability.html").read_text()
    # Within a minute there may be a drift by temperature, or none.
    position_um = 1e3 * np.array([reading["position_mm"] for reading in readings])
    around = position_um - position_um.mean(axis=0)
    with (out / "readings.csv").open() as file:
        rows = list(csv.DictReader(file))
    celsius = np.array([[float(row[name]) for name in found["sensors"]] for row in rows])
    celsius = celsius.mean(axis=1)
    drifts = [np.ones(visits)] + ([celsius] if np.ptp(celsius) >= 0.1 else [])
    design = np.column_stack(drifts)
    left = around - design @ np.linalg.lstsq(design, around, rcond=None)[0]
    expected = np.sqrt((left**2).sum() / (visits - len(drifts)))
    assert found["repeatability_um"] == pytest.approx(expected, rel=1e-3)


def test_the_hand_of_these_tests_is_a_plan_that_check_accepts(tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(f'{HAND}\n[[target]]\nname = "S1"\nposition_mm = {list(SEAT_MM)}\n')
    assert main(["check", str(plan)]) == 0
