"""What findings that are not written leave open, and what a diagnosis makes of that file."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.heldout import open_constants
from armd.compensation.diagnose.heldout.open_constants import add_open_constants
from armd.compensation.diagnose.problem.baseline import (
    LEFT_OPEN,
    collect_identified,
    from_calibration,
)
from armd.compensation.model.calibration import Calibration
from support import synthetic
from support.drawn import drawn
from support.small_fit import candidate

ARM = synthetic.arm()
FINDINGS = tuple(candidate("encoder_scale", k) for k in (1, 2, 3))
COVARIANCE_OF = ["a_2", "theta_3"]
#: By how much each finding, once written, moves what was identified: mm and rad.
MOVES = {0: (0.02, 1e-5), 1: (-0.05, 0.0), 2: (0.01, -3e-5)}


def calibration(*numbers: int, provenance: dict[str, Any] | None = None) -> Calibration:
    """Make the calibration written with some of the findings, by their *numbers*."""
    content = drawn(
        ARM,
        covariance_of=COVARIANCE_OF,
        covariance=[[1e-6, 0.0], [0.0, 1e-12]],
        provenance=provenance or {"diagnosis": {}},
    )
    moves = [sum(MOVES[i][k] for i in numbers) for k in range(2)]
    constants = content.constants | {
        name: content.constants[name] + by for name, by in zip(COVARIANCE_OF, moves, strict=True)
    }
    return content.model_copy(update={"constants": constants})


@pytest.fixture
def last(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A fit of the three findings whose refits are the numbers of those in it."""
    monkeypatch.setattr(
        open_constants,
        "Refits",
        lambda *_: SimpleNamespace(with_subset=lambda numbers: tuple(numbers)),
    )
    monkeypatch.setattr(
        open_constants, "extend_calibration", lambda numbers, *_: calibration(*numbers)
    )
    return SimpleNamespace(
        findings=FINDINGS, noise=None, baseline=SimpleNamespace(calibration=calibration())
    )


def ways_of(content: Calibration) -> list[dict[str, Any]]:
    return content.provenance["diagnosis"][LEFT_OPEN]


def test_each_finding_left_out_says_how_it_would_move_the_constants(last: Any) -> None:
    written = add_open_constants(calibration(0), last, [0], ARM, [])
    ways = ways_of(written)
    assert [way["finding"] for way in ways] == ["encoder_scale joint 2", "encoder_scale joint 3"]
    for way, i in zip(ways, (1, 2), strict=True):
        assert way["moves"] == pytest.approx(dict(zip(COVARIANCE_OF, MOVES[i], strict=True)))
    assert written.constants == calibration(0).constants


def test_with_all_written_nothing_is_open(last: Any) -> None:
    written = calibration(0, 1, 2)
    assert add_open_constants(written, last, [0, 1, 2], ARM, []) is written


def test_what_was_open_before_stays_so_only_where_nothing_new_is_known(last: Any) -> None:
    before = {"finding": "axis_wobble joint 2", "moves": {"a_2": 0.3, "theta_3": 0.0}}
    earlier = {"diagnosis": {"earlier": {LEFT_OPEN: [before]}}}
    nothing = add_open_constants(calibration(provenance=earlier), last, [], ARM, [])
    assert ways_of(nothing)[0] == before and len(ways_of(nothing)) == 4
    written = add_open_constants(calibration(0, provenance=earlier), last, [0], ARM, [])
    assert len(ways_of(written)) == 2


def test_a_diagnosis_under_it_takes_each_way_as_one_standard_uncertainty(last: Any) -> None:
    """Covariance + Σ m mᵀ, where the calibration is held; as it stands where it is not."""
    written = add_open_constants(calibration(0), last, [0], ARM, [])
    own = np.array([[1e-6, 0.0], [0.0, 1e-12]])
    moves = np.array([MOVES[1], MOVES[2]])
    for held, expected in ((True, own + moves.T @ moves), (False, own)):
        root = from_calibration(written, ARM, held).root
        assert root @ root.T == pytest.approx(expected, rel=1e-9, abs=1e-20)


def test_constants_and_coefficients_by_their_names() -> None:
    content = calibration(0)
    found = collect_identified(content, ["theta_3", "a_2"])
    assert found.tolist() == [content.constants["theta_3"], content.constants["a_2"]]
