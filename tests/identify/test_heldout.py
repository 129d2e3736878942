"""The held-out figure is what readings elsewhere miss by: all of them, outliers too."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.identify.heldout import HeldOut
from support import synthetic
from support.selection import parametrize_default

ARM = synthetic.arm()
SEEDS = 6


def noisy(session: Session, rng: np.random.Generator, wrong: int) -> Session:
    """10″ on every encoder, and so many readings gone wrong by 1 mrad of joint 3."""
    q = session.states.q + 5e-5 * rng.normal(size=session.states.q.shape)
    q[rng.choice(len(q), wrong, replace=False), 2] += 1e-3
    return replace(session, states=replace(session.states, q=q))


def rms(values: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.slow
@parametrize_default(("readings", "wrong"), [(24, 0), (200, 0), (200, 8)])
def test_readings_of_a_tracker(readings: int, wrong: int) -> None:
    printed, without, elsewhere = [], [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        whole = synthetic.tracked(ARM, synthetic.disturbed(ARM, rng), rng, readings=2 * readings)
        first = np.arange(2 * readings) < readings
        one, other = (noisy(whole.rows(half), rng, wrong) for half in (first, ~first))
        result = calibrate([one], ARM, Options(thermal_order=0))
        printed.append(result.heldout_rms_um)
        without.append(result.heldout.without_down_weighted_um)
        assert result.heldout.n_down_weighted == len(result.fit.down_weighted) >= wrong // 2
        assert (" without the " in result.heldout.in_words()) == (
            result.heldout.n_down_weighted > 0
        )
        elsewhere.append(evaluate([other], ARM, result.calibration).rms_um)
    assert rms(printed) == pytest.approx(rms(elsewhere), rel=0.2)
    assert rms(without) <= rms(printed)
    assert (rms(without) < 0.8 * rms(printed)) == (wrong > 0)


@pytest.mark.slow
def test_seats_at_other_places() -> None:
    """Two seats: where they lie in their plate is told by the placements that stay."""
    printed, elsewhere = [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        truth = synthetic.disturbed(ARM, rng)
        whole = synthetic.session(
            ARM, truth, rng, readings=192, placements=8, targets=2, known=False,
            distances=[(0, 1)], spread_mm=100.0,
        )  # fmt: skip
        even = whole.placement % 2 == 0
        one, other = (noisy(whole.rows(half), rng, 0) for half in (even, ~even))
        result = calibrate([one], ARM, Options(thermal_order=0))
        assert result.heldout_by == "placement"
        printed.append(result.heldout_rms_um)
        elsewhere.append(evaluate([other], ARM, result.calibration).rms_um)
    # Evaluated, the other half finds its seats anew: it misses by a little less.
    assert 0.95 * rms(elsewhere) < rms(printed) < 1.25 * rms(elsewhere)


def test_sessions_that_a_fold_leaves_alone_are_as_it_would_find_them_itself() -> None:
    """Three sessions, two placements each, of which the fold takes one placement of the first."""
    rng = np.random.default_rng(7)
    truth = synthetic.disturbed(ARM, rng)
    sessions = [
        replace(synthetic.session(ARM, truth, rng, readings=60, placements=2), name=f"s{i}")
        for i in range(3)
    ]
    result = calibrate([noisy(s, rng, 0) for s in sessions], ARM, Options(thermal_order=0)).fit
    columns = result.unknowns.columns(
        result.linearisation.jacobian, result.linearisation.basis, result.terms
    )
    scale, pull = result.solution.scale, -result.departure
    out = result.observations.placement == 0
    fold = (
        HeldOut(result, columns, scale, result.linearisation.residual_mm, pull, [out])
        .folds[0]
        .training
    )
    own = replace(fold, full_problem=None)
    taken = [fold._placements._is_as_in_full_problem(number) for number in range(3)]
    assert taken == [False, True, True]
    np.testing.assert_array_equal(fold.solve(scale, pull).step, own.solve(scale, pull).step)
