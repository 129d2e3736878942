"""The demo's verdict: what it may take out, and what it must not."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armd import POINT, Flag
from armd.daemon.commands.service.comparison import TRUTH, compare, load_truth


def made_up(n: int = 2000) -> tuple[np.ndarray, np.ndarray]:
    """Points whose corrected positions err by 10 µm an axis, in a base frame of their own, and
    whose corrections are 300 µm along x."""
    rng = np.random.default_rng(1)
    truth = np.zeros(n, TRUTH)
    truth["seq"] = np.arange(n)
    truth["position_mm"] = rng.uniform(-800, 800, (n, 3))
    points = np.zeros(n, POINT)
    points["seq"] = truth["seq"]
    turn = Rotation.from_rotvec([0, 0, 1e-3])
    placed = np.add(turn.apply(truth["position_mm"]), [0.5, -0.3, 0.2])
    points["position_mm"] = placed + rng.normal(0, 0.01, (n, 3))
    points["correction_mm"] = [0.3, 0, 0]
    return points, truth


def test_the_base_frame_is_taken_out_and_nothing_else():
    points, truth = made_up()
    points["flags"][10] = Flag.INVALID
    points["position_mm"][10] = np.nan
    errors = compare(points[5:], truth[:-5])
    assert errors.n == 1989
    assert errors.after_um == pytest.approx(10 * 3**0.5, rel=0.05)
    assert errors.before_um == pytest.approx(300, rel=0.02)
    assert errors.improvement == pytest.approx(300 / 10 / 3**0.5, rel=0.05)
    assert errors.correction_um == pytest.approx(300)


def test_a_record_that_is_not_whole_yet_is_left_out(tmp_path):
    _, truth = made_up(3)
    (tmp_path / "truth.bin").write_bytes(truth.tobytes() + b"half a record")
    np.testing.assert_array_equal(load_truth(tmp_path / "truth.bin"), truth)
