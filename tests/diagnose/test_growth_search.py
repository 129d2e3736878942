"""Which links grow: against every combination, by marginal likelihoods and sums of squares."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import chi2, multivariate_normal

from armd.arrays import F64
from armd.compensation.diagnose.constants import EXPECTED_PRIOR
from armd.compensation.diagnose.search import growth as module
from armd.compensation.diagnose.search.growth import _grown, _Growth
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.sizes import SCALES
from support import synthetic
from support.small_fit import candidate, unit_noise

ARM = synthetic.arm()
RESTS = 20
TYPICAL = 0.7
WAYS = (None, 0, 1)
Chosen = tuple[int | None, ...]


def way(link: int, widths: int) -> Candidate:
    return replace(candidate("link_expansion", link, widths, TYPICAL), expected=True)


#: Of three links: one coefficient for all of a link, or one for each of its two pieces.
LINKS = [[way(link, 1), way(link, 2)] for link in (1, 2, 3)]


class Case:
    """Columns of each way, and readings of which the first link grows in one piece and the second
    as a whole."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        rng = np.random.default_rng(8)
        pieces = [rng.normal(size=(3 * RESTS, 2)) for _ in LINKS]
        ways = [(pair.sum(axis=1, keepdims=True), pair) for pair in pieces]
        self.columns = {
            c: x for of, xs in zip(LINKS, ways, strict=True) for c, x in zip(of, xs, strict=True)
        }
        self.residual = rng.normal(size=3 * RESTS) + pieces[0][:, 0] + pieces[1].sum(axis=1)
        monkeypatch.setattr(
            module, "make_finding_columns", lambda _, of, __: [self.columns[c] for c in of]
        )
        nothing_absorbs = SimpleNamespace(clear_of_all=lambda columns: (columns, columns))
        monkeypatch.setattr(module, "make_projection", lambda *_: nothing_absorbs)
        self.about: Any = SimpleNamespace(
            linear=None, residual=self.residual, noise=unit_noise(RESTS)
        )
        self.growth = _Growth(self.about, LINKS, ARM)

    def matrix(self, chosen: Chosen) -> F64:
        named = [LINKS[i][which] for i, which in enumerate(chosen) if which is not None]
        return np.hstack([np.zeros((3 * RESTS, 0)), *(self.columns[c] for c in named)])

    def log_weight(self, chosen: Chosen) -> float:
        """Marginal likelihood of the readings themselves over that of noise, and the prior."""
        x, n = self.matrix(chosen), 3 * RESTS
        logs = [
            np.log(share)
            + multivariate_normal.logpdf(
                self.residual, np.zeros(n), np.eye(n) + (scale * TYPICAL) ** 2 * x @ x.T
            )
            for scale, share in SCALES.items()
        ]
        noise = multivariate_normal.logpdf(self.residual, np.zeros(n), np.eye(n))
        able = [1.0 - EXPECTED_PRIOR if which is None else EXPECTED_PRIOR / 2 for which in chosen]
        return float(logsumexp(logs) - logsumexp(np.log([*SCALES.values()])) - noise
                     + np.log(able).sum())  # fmt: skip

    def squares(self, chosen: Chosen) -> float:
        x = self.matrix(chosen)
        if not x.size:
            return float(self.residual @ self.residual)
        left = self.residual - x @ np.linalg.lstsq(x, self.residual, rcond=None)[0]
        return float(left @ left)


@pytest.fixture
def case(monkeypatch: pytest.MonkeyPatch) -> Case:
    return Case(monkeypatch)


def test_the_likeliest_growth_is_that_of_all_combinations(case: Case) -> None:
    every = list(itertools.product(WAYS, repeat=len(LINKS)))
    weights = [case.log_weight(chosen) for chosen in every]
    assert [case.growth.log_weight(chosen) for chosen in every] == pytest.approx(weights)
    best = list(every[int(np.argmax(weights))])
    assert best == [1, 0, None]
    assert case.growth.likeliest([None] * 3) == case.growth.likeliest([0] * 3) == best


@pytest.mark.parametrize("link", [0, 1])
def test_a_link_is_as_significant_as_the_squares_that_it_takes_away(case: Case, link: int) -> None:
    chosen: list[int | None] = [1, 0, None]
    without = tuple(None if i == link else which for i, which in enumerate(chosen))
    fall = case.squares(without) - case.squares(tuple(chosen))
    assert case.growth.log_p(link, chosen) == pytest.approx(chi2.logsf(fall, 2 - link))


def test_growth_that_is_not_significant_is_given_up(case: Case) -> None:
    assert _grown(case.about, LINKS, ARM) == [LINKS[0][1], LINKS[1][0]]
    noise = np.random.default_rng(9).normal(size=3 * RESTS)
    case.about.residual = noise
    assert _grown(case.about, LINKS, ARM) == []
