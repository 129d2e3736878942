"""Halves of the ball-in-socket sets: one is diagnosed, the other judges, the scale kept.

A smaller arm scatters less: what a diagnosis calls better must be so against the certified length.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from convert import ROBOTS

from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.report.result import as_json
from armd.compensation.diagnose.report.verdict import write_verdict
from armd.compensation.estimate.gauge import PLAUSIBLE
from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import Calibration
from support.long_case import long_case
from support.planting import rms_um


def scatter_um(session: Session, arm: Arm, calibration: Calibration) -> float:
    """3-D RMS about the seats, stated with the arm as large as drawn."""
    lengths = np.array([parameters.find_unit(n) == "mm" for n in arm.layout.names])
    drawn, now = arm.nominal() * lengths, calibration.vector(arm.n_joints) * lengths
    return rms_um([session], arm, calibration) * float(drawn @ drawn) / float(now @ drawn)


def judge(converted: Path, robot: str, seed: int) -> None:
    arm = load_arm(converted / robot / "arm.toml")
    whole = load_session(converted / robot / "seats", arm)
    one = np.random.default_rng(seed).permutation(whole.n) < whole.n // 2
    diagnosis = diagnose([whole.rows(one)], arm)
    before, after = diagnosis.baseline.calibration, diagnosis.extended
    change = np.abs(after.vector(arm.n_joints) - before.vector(arm.n_joints))
    most = [PLAUSIBLE[parameters.find_unit(name)] for name in arm.layout.names]
    assert (change <= most).all()
    other = whole.rows(~one)
    was, now = scatter_um(other, arm, before), scatter_um(other, arm, after)
    assert now < 1.02 * was
    if diagnosis.gains:  # placements left out are harder than a random half: not promised too much
        assert diagnosis.gains[-1].after_um > 0.8 * now
    for refused in diagnosis.search.refused:
        assert refused.reason in write_verdict(diagnosis)


def test_an_arm_is_not_folded_away(converted: Path) -> None:
    """A link of 262 mm became nothing, the certified 50 mm −38, and that was called a gain."""
    judge(converted, "dinova_1", 2)


@pytest.mark.slow
@pytest.mark.parametrize("robot", sorted(ROBOTS))
@pytest.mark.parametrize("seed", [0, *map(long_case, range(1, 5))])
def test_halves_agree(converted: Path, robot: str, seed: int) -> None:
    judge(converted, robot, seed)


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "seed"), [("panda_1", 0), ("panda_1", 2), ("kuka_14", 0)])
def test_no_cause_is_told_that_is_less_likely_than_another(
    converted: Path, robot: str, seed: int
) -> None:
    arm = load_arm(converted / robot / "arm.toml")
    whole = load_session(converted / robot / "seats", arm)
    one = np.random.default_rng(seed).permutation(whole.n) < whole.n // 2
    findings = as_json(diagnose([whole.rows(one)], arm), None)["findings"]
    assert findings
    for finding in findings:
        if finding["cause"] != "unknown":
            others = [rival["probability"] for rival in finding["alternatives"]]
            assert finding["probability"] >= max(others, default=0.0)
