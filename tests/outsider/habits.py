"""What workshops do though nothing is wrong with the arm, and which names are true of that.

A habit goes on in the sessions that are diagnosed, and not in the further one; but trackers and
lone sensors are what they are in all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from outsider.chain import F64, Alteration, posture
from outsider.faults import inner, late
from outsider.faults import touched as moved_by_hand
from outsider.measured import Rng
from outsider.scene import Scene

Names = tuple[tuple[str, str], ...]
#: Rows latched while the arm still moved; how late; how far an interpolation jumps.
MOVING, LATE_S, JUMP_RAD = 0.03, (0.003, 0.02), (2e-4, 8e-4)
#: A tracker's frame, per hour: mm and rad; and its scale.
FRAME_MM_H, FRAME_RAD_H, SCALE = 3e-3, 1.5e-6, 0.5e-6


@dataclass(frozen=True)
class Habit:
    """*names*, and `unknown` in nothing but *variables*, are true of it: whether they are told or
    not counts for nothing."""

    alter: Alteration
    words: str
    names: Names
    variables: tuple[str, ...] = ()
    truth_mm: F64 | None = None  # (n, 3) what a tracker said
    mistaken: int | None = None  # a placement whose targets have each other's names


def _here(scene: Scene) -> F64:
    """(n,) rows that are diagnosed."""
    here: F64 = scene.on & (scene.readings.session < scene.readings.session.max())
    return here


def unsoaked(rng: Rng, scene: Scene) -> Habit:
    """The artefact comes from elsewhere and takes its time to the room's temperature, which is what
    is written down as its own."""
    readings, target = scene.readings, np.zeros_like(scene.readings.goal)
    hours, off_k = rng.uniform(0.5, 1.5), rng.choice([-1, 1]) * rng.uniform(2, 4)
    for session in np.unique(readings.session[_here(scene)]):
        rows = np.flatnonzero(readings.session == session)
        since = (readings.time_s[rows] - readings.time_s[rows[0]]) / 3600
        still = off_k * rng.uniform(0.5, 1.0) * np.exp(-since / hours)
        target[rows] = readings.lever[rows] * (scene.thing.per_k * still)[:, None]
    names = tuple((cause, "artefact") for cause in ("artefact_expansion", "artefact_length"))
    return Habit(
        replace(scene.none(), target=target), f"{off_k:.1f} K, {hours:.1f} h",
        (*names, ("thermal_lag", "artefact")), ("artefact_c", "time_s", "target"),
    )  # fmt: skip


def pressed(rng: Rng, scene: Scene) -> Habit:
    """One of two operators presses harder, along the stylus: every other session, or one. Not the
    last: nobody could know that the other one measures the further session."""
    readings, table = scene.readings, scene.machine.built
    sessions = np.unique(readings.session[_here(scene)])
    by_one = sessions[-2::-2] if rng.random() < 0.5 else rng.choice(sessions[:-1], 1)
    along = posture(table, readings.q, readings.warm).turns[:, -1] @ table.tip
    size = rng.uniform(0.01, 0.03)
    off = np.isin(readings.session, by_one)[:, None] * size * along / np.linalg.norm(table.tip)
    return Habit(
        replace(scene.none(), target=off), f"{1e3 * size:.0f} µm in {len(by_one)} sessions",
        (("tip_offset", "tip"), ("probing_force", "tip")),
    )  # fmt: skip


def latched(rng: Rng, scene: Scene) -> Habit:
    """Some rows were latched late, while the arm still moved."""
    rows = _here(scene) & (rng.random(len(scene.on)) < MOVING)
    by = rows * rng.uniform(*LATE_S, len(rows))
    alter = replace(scene.none(), encoder=scene.readings.rate * by[:, None])
    return Habit(alter, f"{rows.sum()} rows", (("outliers", "rows"),))


def glitch(rng: Rng, scene: Scene) -> Habit:
    """Once in each placement one encoder's interpolation jumps, in one row."""
    k, encoder = int(rng.integers(scene.machine.joints)), np.zeros_like(scene.readings.q)
    jump = rng.uniform(*JUMP_RAD)
    for placement in np.unique(scene.readings.placement[_here(scene)]):
        rows = np.flatnonzero(scene.readings.placement == placement)
        encoder[rng.choice(rows), k] = jump
    alter = replace(scene.none(), encoder=encoder)
    return Habit(alter, f"joint {k + 1}, {1e6 * jump:.0f} µrad", (("outliers", "rows"),))


def numbered(rng: Rng, scene: Scene) -> Habit:
    """In one placement the targets were counted from the other end."""
    readings, points = scene.readings, scene.thing.points
    placement = rng.choice(np.unique(readings.placement[_here(scene)]))
    rows = np.flatnonzero(readings.placement == placement)
    middle, named = points - points.mean(axis=0), readings.target[rows]
    turn = np.linalg.lstsq(middle[named], readings.lever[rows], rcond=None)[0]  # and growth
    # The artefact lies half turned, so that it looks right: only its irregularities tell.
    touched = middle[::-1][named] @ _half_turn(points)
    target = np.zeros_like(readings.goal)
    target[rows] = (touched - middle[named]) @ turn
    return Habit(
        replace(scene.none(), target=target), "one placement",
        (("outliers", "rows"), ("artefact_moved", "artefact")), mistaken=int(placement),
    )  # fmt: skip


def _half_turn(points: F64) -> F64:
    """(3, 3) the turn that brings a plate's or a beam's points, counted backwards, near its own."""
    middle = points - points.mean(axis=0)
    left, _, right = np.linalg.svd(middle[::-1].T @ middle)
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(left @ right))])
    turn: F64 = left @ sign @ right
    return turn


def ambient(rng: Rng, scene: Scene) -> Habit:
    """One sensor, in the room's air; every link follows the air late, each in its own time."""
    readings, air = scene.readings, scene.readings.warm.mean(axis=1)
    link = np.zeros_like(readings.warm)
    minutes = rng.uniform(5, 25, scene.machine.joints)
    for session in np.unique(readings.session):
        rows = np.flatnonzero(readings.session == session)
        for k, each in enumerate(minutes):
            behind = late(readings.time_s[rows], air[rows], 60 * each)
            link[rows, k] = air[rows] + behind - readings.warm[rows, k]
    sensor = air[:, None] - readings.warm
    places = [f"link {k + 1}" for k in range(scene.machine.joints)]
    return Habit(
        replace(scene.none(), link=link, sensor=sensor), "5 to 25 min",
        tuple(("thermal_lag", place) for place in ("sensor t1", *places)), ("t1", "time_s"),
    )  # fmt: skip


def tracker(rng: Rng, scene: Scene) -> Habit:
    """A laser tracker some metres off says where the tip was; its frame drifts."""
    readings = scene.readings
    target, truth = np.zeros_like(readings.goal), np.zeros_like(readings.goal)
    for placement in np.unique(readings.placement):
        rows = np.flatnonzero(readings.placement == placement)
        bearing, level = rng.uniform(0, 2 * np.pi), rng.uniform(-300, 300)
        far = rng.uniform(2000, 4000)
        away = readings.goal[rows] - [far * np.cos(bearing), far * np.sin(bearing), level]
        hours = (readings.time_s[rows] - readings.time_s[rows[0]]) / 3600
        moved = FRAME_MM_H * rng.standard_normal(3) + np.cross(
            FRAME_RAD_H * rng.standard_normal(3), away
        )
        target[rows] = SCALE * rng.standard_normal() * away + moved * hours[:, None]
        c, s = np.cos(bearing), np.sin(bearing)
        truth[rows] = away @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return Habit(
        replace(scene.none(), target=target), "2 to 4 m off",
        (("mount_drift", "base"), ("artefact_moved", "artefact")), (), truth,
    )  # fmt: skip


def hand(rng: Rng, scene: Scene) -> Habit:
    """A hand moves the artefact, once."""
    (fault,) = moved_by_hand(rng, scene)
    return Habit(fault.alter, fault.words, ((fault.cause, fault.location),))


def shop_floor(rng: Rng, scene: Scene) -> Habit:
    """The arm was calibrated in a room kept within 1 K, where no link's growth shows."""
    numbers = range(1, scene.machine.joints + 1)
    return Habit(
        scene.none(), "growth unknown", tuple(("link_expansion", f"link {k}") for k in numbers),
        tuple(f"t{k}" for k in numbers),
    )  # fmt: skip


def another(rng: Rng, scene: Scene) -> Habit:
    """The arm was calibrated with an artefact that is longer than certified, and so is all of it:
    each of its lengths is wrong, and the artefact now used seems to be."""
    scale, drawn = rng.choice([-1, 1]) * rng.uniform(1e-5, 4e-5), scene.machine.drawn
    target = scale * scene.readings.lever * ~scene.on[:, None]
    long = np.flatnonzero(np.hypot(drawn.d, drawn.a) > 100) + 1
    return Habit(
        replace(scene.none(), target=target), f"{1e6 * scale:.0f} ppm",
        (("artefact_length", "artefact"), *(("geometry_shift", f"joint {k}") for k in long)),
    )  # fmt: skip


def unsigned(rng: Rng, scene: Scene) -> Habit:
    """A joint has play, and nobody wrote down rates, which alone say to which side."""
    k, size = inner(rng, scene), rng.uniform(1e-5, 3e-5)
    alter = scene.at_joint(k, size * np.sign(scene.readings.rate[:, k]))
    names = (("joint_backlash", f"joint {k + 1}"),)
    return Habit(alter, f"joint {k + 1}, {1e6 * size:.0f} µrad", names, (f"q{k + 1}",))


HABITS: dict[str, Callable[[Rng, Scene], Habit]] = {
    "unsoaked": unsoaked, "pressed": pressed, "latched": latched, "glitch": glitch,
    "numbered": numbered, "ambient": ambient, "tracker": tracker, "hand": hand,
    "shop_floor": shop_floor, "another": another, "unsigned": unsigned,
}  # fmt: skip
