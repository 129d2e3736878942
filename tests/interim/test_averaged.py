"""Corrections averaged over what checks cannot tell apart: against the posterior written out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from test_interim_evidence import a_stack, density

from armd.compensation.interim.changes import scenarios as module
from armd.compensation.interim.changes.change import Change
from armd.compensation.interim.changes.scenarios import list_scenarios
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.likelihood import NOISE_WEIGHT, SIZES
from armd.compensation.interim.evidence.stack import Stack
from armd.compensation.interim.report.amend import fit
from armd.compensation.interim.report.average import Averaged, compute_average


def a_step(of: Stack, cause: int, first: int) -> Change:
    return Change(cause, False, first, first, first, float(of.time_d[first]), np.nan)


def steps_alone(causes: list[Cause]) -> list[Cause]:
    return [replace(cause, prior_gradual=0.0) for cause in causes]


def moments(of: Stack, causes: list[Cause], probe: np.ndarray) -> tuple[float, float]:
    """Mean and variance of what all columns do at a *probe* (C,) after the last check, over every
    cause, onset and size; covariances of all readings written out in full."""
    z = np.concatenate(of.residual)
    known = np.concatenate(of.error_columns)
    logs, means, variances = [], [], []
    for first in range(of.n):
        step = np.arange(of.n) >= first
        for cause, block in zip(causes, of.blocks, strict=True):
            more = [w * x[:, block] for w, x in zip(step, of.columns, strict=True)]
            x = np.concatenate(more)
            for size in SIZES:
                shape = np.eye(len(z)) + known @ known.T + size**2 * x @ x.T
                gain = size**2 * x.T @ np.linalg.inv(shape)
                scale = (NOISE_WEIGHT + z @ np.linalg.inv(shape) @ z) / (NOISE_WEIGHT + len(z))
                own = scale * (size**2 * np.eye(x.shape[1]) - size**2 * gain @ x)
                at = probe[block]
                logs.append(density(of, more, size) + np.log(cause.prior_sudden))
                means.append(-at @ gain @ z)  # a correction takes away what the readings show
                variances.append(at @ own @ at)
    share = np.exp(np.array(logs) - max(logs))
    share /= share.sum()
    mean = share @ means
    return float(mean), float(share @ (np.array(variances) + (np.array(means) - mean) ** 2))


def at_probe(found: Averaged, of: Stack, probe: np.ndarray) -> tuple[float, float]:
    row = np.concatenate([probe[of.blocks[change.cause]] for change in found.changes])
    mean = row @ np.concatenate([value.ravel() for value in found.amplitudes.values])
    return float(mean), float(row @ found.amplitudes.covariance @ row)


@pytest.mark.parametrize("seed", range(3))
def test_mean_and_variance_are_those_of_the_posterior(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "KEPT_SHARE", 1.0)
    monkeypatch.setattr(module, "MOST_SCENARIOS", 10_000)
    rng = np.random.default_rng(seed)
    of, causes = a_stack(rng)
    causes = steps_alone(causes)
    every = list_scenarios(of, causes, [a_step(of, 0, 2)], ())
    assert len(every) == of.n * len(causes) * len(SIZES)
    found = compute_average(of, causes, every, ())
    for _ in range(3):
        probe = rng.normal(size=3)
        assert at_probe(found, of, probe) == pytest.approx(moments(of, causes, probe), rel=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_what_is_left_out_has_little_share(seed: int) -> None:
    rng = np.random.default_rng(seed)
    of, causes = a_stack(rng)
    causes = steps_alone(causes)
    few = list_scenarios(of, causes, [a_step(of, 0, 2)], ())
    shares = [share for share, _ in few]
    assert sum(shares) == pytest.approx(1.0) and shares == sorted(shares, reverse=True)
    probe = rng.normal(size=3)
    mean, variance = moments(of, causes, probe)
    near, its_variance = at_probe(compute_average(of, causes, few, ()), of, probe)
    assert abs(near - mean) < 0.1 * np.sqrt(variance)
    assert its_variance == pytest.approx(variance, rel=0.2)


def test_two_changes_are_averaged_each_over_its_own_causes() -> None:
    of, causes = a_stack(np.random.default_rng(0))
    causes = steps_alone(causes)
    of = replace(of, residual=tuple(
        z + 30.0 * (x[:, 0] * (i >= 1) + x[:, 1] * (i >= 3))
        for i, (z, x) in enumerate(zip(of.residual, of.columns, strict=True))
    ))  # fmt: skip
    found = compute_average(
        of, causes, list_scenarios(of, causes, [a_step(of, 0, 1), a_step(of, 1, 3)], ()), ()
    )
    assert found.of_change == tuple(sorted(found.of_change)) and set(found.of_change) == {0, 1}
    for number in (0, 1):
        own = {i: found.shares[i] for i, n in enumerate(found.of_change) if n == number}
        assert sum(own.values()) == pytest.approx(1.0)
        likeliest = max(own, key=lambda i: own[i])
        assert found.changes[likeliest].cause == number
        assert found.amplitudes.values[likeliest][0, 0] == pytest.approx(-30.0, rel=0.2)
    assert found.count_until(0) == sum(number == 0 for number in found.of_change)


def test_an_unnamed_change_has_no_amplitudes() -> None:
    of, causes = a_stack(np.random.default_rng(1))
    strange = Change(None, False, 3, 3, 3, np.nan, 1.0)
    found = compute_average(of, causes, list_scenarios(of, causes, [strange], ()), ())
    assert found.changes == (strange,) and found.amplitudes.covariance.size == 0


def test_how_far_a_cause_moved_is_the_difference_of_after_and_before() -> None:
    """What it was before is asked of the checks before, however small standing errors are."""
    rng = np.random.default_rng(4)
    columns = tuple(30.0 * rng.normal(size=(20, 1)) for _ in range(8))
    was, moved = 0.2, 0.5
    residual = tuple(x[:, 0] * (was + moved * (i >= 4)) for i, x in enumerate(columns))
    _, (one, _) = a_stack(rng)
    known = tuple(0.3 * x for x in columns)
    nothing = tuple(np.zeros((20, 0)) for _ in range(8))
    of = Stack(np.arange(8.0), residual, columns, known, nothing, (slice(0, 1),), (0, 1), 0.3)
    of = of.rescale(0.01 / 0.3)
    found = fit(of, [one], (a_step(of, 0, 4),), ())
    assert found.values[0][0, 0] == pytest.approx(-moved, abs=0.02)
