"""A default plan of a guided measurement yields what its certificate and its tests want."""

from __future__ import annotations

import pytest

from armd.compensation.data.sessions.format import Artefact
from armd.compensation.model.arm import Arm
from armd.daemon.measure.plan.kinds import make_plan
from armd.daemon.measure.plan.stations import Wishes


def arm(joints: int) -> Arm:
    return Arm.model_validate(
        {"schema": "armd.arm/1", "serial_number": "A", "joint": [{"a_mm": 300.0}] * joints}
    )


def balls(certified: int, unknown: int = 0) -> Artefact:
    targets: list[dict[str, object]] = [
        {"name": f"B{k}", "position_mm": [100.0 * k, 0.0, 0.0]} for k in range(certified)
    ]
    targets += [{"name": f"S{k}"} for k in range(unknown)]
    return Artefact.model_validate({"name": "bar", "target": targets})


@pytest.mark.parametrize(
    ("joints", "artefact", "wishes", "readings"),
    [
        # 21 constants, 18 of three placements: 39 unknowns, 13 readings and one more, three times
        (6, balls(3), Wishes(), 45),
        # and 9 of three unknown points: 48, 17 readings, 51: 6 rounds of 9
        (6, balls(0, 3), Wishes(), 54),
        (6, balls(10), Wishes(), 90),
        (5, balls(2), Wishes(), 42),
        (6, balls(3), Wishes(repeats=3), 27),
    ],
)
def test_an_artefacts_default_plan_is_enough_for_a_certificate(
    joints: int, artefact: Artefact, wishes: Wishes, readings: int
) -> None:
    assert len(make_plan("artefact", arm(joints), artefact, wishes).stations) == readings


def ball(**more: object) -> Artefact:
    sphere = {"between": ["SPHERE.a", "SPHERE.b"], "length_mm": 25.0}
    return Artefact.model_validate({"name": "ball", "distance": [sphere], **more})


def test_a_certified_sphere_is_all_that_a_verification_wants() -> None:
    """2 × 25, 5 × 5 and 3 × 9 points on it (docs/how-to/verify.md), none written by hand."""
    plan = make_plan("verify", arm(6), ball(), Wishes())
    names = [station.target for station in plan.stations]
    assert len(names) == len(set(names)) == 50 + 25 + 27
    assert {"SPHERE1.01", "SPHERE2.25", "LDIA.5.5", "EFFDIA.3.9"} <= set(names)
    assert set(names) <= set(plan.artefact.target_names)
    only = make_plan("verify", arm(6), ball(), Wishes(tests=["l_dia", "spat"]))
    assert len(only.stations) == 25 + 30


def test_points_that_are_listed_stay_as_they_are() -> None:
    listed = [{"name": f"SPHERE{w}.{k}"} for w in (1, 2) for k in range(1, 31)]
    plan = make_plan("verify", arm(6), ball(target=listed), Wishes(tests=["probing"]))
    assert len(plan.stations) == 60
