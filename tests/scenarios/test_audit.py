"""The soak's judge is itself judged: it must see each kind of wrong point."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armd import POINT, Flag
from support.audit import Audit
from support.simulated_arm import TRUTH

N = 1000
STOP = {"event": "stop", "seq": N, "monotonic_ns": 10**9}


def truth_log(folder: Path) -> Path:
    truth = np.zeros(N, TRUTH)
    truth["seq"] = np.arange(N)
    truth["position_mm"] = np.arange(N)[:, None] * [1.0, 2.0, 3.0]
    (folder / "truth.bin").write_bytes(truth.tobytes())
    return folder / "truth.bin"


def true_points() -> np.ndarray:
    points = np.zeros(N, POINT)
    points["seq"] = np.arange(N)
    points["position_mm"] = np.arange(N)[:, None] * [1.0, 2.0, 3.0]
    points["position_mm"][:, 0] += 0.005
    return points


def without(points: np.ndarray, first: int, last: int) -> np.ndarray:
    """Lose first … last, and say so."""
    left = np.concatenate([points[:first], points[last + 1 :]])
    left["flags"][first] |= int(Flag.SAMPLES_LOST)
    return left


def judged(folder: Path, points: np.ndarray, *log: dict[str, Any]) -> dict[str, Any]:
    audit = Audit(truth_log(folder), 1000)
    for i, batch in enumerate(np.array_split(points, 10)):
        audit.take(batch, i)
    audit.settle()
    return audit.report([*log, STOP])


def test_true_points_pass(tmp_path: Path) -> None:
    report = judged(tmp_path, true_points())
    assert report["delivered"] == N
    assert report["wrong"] == 0
    assert report["unexplained"] == 0
    assert report["max_error_um"] == pytest.approx(5.0)


def far(points: np.ndarray) -> np.ndarray:
    points["position_mm"][500] += 1.0
    return points


def invented(points: np.ndarray) -> np.ndarray:
    points["seq"][-1] = 5_000_000_000
    return points


def repeated(points: np.ndarray) -> np.ndarray:
    return np.concatenate([points[:500], points[499:]])


def silent_loss(points: np.ndarray) -> np.ndarray:
    return np.concatenate([points[:500], points[501:]])


def false_alarm(points: np.ndarray) -> np.ndarray:
    points["flags"][500] = int(Flag.SAMPLES_LOST)
    return points


def invalid_with_position(points: np.ndarray) -> np.ndarray:
    points["flags"][500] = int(Flag.INVALID)
    return points


def no_position(points: np.ndarray) -> np.ndarray:
    points["position_mm"][500] = np.nan
    return points


@pytest.mark.parametrize(
    "spoil",
    [far, invented, repeated, silent_loss, false_alarm, invalid_with_position, no_position],
)
def test_a_wrong_point_is_seen(spoil: Any, tmp_path: Path) -> None:
    assert judged(tmp_path, spoil(true_points()))["wrong"] >= 1


def test_a_loss_wants_a_reason(tmp_path: Path) -> None:
    points = without(true_points(), 400, 409)
    assert judged(tmp_path, points)["unexplained"] == 10
    withheld = {"event": "withheld", "reason": "lost_samples", "first_seq": 400, "last_seq": 407}
    report = judged(tmp_path, points, withheld)
    assert report["withheld"] == {"lost_samples": 8}
    assert report["unexplained_seq"] == [408, 409]
    assert report["wrong"] == 0


def test_an_invalid_point_wants_a_reason(tmp_path: Path) -> None:
    points = true_points()
    points["flags"][300:302] = int(Flag.INVALID)
    points["position_mm"][300:302] = np.nan
    assert judged(tmp_path, points)["unexplained"] == 2
    begin = {"event": "begin", "fault": "joint_invalid", "seq": 300}
    end = {"event": "end", "fault": "joint_invalid", "seq": 302}
    assert judged(tmp_path, points, begin, end)["unexplained"] == 0


def test_recovery_runs_from_the_faults_end_to_the_first_point(tmp_path: Path) -> None:
    points = without(true_points(), 300, 309)
    begin = {"event": "begin", "fault": "silence", "seq": 300}
    end = {"event": "end", "fault": "silence", "seq": 308, "monotonic_ns": -500_000_000}
    report = judged(tmp_path, points, begin, end)
    assert report["unexplained"] == 0
    assert report["longest_recovery_s"] == {"silence": 0.5}
