"""Write measurements of a running arm as a session's folder for `armd calibrate`."""

from __future__ import annotations

import datetime
import math
from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

from armd import Flag
from armd.compensation.data.sessions.columns import APPROACH
from armd.compensation.data.sessions.files import READINGS
from armd.compensation.data.sessions.format import Artefact, ArtefactFile
from armd.compensation.data.sessions.writing import write_session
from armd.compensation.model.arm import Arm
from armd.errors import BadInput
from armd.files.schema import load_toml, validate
from armd.terminal.counted import format_count

SEAT = "seat"


class SessionFolder:
    """A session in the making; on disk it is complete after every reading."""

    def __init__(
        self, path: Path, arm: Arm, artefact: Artefact, targets: Sequence[str], placement: str
    ) -> None:
        """Prepare a session in which the tip goes to *targets* in turn, repeatedly.

        Raises `BadInput` if *path* holds a session already, or the artefact has no target of that
        name.
        """
        if path.exists() and not path.is_dir():
            raise BadInput(path, "the session", "a file", "a new or empty folder")
        for name in ("session.toml", *READINGS):
            if (path / name).exists():
                raise BadInput(path, "the folder", name, "a new or empty folder")
        for name in targets:
            if name not in artefact.target_names:
                expected = f"targets of the artefact: {', '.join(artefact.target_names)}"
                raise BadInput("the command line", "--targets", repr(name), expected)
        self._path = path
        self._arm = arm
        self._artefact = artefact.model_dump(by_alias=True, exclude_defaults=True)
        self._targets = cycle(targets)
        self._placement = placement
        self._started_s = 0  # Unix time of the first reading, in whole seconds
        self._rows: list[dict[str, str | float]] = []
        self.target = next(self._targets)  # of the next reading

    @property
    def n(self) -> int:
        return len(self._rows)

    def take(self, measurement: dict[str, Any]) -> str:
        """Write one more reading; return a message for the operator.

        A measurement that cannot be a reading is skipped, and its target stays the next.
        """
        if reason := explain_unfit(measurement):
            return f"left out, {reason[1]}"
        if not self._rows:
            self._started_s = measurement["stamp_ns"] // 10**9
        location = self._placement, self.target
        self._rows.append(make_reading_row(measurement, self._arm, self._started_s, *location))
        write_readings(self._path, self._arm, self._artefact, self._started_s, self._rows)
        target, self.target = self.target, next(self._targets)
        if measurement["standard_deviation_mm"] is None:
            return f"{target}: one point, whose scatter nobody knows"
        spread_um = 1000 * math.hypot(*measurement["standard_deviation_mm"])
        return (
            f"{target}: {format_count(measurement['count'], 'point')}, scatter {spread_um:.1f} µm"
        )


def make_reading_row(
    measurement: Mapping[str, Any], arm: Arm, started_s: int, placement: str, target: str
) -> dict[str, str | float]:
    """Convert a measurement as published to a row of a session.

    The session began at *started_s* (Unix time).
    """
    joints = range(1, arm.n_joints + 1)
    unknown = [math.nan] * arm.n_joints
    # At rest the rates show only the side of approach. Without the direction of travel a reader
    # would derive one from them, so rates are written only with an approach.
    approach = measurement["approach"]
    rates = measurement["rates_rad_s"] if approach else None
    celsius = measurement["temperatures_c"]
    return {
        "time_s": (measurement["stamp_ns"] - started_s * 10**9) * 1e-9,
        "placement": placement,
        "target": target,
        **{f"q{k}": value for k, value in zip(joints, measurement["angles_rad"], strict=True)},
        **{f"w{k}": value for k, value in zip(joints, rates or unknown, strict=True)},
        **{name: _to_number(celsius[name]) for name in arm.sensors},
        **dict(zip(APPROACH, approach or [math.nan] * 3, strict=True)),
    }


def write_readings(
    path: Path,
    arm: Arm,
    artefact: Mapping[str, Any],
    started_s: int,
    rows: Sequence[Mapping[str, str | float]],
) -> None:
    """Write the session's folder whole; *rows* is not empty."""
    content = {
        "schema": "armd.session/1",
        "arm": arm.serial_number,
        "started": datetime.datetime.fromtimestamp(started_s, datetime.UTC),
        "artefact": artefact,
    }
    write_session(path, content, {name: [row[name] for row in rows] for name in rows[0]})


def load_artefact(path: Path | None, targets: Sequence[str]) -> Artefact:
    """Return the artefact of a file.

    Without a file it has *targets* (none: one) that are fixed points at unknown positions.
    """
    if path is not None:
        return load_toml(path, ArtefactFile).artefact
    seats = [{"name": name} for name in dict.fromkeys(targets or [SEAT])]
    return validate("--targets", {"name": SEAT, "target": seats}, Artefact)


def explain_unfit(measurement: Mapping[str, Any]) -> tuple[str, str] | None:
    """Return why a measurement cannot be a reading: the reason's name and words.

    Returns None if it can be one.
    """
    flags = Flag(measurement["flags"])
    if measurement["count"] == 0:
        return "invalid", "the arm's points are invalid"
    if Flag.TEMPERATURE_STALE in flags:
        return "temperature", "a temperature in use is stale"
    if Flag.AT_REST not in flags:
        return "moving", "the tip had not rested for half a second"
    return None


def _to_number(value: float | None) -> float:
    return math.nan if value is None else value
