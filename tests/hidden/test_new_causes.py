"""What used to be strangers: each planted by the simulator's own physics, found, named, sized."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.report.verdict import write_verdict
from armd.simulator.campaigns.hidden import Design
from armd.simulator.plants.plant import Plant
from support.made_case import make_case
from support.planting import ARC_SECOND
from support.selection import parametrize_default

DESIGN = Design(sessions=5, articulations=3, holdout=0)


def diagnosed(seed: int, plant: Plant) -> Diagnosis:
    made = make_case(seed, [plant], DESIGN)
    return diagnose(made.sessions, made.arm)


@parametrize_default(
    ("plant", "size"),
    [
        # A disc's radius is 25 mm, of which the offset is the sine of the error.
        (Plant("encoder_thermal", "joint 3", 0.3), 0.3e-3 / 25.0),
        (Plant("gear_mesh", "joint 3", 4.0, {"other": 2, "waves": 5, "ratio": 0}), 4 * ARC_SECOND),
        (Plant("gear_mesh", "joint 5", 6.0, {"other": 4, "waves": 2, "ratio": 1}), 6 * ARC_SECOND),
        (Plant("stylus_sag", "tip", 20.0), 20e-3),
    ],
    ids=lambda value: f"{value.cause}-{dict(value.detail)}" if isinstance(value, Plant) else "",
    default=1,
)
def test_it_is_found_named_and_sized(plant: Plant, size: float) -> None:
    found = diagnosed(31, plant)
    assert {f.candidate.place for f in found.findings} == {(plant.cause, plant.location)}
    assert found.findings[0].probability > 0.95
    assert 0 in found.written
    values, covariance = found.search.last.amplitudes[0], found.search.last.covariances[0]
    length = float(np.linalg.norm(values))
    sigma = float(np.sqrt(values @ covariance @ values)) / length
    assert length == pytest.approx(size, abs=3 * sigma)
    assert sigma < size / 5


@parametrize_default(
    ("plant", "size", "word"),
    [
        (Plant("self_heating", "joint 3", 60.0, {"time_constant_s": 300.0}), 60 * ARC_SECOND, ""),
        # Between supports near its ends a beam hangs nearly as the square of the place along it.
        (Plant("artefact_sag", "artefact", 40.0, {"supports": 0.9}), None, "longest"),
    ],
    ids=lambda value: value.cause if isinstance(value, Plant) else "",
    default=0,
)
def test_what_no_calibration_can_hold_is_told_and_not_written(
    plant: Plant, size: float | None, word: str
) -> None:
    found = diagnosed(32, plant)
    assert [f.candidate.place for f in found.findings] == [(plant.cause, plant.location)]
    assert found.written == ()
    assert found.gains[0].is_confirmed
    assert "No calibration can contain 1: reported, and not written." in write_verdict(found)
    given, written = found.baseline.calibration, found.extended
    assert (written.constants, written.terms) == (given.constants, given.terms)
    (value,) = found.search.last.amplitudes[0]
    sigma = float(np.sqrt(found.search.last.covariances[0][0, 0]))
    assert word in found.findings[0].candidate.columns[0].name
    if size is None:
        assert abs(value) == pytest.approx(1e-3 * plant.size, rel=0.2)
    else:
        # The time constant, scanned, moves the size too: by a fifth of it at most here.
        assert abs(value) == pytest.approx(size, abs=3 * sigma + 0.2 * size)
