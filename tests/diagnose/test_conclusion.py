"""What a diagnosis ends with: odds that held-out readings lower, outliers by session and row."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.conclusion import lower_odds, name_outliers
from armd.compensation.diagnose.diagnosis import Finding, Outlier
from support.small_fit import candidate


def test_held_out_readings_lower_the_odds_of_a_finding_that_they_speak_against() -> None:
    causes = [candidate("encoder_slip", 1), candidate("encoder_scale", 2)]
    found = [Finding(cause, 1e-9, 90.0, 0.8, (), ()) for cause in causes]
    doubted, other = lower_odds(found, {0: 0.25})
    assert doubted.probability == pytest.approx(0.5)  # four to one, by a quarter
    assert other.probability == pytest.approx(0.8)


def test_an_outlier_is_every_reading_of_its_rest_by_session_and_row() -> None:
    """Two sessions of three readings, the second without its first two rows; rest 2 has two."""
    sessions = [
        SimpleNamespace(n=3, row=np.array([0, 1, 2]), name="morning"),
        SimpleNamespace(n=3, row=np.array([2, 3, 4]), name="evening"),
    ]
    rests: Any = SimpleNamespace(sessions=sessions, rest_of=np.array([0, 0, 1, 2, 2, 3]))
    last: Any = SimpleNamespace(left_mm=np.array([[0, 0, 0], [0, 0, 0], [0.3, 0, 0.4], [0, 0, 0]]))
    assert name_outliers(np.array([2]), rests, last) == (
        Outlier("evening", 3, pytest.approx(500.0)),
        Outlier("evening", 4, pytest.approx(500.0)),
    )
    assert name_outliers(np.array([], dtype=int), rests, last) == ()
