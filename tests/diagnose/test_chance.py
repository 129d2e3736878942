"""How sure a p value allows one to be, against the published table."""

import pytest

from armd.compensation.diagnose.search.chance import surest


@pytest.mark.parametrize(
    ("p", "nothing"), [(0.1, 0.385), (0.05, 0.289), (0.01, 0.111), (0.005, 0.067), (0.001, 0.0184)]
)
def test_the_chance_of_nothing_is_as_sellke_bayarri_and_berger_have_it(
    p: float, nothing: float
) -> None:
    assert 1.0 - surest(p) == pytest.approx(nothing, abs=5e-4)


def test_what_is_beyond_doubt_or_of_no_weight_has_its_bounds() -> None:
    assert surest(0.0) == 1.0
    assert surest(1e-12) > 0.9999
    assert surest(0.5) == surest(1.0) == 0.5
