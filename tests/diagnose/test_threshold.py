"""The family-wise p value against the smallest of as many that chance draws."""

import numpy as np
import pytest

from armd.compensation.diagnose.constants import ALPHA
from armd.compensation.diagnose.scoring.threshold import compute_family_wise_p, is_significant


@pytest.mark.parametrize("tests", [1, 20, 300])
def test_the_smallest_of_many_falls_so_low_as_often_as_is_said(tests: int) -> None:
    smallest = np.random.default_rng(tests).uniform(size=(20_000, tests)).min(axis=1)
    for share in (0.01, 0.1, 0.5):
        threshold = np.quantile(smallest, share)
        assert compute_family_wise_p(np.log(threshold), tests) == pytest.approx(share, rel=0.2)
    alarms = is_significant(np.log(smallest), tests).mean()
    assert alarms == pytest.approx(ALPHA, abs=3 * np.sqrt(ALPHA / 20_000))


def test_what_is_far_too_small_for_a_float_is_zero_and_certainty_is_one() -> None:
    assert compute_family_wise_p(-5000.0, 3000) == 0.0
    assert compute_family_wise_p(0.0, 3000) == 1.0
