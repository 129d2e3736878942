"""Who joins the findings next, and scores with a finding taken out: made-up sums, dense algebra."""

from functools import cached_property
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from armd.arrays import F64
from armd.compensation.diagnose.scoring import candidates
from armd.compensation.diagnose.scoring.candidates import ScoredCandidates
from armd.compensation.diagnose.scoring.evidence import Scores
from armd.compensation.diagnose.scoring.threshold import compute_family_wise_p
from armd.compensation.diagnose.search import selection
from armd.compensation.effects.effect import Candidate
from support.small_fit import candidate
from support.small_sums import CANDIDATES, problem, sums_of

TESTS = 100
FIRST, SECOND, OTHER = candidate("a", 1), candidate("a", 1, typical=2.0), candidate("b", 2)
NOTHING: Any = None


class StatedScores(Scores):
    """Of shares as stated: the prior of the catalogue is tried elsewhere."""

    @cached_property
    def log_prior(self) -> F64:
        return np.zeros(len(self.freedom))


def scores_of(candidates: list[Candidate], log_p: list[float], posterior: list[float]) -> Scores:
    """Of *candidates* that explain as much as their p says, with posterior shares."""
    n = len(candidates)
    signatures: Any = SimpleNamespace(candidates=tuple(candidates))
    return StatedScores(
        signatures, chi2.isf(np.exp(log_p), 1), np.ones(n, dtype=np.int64), np.array(log_p),
        np.log(posterior), np.ones(n),
    )  # fmt: skip


@pytest.fixture
def scatter(monkeypatch: pytest.MonkeyPatch) -> dict[int, float]:
    """Log p by the scatter of the rests, by candidate; significant where nothing is said."""
    told: dict[int, float] = {}
    monkeypatch.setattr(
        selection, "compute_log_p_by_scatter", lambda own, about: told.get(id(own), -30.0)
    )
    return told


def test_nobody_joins_without_significance(scatter: dict[int, float]) -> None:
    assert (
        selection.choose_candidate(
            NOTHING, scores_of([FIRST, OTHER], [-3.0, -5.0], [0.5, 0.5]), TESTS
        )
        is None
    )


def test_the_likeliest_place_joins_by_its_likeliest_value(scatter: dict[int, float]) -> None:
    """Two values of one place together are likelier than another place that is so by itself."""
    scores = scores_of([FIRST, SECOND, OTHER], [-30.0, -31.0, -35.0], [0.28, 0.32, 0.4])
    assert selection.choose_candidate(NOTHING, scores, TESTS) is SECOND
    alone = scores_of([FIRST, OTHER], [-30.0, -29.0], [0.45, 0.55])
    assert selection.choose_candidate(NOTHING, alone, TESTS) is OTHER


def test_what_is_likeliest_must_be_significant_itself(scatter: dict[int, float]) -> None:
    scores = scores_of([FIRST, OTHER], [-4.0, -30.0], [0.9, 0.1])
    assert selection.choose_candidate(NOTHING, scores, TESTS) is OTHER


def test_what_few_rests_bear_is_refused_for_the_next(
    scatter: dict[int, float], monkeypatch: pytest.MonkeyPatch
) -> None:
    scores = scores_of([FIRST, SECOND, OTHER], [-30.0, -31.0, -25.0], [0.3, 0.4, 0.3])
    scatter[id(SECOND)] = scatter[id(FIRST)] = -1.0
    compared = []

    def likelier(admitted: Candidate, refused: list[Candidate], *_: object) -> Candidate:
        compared.append([c.place for c in refused])
        return admitted

    monkeypatch.setattr(selection, "_likelier", likelier)
    assert selection.choose_candidate(NOTHING, scores, TESTS) is OTHER
    assert compared == [[SECOND.place, FIRST.place]]  # and asked whether it is the same signal
    scatter[id(OTHER)] = -1.0
    assert selection.choose_candidate(NOTHING, scores, TESTS) is None


def test_what_few_rests_bear_is_not_left_over(scatter: dict[int, float]) -> None:
    """What is not named as its rests scatter too much is nothing that stays unexplained."""
    scored: Any = SimpleNamespace(
        scores=scores_of([FIRST, OTHER], [-30.0, -25.0], [0.9, 0.1]), projection=NOTHING
    )
    assert selection.find_strongest_left(scored, TESTS) == (FIRST, -30.0)
    scatter[id(FIRST)] = -2.0
    assert selection.find_strongest_left(scored, TESTS) == (OTHER, -25.0)
    scatter[id(OTHER)] = -3.0
    left, log_p = selection.find_strongest_left(scored, TESTS)
    assert (left, log_p) == (OTHER, -3.0)
    assert float(compute_family_wise_p(log_p, TESTS)) > 0.9


def test_a_finding_taken_out_is_a_candidate_again_as_in_dense_least_squares() -> None:
    b, x, r = problem()
    x[:, :1] = b[:, 2:3]  # the finding's own column is shared column 2
    sums = sums_of(b, x, r, np.full(4, np.inf))
    finding = CANDIDATES[0]
    projection: Any = SimpleNamespace(
        fit=SimpleNamespace(findings=(finding,)),
        shapes=SimpleNamespace(list_columns=lambda fit, index: np.array([2])),
        shared_number=np.arange(4),
    )
    scored = ScoredCandidates(projection, sums)
    assert scored.scores.freedom[0] == 0 and not np.isfinite(scored.scores.log_evidence[0])
    others = np.delete(b, 2, axis=1)

    def clear(columns: np.ndarray) -> np.ndarray:
        left: np.ndarray = columns - others @ np.linalg.lstsq(others, columns, rcond=None)[0]
        return left

    for i, own in enumerate((slice(0, 1), slice(1, 3), slice(3, 4))):
        q = np.linalg.qr(clear(x[:, own]))[0]
        assert scored.score_without_finding(0).statistic[i] == pytest.approx(
            float(((q.T @ clear(r)) ** 2).sum())
        )
    # Nothing that is within a finding competes beside it, the finding itself but when it is out.
    assert scored.score_eligible_without(0).freedom.tolist() == [1, 2, 1]
    assert scored.scores.statistic[1] < scored.score_without_finding(0).statistic[1]


def test_the_weakest_finding_is_the_one_that_is_missed_least(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each judged with itself out of the model, whatever it says while another is."""
    by_one_out = np.array([[-9.0, -1.0, 0.0], [0.0, -4.0, -1.0], [-1.0, 0.0, -30.0]])
    freed = SimpleNamespace(score_without_finding=lambda i: SimpleNamespace(log_p=by_one_out[i]))
    monkeypatch.setattr(candidates, "score_candidates", lambda projection, findings: freed)
    projection: Any = SimpleNamespace(fit=SimpleNamespace(findings=[FIRST, SECOND, OTHER]))
    assert candidates.find_weakest(projection) == (1, -4.0)
