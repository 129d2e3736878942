"""Surfaces of unknown place: nearest points, columns, where a fit begins and ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from armd.arrays import F64
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.session import Session
from armd.compensation.estimate.linearise import linearise
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.placements.poses import Poses
from armd.compensation.estimate.surface_kinds import (
    CYLINDER,
    PLANE,
    POINT,
    SPHERE,
    list_kinds,
    list_placements,
)
from armd.compensation.estimate.surfaces import choose_side, measure_heights, project_on_normals
from armd.compensation.identify.admission.touched_surfaces import require_surfaces
from armd.compensation.model.kinematics import compute_pose
from armd.errors import BadInput
from armd.files.schema import validate
from support import synthetic
from support.readings import session_of, states_of
from support.slopes import compute_pose_slopes, compute_target_slopes

RADIUS_MM = 3.0
ARM = synthetic.arm().model_copy(
    update={"tip": synthetic.arm().tip.model_copy(update={"radius_mm": RADIUS_MM})}
)
BODIES = {
    "name": "bodies",
    "target": [
        {"name": "seat"},
        {"name": "B1", "position_mm": [0.0, 0.0, 0.0]},
        {"name": "B2", "position_mm": [80.0, 0.0, 0.0]},
        {"name": "B3", "position_mm": [0.0, 60.0, 5.0]},
    ],
    "surface": [
        {"name": "plate", "kind": "plane"},
        {"name": "ball", "kind": "sphere", "radius_mm": 25.0},
        {"name": "other ball", "kind": "sphere"},
        {"name": "pin", "kind": "cylinder"},
        {"name": "foot", "kind": "plane"},
        {"name": "head", "kind": "plane"},
    ],
    "distance": [{"between": ["foot", "head"], "length_mm": 40.0}],
}


def session(target: list[str], placement: list[int], approach: F64 | None = None) -> Session:
    """Readings whose angles say nothing; *approach* (n, 3)."""
    artefact = validate("artefact", BODIES, Artefact)
    n = len(target)
    rng = np.random.default_rng(1)
    names = artefact.target_names
    states = states_of(
        rng.uniform(-1.0, 1.0, (n, ARM.n_joints)),
        temperature_c=np.full((n, len(ARM.sensors)), np.nan),
        approach=np.full((n, 3), np.nan) if approach is None else approach,
    )
    return session_of(
        "bodies",
        ARM.serial_number,
        artefact,
        states,
        placement=np.array(placement),
        placement_names=["P1", "P2"],
        target=np.array([names.index(name) for name in target]),
    )


def names_of(observations: Observations) -> list[str]:
    return [name.partition("/")[2] for name in observations.target_names]


def directions(n: int, seed: int = 2) -> F64:
    vectors = np.random.default_rng(seed).normal(size=(n, 3))
    unit: F64 = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    return unit


def test_each_surface_has_a_placement_of_its_own_and_a_block_one_for_both_faces() -> None:
    artefact = validate("artefact", BODIES, Artefact)
    assert list_kinds(artefact).tolist() == [
        *[POINT] * 4, PLANE, SPHERE, SPHERE, CYLINDER, PLANE, PLANE,
    ]  # fmt: skip
    of = session(["seat", "plate", "foot", "head", "plate", "seat"], [0, 0, 0, 0, 1, 1])
    names, placement = list_placements(of)
    assert placement[[0, 5]].tolist() == [0, 1]  # the session's own
    assert placement[2] == placement[3]
    assert len(set(placement.tolist())) == 5
    assert [names[p] for p in placement] == ["P1", "P1", "P1", "P1", "P2", "P2"]
    true = replace(of, truth_mm=np.zeros((6, 3)))  # the row's own truth is in the session's frame
    assert list_placements(true)[1].tolist() == [0, 0, 0, 0, 1, 1]


def test_a_reading_on_a_surface_is_one_equation() -> None:
    observations = collect_observations([session(["seat", "plate", "pin"], [0, 0, 0])], ARM)
    assert observations.freedom.tolist() == [3, 1, 1]
    unknown = [
        name for name, u in zip(names_of(observations), observations.unknown, strict=True) if u
    ]
    assert unknown == ["seat", "other ball", "pin", "foot", "head"]
    assert observations.position_mm[5].tolist() == [0.0, 0.0, 25.0]


@pytest.mark.parametrize("kind", [PLANE, SPHERE, CYLINDER])
def test_the_nearest_point_is_the_nearest_of_all(kind: int) -> None:
    """Brute force: no point of the surface of that size is nearer."""
    point = np.array([[7.0, -4.0, 9.0]])
    height, normal = measure_heights(np.array([kind]), point)
    size = 5.0

    def on_surface(u: F64) -> F64:
        if kind == PLANE:
            return np.array([u[0], u[1], size])
        if kind == SPHERE:
            return size * np.array(
                [np.cos(u[0]) * np.cos(u[1]), np.sin(u[0]) * np.cos(u[1]), np.sin(u[1])]
            )
        return np.array([size * np.cos(u[0]), size * np.sin(u[0]), u[1]])

    found = minimize(lambda u: float(np.sum((on_surface(u) - point[0]) ** 2)), np.array([0.1, 0.1]))
    nearest = point[0] - (height[0] - size) * normal[0]
    assert abs(height[0] - size) == pytest.approx(np.sqrt(found.fun), abs=1e-5)
    np.testing.assert_allclose(nearest, on_surface(found.x), atol=1e-3)


def test_columns_across_a_surface_are_taken_away() -> None:
    columns = np.random.default_rng(4).normal(size=(2, 3, 5))
    normal = np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.8]])
    kept = project_on_normals(normal, columns)
    np.testing.assert_array_equal(kept[0], columns[0])
    np.testing.assert_allclose(kept[1], np.outer(normal[1], normal[1]) @ columns[1])


def test_a_clear_approach_says_the_side_else_the_shaft() -> None:
    assert choose_side(-0.9, 0.8) == -1.0
    assert choose_side(np.nan, -0.4) == -1.0
    assert choose_side(-0.01, 0.4) == 1.0


def bodies_touched(seed: int) -> tuple[Observations, F64, dict[str, F64]]:
    """Tips that rest on all bodies in one placement, each body anywhere; and what is true."""
    rng = np.random.default_rng(seed)
    names, tips, pushed = [], [], []
    true = {"pin": 12.0 + rng.uniform(0, 5), "other ball": 18.0 + rng.uniform(0, 5)}

    def touch(name: str, turn: Rotation, where: F64, points: F64, out: F64) -> None:
        names.extend([name] * len(points))
        tips.append(turn.apply(points + RADIUS_MM * out) + where)
        pushed.append(-turn.apply(out))

    for name in ("plate", "ball", "other ball", "pin", "block"):
        turn = Rotation.random(random_state=int(rng.integers(1 << 30)))
        where = rng.uniform(-300.0, 300.0, 3)
        if name in ("plate", "block"):
            faces = {"plate": (0.0, 1.0)} if name == "plate" else {"foot": (0, -1), "head": (40, 1)}
            for face, (z, up) in faces.items():
                flat = rng.uniform(-50.0, 50.0, (12, 3)) * [1, 1, 0] + [0, 0, z]
                touch(face, turn, where, flat, np.tile([0.0, 0.0, float(up)], (12, 1)))
            continue
        out = directions(16, seed + len(names))
        size = 25.0 if name == "ball" else float(true[name])
        if name == "pin":
            out[:, 2] = 0.0
            out /= np.linalg.norm(out, axis=1, keepdims=True)
        points = size * out
        if name == "pin":
            points[:, 2] = rng.uniform(-30.0, 30.0, 16)
        touch(name, turn, where, points, out)
    turn, where = Rotation.random(random_state=seed), rng.uniform(-300.0, 300.0, 3)
    balls = np.array([[0.0, 0.0, 0.0], [80.0, 0.0, 0.0], [0.0, 60.0, 5.0], [33.0, 21.0, -9.0]])
    names += ["B1", "B2", "B3", "seat"] * 2  # points in a placement of their own, beside all that
    tips.append(np.tile(turn.apply(balls) + where, (2, 1)))
    pushed.append(np.full((8, 3), np.nan))
    of = session(names, [0] * len(names), np.concatenate(pushed))
    return (
        collect_observations([of], ARM),
        np.concatenate(tips),
        {k: np.array(v) for k, v in true.items()},
    )


@pytest.mark.parametrize("seed", range(3))
def test_bodies_are_found_where_they_stand_and_as_large_as_they_are(seed: int) -> None:
    observations, tips, true = bodies_touched(seed)
    poses = fit_poses(observations, tips)
    assert np.abs(poses.residual(observations, tips)).max() < 1e-7
    size = dict(zip(names_of(observations), poses.target_mm[:, 2], strict=True))
    np.testing.assert_allclose(poses.target_mm[0], [33.0, 21.0, -9.0], atol=1e-7)
    assert size["pin"] == pytest.approx(true["pin"], abs=1e-7)
    assert size["other ball"] == pytest.approx(true["other ball"], abs=1e-7)
    assert abs(size["head"] - size["foot"]) == pytest.approx(40.0, abs=1e-7)


def test_a_warm_block_and_pin_are_as_large_as_at_their_reference_temperature() -> None:
    """Touched where they are by their certificate: 10 K warmer, that is smaller at 20 °C."""
    observations, tips, true = bodies_touched(2)
    warm = replace(observations, stretch=np.full(observations.n, 1.0 + 10.0 * 2e-4))
    size = fit_poses(warm, tips).target_mm[:, 2]
    found = dict(zip(names_of(warm), size, strict=True))
    assert found["pin"] == pytest.approx(true["pin"] / 1.002, abs=1e-7)
    assert abs(found["head"] - found["foot"]) == pytest.approx(40.0 / 1.002, abs=1e-7)


def test_a_bore_is_touched_from_inside() -> None:
    out = directions(20)
    out[:, 2] = 0.0
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    along = np.random.default_rng(1).uniform(-20.0, 20.0, 20)
    tips = (15.0 - RADIUS_MM) * out + np.outer(along, [0.0, 0.0, 1.0])
    observations = collect_observations([session(["pin"] * 20, [0] * 20, approach=out)], ARM)
    poses = fit_poses(observations, tips)
    assert poses.side is not None and poses.side[observations.target[0]] == -1.0
    assert poses.target_mm[observations.target[0], 2] == pytest.approx(15.0, abs=1e-7)


def test_columns_are_the_residuals_slopes() -> None:
    """Central differences of the residual along the normal, by constants, poses and radii."""
    observations = bodies_touched(1)[0]
    constants = ARM.nominal()
    position = compute_pose(observations.states.q, np.tile(constants, (observations.n, 1)))[0]
    poses = fit_poses(observations, position)
    at = linearise(observations, constants, [], poses, 20.0)
    normal = poses.compute_normals(observations, position)

    def along(there: Poses) -> F64:
        return np.einsum("ni,ni->n", normal, there.residual(observations, position))

    wanted = np.einsum("ni,nik->nk", normal, at.pose_columns)
    np.testing.assert_allclose(compute_pose_slopes(at, along, 1e-5), wanted, atol=2e-4)
    radius = np.einsum("ni,ni->n", normal, at.target_columns[:, :, 2])
    by_radius = compute_target_slopes(at, along, 1e-5)[:, 2]
    np.testing.assert_allclose(by_radius, radius, atol=1e-6)
    assert not at.target_columns[observations.on_surface, :, :2].any()


@pytest.mark.parametrize("approach", [False, True])
def test_a_pin_along_the_shaft_asks_for_the_approach(approach: bool) -> None:
    """With the shaft along the axis, nobody can tell a pin from a bore of the same radius."""
    one = session(["ball"] * 24, [0] * 24)
    surfaces = [{"name": "ball", "kind": "cylinder", "radius_mm": 25.0}]
    artefact = validate("artefact", {"name": "pin", "surface": surfaces}, Artefact)
    q = np.tile(one.states.q[0], (24, 1))
    frame = compute_pose(q[:1], ARM.nominal()[None])[1][0]
    shaft = frame @ np.array(ARM.tip.offset_mm)
    upright = np.linalg.svd(shaft[None])[2][[1, 2, 0]]  # rows: two across the shaft, the shaft
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    out = np.stack([np.cos(angle), np.sin(angle), np.zeros(24)], axis=1) @ upright
    tips = (25.0 + RADIUS_MM) * out + np.outer(np.linspace(-30.0, 30.0, 24) % 17.0, upright[2])
    states = replace(one.states, q=q)
    if approach:
        states = replace(states, approach=-out)
    one = replace(one, artefact=artefact, target=np.zeros(24, dtype=np.int64), states=states)
    observations = collect_observations([one], ARM)
    poses = fit_poses(observations, tips)
    if approach:
        assert poses.side is not None and poses.side[0] == 1.0
        require_surfaces([one], observations, poses, tips)
        return
    with pytest.raises(BadInput, match=r"surface ball, placement P1: .* expected approach_x"):
        require_surfaces([one], observations, poses, tips)


def test_poses_without_surfaces_need_none() -> None:
    at = Poses(np.eye(3)[None], np.zeros((1, 3)), np.zeros((1, 3)))
    observations = collect_observations([session(["seat"] * 3, [0] * 3)], ARM)
    assert not at.compute_normals(observations, np.zeros((3, 3))).any()
