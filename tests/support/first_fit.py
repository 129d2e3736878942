"""A fit of nothing to small sessions with known plants, and what is clear of all that absorbs in a
fit, by one dense least-squares problem."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.fitting.under_test import make_model_and_judge_sessions
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.diagnose.problem.session_facts import collect_facts
from armd.compensation.diagnose.problem.whitening import RestNoise
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.arm import Arm
from armd.simulator.campaigns.hidden import Design
from armd.simulator.plants.plant import Plant
from support.made_case import MadeCase, make_case


def first_fit(seed: int, plants: Sequence[Plant]) -> tuple[MadeCase, Fit, Arm, list[Candidate]]:
    """The case, a fit of no finding to its sessions, the arm, and the catalogue's candidates."""
    made = make_case(seed, plants, Design(sessions=4, articulations=3, holdout=0))
    arm, sessions = made.arm, made.sessions
    baseline, _ = make_model_and_judge_sessions(sessions, arm, None)
    rests = collect_rests(sessions, arm)
    candidates = list(catalogue.list_all_candidates(collect_facts(rests, arm, baseline)))
    return made, fit(rests, arm, baseline, baseline.model), arm, candidates


def whitened(noise: RestNoise, columns: F64) -> tuple[F64, F64]:
    """Columns of unit length, and by what they were divided."""
    white = noise.whiten(columns)
    scale: F64 = np.linalg.norm(white, axis=0)
    scale[scale == 0.0] = 1.0
    return white / scale, scale


def clear_of_absorbing(current: Fit, white: F64) -> F64:
    """Whitened columns, (N,) or (N, m), clear of all that absorbs; its prior as rows."""
    variance = np.minimum(current.nuisance.variance, 1e12)
    absorbing, scale = whitened(current.noise, current.nuisance.columns.to_dense())
    prior = np.diag(1.0 / np.sqrt(variance * scale**2))
    rows = np.concatenate([white, np.zeros((len(prior), *white.shape[1:]))])
    stacked = np.vstack([absorbing, prior])
    clear: F64 = rows - stacked @ np.linalg.lstsq(stacked, rows, rcond=1e-13)[0]
    return clear
