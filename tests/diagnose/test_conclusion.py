"""What a diagnosis ends with: odds that held-out readings lower, outliers by session and row."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.conclusion import name_outliers, reduce_odds
from armd.compensation.diagnose.diagnosis import Finding, Outlier
from armd.compensation.diagnose.problem.layout import EXPANSIONS
from armd.compensation.diagnose.report.verdict import _nothing_found
from support.small_fit import candidate


def test_held_out_readings_lower_the_odds_of_a_finding_that_they_speak_against() -> None:
    causes = [candidate("encoder_slip", 1), candidate("encoder_scale", 2)]
    found = [Finding(cause, 1e-9, 90.0, 0.8, (), ()) for cause in causes]
    doubted, other = reduce_odds(found, {0: 0.25})
    assert doubted.probability == pytest.approx(0.5)  # four to one, by a quarter
    assert other.probability == pytest.approx(0.8)


def test_an_outlier_is_every_reading_of_its_rest_by_session_and_row() -> None:
    """Two sessions of three readings, the second without its first two rows; rest 2 has two."""
    sessions = [
        SimpleNamespace(n=3, row=np.array([0, 1, 2]), name="morning"),
        SimpleNamespace(n=3, row=np.array([2, 3, 4]), name="evening"),
    ]
    rests: Any = SimpleNamespace(sessions=sessions, rest_of=np.array([0, 0, 1, 2, 2, 3]))
    last: Any = SimpleNamespace(
        rest_residual_mm=np.array([[0, 0, 0], [0, 0, 0], [0.3, 0, 0.4], [0, 0, 0]])
    )
    assert name_outliers(np.array([2]), rests, last) == (
        Outlier("evening", 3, pytest.approx(500.0)),
        Outlier("evening", 4, pytest.approx(500.0)),
    )
    assert name_outliers(np.array([], dtype=int), rests, last) == ()


@pytest.mark.parametrize(
    ("remain_um", "held", "said"),
    [
        (4.5, True, "they are explained by the calibration's uncertainty; 4.50 µm remain"),
        (8.0, True, "a part is explained by the calibration's uncertainty; nothing in the "
                    "catalogue, nor any smooth structure, explains the 8.00 µm that remain"),
        (19.0, True, "makes: nothing in the catalogue, nor any smooth structure, explains them."),
        (4.5, False, "makes: nothing in the catalogue, nor any smooth structure, explains them."),
    ],
)  # fmt: skip
def test_nothing_explains_the_residuals_only_where_nothing_absorbs_them(
    remain_um: float, held: bool, said: str
) -> None:
    """Residuals of 20 µm in a noise of 4, of which what is under test leaves some."""
    left_mm = np.tile([1e-3 * remain_um, 0.0, 0.0], (4, 1))
    of = SimpleNamespace(stop=0, start=0)
    last = SimpleNamespace(
        baseline=SimpleNamespace(growth=(), is_given=held),
        point_residual_mm=left_mm,
        layout=SimpleNamespace(blocks={EXPANSIONS: of}),
    )
    found: Any = SimpleNamespace(rms_um=20.0, noise_floor_um=4.0, search=SimpleNamespace(last=last))
    assert said in _nothing_found(found, ())
