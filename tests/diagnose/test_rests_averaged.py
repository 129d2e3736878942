"""Readings of one rest enter the diagnosis as their mean, with all that belongs to a reading."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.model.kinematics import compute_pose
from support import synthetic

#: What an observation has for each reading.
EACH = ("session", "placement", "target", "truth_mm", "stretch", "reflector",
        "measured_turn", "turned")  # fmt: skip


def test_three_readings_of_each_rest_are_one_row_of_every_column() -> None:
    arm = synthetic.arm()
    rng = np.random.default_rng(1)
    one = synthetic.session(arm, arm.nominal(), rng, readings=60, targets=5, placements=3)
    thrice = one.rows(np.repeat(np.arange(60), 3))
    q = thrice.states.q + 1e-6 * rng.normal(size=thrice.states.q.shape)
    states = replace(thrice.states, q=q, time_s=np.arange(180.0))
    observations = collect_rests([replace(thrice, states=states)], arm).observations
    named = {field.name for field in fields(observations)}
    for name in EACH:
        assert name in named
        assert len(getattr(observations, name)) == 60, name
    position = compute_pose(observations.states.q, np.tile(arm.nominal(), (60, 1)))[0]
    residual = fit_poses(observations, position).residual(observations, position)
    assert np.abs(residual).max() < 1e-2
