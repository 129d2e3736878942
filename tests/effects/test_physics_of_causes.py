"""What each cause says of the arm against the physics in its name, done with plain matrices.

The cause's file says weights of the arm's parameters; here the angle is read wrong, the bearing
tilts, the beam is integrated piece by piece, the sensor is off.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.diagnose.problem.signatures import compile_candidates
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.courses import is_drift
from armd.compensation.effects.effect import Candidate
from support.plain_basis import GRAVITY_M_S2
from support.plain_kinematics import links, product, rotation, tip_pose, translation
from support.whole_scene import REFERENCE_C, TERMS, Whole, model_at, warm, whole_scene

FRACTION = 0.01


@pytest.fixture(scope="module")
def whole() -> Whole:
    return whole_scene()


def joint_of(candidate: Candidate) -> int:
    assert candidate.location.joint is not None
    return candidate.location.joint


def rise(candidate: Candidate, whole: Whole) -> np.ndarray:
    """(n,) how much warmer than the reference the joint is, or a sensor where it has none."""
    weights = whole.plain.arm.joint[joint_of(candidate) - 1].weights
    return whole.plain.mean_c(weights or {candidate.depends_on[0]: 1.0}) - REFERENCE_C


def since(candidate: Candidate, whole: Whole) -> np.ndarray:
    """(n,) 1 from the candidate's instant on; everywhere where it has none."""
    instants = [number for name, number, _ in candidate.setting if name == "instant"]
    return 1.0 * (whole.plain.time_s >= max(instants, default=0.0))


def order_of(candidate: Candidate) -> int:
    return int(candidate.setting[0][1]) if candidate.setting else 1


# What is wrong by one unit, as a change of the angles read (n, N) …


def angle(of: Callable[[Candidate, int, Whole], np.ndarray]) -> Callable[..., np.ndarray]:
    def tip(candidate: Candidate, i: int, whole: Whole, amount: float) -> np.ndarray:
        q = whole.plain.q.copy()
        q[:, joint_of(candidate) - 1] += amount * of(candidate, i, whole)
        return tip_pose(q, whole.parameters)

    return tip


def wave(order: int | None = None) -> Callable[[Candidate, int, Whole], np.ndarray]:
    def of(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
        times = order or order_of(candidate)
        if candidate.setting and candidate.setting[0][0] == "highest order":
            times = 3 + i // 2
        return (np.sin, np.cos)[i % 2](times * whole.plain.q[:, joint_of(candidate) - 1])

    return of


def rate(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
    return whole.plain.rate[:, joint_of(candidate) - 1]


def meshed(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
    """The wheel's turn is the other joint's, and in a differential this one's with it."""
    joint, turn = joint_of(candidate), 0.0
    for name in candidate.depends_on:
        sign = -1.0 if f"- {name}" in candidate.columns[0].name else 1.0
        turn = turn + sign * whole.plain.q[:, int(name[1:]) - 1]
    assert f"q{joint}" in candidate.depends_on or len(candidate.depends_on) == 1
    return (np.sin, np.cos)[i](order_of(candidate) * turn)


def torque(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
    """Weights times their levers about the joint's axis."""
    scene, joint = whole.plain, joint_of(candidate)
    frames = scene.frames
    axis, at = frames[:, joint - 1, :3, 2], frames[:, joint - 1, :3, 3]
    found = np.zeros(len(scene.q))
    for k, link in enumerate(scene.arm.joint, 1):
        if k >= joint:
            centre = (frames[:, k] @ [*link.centre_of_mass_mm, 1.0])[:, :3]
            pull = link.mass_kg * GRAVITY_M_S2 * scene.down
            found += (np.cross((centre - at) / 1000, pull) * axis).sum(axis=1)
    return found


# … of the parameters …


def parameters(of: Callable[[Candidate, int, Whole], np.ndarray]) -> Callable[..., np.ndarray]:
    def tip(candidate: Candidate, i: int, whole: Whole, amount: float) -> np.ndarray:
        return tip_pose(whole.plain.q, whole.parameters + amount * of(candidate, i, whole))

    return tip


def constant(*stems: str, grown: str = "") -> Callable[[Candidate, int, Whole], np.ndarray]:
    """Constants of the joint by one unit, or by their own length; *grown*: with its rise."""

    def of(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
        layout, joint = whole.plain.arm.layout, candidate.location.joint
        found = np.zeros_like(whole.parameters)
        for stem in stems or (candidate.columns[i].name,):
            name = f"{stem}_{joint}" if joint else stem
            at = layout.names.index(name)
            size = whole.plain.constants[at] if stems else 1.0
            found[:, at] = size * since(candidate, whole)
            if grown:
                found[:, at] *= rise(candidate, whole) ** column_order(candidate, i)
        return found

    return of


def column_order(candidate: Candidate, i: int) -> int:
    """A column in K^n has the order n of its own, beside others of the same candidate."""
    power = re.search(r"K\^(\d+)$", candidate.columns[i].unit)
    return int(power[1]) if power else order_of(candidate)


def expanded(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
    """The lengths that this candidate grows, each by its own share."""
    moved = {term.parameter for term in candidate.columns[i].terms}
    found = np.zeros_like(whole.parameters)
    for name in moved:
        assert name.startswith("tip_") or name[-1] == str(joint_of(candidate))
        at = whole.plain.arm.layout.names.index(name)
        found[:, at] = whole.plain.constants[at] * rise(candidate, whole)
    return found


def heated(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
    use = candidate.columns[i].use
    assert use is not None
    layout, joint = whole.plain.arm.layout, joint_of(candidate)
    found = np.zeros_like(whole.parameters)
    angle = candidate.columns[i].name.startswith("angle")
    for name in (f"theta_{joint}",) if angle else (f"d_{joint}", f"a_{joint}"):
        at = layout.names.index(name)
        size = 1.0 if angle else whole.plain.constants[at]
        found[:, at] = size * warm(use, whole.plain)
    return found


def read_by(sensor: str, whole: Whole, celsius: np.ndarray) -> np.ndarray:
    """(n, S) all temperatures, those of a sensor as they are said to be."""
    found = whole.plain.temperature_c.copy()
    found[:, whole.plain.arm.sensors.index(sensor)] = celsius
    return found


def off(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
    (name,), step = candidate.depends_on, 1e-3
    own = whole.plain.mean_c({name: 1.0})
    up, down = (
        model_at(replace(whole.plain, temperature_c=read_by(name, whole, own + s)))
        for s in (step, -step)
    )
    return (up - down) / (2 * step)


def exchanged(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
    celsius = whole.plain.temperature_c.copy()
    at = [whole.plain.arm.sensors.index(name) for name in candidate.depends_on]
    celsius[:, at] = celsius[:, at[::-1]]
    return model_at(replace(whole.plain, temperature_c=celsius)) - whole.parameters


def late(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
    """The model where the links on these sensors alone have their temperatures of before."""
    *sensors, _ = candidate.depends_on
    lag_s = candidate.setting[0][1]
    found = np.zeros_like(whole.parameters)
    for term in TERMS:
        (factor,) = term.basis
        if set(factor.weights) == set(sensors):
            late, now = (whole.plain.mean_c(factor.weights, s) - REFERENCE_C for s in (lag_s, 0.0))
            grown = late**factor.order - now**factor.order
            found[:, whole.plain.arm.layout.names.index(term.parameter)] += term.coefficient * grown
    return found


# … and of the bodies between the frames.


def inserted(
    of: Callable[[Candidate, int, Whole], tuple[int, np.ndarray, np.ndarray]],
) -> Callable[..., np.ndarray]:
    """*of* says before which matrix of the chain, and how it turns (n, 3) and shifts (n, 3)."""

    def tip(candidate: Candidate, i: int, whole: Whole, amount: float) -> np.ndarray:
        before, turn, shift = of(candidate, i, whole)
        chain = links(whole.plain.q, whole.parameters)
        small = translation(amount * shift)
        for axis in range(3):
            small = small @ rotation(axis, amount * turn[:, axis])
        return product([*chain[:before], small, *chain[before:]])

    return tip


def wobble(candidate: Candidate, i: int, whole: Whole) -> tuple[int, np.ndarray, np.ndarray]:
    joint = joint_of(candidate)
    size = (np.sin, np.cos)[i % 2](order_of(candidate) * whole.plain.q[:, joint - 1])
    across = np.outer(size, np.eye(3)[i // 2])
    still = np.zeros_like(across)
    tilts = candidate.columns[i].name.startswith("tilt")
    return (joint, across, still) if tilts else (joint, still, across)


def way_along(whole: Whole, link: int) -> tuple[np.ndarray, float]:
    """The link's direction in the frame at its end, and its length in m."""
    p = whole.plain.constants[5 * (link - 1) : 5 * link]
    end = rotation(0, p[3]) @ rotation(1, p[4])
    way = end[:3, :3].T @ [p[2], 0.0, p[1]]
    length = np.linalg.norm(way)
    return way / length, float(length) / 1000


def integrated(along: np.ndarray, length_m: float, curvature: np.ndarray) -> tuple[np.ndarray, ...]:
    """Turn and shift in mm at the end of a beam clamped at its beginning, of its curvature
    (pieces, n, 3) in 1/m."""
    step = length_m / (len(curvature) - 1)
    turn = np.concatenate(
        [np.zeros_like(curvature[:1]), np.cumsum((curvature[1:] + curvature[:-1]) / 2, axis=0)]
    )
    slope = np.cross(turn * step, along)
    shift = ((slope[1:] + slope[:-1]) / 2).sum(axis=0) * step
    return turn[-1] * step, shift * 1000


def bent(candidate: Candidate, i: int, whole: Whole) -> tuple[int, np.ndarray, np.ndarray]:
    """By what hangs at the link's end and by its own weight, evenly spread; the amplitude is its
    length over its stiffness."""
    scene, link = whole.plain, joint_of(candidate)
    u, length = way_along(whole, link)
    end = scene.frames[:, link]
    down = np.einsum("nji,j->ni", end[:, :3, :3], scene.down)
    moment, weight = np.zeros((len(scene.q), 3)), 0.0
    for k in range(link, 6):
        body = scene.arm.joint[k]
        centre = (scene.frames[:, k + 1] @ [*body.centre_of_mass_mm, 1.0])[:, :3]
        lever = np.einsum("nji,nj->ni", end[:, :3, :3], centre - end[:, :3, 3]) / 1000
        moment += np.cross(lever, body.mass_kg * GRAVITY_M_S2 * down)
        weight += body.mass_kg * GRAVITY_M_S2
    own = scene.arm.joint[link - 1].mass_kg * GRAVITY_M_S2 / length  # N/m
    beyond = np.linspace(length, 0.0, 401)[:, None, None]
    pull = np.cross(u, down)
    at = moment + beyond * weight * pull + beyond**2 / 2 * own * pull
    at -= (at @ u)[..., None] * u  # it bends; it does not twist
    turn, shift = integrated(u, length, at / length)
    return link + 1, turn, shift


def curved(candidate: Candidate, i: int, whole: Whole) -> tuple[int, np.ndarray, np.ndarray]:
    """Evenly, by the difference of two sensors, about one of two axes across the link."""
    link = joint_of(candidate)
    u, length = way_along(whole, link)
    first = np.cross(u, np.eye(3)[np.argmin(np.abs(u))])
    axis = (first / np.linalg.norm(first), np.cross(u, first / np.linalg.norm(first)))[i]
    warm, cold = candidate.depends_on
    difference = whole.plain.mean_c({warm: 1.0, cold: -1.0})
    curvature = np.tile(np.outer(difference, axis), (401, 1, 1))
    turn, shift = integrated(u, length, curvature)
    return link + 1, turn, shift


def of_tip(of: Callable[[Candidate, int, Whole], np.ndarray]) -> Callable[..., np.ndarray]:
    """*of* says how the tip moves (n, 3) in the base frame."""

    def tip(candidate: Candidate, i: int, whole: Whole, amount: float) -> np.ndarray:
        pose = tip_pose(whole.plain.q, whole.parameters)
        pose[:, :3, 3] += amount * of(candidate, i, whole)
        return pose

    return tip


def across_stylus(force: np.ndarray, whole: Whole) -> np.ndarray:
    stylus = whole.plain.frames[:, 6, :3, :3] @ whole.plain.constants[30:33]
    stylus /= np.linalg.norm(stylus, axis=1, keepdims=True)
    return force - (force * stylus).sum(axis=1, keepdims=True) * stylus


def pushed(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
    force = whole.plain.approach
    return force if i == 0 else across_stylus(force, whole)


def hanging(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
    return across_stylus(np.tile(whole.plain.down, (len(whole.plain.q), 1)), whole)


def stepped(candidate: Candidate, i: int, whole: Whole) -> np.ndarray:
    """The tip along an axis of the last frame."""
    return whole.plain.frames[:, 6, :3, i] * since(candidate, whole)[:, None]


def knocked(candidate: Candidate, i: int, whole: Whole) -> tuple[int, np.ndarray, np.ndarray]:
    moved = np.outer(since(candidate, whole), np.eye(3)[i % 3])
    still = np.zeros_like(moved)
    return (0, still, moved) if i < 3 else (0, moved, still)


PHYSICS = {
    "encoder_eccentricity": angle(wave(1)),
    "encoder_ellipticity": angle(wave(2)),
    "encoder_periodic": angle(wave()),
    "encoder_scale": angle(lambda c, i, w: w.plain.q[:, joint_of(c) - 1]),
    "encoder_slip": angle(lambda c, i, w: since(c, w)),
    "encoder_thermal": angle(lambda c, i, w: rise(c, w) * wave()(c, i, w)),
    "time_skew": angle(rate),
    "axis_wobble": inserted(wobble),
    "gear_mesh": angle(meshed),
    "geometry_shift": parameters(constant()),
    "joint_backlash": angle(lambda c, i, w: np.sign(rate(c, i, w))),
    "joint_compliance": angle(torque),
    "link_bending": inserted(bent),
    "joint_thermal": parameters(constant(grown="by its order")),
    "link_expansion": parameters(expanded),
    "nonlinear_expansion": parameters(constant("d", "a", grown="by its order")),
    "self_heating": parameters(heated),
    "sensor_offset": parameters(off),
    "sensor_swapped": parameters(exchanged),
    "thermal_gradient": inserted(curved),
    "thermal_lag": parameters(late),
    "mount_drift": inserted(knocked),
    "probing_force": of_tip(pushed),
    "stylus_sag": of_tip(hanging),
    "tip_offset": of_tip(stepped),
}
#: Those of the artefact move targets, which `test_every_cause` does plainly; drifts are courses,
#: which have a test of their own.
NOT_THE_ARM = {"artefact_expansion", "artefact_length", "artefact_moved", "artefact_sag"}


def test_each_cause_of_the_arm_is_here() -> None:
    assert set(PHYSICS) == set(CATALOGUE) - NOT_THE_ARM - {"outliers", "unknown"}


@pytest.mark.parametrize("cause", PHYSICS)
def test_a_cause_does_what_its_physics_say(cause: str, whole: Whole) -> None:
    found = [c for c in CATALOGUE[cause].candidates(whole.held) if not is_drift(c)]
    chosen = [found[i] for i in np.unique(np.linspace(0, len(found) - 1, 40).astype(int))]
    signatures = compile_candidates(chosen, whole.linear, whole.plain.arm)
    rows = signatures.rows(whole.linear, np.arange(signatures.n_columns))
    largest = 0.0
    for number, candidate in enumerate(chosen):
        own = rows[list(signatures.columns_of(number)), : 3 * len(whole.plain.q)]
        plain = np.zeros_like(own)
        for i, column in enumerate(candidate.columns):
            amount = FRACTION * column.prior_sd
            up, down = (PHYSICS[cause](candidate, i, whole, s * amount)[:, :3, 3] for s in (1, -1))
            plain[i] = ((up - down) / (2 * amount)).ravel()
        if cause == "thermal_gradient":  # about two axes across the link, whichever they are
            turned = np.linalg.lstsq(plain.T, own.T, rcond=None)[0]
            np.testing.assert_allclose(turned.T @ turned, np.eye(2), atol=1e-5)
            plain = turned.T @ plain
        error = np.abs(own - plain).max()
        assert error <= 2e-5 * np.abs(plain).max() + 1e-7, (candidate.columns[0].name, error)
        largest = max(largest, np.abs(plain).max())
    assert largest > 0.0
