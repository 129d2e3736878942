"""Known errors more, summed beside those of a stack, against a stack that has them."""

from __future__ import annotations

import numpy as np
import pytest
from test_interim_changes import a_month

from armd.compensation.interim.evidence.extended_sums import ExtendedSums


@pytest.mark.parametrize("width", [0, 1, 5])
@pytest.mark.parametrize("until", [29, 1])
def test_sums_beside_are_those_of_a_stack_that_knows_all(width: int, until: int) -> None:
    rng = np.random.default_rng(1)
    of = a_month(rng)
    chosen = [i for i in range(until) if i not in (0, 7)]  # none of one
    extra = [rng.normal(size=(len(residual), width)) for residual in of.residual]
    found, expected = (
        ExtendedSums(of, chosen).sum_with(extra),
        of.add_known_errors(extra).sum_checks(chosen),
    )
    assert found.curvature == pytest.approx(expected.curvature, abs=1e-9)
    assert found.side == pytest.approx(expected.side, abs=1e-9)
    assert found.square == pytest.approx(expected.square)
    assert found.numbers == expected.numbers
