"""Refuses surfaces and reflectors where a command accepts only points of one tip."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.session import Session
from armd.errors import BadInput

#: For commands that accept only points of one tip: the reason, and an alternative.
INSTEAD = {
    "`armd design`": "it chooses a posture at a point, and how far a surface extends no file"
    " states; touch it wherever the arm reaches it, 40 times in each placement, and `armd"
    " diagnose` says what is left to tell",
    "`armd interim`": "a check of joints repeats the same points; of surfaces add tables of points"
    " (docs/how-to/interim.md), `armd diagnose` with the calibration has what changed",
    "`armd measure`": "poses and interim checks go to points with a name; `armd measure artefact`"
    " and `armd measure verify` lead over surfaces",
}
ELSEWHERE = (
    "`armd calibrate` and `armd diagnose` use them, and `armd evaluate` of fewer readings at once"
)


def refuse_surfaces(artefact: Artefact, place: str | Path, command: str) -> None:
    """Raise `BadInput`, which names *place*, for an artefact with a surface."""
    if artefact.surfaces:
        surface = artefact.surfaces[0]
        raise BadInput(
            place,
            "artefact.surface[1]",
            f"{surface.name!r}, a {surface.kind}",
            f"points: {command} does not use surfaces: {INSTEAD.get(command, ELSEWHERE)}",
        )


def require_points(sessions: Sequence[Session], command: str) -> None:
    """Raise `BadInput` for the first session with a surface, or with readings of reflectors."""
    for session in sessions:
        refuse_surfaces(session.artefact, session.path / "session.toml", command)
    refuse_reflectors(sessions, command)


def refuse_reflectors(sessions: Sequence[Session], command: str) -> None:
    """Raise `BadInput` for the first session with readings of reflectors."""
    for session in sessions:
        if session.reflector is not None:
            raise BadInput(
                session.path,
                "column reflector",
                f"{', '.join(session.reflector_names[:3])}",
                f"readings of one tip: {command} does not use reflectors: {ELSEWHERE}",
            )
