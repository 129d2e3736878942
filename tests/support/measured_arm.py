"""A synthetic arm's files, and readings of it as columns, for tests of the public functions."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from armd.compensation.data.sessions.session import Session
from armd.compensation.data.sessions.writing import write_session
from armd.compensation.model.arm import Arm
from armd.files.toml_text import format_toml
from support import synthetic

Columns = dict[str, Any]


@dataclass(frozen=True)
class MeasuredArm:
    """An arm.toml, and a session as plain data."""

    arm: Arm
    arm_file: Path
    columns: Columns
    artefact: dict[str, Any]


def measured_arm(folder: Path, seed: int = 1, **options: Any) -> MeasuredArm:
    """Write arm.toml to *folder*; readings are of an arm that differs from it, with noise."""
    rng = np.random.default_rng(seed)
    arm = synthetic.arm()
    options = {"readings": 72, "encoder_rad": 5e-6, "placements": 4} | options
    session = synthetic.session(arm, synthetic.disturbed(arm, rng), rng, **options)
    artefact = session.artefact.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    return MeasuredArm(arm, write_arm(folder, arm), columns_of(session), artefact)


def write_arm(folder: Path, arm: Arm) -> Path:
    """Write arm.toml to *folder*, and return its path."""
    content = arm.model_dump(mode="json", by_alias=True, exclude_defaults=True)
    (folder / "arm.toml").write_text(format_toml(content), encoding="utf-8")
    return folder / "arm.toml"


def write_folder(
    folder: Path,
    session: Session,
    *,
    expansion_per_k: float = 0.0,
    parquet: bool = False,
    **columns: Any,
) -> str:
    """Write a synthetic session, *columns* in place of its own; return its folder."""
    artefact = session.artefact.model_dump(exclude_none=True, by_alias=True)
    content = {
        "schema": "armd.session/1",
        "arm": session.arm,
        "started": synthetic.STARTED,
        "angle_unit": "rad",
        "artefact": artefact | {"expansion_per_k": expansion_per_k},
    }
    truth = dict(zip(("x_mm", "y_mm", "z_mm"), session.truth_mm.T, strict=True))
    write_session(folder, content, columns_of(session) | truth | columns, parquet=parquet)
    return str(folder)


def columns_of(session: Session) -> Columns:
    """The session's readings with the contract's columns."""
    states = session.states
    names = np.array(session.artefact.target_names)
    columns: Columns = {
        "time_s": states.time_s - session.started_unix_s,
        "placement": np.array(session.placement_names)[session.placement],
        "target": names[session.target],
    }
    within = np.remainder(states.q + np.pi, 2 * np.pi) - np.pi  # no turn is in doubt
    columns |= {f"q{k}": angle for k, angle in enumerate(within.T, 1)}
    return columns | {f"t{k}": celsius for k, celsius in enumerate(states.temperature_c.T, 1)}
