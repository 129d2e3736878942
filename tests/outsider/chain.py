"""The outsider's arm: a chain of Denavit-Hartenberg rows, by its own sums.

A = Rz(θ)·Tz(d)·Tx(a)·Rx(α) for each joint (Chinese Optics Letters 12, S11203, eq. 2). Lengths in
mm, angles in rad, temperatures in kelvin above the reference. n readings, N joints.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
#: Steps of the numerical derivatives: rad, mm.
STEP_RAD, STEP_MM = 1e-6, 1e-3


@dataclass(frozen=True)
class Table:
    """An arm's constants: θ0, d, a, α of each joint, the tip, and what d and a grow per kelvin."""

    theta: F64  # (N,)
    d: F64
    a: F64
    alpha: F64
    tip: F64  # (3,) in the last frame
    per_k: F64  # (N, 2) of d and a, as a share of the length


@dataclass(frozen=True)
class Alteration:
    """What a fault changes at each reading; all zero without one."""

    encoder: F64  # (n, N) rad: the encoder shows so much more than the joint's angle
    sensor: F64  # (n, N) K: so does the sensor, more than the course of temperatures
    link: F64  # (n, N) K: the link is so much warmer than that course
    turn: F64  # (n, N, 3) rad, of what follows link k, about the axes of the frame at its end
    shift: F64  # (n, N, 3) mm, likewise
    base: F64  # (n, 6) mm and rad: shift and turn of the whole arm
    target: F64  # (n, 3) mm: the point touched is so far off, base frame

    @staticmethod
    def none(n: int, joints: int) -> Alteration:
        flat, deep = np.zeros((n, joints)), np.zeros((n, joints, 3))
        return Alteration(flat, flat, flat, deep, deep, np.zeros((n, 6)), np.zeros((n, 3)))

    def plus(self, other: Alteration) -> Alteration:
        """Both at once."""
        return Alteration(*(part + vars(other)[name] for name, part in vars(self).items()))

    def times(self, size: float | F64) -> Alteration:
        """Every part times a number, or times one number for each reading."""

        def scaled(part: F64) -> F64:
            by = np.asarray(size, dtype=float)
            return part * by.reshape(by.shape + (1,) * (part.ndim - 1 if by.ndim else 0))

        return Alteration(*(scaled(getattr(self, field.name)) for field in fields(self)))


@dataclass(frozen=True)
class Posture:
    """Where everything stands at each reading, base frame."""

    origins: F64  # (n, N + 1, 3), the base first
    turns: F64  # (n, N + 1, 3, 3)
    tip: F64  # (n, 3)


def rotation(vector: F64) -> F64:
    """(..., 3) turn vectors → (..., 3, 3), Rodrigues' formula."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    cross = np.zeros((*vector.shape[:-1], 3, 3))
    cross[..., 2, 1], cross[..., 0, 2], cross[..., 1, 0] = np.moveaxis(vector, -1, 0)
    cross -= np.swapaxes(cross, -1, -2)
    small = np.maximum(angle, 1e-12)
    result: F64 = (
        np.eye(3) + np.sin(small) / small * cross + (1 - np.cos(small)) / small**2 * (cross @ cross)
    )
    return result


def posture(table: Table, q: F64, warm: F64, alter: Alteration | None = None) -> Posture:
    """Of the joints' true angles *q* and the links' true temperatures *warm*, both (n, N)."""
    n, joints = q.shape
    turn, place = np.tile(np.eye(3), (n, 1, 1)), np.zeros((n, 3))
    if alter:
        warm = warm + alter.link
        turn, place = rotation(alter.base[:, 3:]), alter.base[:, :3]
    origins, turns = [place], [turn]
    for k in range(joints):
        d = table.d[k] * (1 + table.per_k[k, 0] * warm[:, k])
        a = table.a[k] * (1 + table.per_k[k, 1] * warm[:, k])
        angle = q[:, k] + table.theta[k]
        c, s, zero, one = np.cos(angle), np.sin(angle), np.zeros(n), np.ones(n)
        about_z = np.stack([c, -s, zero, s, c, zero, zero, zero, one], axis=1).reshape(n, 3, 3)
        place = place + np.einsum("nij,nj->ni", turn, np.stack([a * c, a * s, d], axis=1))
        turn = turn @ about_z @ rotation(np.array([table.alpha[k], 0.0, 0.0]))
        if alter:
            place = place + np.einsum("nij,nj->ni", turn, alter.shift[:, k])
            turn = turn @ rotation(alter.turn[:, k])
        origins.append(place)
        turns.append(turn)
    tip = place + np.einsum("nij,j->ni", turn, table.tip)
    return Posture(np.stack(origins, axis=1), np.stack(turns, axis=1), tip)


def by_angles(stands: Posture) -> F64:
    """d tip / d q, (n, 3, N): each joint turns the tip about its axis."""
    axes, arms = stands.turns[:, :-1, :, 2], stands.tip[:, None] - stands.origins[:, :-1]
    return np.swapaxes(np.cross(axes, arms), 1, 2)


def solve(
    table: Table, start: F64, goal: F64, warm: F64, alter: Alteration | None = None
) -> tuple[F64, F64]:
    """Angles near *start* (n, N) that bring the tip to *goal* (n, 3), and the miss (n,) in mm."""
    q = start.copy()
    for _ in range(25):
        stands = posture(table, q, warm, alter)
        jacobian = by_angles(stands)
        square = jacobian @ np.swapaxes(jacobian, 1, 2) + 1e-3 * np.eye(3)
        step = np.linalg.solve(square, (goal - stands.tip)[..., None])
        move = (np.swapaxes(jacobian, 1, 2) @ step)[..., 0]
        q += np.clip(move, -0.3, 0.3)
    return q, np.linalg.norm(goal - posture(table, q, warm, alter).tip, axis=1)


def by_constants(table: Table, q: F64, warm: F64) -> F64:
    """d tip / d every identified constant, (n, 3, columns), by central differences.

    θ, d, a, α of each joint, the tip, and the growth of each d and a with temperature.
    """
    columns = []
    for name, step in (("theta", STEP_RAD), ("d", STEP_MM), ("a", STEP_MM), ("alpha", STEP_RAD),
                       ("tip", STEP_MM), ("per_k", STEP_RAD)):  # fmt: skip
        value = getattr(table, name)
        for index in np.ndindex(value.shape):
            by = np.zeros_like(value)
            by[index] = step
            ends = [
                posture(replace(table, **{name: value + sign * by}), q, warm).tip
                for sign in (1.0, -1.0)
            ]
            columns.append((ends[0] - ends[1]) / (2 * step))
    return np.stack(columns, axis=2)
