"""The head of a signed report: arm, date, place, operator, artefact and temperatures."""

from __future__ import annotations

import datetime
from collections.abc import Iterable, Sequence

import numpy as np

from armd import __version__
from armd.arrays import F64
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.session import Session
from armd.compensation.model.arm import Arm
from armd.compensation.report.layout.about import About
from armd.compensation.report.layout.page import APPENDIX, Page

#: The most different entries of one kind in the head.
MOST_NAMED = 3
#: The serial number of an arm of which only points are known (`verify.points`).
NOBODYS = "-"


def add_head(
    page: Page,
    arm: Arm | None,
    sessions: Sequence[Session],
    about: About | None,
    started_unix_s: Sequence[float] = (),
) -> None:
    """Add the head block of a report of *sessions*; *arm* is None where only points are known.

    *started_unix_s* are instants of measurements that are not sessions.
    """
    about = about or About()
    started = [*started_unix_s, *(session.started_unix_s for session in sessions)]
    operators = about.operator or _join_different(session.operator for session in sessions)
    artefacts = [session.artefact for session in sessions]
    page.add_head(
        [
            ("document", about.document),
            ("arm, serial number", _get_serial(arm)),
            ("customer", about.customer),
            ("laboratory", about.laboratory),
            ("place", about.place),
            ("measured on", _format_days(started)),
            ("operator", operators),
            ("artefact", _join_different(artefact.name for artefact in artefacts)),
            (
                "certificate",
                _join_different(_describe_certificate(artefact) for artefact in artefacts),
            ),
            ("environment", _describe_environment(sessions)),
            ("software", f"armd {__version__}"),
        ]
    )


def _get_serial(arm: Arm | None) -> str | None:
    is_known = arm is not None and arm.serial_number != NOBODYS
    return arm.serial_number if arm and is_known else None


def _join_different(texts: Iterable[str | None]) -> str | None:
    """Join the different texts in their order; None if there is none."""
    different = list(dict.fromkeys(filter(None, texts)))
    n_further = len(different) - MOST_NAMED
    text = "; ".join(different[:MOST_NAMED]) + (
        f"; {n_further} more: {APPENDIX}" if n_further > 0 else ""
    )
    return text or None


def _describe_certificate(artefact: Artefact) -> str | None:
    if artefact.certificate is None:
        return None
    until = artefact.certificate_valid_until
    return f"{artefact.certificate}, valid until {until or '__________'}"


def _format_days(started_unix_s: Sequence[float]) -> str | None:
    """Format the day, or the first and the last day; an instant of 0 is unknown."""
    instants = [instant for instant in started_unix_s if instant > 0.0]
    if not instants:
        return None
    first, last = (
        f"{datetime.datetime.fromtimestamp(instant, datetime.UTC):%Y-%m-%d}"
        for instant in (min(instants), max(instants))
    )
    return first if first == last else f"{first} to {last}"


def _describe_environment(sessions: Sequence[Session]) -> str | None:
    parts = {
        "arm": [session.states.temperature_c.ravel() for session in sessions],
        "artefact": [session.artefact_c for session in sessions],
    }
    ranges = {
        quantity: _format_range(np.concatenate(values))
        for quantity, values in parts.items()
        if values
    }
    return ", ".join(f"{quantity} {text}" for quantity, text in ranges.items() if text) or None


def _format_range(values_c: F64) -> str:
    measured_c = values_c[np.isfinite(values_c)]
    if not measured_c.size:
        return ""
    low, high = f"{measured_c.min():.1f}", f"{measured_c.max():.1f}"
    return f"{low} °C" if low == high else f"{low} to {high} °C"
