"""`armd schema NAME`: print the JSON schema of one of armd's files, for an editor."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from pydantic import BaseModel

from armd.compensation.data.sessions.format import ArtefactFile, SessionFile
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.compensation.report.layout.about import About
from armd.compensation.verify.limits import PermissibleErrors
from armd.daemon.config import DaemonFile
from armd.files.outputs import OutputKind, add_force, check_outputs
from armd.files.writing import write_whole

DIALECT = "https://json-schema.org/draft/2020-12/schema"
#: name → model, and the file's name with its content
FORMATS: dict[str, tuple[type[BaseModel], str]] = {
    "arm": (Arm, "arm.toml: what the arm is"),
    "session": (SessionFile, "session.toml: an arm measured on an artefact"),
    "artefact": (ArtefactFile, "artefact.toml: what is touched, for several sessions"),
    "daemon": (DaemonFile, "armd.toml: the daemon's configuration"),
    "mpe": (PermissibleErrors, "mpe.toml: what the arm must meet"),
    "about": (About, "about.toml: the head of a report"),
    "calibration": (Calibration, "calibration.json: constants and terms of an arm"),
}


def make_json_schema(name: str) -> dict[str, Any]:
    """Return the JSON schema of one of `FORMATS`."""
    model, title = FORMATS[name]
    schema = model.model_json_schema(by_alias=True)
    return {"$schema": DIALECT, **schema, "title": title}


SCHEMA = OutputKind("a JSON schema", lambda head: DIALECT.encode() in head)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = "; ".join(f"{name}: {title.split(':')[0]}" for name, (_, title) in FORMATS.items())
    parser.add_argument("name", choices=FORMATS, metavar="NAME", help=f"of which file: {words}")
    parser.add_argument(
        "-o", "--output", type=Path, metavar="FILE.json", help="default: standard output"
    )
    add_force(parser)


def run(args: argparse.Namespace) -> int:
    text = json.dumps(make_json_schema(args.name), indent=1) + "\n"
    if args.output is None:
        print(text, end="")
        return 0
    check_outputs({"-o": (args.output, SCHEMA)}, [], args.force)
    write_whole(args.output, text)
    return 0
