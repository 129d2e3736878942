"""Features against published results, exact shapes anywhere in space, brute force, Monte Carlo."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from armd.compensation.features.algebraic import LEAST_MM, fit_algebraic_sphere
from armd.compensation.features.fit import fit
from armd.compensation.features.relate import compute_angle, compute_distance
from support.selection import parametrize_default

#: They tell a variance of a few unknowns within about 10 %, one sigma.
TRIES = 80
SHAPES = ("line", "plane", "circle", "sphere", "cylinder")


def on(shape, rng, n):
    """Points of an exact shape about the origin, its direction along z, radius 12 where it has
    one; only a part of it, as a probe reaches it."""
    turn, up = rng.uniform(0, 4.0, n), rng.uniform(-20, 20, n)
    ring = np.stack([np.cos(turn), np.sin(turn), np.zeros(n)], axis=1)
    z = np.array([0.0, 0.0, 1.0])
    match shape:
        case "line":
            return np.outer(up, z)
        case "plane":
            return rng.uniform(-30, 30, (n, 3)) * [1, 1, 0]
        case "circle":
            return 12 * ring
        case "cylinder":
            return 12 * ring + np.outer(up, z)
    tilt = rng.uniform(0, 1.2, n)[:, None]
    return 12 * (np.sin(tilt) * ring + np.cos(tilt) * z)


def placed(points, rng):
    """Somewhere in space: the points, and where origin and z axis went."""
    turn, shift = Rotation.random(random_state=rng), rng.uniform(-800, 800, 3)
    return turn.apply(points) + shift, shift, turn.apply([0.0, 0.0, 1.0])


def test_the_circle_of_gander_golub_and_strebel():
    """BIT 34 (1994) 558, their geometric fit: centre (4.7398, 2.9835), radius 4.7142."""
    points = np.array([(1, 7), (2, 6), (5, 8), (7, 7), (9, 5), (3, 7)], dtype=float)
    found = fit("circle", np.column_stack([points, np.zeros(6)]))
    np.testing.assert_allclose(found.point_mm, [4.7398, 2.9835, 0.0], atol=6e-5)
    assert found.radius_mm == pytest.approx(4.7142, abs=6e-5)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("shape", SHAPES)
def test_an_exact_shape_is_found_wherever_it_lies(shape, seed):
    rng = np.random.default_rng(seed)
    points, origin, z = placed(on(shape, rng, 14), rng)
    found = fit(shape, points)
    assert found.form_error_mm < 1e-8 and found.rms_mm < 1e-8
    if found.direction is not None:
        assert abs(found.direction @ z) == pytest.approx(1.0, abs=1e-12)
    if found.radius_mm is not None:
        assert found.radius_mm == pytest.approx(12.0, abs=1e-7)
    away = found.point_mm - origin
    if shape in ("line", "cylinder"):
        away -= z * (z @ away)
    if shape == "plane":
        away = z * (z @ away)
    assert np.linalg.norm(away) < 1e-7


def squares(shape, x, u):
    """Sum of squared orthogonal distances of points to a shape given by plain numbers: point,
    direction by two angles, radius. Written without a look at `fit`."""
    p, (a, b), r = u[:3], u[3:5], u[5]
    d = np.array([np.sin(a) * np.cos(b), np.sin(a) * np.sin(b), np.cos(a)])
    away = x - p
    along = away @ d
    beside2 = np.sum(away**2, axis=1) - along**2
    match shape:
        case "line":
            return beside2.sum()
        case "plane":
            return (along**2).sum()
        case "circle":
            return ((np.sqrt(beside2) - r) ** 2 + along**2).sum()
        case "sphere":
            return ((np.linalg.norm(away, axis=1) - r) ** 2).sum()
        case "cylinder":
            return ((np.sqrt(beside2) - r) ** 2).sum()


@pytest.mark.parametrize("shape", SHAPES)
def test_no_other_shape_is_nearer_to_the_points(shape):
    """Brute force: a general minimiser from the result and from around it finds nothing better."""
    rng = np.random.default_rng(7)
    points = placed(on(shape, rng, 12), rng)[0]
    points = points - points.mean(axis=0) + rng.normal(0, 0.5, points.shape)
    found = fit(shape, points)
    own = float(np.sum(found.residual_mm**2))
    d = np.array([0.0, 0.0, 1.0]) if found.direction is None else found.direction
    at = [*found.point_mm, np.arccos(d[2]), np.arctan2(d[1], d[0]), found.radius_mm or 0.0]
    assert squares(shape, points, np.array(at)) == pytest.approx(own, rel=1e-9)
    for size in (1e-3, 0.1, 2.0):
        begin = np.array(at) + rng.normal(0, size, 6) * [1, 1, 1, 0.1, 0.1, 1]
        best = minimize(lambda u: squares(shape, points, u), begin, method="BFGS")
        assert best.fun > own * (1 - 1e-7)


@parametrize_default("shape", ["point", *SHAPES], default=2)
@parametrize_default("known", [True, False], ids=["points", "scatter"])
def test_the_uncertainty_is_that_of_many_repetitions(shape, known):
    """Stated covariance against the scatter of fits with fresh noise, alike or skewed."""
    rng = np.random.default_rng(11)
    clean = np.zeros((14, 3)) if shape == "point" else on(shape, rng, 14)
    clean = placed(clean, rng)[0]
    spread = np.tile(np.eye(3) * 1e-4, (14, 1, 1))
    if known:
        root = rng.normal(size=(14, 3, 3)) * 0.01
        spread = root @ root.transpose(0, 2, 1)
    lower = np.linalg.cholesky(spread)
    found, stated = [], []
    first = fit(shape, clean).direction
    for _ in range(TRIES // 2 if shape == "cylinder" else TRIES):  # of which each takes longest
        noisy = clean + np.einsum("nij,nj->ni", lower, rng.normal(size=(14, 3)))
        one = fit(shape, noisy, spread if known else None)
        direction = np.zeros(3)
        if one.direction is not None:
            direction = one.direction * np.sign(one.direction @ first)
        found.append([*one.point_mm, *(50 * direction), one.radius_mm or 0.0])
        scale = np.array([1, 1, 1, 50, 50, 50, 1.0])
        stated.append(np.diag(one.covariance) * scale**2)
    real = np.var(found, axis=0, ddof=1).sum()
    assert 0.7 < np.sum(np.mean(stated, axis=0)) / real < 1.4


def test_distances_and_angles_of_known_shapes():
    rng = np.random.default_rng(3)
    move = Rotation.random(random_state=rng)

    def shifted(shape, turn_deg, shift):
        turn = Rotation.from_euler("x", turn_deg, degrees=True)
        points = move.apply(turn.apply(on(shape, rng, 20)) + shift)
        return fit(shape, np.add(points, (10.0, 20.0, 30.0)))

    table = shifted("plane", 0, [0, 0, 0])
    ball = shifted("sphere", 0, [5, 5, 40.0])
    bore = shifted("cylinder", 0, [30.0, 0, 7])
    shaft = shifted("cylinder", 90, [0.0, 0, 25.0])
    edge = shifted("line", 30, [0, 0, 0])
    other = shifted("plane", 0, [0, 0, 8.0])
    assert compute_distance(table, ball).value == pytest.approx(40.0, abs=1e-6)
    assert compute_distance(ball, bore).value == pytest.approx(np.hypot(25.0, 5.0), abs=1e-6)
    assert compute_distance(bore, shaft).value == pytest.approx(30.0, abs=1e-6)
    assert compute_distance(table, other).value == pytest.approx(8.0, abs=1e-6)
    assert compute_angle(bore, shaft).value == pytest.approx(90.0, abs=1e-6)
    assert compute_angle(table, bore).value == pytest.approx(90.0, abs=1e-6)
    assert compute_angle(table, edge).value == pytest.approx(60.0, abs=1e-6)
    assert compute_angle(table, other).value == pytest.approx(0.0, abs=1e-6)
    with pytest.raises(ArithmeticError, match="a sphere has no direction"):
        compute_angle(ball, table)


@pytest.mark.slow
def test_the_uncertainty_of_a_distance_is_that_of_many_repetitions():
    rng = np.random.default_rng(5)
    table, ball = on("plane", rng, 9), np.add(on("sphere", rng, 12), (60.0, 0.0, 40.0))
    values, stated = [], []
    for _ in range(TRIES):
        one, other = (fit(s, x + rng.normal(0, 0.01, x.shape)) for s, x in
                      (("plane", table), ("sphere", ball)))  # fmt: skip
        found = compute_distance(one, other)
        values.append(found.value)
        stated.append(found.standard_uncertainty**2)
    assert 0.7 < np.mean(stated) / np.var(values, ddof=1) < 1.4


@pytest.mark.parametrize(
    ("shape", "points", "words"),
    [
        ("plane", [[0, 0, 0], [1, 0, 0]], "2 points, expected at least 3 for a plane"),
        ("plane", [[0, 0, 0], [1, 0, 0], [3, 0, 0]], "on one line: no plane"),
        ("line", [[1, 2, 3], [1, 2, 3]], "at one place: no line"),
        ("sphere", [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0.6, 0.8, 0]], "in one plane"),
        ("cylinder", [[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0.6, 0.8, 0]], "in one plane"),
    ],
)  # fmt: skip
def test_points_that_determine_nothing_are_refused(shape, points, words):
    with pytest.raises(ArithmeticError, match=words):
        fit(shape, np.array(points, dtype=float))


def test_as_many_points_as_unknowns_leave_the_uncertainty_open():
    found = fit("plane", np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]))
    assert found.covariance is None
    assert found.as_json()["point_standard_uncertainty_mm"] is None


@pytest.mark.parametrize("d", [2, 3])
def test_points_on_a_sphere_give_it_by_one_linear_system(d: int) -> None:
    rng = np.random.default_rng(d)
    way = rng.normal(size=(9, d))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    centre, radius = fit_algebraic_sphere(np.arange(1.0, d + 1) + 7.5 * way)
    assert centre == pytest.approx(np.arange(1.0, d + 1))
    assert radius == pytest.approx(7.5)
    assert fit_algebraic_sphere(np.zeros((5, d)))[1] == LEAST_MM  # all in one place
