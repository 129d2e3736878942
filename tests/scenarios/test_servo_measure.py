"""`armd measure` on arms of servos with five and with seven joints, over the wire."""

from __future__ import annotations

import json
import socket
import subprocess
from pathlib import Path

import numpy as np
import pytest
from programs import program
from so101 import ARMD

SEAT_MM = (220.0, -60.0, 90.0)
HAND = """\
schema = "armd.operator/1"
rest_s = 1.6
press_after_s = 1.2
haste = 2.0
start_s = 6.0

[[visit]]
placement = "P1"
rounds = 6
position_mm = [0.0, 0.0, 0.0]
"""


@pytest.mark.slow
@pytest.mark.parametrize(("family", "n"), [("feetech", 5), ("dynamixel", 7)])
def test_seats_are_measured_with_any_number_of_joints(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, family: str, n: int
) -> None:
    """Nominal geometry: a reading is where the seat is to within what the arm's making leaves. One
    seat, and two more presses than are asked for: of the first ones nobody may hear yet."""
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    plan = tmp_path / "plan.toml"
    plan.write_text(f'{HAND}\n[[target]]\nname = "S1"\nposition_mm = {list(SEAT_MM)}\n')
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    port, config = tmp_path / "port", tmp_path / "armd.toml"
    config.write_text(
        f'schema = "armd.daemon/1"\narm = "arm.toml"\n[driver]\nkind = "{family}"\n'
        f'port = "{port}"\nbaud = 1000000\nids = {list(range(1, n + 1))}\n'
        f"temperature_ids = {list(range(2, n + 2))}\n"
        f"trigger = {{ id = {n + 1}, pressed_below = 1900 }}\n[zenoh]\nlisten = ['{endpoint}']\n"
    )
    simulate = ["simulate", "--servo", family, "--joints", str(n), "--link", str(port)]
    simulate += ["--arm-out", str(tmp_path / "arm.toml"), "--operator", str(plan)]
    measure = ["measure", "seats", "--endpoint", endpoint, "--json", "--seconds", "120"]
    measure += ["--targets", "S1", "--repeats", "4", "--then", "none"]
    measure += ["-o", str(tmp_path / "seats")]
    with (
        program([*ARMD, *simulate, "--seconds", "200"], tmp_path / "arm.log"),
        program([*ARMD, "run", str(config)], tmp_path / "daemon.log", "armd: ready"),
    ):
        done = subprocess.run([*ARMD, *measure], capture_output=True, text=True, check=False)
    told = [json.loads(line) for line in done.stdout.splitlines()]
    assert done.returncode == 0, (done.stderr, told)
    readings = [line for line in told if line["event"] == "reading"]
    assert len(readings) == 4 and told[-1]["finished"]
    away_mm = [np.subtract(reading["position_mm"], SEAT_MM) for reading in readings]
    assert np.linalg.norm(away_mm, axis=1).max() < 10.0
