"""The search's work is bounded by a count: what is left then is skipped, and reported."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from armd.compensation.diagnose.constants import (
    AS_FAR_OFF,
    LEAST_REPEATED,
    MOST_PRODUCTS,
    STEP_WORK,
    TRIAL_WORK,
)
from armd.compensation.diagnose.problem.linear import Baseline, ModelState
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.diagnose.scoring.candidates import ScoredCandidates
from armd.compensation.diagnose.search import search
from armd.compensation.diagnose.search.work import WorkBudget
from armd.compensation.diagnose.search_outcome import is_farther_off
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.encoder.encoder_eccentricity import make_harmonic_columns
from armd.compensation.model.calibration import ArtefactCorrection
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.model.terms import Term
from support import synthetic
from support.drawn import drawn
from support.small_fit import unit_noise

ARM = synthetic.arm()


def look(columns: int = 100, shared: int = 40, rests: int = 0) -> ScoredCandidates:
    """One look at a catalogue of so many columns beside shared ones."""
    signatures = SimpleNamespace(count=np.ones(columns, dtype=int))
    model = SimpleNamespace(layout=SimpleNamespace(n=shared))
    linear = SimpleNamespace(rests=SimpleNamespace(n=rests))
    sums = SimpleNamespace(signatures=signatures, shared=model)
    projection = SimpleNamespace(fit=SimpleNamespace(linear=linear))
    return ScoredCandidates(cast(Any, projection), cast(Any, sums))


def test_a_step_counts_the_products_of_candidates_and_shared_columns() -> None:
    work = WorkBudget(limit=8000.0)
    work.add(look().n_products, STEP_WORK)
    assert work.done == 4000.0 and work.may_go_on and work.may_try_sets
    work.add(look().n_products, STEP_WORK)
    assert not work.may_go_on and not work.may_try_sets
    assert work.in_words() == []
    work.skip("this")
    work.skip("this")
    assert work.skipped == ["this"] and "take more of it: this." in work.in_words()[0]


def test_many_readings_have_one_bound_and_few_a_higher_one() -> None:
    most = [WorkBudget.of_readings(n).limit for n in (20_000, 2_000, 1_000, 100, 0)]
    assert most == [MOST_PRODUCTS, MOST_PRODUCTS, 2 * MOST_PRODUCTS, *[4 * MOST_PRODUCTS] * 2]


def test_other_sets_leave_work_for_what_follows() -> None:
    work = WorkBudget(limit=8000.0)
    work.add(1000.0, TRIAL_WORK)
    assert work.done == 300.0 and work.of_sets == 0.0
    while work.may_try_sets:
        work.add(look().n_products, TRIAL_WORK, of_sets=True)
    assert work.may_go_on and work.done < 0.7 * work.limit


def test_pieces_beside_each_other_have_equal_parts_and_always_some() -> None:
    """Not the one that comes first most of it: the answer must not go by the threads' order."""
    work = WorkBudget(limit=1000.0, done=400.0)
    assert [work.split(3).limit for _ in range(3)] == [200.0] * 3
    work.done = 2000.0
    piece = work.split(2)
    assert piece.limit == LEAST_REPEATED * 500.0
    piece.done, piece.skipped = 70.0, ["that"]
    work.take(piece)
    assert work.done == 2070.0 and work.skipped == ["that"]


@pytest.mark.parametrize("most", [1.0, 1e12])
def test_a_search_without_work_left_ends_and_reports_it(
    most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disc that is plain to see; the same answer each time."""
    candidates = [
        Candidate("encoder_eccentricity", location.joint(k), make_harmonic_columns(k, 1, 1e-4), ())
        for k in range(1, 7)
    ]
    monkeypatch.setattr(search.catalogue, "list_all_candidates", lambda _facts: iter(candidates))
    wave = Harmonic(kind="sin", joint=3, order=1)
    term = Term(parameter="theta_3", basis=[wave], coefficient=2e-4)
    session = synthetic.session(
        ARM, ARM.nominal(), np.random.default_rng(3), terms=[term], encoder_rad=5e-6
    )
    model = ModelState(ARM.nominal(), (), 20.0, ArtefactCorrection())
    baseline = Baseline(model, drawn(ARM), True, (), (), np.zeros((0, 0)))
    rests = collect_rests([session], ARM)
    for work in (WorkBudget(most), WorkBudget(most)):
        result = search.Search(rests, ARM, baseline, work=work).run()
        skipped = ["more than 0 causes"] if most == 1.0 else []
        assert work.skipped == skipped
        assert len(result.findings) == (0 if skipped else 1)


@pytest.mark.parametrize(("times", "farther"), [(1.0, False), (2.0, False), (6.0, True)])
def test_a_session_that_is_clipped_away_is_farther_off_all_the_same(
    times: float, farther: bool
) -> None:
    """Of ten sessions one, the noise being that of the others."""
    n = 300
    session = np.arange(n) // 30
    left = np.random.default_rng(5).normal(size=(n, 3))
    left[session == 4] *= times
    paths = [Path(f"session-{k}") for k in range(10)]
    sessions = [SimpleNamespace(path=path) for path in paths]
    rests = SimpleNamespace(observations=SimpleNamespace(session=session), sessions=sessions)
    fit: Any = SimpleNamespace(
        noise=unit_noise(n), rest_residual_mm=left, linear=SimpleNamespace(rests=rests)
    )
    assert times < AS_FAR_OFF or farther
    assert is_farther_off(fit, paths[4]) is farther
