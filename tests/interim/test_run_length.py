"""How often the alarm's statistic, simulated without a change, passes its limit."""

from __future__ import annotations

from pathlib import Path

import pytest
from run_length import alarms_and_watched, noise_alone
from scipy.stats import binom
from test_interim_history import measured, true_calibration

from armd.compensation.data.session import load_sessions
from armd.compensation.interim.checks.columns import causes_of
from armd.compensation.interim.checks.reduce import reduce
from armd.compensation.interim.evidence.likelihood import LIMIT, RUN_LENGTH
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration

#: One false alarm in so many checks at most.
MARK = 300.0


@pytest.mark.slow
def test_false_alarms_are_about_as_rare_as_is_said(tmp_path: Path) -> None:
    folder = measured(tmp_path / "checks", "--days", "24")
    true_calibration(folder)
    arm = load_arm(folder / "arm.toml")
    calibration = load_calibration(folder / "calibration.json", arm).content
    causes = causes_of(arm, calibration)
    month = [
        reduce(session, arm, calibration, causes)
        for session in load_sessions(sorted(folder.glob("day-*")), arm)
    ]
    statistics = noise_alone(month, causes, checks=120, draws=80, seed=34)
    alarms, watched = alarms_and_watched(statistics, LIMIT)
    # As often as the mark allows, or as is said: neither is refuted, with 1 % on either side.
    assert alarms <= binom.ppf(0.99, watched, 1 / MARK), (alarms, watched)
    assert alarms >= binom.ppf(0.01, watched, 1 / (2 * RUN_LENGTH)), (alarms, watched)
