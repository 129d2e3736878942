"""How sure a p value allows one to be, against the published table; and who that is told of."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.diagnosis import Finding
from armd.compensation.diagnose.search import chance
from armd.compensation.diagnose.search.chance import limit_probability
from support.small_fit import candidate, small_fit


@pytest.mark.parametrize(
    ("p", "nothing"), [(0.1, 0.385), (0.05, 0.289), (0.01, 0.111), (0.005, 0.067), (0.001, 0.0184)]
)
def test_the_chance_of_nothing_is_as_sellke_bayarri_and_berger_have_it(
    p: float, nothing: float
) -> None:
    assert 1.0 - limit_probability(p) == pytest.approx(nothing, abs=5e-4)


def test_what_is_beyond_doubt_or_of_no_weight_has_its_bounds() -> None:
    assert limit_probability(0.0) == 1.0
    assert limit_probability(1e-12) > 0.9999
    assert limit_probability(0.5) == limit_probability(1.0) == 0.5


@pytest.mark.parametrize("lasts", [False, True])
def test_beside_noise_that_lasts_each_is_as_sure_as_its_own_p_value_allows(
    monkeypatch: pytest.MonkeyPatch, lasts: bool
) -> None:
    """Its p value beside all others: with them in the model, and itself out of it."""
    some = np.ones((30, 1))
    causes = [candidate("encoder_slip", 1), candidate("encoder_scale", 2)]
    fit = small_fit(np.zeros(30), some, dict.fromkeys(causes, some))
    log_p = {"encoder_slip": np.log(1e-5), "encoder_scale": np.log(1e-30)}
    tests = 100

    def by_scatter(of: Any, about: Any) -> float:
        assert [c.cause for c in about] == [c.cause for c in causes if c is not of]
        return float(log_p[of.cause])

    monkeypatch.setattr(chance, "_lasts", lambda _: lasts)
    monkeypatch.setattr(chance, "solve_again", lambda _fit, others, *_: others)
    monkeypatch.setattr(chance, "make_projection", lambda fitted, _arm: fitted)
    monkeypatch.setattr(chance, "compute_log_p_by_scatter", by_scatter)
    scored: Any = SimpleNamespace(projection=SimpleNamespace(arm=None), fit=fit)
    found = [Finding(cause, 1e-9, 50.0, 0.8, (), ()) for cause in causes]
    slip, scale = chance.limit_by_lasting_noise(found, scored, tests)
    assert slip.probability == pytest.approx(
        0.8 * (limit_probability(1e-3) if lasts else 1.0), rel=1e-3
    )
    assert scale.probability == pytest.approx(0.8)
    assert chance.limit_by_lasting_noise([], scored, tests) == ()
