"""Arms of three to nine joints by the commands that need no arm: measured, calibrated, judged, and
the next poses chosen."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from armd.daemon import cli
from support import synthetic
from support.measured_arm import write_arm, write_folder

COUNT_RAD = 2e-6


def _measured(n: int, truth: np.ndarray, rng: np.random.Generator) -> synthetic.Session:
    """Balls in three placements; an arm of three joints cannot come to one in two ways, and is
    followed by a tracker."""
    arm = synthetic.arm(n)
    if n == 3:
        return synthetic.tracked(arm, truth, rng)
    return synthetic.session(arm, truth, rng, readings=30 * n, encoder_rad=COUNT_RAD)


@pytest.mark.parametrize(
    "n", [3, 5, pytest.param(7, marks=pytest.mark.slow), pytest.param(9, marks=pytest.mark.slow)]
)
def test_calibrated_judged_and_the_next_poses_chosen(n: int, tmp_path: Path) -> None:
    rng = np.random.default_rng(n)
    truth = synthetic.disturbed(synthetic.arm(n), rng)
    arm = write_arm(tmp_path, synthetic.arm(n))
    measured = write_folder(tmp_path / "measured", _measured(n, truth, rng))
    fresh = write_folder(tmp_path / "fresh", _measured(n, truth, rng))
    cal, poses, judged = (str(tmp_path / f) for f in ("cal.json", "poses.csv", "judged.json"))
    assert cli.main(["check", str(arm), measured]) == 0
    assert cli.main(["calibrate", measured, "--arm", str(arm), "-o", cal]) == 0
    with_cal = ["--arm", str(arm), "--calibration", cal]
    assert cli.main(["evaluate", fresh, *with_cal, "--json", judged]) == 0
    reach_mm = 400.0 * n
    assert json.loads(Path(judged).read_text())["rms_um"] < 1e3 * reach_mm * COUNT_RAD * np.sqrt(n)
    assert cli.main(["design", measured, *with_cal, "-o", poses]) == 0
    with Path(poses).open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) >= 12 and f"q{n + 1}_deg" not in rows[0]
    angles = np.array([[float(row[f"q{k}_deg"]) for k in range(1, n + 1)] for row in rows])
    assert np.isfinite(angles).all() and np.ptp(angles, axis=0).min() > 10
