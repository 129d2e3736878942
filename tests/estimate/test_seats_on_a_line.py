"""Seats of a beam: on a line, on something that grows, and nobody has certified where they are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.data.session import Session
from armd.compensation.estimate.observations import gather
from armd.compensation.estimate.poses import fit_poses
from armd.compensation.identify.calibrate import calibrate
from support import synthetic

ARM = synthetic.arm()
PER_K = 5e-6
ALONG_MM = np.array([0.0, 475.0, 285.0, 380.0, 190.0])


def warming(session: Session, celsius: np.ndarray) -> Session:
    artefact = session.artefact.model_copy(update={"expansion_per_k": PER_K})
    return replace(session, artefact=artefact, artefact_c=celsius)


@pytest.mark.parametrize("seed", range(10))
def test_a_seat_lies_in_the_middle_of_its_readings(seed: int) -> None:
    """Of one placement that is the least squares' answer, to within what five seats grow in 6 K.
    One of these, they threw 12 mm off."""
    rng = np.random.default_rng(1)
    one = synthetic.session(
        ARM, ARM.nominal(), rng, targets=5, known=False, placements=1, readings=40
    )
    observations = gather([warming(one, 20.0 + np.linspace(-3.0, 3.0, 40))], ARM)
    rng = np.random.default_rng(seed)
    along = rng.normal(size=3)
    along /= np.linalg.norm(along)
    at_mm = rng.uniform(-400.0, 400.0, 3) + np.outer(ALONG_MM[one.target], along)
    tip_mm = at_mm + rng.normal(0.0, 0.05, at_mm.shape)
    left = fit_poses(observations, tip_mm).residual(observations, tip_mm)
    for k in range(5):
        assert np.linalg.norm(left[one.target == k].mean(axis=0)) < 1e-4


def test_an_arm_is_calibrated_on_a_beam_of_seats() -> None:
    """Four sessions on five seats with four certified lengths each."""
    rng = np.random.default_rng(7)
    truth = synthetic.disturbed(ARM, rng, 0.3)
    sessions = []
    for k in range(4):
        along = rng.normal(size=3)
        beam = np.outer(np.linspace(-200.0, 200.0, 5), along / np.linalg.norm(along))
        one = synthetic.session(
            ARM, truth, rng, points=beam, known=False, placements=1, readings=60,
            distances=[(j, j + 1) for j in range(4)], encoder_rad=4e-6, name=f"beam-{k}",
        )  # fmt: skip
        sessions.append(warming(one, 20.0 + 0.02 * rng.normal(size=60)))
    result = calibrate(sessions, ARM)
    assert result.rms_um < 10.0
    assert result.heldout.rms_um < 15.0
