"""armd's own files as JSON schemas, so that editors complete keys and mark what is wrong."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel

from armd.compensation.data.session_format import ArtefactFile, SessionFile
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.report.about import About
from armd.compensation.verify.limits import PermissibleErrors
from armd.daemon.config import DaemonFile

DIALECT = "https://json-schema.org/draft/2020-12/schema"
#: name → model, and the file as a person knows it
FORMATS: dict[str, tuple[type[BaseModel], str]] = {
    "arm": (Arm, "arm.toml: what the arm is"),
    "session": (SessionFile, "session.toml: an arm measured on an artefact"),
    "artefact": (ArtefactFile, "artefact.toml: what is touched, for several sessions"),
    "daemon": (DaemonFile, "armd.toml: the daemon's configuration"),
    "mpe": (PermissibleErrors, "mpe.toml: what the arm must meet"),
    "about": (About, "about.toml: the head of a report"),
    "calibration": (Calibration, "calibration.json: constants and terms of an arm"),
}


def json_schema(name: str) -> dict[str, Any]:
    """Of one of `FORMATS`."""
    model, title = FORMATS[name]
    schema = model.model_json_schema(by_alias=True)
    return {"$schema": DIALECT, **schema, "title": title}
