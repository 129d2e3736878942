"""States and sessions of readings, as far as a test knows them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.session import Session
from armd.compensation.model.state import States


def states_of(q: F64, **known: Any) -> States:
    """Angles (n, N), rad, in one run, a second apart; whatever else is not *known* is NaN."""
    n = len(q)
    usual = {
        "rate": np.full(q.shape, np.nan),
        "temperature_c": np.full((n, 1), np.nan),
        "time_s": np.arange(float(n)),
        "approach": np.full((n, 3), np.nan),
        "series": np.zeros(n, np.int64),
    }
    return States(q=q, **usual | known)


def session_of(name: str, arm: str, artefact: Artefact, states: States, **known: Any) -> Session:
    """Of the first target, in one placement, from the first reading on, if no other is *known*."""
    n = len(states.q)
    usual = {
        "started_unix_s": float(states.time_s[0]) if n else 0.0,
        "placement": np.zeros(n, np.int64),
        "placement_names": ["P1"],
        "target": np.zeros(n, np.int64),
        "truth_mm": np.full((n, 3), np.nan),
        "artefact_c": np.full(n, np.nan),
        "unused_columns": [],
        "row": np.arange(n),
    }
    return Session(
        path=Path(name), name=name, arm=arm, artefact=artefact, states=states, **usual | known
    )
