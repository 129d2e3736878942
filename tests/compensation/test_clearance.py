"""How high an arm's parts are, and how far from its column, against the plain chain."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.design.clearance import compute_column_distance_mm, compute_height_mm
from armd.compensation.model.arm import Arm
from support import synthetic
from support.plain_kinematics import frames, tip_pose

ARM = synthetic.arm()


def parts(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origins (n, N + 1, 3) of base and links, and tips (n, 3)."""
    p = np.tile(ARM.nominal(), (len(q), 1))
    return frames(q, p)[:, :, :3, 3], tip_pose(q, p)[:, :3, 3]


@pytest.mark.parametrize("up", [(0.0, 0.0, 1.0), (0.0, 1.0, 0.0), (0.6, 0.0, 0.8)])
def test_the_lowest_of_all_joints_and_the_tip_counts(up: tuple[float, ...]) -> None:
    """An arm may stand, hang, or be mounted to a wall: up is against gravity."""
    q = np.random.default_rng(1).uniform(-2.5, 2.5, (40, ARM.n_joints))
    arm = Arm.model_validate(
        ARM.model_dump(mode="json", by_alias=True) | {"gravity": [-x for x in up]}
    )
    origins, tips = parts(q)
    every = np.concatenate([origins, tips[:, None]], axis=1) - origins[:, :1]
    expected = (every @ up).min(axis=1)
    assert compute_height_mm(q, ARM.nominal(), arm) == pytest.approx(expected, abs=1e-9)
    assert expected.min() < -50.0 and (expected <= 0.0).all()  # the base is a part of it


def test_the_distance_is_from_the_first_axis() -> None:
    q = np.random.default_rng(2).uniform(-2.5, 2.5, (40, ARM.n_joints))
    tips = parts(q)[1]
    found = compute_column_distance_mm(q, ARM.nominal())
    assert found == pytest.approx(np.linalg.norm(tips[:, :2], axis=1))
    turned = q.copy()
    turned[:, 0] += 1.0  # about that axis nothing comes nearer
    assert compute_column_distance_mm(turned, ARM.nominal()) == pytest.approx(found)
