"""Thermal causes under calibrations of one temperature, of two, and under none, by their truth.

The sets' README says what was planted, and what a fit errs by that is told the cause.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session, load_sessions
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.report.diagnosis.signature_plot import make_signature_plot
from support.selection import parametrize_default

SETS = Path(__file__).parent / "thermal"
TIP_LABEL = "fitted effect at the tip, µm"  # of what depends on several variables
#: Written models err by at most so many times what the fit does that is told the cause.
NEARLY = 1.05


@dataclass(frozen=True)
class Truth:
    name: str
    cause: str
    places: tuple[str, ...]
    size: float  # of the first amplitude; 0: the set does not say, or not in this form
    oracle_um: float


TRUTHS = (
    Truth("expansion", "link_expansion", ("link 3",), 3.2e-6, 3.66),
    Truth("joint-thermal", "joint_thermal", ("joint 2",), 2.67e-6, 3.55),
    Truth("nonlinear", "nonlinear_expansion", ("link 5",), 0.0, 3.74),
    Truth("lag", "thermal_lag", ("link 2", "sensor t2"), 0.0, 3.99),
)


@parametrize_default("truth", TRUTHS, ids=lambda truth: truth.name)
def test_the_cause_is_named_sized_and_written(truth: Truth) -> None:
    folder = SETS / truth.name
    arm = load_arm(folder / "arm.toml")
    given = _sessions(folder / "calib", arm)
    calibration = calibrate(given, arm).calibration if given else None
    diagnosis = diagnose(_sessions(folder / "train", arm), arm, calibration)
    first = diagnosis.findings[0]
    assert first.candidate.cause == truth.cause
    assert str(first.candidate.location) in truth.places
    assert first.probability > 0.9
    assert diagnosis.written == (0,)  # and nothing else is confirmed
    if truth.size:
        value, sigma = (
            diagnosis.search.last.amplitudes[0][0],
            float(np.sqrt(diagnosis.search.last.covariances[0][0, 0])),
        )
        assert value == pytest.approx(truth.size, abs=3.0 * sigma)
        assert sigma < 0.1 * truth.size
    (panel,) = make_signature_plot(diagnosis, 0).axes
    assert panel.get_xlabel() in (*(f"{name}, °C" for name in arm.sensors), TIP_LABEL)
    assert panel.get_ylabel().startswith("correction ") and panel.get_ylabel()[-1] in "m″"
    assert "fitted effect" in [text.get_text() for text in panel.get_legend().get_texts()]
    held_out = evaluate(_sessions(folder / "holdout", arm), arm, diagnosis.extended)
    assert float(np.sqrt((held_out.distance_um**2).mean())) < NEARLY * truth.oracle_um


def _sessions(folder: Path, arm: Arm) -> Sequence[Session]:
    paths = sorted(map(str, folder.iterdir())) if folder.is_dir() else []
    return load_sessions(paths, arm) if paths else ()
