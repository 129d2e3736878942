"""A region of postures where the arm is wrong is fitted; readings gone wrong are not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.estimate.noise.regions import find_regions
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.identify import fit as fitting
from armd.compensation.identify.evaluation.evaluate import evaluate_model
from armd.compensation.identify.fit import Identification
from support import synthetic
from support.fitted import fit_constants

ARM = synthetic.arm()


def half(truth: np.ndarray, rng: np.random.Generator, bump_rad: float) -> Observations:
    """300 postures; around 1.5 rad of joint 3, in a tenth of them, joint 2 reads too much."""
    seen = synthetic.tracked(ARM, truth, rng, readings=300)
    q = seen.states.q.copy()
    q[:, 1] += bump_rad * np.exp(-(((q[:, 2] - 1.5) / 0.3) ** 2))
    q += 1e-5 * rng.normal(size=q.shape)
    return collect_observations([replace(seen, states=replace(seen.states, q=q))], ARM)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_region_serves_the_other_half_as_plain_least_squares_does(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    rng = np.random.default_rng(seed)
    truth = synthetic.disturbed(ARM, rng)
    one, other = (half(truth, rng, 6e-4) for _ in range(2))

    def elsewhere_um(found: Identification) -> float:
        return evaluate_model(other, found.constants, [], 20.0).rms_um

    found = fit_constants(one)
    monkeypatch.setattr(
        fitting, "compute_redescending_weights", lambda d2, region: np.ones_like(d2)
    )
    plain = fit_constants(one)
    assert found.region.sum() > 25
    assert elsewhere_um(found) < 1.01 * elsewhere_um(plain)


def test_readings_gone_wrong_at_random_are_no_region() -> None:
    rng = np.random.default_rng(3)
    q = rng.uniform(-2.0, 2.0, (600, 6))
    far = rng.random(600) < 0.1
    assert find_regions(far, q).sum() < 0.05 * far.sum()
    # One posture read ten times while the ball lay beside its seat is no region either.
    q[:10] = q[0]
    far[:] = False
    far[:10] = True
    assert not find_regions(far, q).any()
    # Where every reading in a range of one joint is far off, nearly all of them are one.
    far = q[:, 3] > 1.7
    assert find_regions(far, q).sum() > 0.9 * far.sum()
