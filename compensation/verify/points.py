"""Verify an arm by points alone, as its own host reports them, without joint angles."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from armd.compensation.data.foreign.points import read_points
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.session import Session
from armd.compensation.model.arm import Arm
from armd.compensation.model.state import States
from armd.compensation.verify.figures import evaluate_figures
from armd.compensation.verify.limits import TestUncertainty
from armd.compensation.verify.results import Verification
from armd.errors import BadInput
from armd.files.inputs import hash_input
from armd.terminal.suggest import suggest_names

#: Used in place of an arm of which only the points are known.
UNKNOWN = {"schema": "armd.arm/1", "serial_number": "-", "joint": [{}, {}, {}]}


@dataclass(frozen=True)
class PointsVerification:
    """The verification of a table of points, and the assumptions made in reading it."""

    verification: Verification
    session: Session
    arm: Arm
    messages: list[str]


def verify_points(
    path: Path,
    artefact: Artefact | None,
    tip_radius_mm: float,
    test: TestUncertainty,
    *,
    judged: bool,
) -> PointsVerification:
    """Compute all figures that the table at *path* supports; raises `BadInput`.

    *judged*: by limits, for which a test has to be complete; otherwise each seat has its own SPAT.
    """
    points = read_points(path)
    artefact = (
        artefact or Artefact.model_validate({"name": path.stem, "target": []})
    ).with_documented(points.target)
    names = artefact.target_names
    for row, name in enumerate(points.target, 1):
        if name not in names:
            suggestion = suggest_names(name, names)
            expected = f"a name of docs/how-to/verify.md, or of the artefact's targets{suggestion}"
            raise BadInput(path, f"row {row}, target", repr(name), expected)
    n = len(points.target)
    unknown = np.full((n, 3), np.nan)
    placements = list(dict.fromkeys(points.placement))
    states = States(
        q=np.zeros((n, 3)),
        rate=unknown,
        temperature_c=np.empty((n, 0)),
        time_s=np.full(n, np.nan),
        approach=unknown,
        series=np.zeros(n, np.int64),
    )
    arm = Arm.model_validate(UNKNOWN | {"tip": {"radius_mm": tip_radius_mm}})
    session = Session(
        path=path,
        name=path.name,
        arm=arm.serial_number,
        started_unix_s=0.0,
        artefact=artefact,
        states=states,
        placement=np.array([placements.index(name) for name in points.placement], np.int64),
        placement_names=placements,
        target=np.array([names.index(name) for name in points.target], np.int64),
        truth_mm=unknown,
        artefact_c=np.full(n, np.nan),
        unused_columns=[],
        row=np.arange(n),
        digest=lambda: hash_input(path),
    )
    verification = evaluate_figures(session, arm, points.position_mm, test, complete=judged)
    return PointsVerification(verification, session, arm, points.remarks)
