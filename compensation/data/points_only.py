"""Refuse surfaces and reflectors where a command takes points of one tip alone."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from armd.compensation.data.session import Session
from armd.compensation.data.session_format import Artefact
from armd.errors import BadInput


def refuse_surfaces(artefact: Artefact, place: str | Path, command: str) -> None:
    """Raise `BadInput`, which names *place*, for an artefact with a surface."""
    if artefact.surfaces:
        surface = artefact.surfaces[0]
        raise BadInput(
            place,
            "artefact.surface[1]",
            f"{surface.name!r}, a {surface.kind}",
            f"points: {command} does not use surfaces; `armd calibrate`, `armd evaluate` and"
            " `armd diagnose` do",
        )


def require_points(sessions: Sequence[Session], command: str) -> None:
    """Raise `BadInput` for the first session with a surface, or with readings of reflectors."""
    for session in sessions:
        refuse_surfaces(session.artefact, session.path / "session.toml", command)
        if session.reflector is not None:
            raise BadInput(
                session.path,
                "column reflector",
                f"{', '.join(session.reflector_names[:3])}",
                f"readings of one tip: {command} does not use reflectors; `armd calibrate`,"
                " `armd evaluate` and `armd diagnose` do",
            )
