"""Single readings that are far off in a check that is bad or may be."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from armd.compensation.data.sessions.session import Session
from armd.compensation.estimate.noise.robust import MONSTROUS, SUSPECT
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.identify.admission.far_off import (
    FarOff,
    find_far_readings,
    measure_distances_mm,
)
from armd.compensation.identify.admission.mistakes import AssumedModel
from armd.compensation.interim.checks import history
from armd.compensation.interim.checks.history import Check
from armd.compensation.interim.report.judgement import Judgement

#: Whether a check is bad is undecided until this many later ones are there.
UNDECIDED = 3


def list_single_readings(folder: Path, judgement: Judgement) -> Iterator[str]:
    """Yield the readings that are far off in checks that are bad, or may still be so.

    Each sentence also states whether the reading counts.
    """
    for epoch in judgement.epochs:
        for i, check in enumerate(epoch.checks):
            bad = i in epoch.detected.bad
            if not bad and i < len(epoch.checks) - UNDECIDED:
                continue
            session = history.load_measured(folder, check)
            fate = "not counted, as nothing of its check is" if bad else "counted until now"
            # New backlash in a joint makes readings ten times as far off as others, and is a
            # change.
            changed = any(i >= change.first for change in epoch.detected.changes)
            far_readings = _find_far_readings(
                session, check, SUSPECT if bad and not changed else MONSTROUS
            )
            for line in far_readings.in_words(session):
                yield f"{line}; {fate}"


def _find_far_readings(session: Session, check: Check, times: float) -> FarOff:
    calibration = check.calibration.content
    observations = collect_observations([session], check.arm, calibration.artefact)
    model = AssumedModel.from_calibration(check.arm, calibration)
    return find_far_readings(measure_distances_mm(observations, model.tip_mm(observations)), times)
