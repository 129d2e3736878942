"""The word at the top of a report says no more than the result below it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from armd.compensation.interim.recorrection.quality_page import Impact
from armd.compensation.report.diagnosis.page import write_headline


def found(cause: str, location: str = "joint 3", shown: bool = True, guess: bool = False) -> Any:
    return {
        "cause": cause,
        "location": location,
        "depends_on": ["q3"],
        "rows": [{}, {}],
        "gain": {"shown": shown},
        "explains": {"guess": guess},
    }


def told(*findings: Any, significant: bool = False) -> tuple[str, str]:
    unexplained = {"significant": significant}
    return write_headline({"findings": findings, "unexplained": unexplained, "verdict": "Why not."})


DISC, SAG = found("encoder_eccentricity"), found("joint_compliance", "joint 2", guess=True)
DOUBT = found("gear_mesh", shown=False)
STRANGE = found("unknown", "-")
MOVED, FAR = found("artefact_moved", "artefact"), found("outliers", "rows")


@pytest.mark.parametrize(
    ("findings", "word", "reason"),
    [
        ([DISC], "ONE CAUSE FOUND", "encoder eccentricity, joint 3."),
        (
            [MOVED, DISC],
            "ONE CAUSE FOUND",
            "encoder eccentricity, joint 3. Not counted: artefact moved.",
        ),
        (
            [DISC, SAG, DOUBT],
            "2 CAUSES FOUND",
            "encoder eccentricity, joint 3; joint compliance, joint 2 (the name is a guess)."
            " Not counted: gear mesh, joint 3 (held-out readings do not confirm it).",
        ),
        (
            [DOUBT],
            "NOT CONFIRMED",
            "gear mesh, joint 3 (held-out readings do not confirm it).",
        ),
        ([STRANGE], "CAUSE UNKNOWN", "an error that depends on q3 and fits no known cause."),
        ([MOVED], "NO CAUSE IN THE ARM", "artefact moved."),
        ([FAR], "NO CAUSE FOUND", "Only 2 readings far from where all others put them."),
        ([], "NO CAUSE FOUND", "Why not."),
    ],
)
def test_a_diagnosis(findings: list[Any], word: str, reason: str) -> None:
    assert told(*findings) == (word, reason)


def test_what_is_left_unexplained_is_never_called_no_cause() -> None:
    assert told(significant=True) == ("CAUSE UNKNOWN", "Why not.")
    assert told(FAR, significant=True)[0] == "CAUSE UNKNOWN"
    assert told(DISC, significant=True)[0] == "ONE CAUSE FOUND"


NAN = float("nan")


@pytest.mark.parametrize(
    ("distance_mm", "uncertainty_mm", "tolerance_mm", "word", "good"),
    [
        ([0.01, 0.2, 0.3], [0.001] * 3, 0.1, "2 OF 3 MEASUREMENTS AFFECTED", False),
        ([0.01, 0.09], [0.001, 0.02], 0.1, "1 OF 2 MEASUREMENTS MAY BE AFFECTED", False),
        ([0.01, 0.02], [0.001] * 2, 0.1, "NONE OF 2 MEASUREMENTS AFFECTED", True),
        # Within the tolerance as far as is known, and that is not all.
        ([0.01, 0.02], [0.001, NAN], 0.1, "NONE OF 2 MEASUREMENTS AFFECTED", None),
        ([0.01, NAN], [0.001, NAN], 0.1, "NONE OF 2 MEASUREMENTS AFFECTED", None),
        ([0.01, 9.0], [0.001] * 2, None, "NOT JUDGED: NO TOLERANCE", None),
    ],
)
def test_measurements_corrected_again(
    distance_mm: list[float],
    uncertainty_mm: list[float],
    tolerance_mm: float | None,
    word: str,
    good: bool | None,
) -> None:
    n = len(distance_mm)
    change = Impact(
        "A-1", "00", range(n), [0] * n, np.array(distance_mm), np.array(uncertainty_mm),
        tolerance_mm,
    )  # fmt: skip
    assert change.headline() == (word, good)
