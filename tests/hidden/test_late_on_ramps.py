"""A link that follows its sensor late, its sessions begun on a ramp: what went before them is open.

Before that was weighed, the first two were told as a length that wanders in time,
with a probability of 1. In the others that wandering is found before the expansion, and a set of
causes that had the lag only as it acts through the calibration did not replace it.
"""

import pytest
from strangers import SURE, run_strange

SEEDS = (20263260000, 20263260003)
WANDERING_FIRST = (20263260006, 20263260007, 30111260004)


@pytest.mark.slow
@pytest.mark.parametrize("seed", SEEDS)
def test_a_lag_whose_sessions_began_on_a_ramp_is_told(seed: int) -> None:
    case = run_strange("ramped", seed)
    planted = {(cause, location) for cause, location, *_ in case.truths}
    told = {(one.cause, one.location) for one in case.told}
    assert planted == told
    assert all(one.probability > SURE for one in case.told)
    assert case.after_um < 1.07 * case.oracle_um < 0.2 * case.before_um


@pytest.mark.slow
@pytest.mark.parametrize("seed", WANDERING_FIRST)
def test_an_expansion_and_a_lag_through_it_replace_the_wandering_found_first(seed: int) -> None:
    case = run_strange("ramped", seed)
    planted = {(cause, location) for cause, location, *_ in case.truths}
    assert {(one.cause, one.location) for one in case.told} == planted
    assert case.after_um < 0.2 * case.before_um


@pytest.mark.slow
def test_what_fades_of_a_bent_link_is_no_third_cause() -> None:
    """Beside the gradient and the lag stood two structures without a name and a shifted constant,
    where what faded bent the link about another axis than the gradient does."""
    case = run_strange("bent", 20261270001)
    planted = {(cause, location) for cause, location, *_ in case.truths}
    assert {(one.cause, one.location) for one in case.told} == planted
    assert case.after_um < 0.2 * case.before_um
