"""What a step is worth on readings held out: the figure, its interval, and when it is shown."""

import numpy as np
import pytest

from armd.compensation.diagnose.heldout.gain import compute_gain, compute_gains

GROUPS = np.repeat(np.arange(40), 5)


def test_the_figures_are_root_mean_squares_in_micrometres() -> None:
    before, after = np.full(200, 4e-4), np.full(200, 1e-4)
    found = compute_gain(before, after, GROUPS)
    assert (found.before_um, found.after_um) == (pytest.approx(20.0), pytest.approx(10.0))
    assert found.interval_um == (pytest.approx(10.0), pytest.approx(10.0)) and found.is_confirmed


def test_the_interval_holds_the_true_difference_and_nothing_gained_is_not_shown() -> None:
    """Errors of a group move together: resampling single readings would call chance a gain."""
    rng = np.random.default_rng(1)
    held, shown = [], []
    for seed in range(150):
        common = rng.normal(size=(40, 3))[GROUPS] * 1e-2
        before = ((rng.normal(size=(200, 3)) * 1e-2 + common) ** 2).sum(axis=1)
        other = rng.normal(size=(40, 3))[GROUPS] * 1e-2
        after = ((rng.normal(size=(200, 3)) * 1e-2 + other) ** 2).sum(axis=1)
        found = compute_gain(before, after, GROUPS, seed=seed)
        held.append(found.interval_um[0] < 0.0 < found.interval_um[1])
        shown.append(found.is_confirmed)
    assert np.mean(held) >= 0.88
    assert np.mean(shown) <= 0.08


@pytest.mark.parametrize(("n", "least"), [(6, 0.90), (8, 0.91), (20, 0.92)])
def test_the_interval_holds_the_true_difference_of_few_groups(n: int, least: float) -> None:
    """As many as two seats in three placements have: plain percentiles held it in 0.86 of draws."""
    rng = np.random.default_rng(3)
    groups, true_um = np.repeat(np.arange(n), 10), 1e3 * (1.0 - np.sqrt(1.0 - 0.15))
    held = []
    for _ in range(400):
        share = rng.normal(0.15, 0.3, n)  # of its squared error, by which a group improves
        after = np.repeat(np.maximum(1.0 - share, 0.0), 10)
        low_um, high_um = compute_gain(np.ones(10 * n), after, groups).interval_um
        held.append(low_um <= true_um <= high_um)
    assert np.mean(held) >= least


def test_the_last_step_leaves_out_the_readings_it_names() -> None:
    kept = np.arange(200) != 7
    base = np.full(200, 1e-4)
    base[7] = 1.0
    first, last = compute_gains([base, base, base], GROUPS, kept)
    assert first.after_um == pytest.approx(first.before_um)
    assert last.after_um == pytest.approx(10.0)
