"""The sessions a page speaks of: when, by whom, on what, how warm."""

from __future__ import annotations

import datetime
from collections.abc import Sequence

import numpy as np

from armd.compensation.data.session import F64, Session
from armd.compensation.model.arm import Arm
from armd.compensation.report.page import Page

NOT_STATED = "not stated"


def session_facts(page: Page, sessions: Sequence[Session], arm: Arm) -> None:
    """A row per session; what its files do not say is said not to be stated."""
    page.table(
        ["session", "started, UTC", "duration, h", "readings", "operator", "artefact",
         "its certificate", "arm, °C", "artefact, °C"],
        [_row(session) for session in sessions],
    )  # fmt: skip
    page.text(
        f"Temperatures: the lowest and the highest of the {len(arm.sensors)} sensors of the arm,"
        " and of the artefact, over all readings of the session."
    )


def _row(session: Session) -> list[str]:
    started = datetime.datetime.fromtimestamp(session.started_unix_s, datetime.UTC)
    return [
        session.name,
        f"{started:%Y-%m-%d %H:%M}",
        f"{np.ptp(session.states.time_s) / 3600:.2f}",
        str(session.n),
        session.operator or NOT_STATED,
        session.artefact.name,
        session.artefact.certificate or NOT_STATED,
        _range(session.states.temperature_c),
        _range(session.artefact_c),
    ]


def _range(values_c: F64) -> str:
    known = values_c[np.isfinite(values_c)]
    return f"{known.min():.1f} to {known.max():.1f}" if known.size else "not measured"
