"""The plan of each kind of guided measurement (docs/how-to/measure.md)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.points_only import refuse_surfaces
from armd.compensation.identify.admission.reading_counts import (
    LEAST_PLACEMENTS,
    count_certificate_readings,
)
from armd.compensation.model.arm import Arm
from armd.daemon.measure.plan.poses import Pose, make_stations, read_poses
from armd.daemon.measure.plan.proposed import load_proposed_check
from armd.daemon.measure.plan.stations import (
    MOST_STATIONS,
    Plan,
    PlanKind,
    Station,
    Wishes,
    compute_near_mm,
    make_seats_artefact,
    plan_rounds,
)
from armd.daemon.measure.plan.surface_stations import (
    CALIBRATION_TOUCHES,
    SURFACE_PLACEMENTS,
    list_verified_surfaces,
    make_surface_stations,
)
from armd.daemon.measure.plan.verify_stations import (
    SEAT_HOW,
    SEAT_READINGS,
    SPAT,
    SPHERE_POINTS,
    TESTS,
)
from armd.errors import BadInput
from armd.terminal.counted import format_count

COMMAND_LINE = "the command line"
#: Rounds over an artefact in each of its placements, or more if a certificate needs them.
ARTEFACT_ROUNDS = 3
TIP_SEAT_READINGS, TIP_SPHERE_READINGS = 12, 25
#: The offset of a tip before its calibration is unknown: only another seat is farther off.
TIP_NEAR_MM = 100.0
#: Visits of one place: an hour at one each two minutes, enough to separate drift from scatter.
REPEATABILITY_VISITS = 30
INTERIM_SEATS, INTERIM_SEAT_READINGS, INTERIM_ROUNDS = ("S1", "S2"), 10, 2

VISIT_HOW = "away and back to the same place, in the same posture as the first time"
BALL_HOW = "the tip's centre at the ball, the wrist turned otherwise than last time"
SPHERE_HOW = "touch the sphere, all over its upper half"


def make_plan(kind: PlanKind, arm: Arm, artefact: Artefact | None, wishes: Wishes) -> Plan:
    """Return the plan of a measurement of *arm*, on *artefact* if there is one.

    Raises `BadInput` for wishes that cannot be met.
    """
    _refuse_what_is_not_asked(kind, artefact, wishes)
    if artefact is not None and kind in ("poses", "interim"):  # these need named points
        refuse_surfaces(artefact, "the artefact", "`armd measure`")
    artefact, stations = _MAKERS[kind](arm, artefact, wishes)
    names = artefact.target_names
    for name in wishes.targets or ():
        if name not in names:
            expected = f"targets of the artefact: {', '.join(names[:20])}"
            raise BadInput(COMMAND_LINE, "--targets", repr(name), expected)
    if not 0 < len(stations) <= MOST_STATIONS:
        problem = f"{len(stations)} readings"
        raise BadInput(COMMAND_LINE, "the plan", problem, f"1 to {MOST_STATIONS}")
    return Plan(
        kind=kind,
        artefact=artefact,
        stations=stations,
        near_mm=wishes.near_mm or (TIP_NEAR_MM if kind == "tip" else compute_near_mm(arm)),
        within_calibration=kind in ("verify", "tip", "interim"),
        sphere_mm=wishes.sphere_mm,
    )


def _refuse_what_is_not_asked(kind: PlanKind, artefact: Artefact | None, wishes: Wishes) -> None:
    needed = {"artefact": ("--artefact", artefact), "poses": ("--poses", wishes.poses)}
    if kind in needed and needed[kind][1] is None:
        raise BadInput(COMMAND_LINE, needed[kind][0], "nothing", f"a file: `{kind}` wants one")
    only = {
        "--poses": (wishes.poses, ("poses", "interim")),
        "--proposed": (wishes.proposed, ("interim",)),
        "--tests": (wishes.tests, ("verify",)),
        "--sphere-mm": (wishes.sphere_mm, ("tip",)),
        "--artefact": (artefact, ("artefact", "verify", "poses", "interim")),
        "--targets": (wishes.targets, ("seats", "artefact", "interim")),
        "--placements": (wishes.placements, ("seats", "artefact", "poses", "interim")),
        "--repeats": (wishes.repeats, ("seats", "artefact", "tip", "interim", "repeatability")),
    }
    for option, (value, kinds) in only.items():
        if value is not None and kind not in kinds:
            expected = f"it with {' or '.join(kinds)} only"
            raise BadInput(COMMAND_LINE, option, f"it with {kind}", expected)


Made = tuple[Artefact, list[Station]]


def _plan_seats(_arm: Arm, _artefact: Artefact | None, wishes: Wishes) -> Made:
    targets = wishes.targets or ["seat"]
    repeats = wishes.repeats or SEAT_READINGS
    return make_seats_artefact(targets), plan_rounds(
        wishes.placements or ["1"], targets, repeats, SEAT_HOW
    )


def _plan_artefact(arm: Arm, artefact: Artefact | None, wishes: Wishes) -> Made:
    assert artefact is not None  # asked for
    names = wishes.targets or artefact.target_names
    targets = [name for name in names if name not in artefact.surface_kinds]
    count = LEAST_PLACEMENTS if targets else SURFACE_PLACEMENTS
    placements = wishes.placements or [f"P{i + 1}" for i in range(count)]
    positions = {target.name: target.position_mm for target in artefact.targets}
    seats = sum(positions.get(name) is None for name in targets)
    needed = count_certificate_readings(arm.n_joints, len(placements), seats)
    enough = max(ARTEFACT_ROUNDS, -(-needed // max(len(placements) * len(targets), 1)))
    touches = wishes.repeats or CALIBRATION_TOUCHES
    return artefact, [
        station
        for placement in placements
        for station in (
            *plan_rounds([placement], targets, wishes.repeats or enough, BALL_HOW),
            *make_surface_stations(artefact, placement, names, touches),
        )
    ]


def _plan_verify(_arm: Arm, artefact: Artefact | None, wishes: Wishes) -> Made:
    artefact = _with_points(artefact or make_seats_artefact(SPAT), wishes.tests or ())
    stations: list[Station] = []
    tests = list(wishes.tests or TESTS)
    for test in tests:
        if test not in TESTS:
            expected = f"one of {', '.join(TESTS)}"
            raise BadInput(COMMAND_LINE, "--tests", repr(test), expected)
        test_stations = TESTS[test](artefact.target_names)
        if wishes.tests and not test_stations:
            expected = f"the targets of {test} (docs/how-to/verify.md)"
            names = ", ".join(artefact.target_names[:8])
            raise BadInput("the artefact", "target", names, expected)
        stations += test_stations
    if not wishes.tests:
        stations += list_verified_surfaces(artefact)
    if not stations:
        expected = "targets whose names say which test they are of (docs/how-to/verify.md)"
        raise BadInput("the artefact", "target", ", ".join(artefact.target_names[:8]), expected)
    return artefact, stations


def _with_points(artefact: Artefact, tests: Sequence[str]) -> Artefact:
    """Add the points of requested tests, and of tests on the certified sphere.

    Nothing is known of them, so nobody need list them. Points that are listed stay unchanged.
    """
    between = {frozenset(distance.between) for distance in artefact.distances}
    sphere = frozenset(("SPHERE.a", "SPHERE.b")) in between
    names: list[str] = []
    for test, points in SPHERE_POINTS.items():
        prefix = points[0].split(".")[0]
        listed = any(name.startswith(f"{prefix}.") for name in artefact.target_names)
        if not listed and (sphere or test in tests):
            names += points
    if "spat" in tests:
        names += SPAT
    return artefact.with_documented(names)


def _plan_poses(arm: Arm, artefact: Artefact | None, wishes: Wishes) -> Made:
    assert wishes.poses is not None  # asked for
    poses = read_poses(wishes.poses, arm.n_joints, arm.sensors)
    artefact = artefact or make_seats_artefact(["seat"])
    return artefact, make_stations(poses, artefact, (wishes.placements or ["1"])[0])


def _plan_tip(_arm: Arm, _none: Artefact | None, wishes: Wishes) -> Made:
    if wishes.sphere_mm is None:
        names = ["seat"]
        stations = plan_rounds(["1"], names, wishes.repeats or TIP_SEAT_READINGS, SEAT_HOW)
    else:
        # Each contact point is a separate target, because the tip's centre is there only once.
        count = wishes.repeats or TIP_SPHERE_READINGS
        names = [f"SPHERE.{i:02d}" for i in range(1, count + 1)]
        stations = plan_rounds(
            ["1"], names, 1, f"{SPHERE_HOW}, the wrist turned otherwise each time"
        )
    return make_seats_artefact(names), stations


def _plan_repeatability(_arm: Arm, _artefact: Artefact | None, wishes: Wishes) -> Made:
    names = ["seat"]
    return make_seats_artefact(names), plan_rounds(
        ["1"], names, wishes.repeats or REPEATABILITY_VISITS, VISIT_HOW
    )


def _plan_interim(arm: Arm, artefact: Artefact | None, wishes: Wishes) -> Made:
    if wishes.proposed is not None or wishes.poses is not None:
        return _plan_interim_poses(arm, artefact, wishes)
    if artefact is None:
        targets = wishes.targets or INTERIM_SEATS
        repeats = wishes.repeats or INTERIM_SEAT_READINGS
        artefact, how = make_seats_artefact(targets), SEAT_HOW
    else:
        targets, how = wishes.targets or artefact.target_names, BALL_HOW
        repeats = wishes.repeats or INTERIM_ROUNDS
    return artefact, plan_rounds(wishes.placements or ["1"], targets, repeats, how)


def _plan_interim_poses(arm: Arm, artefact: Artefact | None, wishes: Wishes) -> Made:
    """Plan the check that a history or a table proposes: each pose once, the seats in turn."""
    option = "--poses" if wishes.proposed is None else "--proposed"
    options = {
        "--artefact": artefact is not None,
        "--repeats": wishes.repeats is not None,
        "--poses": wishes.poses is not None and option == "--proposed",
    }
    for name, is_given in options.items():
        if is_given:
            expected = f"one of both: {option} says what is touched and how often"
            raise BadInput(COMMAND_LINE, name, f"it with {option}", expected)
    seats, poses = list(wishes.targets or INTERIM_SEATS), _read_interim_table(arm, wishes)
    if len(seats) != (n_seats := len(INTERIM_SEATS)):
        raise BadInput(
            COMMAND_LINE, "--targets", format_count(len(seats), "name"), f"{n_seats}: seats"
        )
    check_artefact = make_seats_artefact(seats)
    return check_artefact, make_stations(poses, check_artefact, (wishes.placements or ["1"])[0])


def _read_interim_table(arm: Arm, wishes: Wishes) -> list[Pose]:
    if wishes.proposed is not None:
        return load_proposed_check(wishes.proposed, arm)
    assert wishes.poses is not None  # asked for
    return read_poses(wishes.poses, arm.n_joints, arm.sensors)


_MAKERS: dict[PlanKind, Callable[[Arm, Artefact | None, Wishes], Made]] = {
    "seats": _plan_seats,
    "artefact": _plan_artefact,
    "verify": _plan_verify,
    "poses": _plan_poses,
    "tip": _plan_tip,
    "interim": _plan_interim,
    "repeatability": _plan_repeatability,
}
