"""The origin of a page about sessions: every file by its hash, and the facts of each measurement.

These are when, by whom, on which artefact and at which temperatures it was made.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session, make_distinct_names
from armd.compensation.model.arm import Arm
from armd.compensation.report.layout.page import Page, make_report_number
from armd.files.inputs import hash_input
from armd.terminal.counted import format_count

NOT_STATED = "not stated"


class InputFile(NamedTuple):
    """An input of a report: its name without folders, and the SHA-256 of its bytes."""

    name: str
    sha256: str

    @classmethod
    def read(cls, path: str | Path | None) -> InputFile | None:
        """Return the input of the file *path*, or None without a path."""
        if not path:
            return None
        return cls(Path(path).name, hash_input(path))


def add_origin(
    page: Page,
    arm: Arm,
    sessions: Sequence[Session],
    files: Mapping[str, InputFile | None],
    facts: Mapping[str, str] | None = None,
) -> None:
    """Add the origin; *files* are the other inputs by their roles (None: there was none)."""
    named = zip(make_distinct_names(sessions), sessions, strict=True)
    inputs = {f"session {name}": session.fingerprint() for name, session in named}
    inputs |= {f"{role} {file.name}": file.sha256 for role, file in files.items() if file}
    page.add_origin(make_report_number(arm.serial_number, *inputs.values()), inputs, facts)
    if sessions:
        add_session_facts(page, sessions, arm)


def add_session_facts(page: Page, sessions: Sequence[Session], arm: Arm) -> None:
    """Add a table with a row per session; facts missing in its files are given as "not stated"."""
    page.add_table(
        ["session", "started, UTC", "duration, h", "readings", "operator", "artefact",
         "its certificate", "arm, °C", "artefact, °C"],
        [
            [name, *_list_facts(session)]
            for name, session in zip(make_distinct_names(sessions), sessions, strict=True)
        ],
    )  # fmt: skip
    if not arm.sensors:
        page.add_text("The arm has no temperature sensors.")
        return
    page.add_text(
        "Temperatures: the lowest and the highest of the"
        f" {format_count(len(arm.sensors), 'sensor')} of the arm, and of the artefact, over all"
        " readings of the session."
    )


def _list_facts(session: Session) -> list[str]:
    started = datetime.datetime.fromtimestamp(session.started_unix_s, datetime.UTC)
    return [
        f"{started:%Y-%m-%d %H:%M}" if session.started_unix_s > 0.0 else NOT_STATED,
        _format_duration_h(session.states.time_s),
        str(session.n),
        session.operator or NOT_STATED,
        session.artefact.name,
        session.artefact.certificate or NOT_STATED,
        _format_range(session.states.temperature_c),
        _format_range(session.artefact_c),
    ]


def _format_duration_h(time_s: F64) -> str:
    span_h = float(np.ptp(time_s)) / 3600
    return f"{span_h:.2f}" if np.isfinite(span_h) else NOT_STATED


def _format_range(values_c: F64) -> str:
    measured_c = values_c[np.isfinite(values_c)]
    return (
        f"{measured_c.min():.1f} to {measured_c.max():.1f}" if measured_c.size else "not measured"
    )
