"""A healthy arm drawn at random, and what somebody measured with it: postures, times, temperatures.

Nothing here is wrong with the arm yet; `faults.py` sees to that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from outsider.chain import F64, Table, posture, solve

Rng = np.random.Generator
#: How far an arm is from its drawing: rad, mm.
BUILT_RAD, BUILT_MM = 1e-3, 0.3
#: A room kept within 1 K, and how much less than usual it drifts.
KEPT_C, KEPT_RESTLESS = (20.3, 21.2), 0.1
POOL = 6000  # postures of which the one next to a target is taken


@dataclass(frozen=True)
class Machine:
    """An arm: as drawn, as it is, and how finely it measures."""

    drawn: Table
    built: Table
    limit: F64  # (N,) rad, either side of 0
    mass_kg: F64  # (N,) of the link after each joint
    encoder_rad: float
    seat_mm: float

    @property
    def joints(self) -> int:
        return len(self.built.d)

    def along(self, k: int) -> F64:
        """Link k (from 0), from the joint's frame before to its own, in the latter's axes."""
        d, a, alpha = self.drawn.d[k], self.drawn.a[k], self.drawn.alpha[k]
        return np.array([a, d * np.sin(alpha), d * np.cos(alpha)])


@dataclass(frozen=True)
class Thing:
    """An artefact: certified points (m, 3) in mm at 20 °C, and what it grows per kelvin."""

    name: str
    points: F64
    per_k: float


@dataclass(frozen=True)
class Readings:
    """All that was measured, in the order of time; n readings."""

    q: F64  # (n, N) rad, true angles of the joints
    rate: F64  # (n, N) rad/s, with the side of approach as its sign
    run_up: F64  # (n, N) rad, how far each joint came from that side
    time_s: F64  # (n,) since the first session began
    session: F64  # (n,) number of the session
    placement: F64  # (n,) running number over all sessions
    target: F64  # (n,) number of the artefact's point
    goal: F64  # (n, 3) mm, where the point truly is, base frame
    lever: F64  # (n, 3) mm, from the placement's origin to it
    warm: F64  # (n, N) K above the reference, of sensors and links alike
    artefact_k: F64  # (n,)

    def only(self, rows: F64) -> Readings:
        return replace(self, **{name: value[rows] for name, value in vars(self).items()})


def draw_machine(rng: Rng, joints: int = 0) -> Machine:
    """So many joints, or 5 to 7; long links on every other one, no axis nearly parallel to the
    next."""
    joints = joints or int(rng.integers(5, 8))
    long = np.arange(joints) % 2 == 0
    d = np.where(long, rng.uniform(160, 380, joints), rng.uniform(-50, 50, joints))
    a = np.where(long, rng.uniform(0, 50, joints), rng.uniform(10, 70, joints))
    alpha = rng.choice([-1, 1], joints) * rng.uniform(np.pi / 3, np.pi / 2, joints)
    d[-1], a[-1], alpha[-1] = rng.uniform(30, 70), 0.0, 0.0
    tip = np.array([rng.uniform(25, 60), rng.uniform(-20, 20), rng.uniform(90, 160)])
    per_k = np.repeat(rng.uniform(3e-6, 24e-6, joints)[:, None], 2, axis=1)
    theta = np.round(rng.uniform(-np.pi, np.pi, joints), 3)
    drawn = Table(theta, d.round(1), a.round(1), alpha.round(3), tip.round(1), np.zeros_like(per_k))

    def off(values: F64, size: float) -> F64:
        return values + size * rng.standard_normal(values.shape)

    built = Table(
        off(drawn.theta, BUILT_RAD), off(drawn.d, BUILT_MM), off(drawn.a, BUILT_MM),
        off(drawn.alpha, BUILT_RAD), off(drawn.tip, BUILT_MM), per_k,
    )  # fmt: skip
    return Machine(
        drawn,
        built,
        rng.uniform(1.9, 3.0, joints),
        np.linspace(1.6, 0.4, joints) * rng.uniform(0.7, 1.3, joints),
        rng.uniform(3e-6, 9e-6),
        rng.uniform(2e-3, 6e-3),
    )


def draw_thing(rng: Rng) -> Thing:
    """A plate of balls, a beam of balls, or cones on a tower."""
    name = str(rng.choice(["ball plate", "ball beam", "tower of cones"]))
    if name == "ball plate":
        grid = np.stack(np.meshgrid(np.arange(4) * 120.0, np.arange(4) * 95.0), axis=-1)
        points = np.column_stack([grid.reshape(-1, 2), np.zeros(16)])
    elif name == "ball beam":
        points = np.outer(np.arange(7) * 95.0, [1.0, 0.0, 0.0])
    else:
        points = rng.uniform(0, 320, (9, 3))
    if name != "ball beam":
        points = points + rng.normal(0, 0.5, points.shape)
    return Thing(name, points.round(4), float(rng.choice([0.5e-6, 5e-6, 11.5e-6])))


@dataclass(frozen=True)
class Plan:
    """Sessions, from the first to the last: how many before the arm went wrong, how many are
    diagnosed; one more comes after these."""

    before: int
    diagnosed: int
    rows: int  # in each session
    placements: int  # in each session
    restless: float = 1.0  # how much more than usual the room drifts within a session
    climates_c: tuple[float, float, float, float] = (16, 26, 18, 24)  # and of the further session
    kept_before: bool = False  # sessions from before were in a room that is kept within 1 K
    uneven: bool = False  # placements of 5, 12 and all other readings, with three targets each
    levels_c: tuple[float, ...] = ()  # of each session, in order; (): drawn between the climates

    @property
    def sessions(self) -> int:
        return self.before + self.diagnosed + 1


def measure(rng: Rng, machine: Machine, thing: Thing, plan: Plan) -> Readings:
    """Every session of the plan by the healthy arm, without noise."""
    pool = rng.uniform(-1, 1, (POOL, machine.joints)) * machine.limit
    reached = posture(machine.built, pool, np.zeros_like(pool)).tip
    room_c = [KEPT_C if plan.kept_before else plan.climates_c[:2], plan.climates_c[:2]]
    levels = [
        *(rng.permutation(np.linspace(*between, max(count, 1)))[:count]
          for between, count in zip(room_c, (plan.before, plan.diagnosed), strict=True)),
        [rng.uniform(*plan.climates_c[2:])],
    ]  # fmt: skip
    level_c, parts, began = np.concatenate(levels), [], 0.0
    if plan.levels_c:
        level_c = np.array(plan.levels_c)
    for session in range(plan.sessions):
        pace = rng.uniform(15, 40)
        time_s = np.cumsum(pace * rng.uniform(0.7, 1.5, plan.rows))
        kept = plan.kept_before and session < plan.before
        restless = KEPT_RESTLESS if kept else plan.restless
        warm = level_c[session] - 20 + _course(rng, time_s, machine.joints, restless)
        placements = np.sort(np.arange(plan.rows) % plan.placements)
        few = len(thing.points)
        if plan.uneven:
            placements, few = np.searchsorted((5, 17), np.arange(plan.rows), side="right"), 3
        rows = [
            _placed(rng, machine, thing, warm[placements == p], pool, reached, few)
            for p in range(plan.placements)
        ]
        q, target, goal, lever, artefact_k = (
            np.concatenate(part) for part in zip(*rows, strict=True)
        )
        parts.append(
            Readings(
                q,
                rng.choice([-1, 1], q.shape) * _log_uniform(rng, 0.02, 0.4, q.shape),
                _log_uniform(rng, 0.03, 0.4, q.shape),
                began + time_s,
                np.full(plan.rows, session),
                session * plan.placements + placements,
                target, goal, lever, warm, artefact_k,
            )
        )  # fmt: skip
        began += float(time_s[-1]) + rng.uniform(1200, 4800)
    return Readings(
        **{name: np.concatenate([vars(part)[name] for part in parts]) for name in vars(parts[0])}
    )


def repeated(readings: Readings, times: int) -> Readings:
    """Each rest read so many times, a second apart, as it stands; and with nothing between."""
    row = np.arange(len(readings.q))
    begin = np.searchsorted(readings.placement, readings.placement)  # of the row's placement
    again = (row - begin) % times
    same = readings.only(row - again)
    return replace(same, time_s=same.time_s + again)


def _log_uniform(rng: Rng, low: float, high: float, shape: tuple[int, ...]) -> F64:
    return np.exp(rng.uniform(np.log(low), np.log(high), shape))


def _course(rng: Rng, time_s: F64, joints: int, restless: float) -> F64:
    """(n, N) K around a session's level: a room that drifts, sensors with courses of their own."""
    hours = (time_s[:, None] + rng.uniform(0, 1200)) / 3600
    room = restless * rng.normal(0, 2.0) * (1 - np.exp(-hours / rng.uniform(0.3, 1.0)))
    waves = rng.uniform(0.5, 2.0, joints)
    own = rng.normal(0, 0.25, joints) * np.sin(2 * np.pi * waves * hours)
    course: F64 = rng.normal(0, 0.6, joints) + room * rng.uniform(0.7, 1.2, joints) + own
    return course


def _placed(
    rng: Rng, machine: Machine, thing: Thing, warm: F64, pool: F64, reached: F64, few: int
) -> tuple[F64, F64, F64, F64, F64]:
    """One placement of the artefact that the arm can reach, and postures that touch *few* of it."""
    n = len(warm)
    while True:
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        turn *= np.sign(np.linalg.det(turn))
        middle = 0.85 * reached[rng.integers(POOL)]
        artefact_k = warm.mean(axis=1) + rng.normal(0, 0.2)
        order = np.concatenate([rng.permutation(len(thing.points)) for _ in range(n)])
        target = order[:n] if few == len(thing.points) else order[np.arange(n) % few]
        grown = thing.points[target] * (1 + thing.per_k * artefact_k[:, None])
        lever = (grown - thing.points.mean(axis=0)) @ turn.T
        goal = middle + lever
        q, open_ = np.zeros((n, machine.joints)), np.ones(n, dtype=bool)
        for _ in range(6):
            distance = np.linalg.norm(reached[None] - goal[open_][:, None], axis=2)
            near = np.argsort(distance, axis=1)[:, :25]
            start = pool[near[np.arange(len(near)), rng.integers(25, size=len(near))]]
            found, miss = solve(machine.built, start, goal[open_], warm[open_])
            good = (miss < 1e-7) & np.all(np.abs(found) < machine.limit, axis=1)
            rows = np.flatnonzero(open_)[good]
            q[rows], open_[rows] = found[good], False
            if not open_.any():
                return q, target, goal, lever, artefact_k
