"""Remarks on sessions without their artefact's temperature: which temperature is assumed."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from armd.compensation.data.sessions.session import Session
from armd.compensation.model.arm import Arm


def report_artefact_temperature(sessions: Sequence[Session], arm: Arm) -> list[str]:
    """Return remarks on missing temperatures of artefacts.

    There is one for each session with `artefact_c` in some rows only, and one for each artefact
    that expands and has none in any row of a session.
    """
    remarks = []
    for session in sessions:
        n_known = int(np.isfinite(session.artefact_c).sum())
        if 0 < n_known < session.n:
            remarks.append(
                f"{session.name}: artefact_c in {n_known} of {session.n} rows; a row without has "
                "the last one before it."
            )
    without = [
        s for s in sessions if s.artefact.expansion_per_k and not np.isfinite(s.artefact_c).any()
    ]
    without.sort(key=lambda session: session.artefact.name)
    for name, group in itertools.groupby(without, key=lambda session: session.artefact.name):
        alike = list(group)
        remarks.append(
            f"No artefact_c ({', '.join(s.name for s in alike)}): {name} is taken to be at "
            f"{alike[0].artefact.reference_temperature_c:g} °C{_at_stake(alike, arm)}."
        )
    return remarks


def _at_stake(sessions: Sequence[Session], arm: Arm) -> str:
    """Return the error if the artefact were as warm as the arm; "" if that is not known."""
    artefact = sessions[0].artefact
    celsius = np.concatenate(
        [s.states.temperature_c[:, arm.used_columns].ravel() for s in sessions]
    )
    rise_k = celsius[np.isfinite(celsius)] - artefact.reference_temperature_c
    if not len(rise_k):
        return ""
    most_k = float(rise_k[np.argmax(np.abs(rise_k))])
    um_per_m = 1e6 * artefact.expansion_per_k * abs(most_k)
    return f"; were it as warm as the arm ({most_k:+.1f} K), it would err by {um_per_m:.0f} µm/m"
