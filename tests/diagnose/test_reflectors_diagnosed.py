"""`armd diagnose` of a nest of reflectors: each one a tip of its own."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import armd
from armd.compensation.data.sessions.session import load_sessions
from armd.compensation.diagnose.problem.rests import collect_rests, count_spare_rows
from armd.compensation.model.arm import load_arm
from armd.daemon.cli import main
from armd.simulator.plants.live import plant_in_arm
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from support.reflector_nest import NEST, TRACKER_MM, write_nest_session


def measured(folder: Path, given: Sequence[str], plant: str, poses: int = 60) -> Path:
    """Sessions *before* the plant and *now*, and the arm.toml beside them."""
    true, rng = TrueArm.default(1), np.random.default_rng(1)
    write_nest_session(folder / "before", true, rng, poses, given)
    write_nest_session(folder / "now", plant_in_arm(true, [plant], 1), rng, poses, given)
    (folder / "arm.toml").write_text(nominal.make_arm_toml(), encoding="utf-8")
    return folder / "arm.toml"


@pytest.mark.slow
def test_a_bad_encoder_is_found_by_reflectors_of_unknown_place(tmp_path: Path) -> None:
    arm = measured(tmp_path, (), "encoder_eccentricity@joint 3=4", poses=30)
    found = armd.diagnose([tmp_path / "now"], arm)
    (finding,) = found.findings
    assert (finding.cause, finding.location) == ("encoder_eccentricity", "joint 3")
    # The tracker's noise, and 1e-5 rad of six encoders at up to a metre.
    assert 1e3 * TRACKER_MM < found.baseline.noise_floor_um < 2.5e3 * TRACKER_MM
    assert finding.gain.heldout_rms_um_after < 1.2 * found.baseline.noise_floor_um
    content = load_arm(arm)
    rests = collect_rests(load_sessions([tmp_path / "now"], content), content)
    assert count_spare_rows(rests.observations) == 3 * 30 * len(NEST) - 6 - 3 * len(NEST)


@pytest.mark.slow
@pytest.mark.parametrize("given", [(), tuple(NEST)])
def test_a_bent_joint_is_found_under_a_calibration(given: Sequence[str], tmp_path: Path) -> None:
    arm = measured(tmp_path, given, "geometry_shift@joint 2=60")
    before = armd.calibrate([tmp_path / "before"], arm)
    found = armd.diagnose([tmp_path / "now"], arm, before)
    (finding,) = found.findings
    assert (finding.cause, finding.location) == ("geometry_shift", "joint 2")
    assert finding.gain.heldout_rms_um_after < 0.4 * finding.gain.heldout_rms_um_before
    extended = found.extended
    assert extended is not None
    after = armd.evaluate([tmp_path / "now"], arm, extended)
    assert after.rms_um < 0.4 * found.baseline.rms_um


def test_a_nest_that_is_given_whole_is_evaluated(tmp_path: Path) -> None:
    write_nest_session(
        tmp_path / "session", TrueArm.default(1), np.random.default_rng(2), 10, tuple(NEST)
    )
    (tmp_path / "arm.toml").write_text(nominal.make_arm_toml(), encoding="utf-8")
    out = tmp_path / "out.json"
    words = ["evaluate", str(tmp_path / "session"), "--arm", str(tmp_path / "arm.toml")]
    assert main([*words, "--json", str(out)]) == 0
    found = json.loads(out.read_text(encoding="utf-8"))["reflectors"]
    for name, offset in NEST.items():
        assert np.allclose(found[name]["offset_mm"], offset)
        assert found[name]["standard_uncertainty_mm"] == [0.0, 0.0, 0.0]
