"""How late a link may be: what a thermal lag's share may come to beside its time constant."""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.scoring.evidence import compute_log_bayes_factors
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Column
from support.found_problem import Problem, problem

__all__ = ["problem"]  # the fixture

#: Noise units of one share, clear of what absorbs.
CLEAR = 1.5


def shares(problem: Problem) -> dict[float, Column]:
    """Time constant, s → what is late of link 3."""
    every = [c for c in catalogue.list_all_candidates(problem.facts) if c.cause == "thermal_lag"]
    return {
        c.setting[0][1]: c.columns[0]
        for c in every
        if str(c.location) == "link 3" and c.columns[0].name == "share"
    }


def evidence(column: Column, share: float) -> float:
    """Log odds against nothing of a share that the readings tell."""
    gram, prior_sd = np.array([[[CLEAR**2]]]), np.array([[column.prior_sd]])
    side: F64 = np.array([[CLEAR**2 * share]])
    return float(compute_log_bayes_factors(gram, side, prior_sd, np.array([[column.reach]]))[0])


def test_on_a_ramp_a_short_time_constant_may_stand_for_an_hour(problem: Problem) -> None:
    """A steady ramp of 5 K/h is 5 K behind with 1 h and all of the growth, and with 1 min and 60
    times as much: these are one signal, and the share may be so large."""
    behind_k = {lag_s: 5.0 * lag_s / 3600 * c.reach for lag_s, c in shares(problem).items()}
    assert len(behind_k) > 5
    assert all(behind >= 5.0 - 1e-9 for behind in behind_k.values())


def test_no_link_is_late_by_many_times_its_growth(problem: Problem) -> None:
    """Fifteen times the growth, 90 min late, is no lag, however much the readings ask for it; all
    of the growth is."""
    column = shares(problem)[5400.0]
    free = Column(column.name, column.unit, column.prior_sd)
    assert evidence(column, 15.0) < evidence(free, 15.0) - 60.0
    assert evidence(column, 1.0) > evidence(free, 1.0) - 0.1
