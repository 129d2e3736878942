"""Noise units of an error of the angles planted into a real robot's readings.

Nobody knows such a robot's noise: it is taken for what a fit of constants and poses alone leaves of
the readings before anything was planted, with whatever else is wrong with the robot. So units are
underestimated, never over. The chain is the outsider's.
"""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from hidden.frozen.oracle import BEFORE, DIAGNOSED, F64, I64, Problem
from outsider.chain import STEP_RAD, Alteration, Table, by_angles, by_constants, posture

Rows = Sequence[dict[str, str]]
PARALLEL = 0.1
MEASURED = ("x_mm", "y_mm", "z_mm")  # of a tracker; seats are held, and nobody measured where


def compute_noise_units(arm: Path, before: Rows, diagnosed: Rows, joint: int, error: F64) -> float:
    """Noise units of *error* (rad), which the encoder of *joint* adds in each diagnosed reading;
    *before* and *diagnosed* are the readings without it."""
    table, rows = _read_table(arm), [*before, *diagnosed]
    q = np.array([[float(r[f"q{k + 1}"]) for k in range(len(table.d))] for r in rows])
    stands = posture(table, q, np.zeros_like(q))
    placement = _number_placements(rows)
    levers, left = _compare(stands.tip, placement, rows)
    effect = np.zeros_like(left)
    effect[len(before) :] = by_angles(stands)[len(before) :, :, joint - 1] * error[:, None]
    part = np.where(np.arange(len(rows)) < len(before), BEFORE, DIAGNOSED)
    constants = by_constants(table, q, np.zeros_like(q))
    if MEASURED[0] not in rows[0]:
        # Without a length all tips could be at one place: the longest of the drawing holds the
        # scale, as the certified distance between the seats does. The first d only lifts the arm.
        lengths = np.abs(np.concatenate([[0.0], table.d[1:], table.a]))
        constants = np.delete(constants, len(table.d) + int(np.argmax(lengths)), axis=2)
    columns = np.concatenate([constants, _tilts(table, q)], axis=2)
    in_mm = Problem(columns, [effect], left, levers, placement, part, np.ones(len(rows)))
    return in_mm.noise_units()[0] / in_mm.unexplained_mm()


def _read_table(arm: Path) -> Table:
    toml = tomllib.loads(arm.read_text(encoding="utf-8"))
    joints = toml["joint"]

    def column(key: str) -> F64:
        return np.array([float(joint.get(key, 0.0)) for joint in joints])

    return Table(
        np.radians(column("theta_deg")), column("d_mm"), column("a_mm"),
        np.radians(column("alpha_deg")), np.array(toml["tip"]["offset_mm"], dtype=float),
        np.zeros((len(joints), 2)),
    )  # fmt: skip


def _number_placements(rows: Rows) -> I64:
    """A tracker's pose by its placement; a seat of unknown place by placement and target."""
    keys = [
        (row["placement"],) if MEASURED[0] in row else (row["placement"], row["target"])
        for row in rows
    ]
    numbers = {key: i for i, key in enumerate(dict.fromkeys(keys))}
    return np.array([numbers[key] for key in keys])


def _compare(tip: F64, placement: I64, rows: Rows) -> tuple[F64, F64]:
    """(n, 3) levers about each placement's origin, and by how much the tip is off, mm; a seat has
    no lever, for nothing tells how it is turned."""
    levers, left = np.zeros_like(tip), np.zeros_like(tip)
    for number in np.unique(placement):
        mine = np.flatnonzero(placement == number)
        off = tip[mine] - tip[mine].mean(axis=0)
        if MEASURED[0] in rows[mine[0]]:
            measured = np.array([[float(rows[i][name]) for name in MEASURED] for i in mine])
            shape = measured - measured.mean(axis=0)
            u, _, vt = np.linalg.svd(shape.T @ off)  # Kabsch: off ≈ shape · R
            turned = shape @ (u * [1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
            levers[mine] = turned
            off = off - turned
        left[mine] = off
    return levers, left


def _tilts(table: Table, q: F64) -> F64:
    """(n, 3, m) by what Hayati's β moves the tip, a turn of the link's end about its y axis.

    Only of joints nearly parallel to the next: elsewhere θ and the next d make the same turn."""
    none = Alteration.none(*q.shape)
    columns: list[F64] = []
    for k in np.flatnonzero(np.abs(np.sin(table.alpha)) < PARALLEL):
        by = np.zeros_like(none.turn)
        by[:, k, 1] = STEP_RAD
        ends = [
            posture(table, q, np.zeros_like(q), replace(none, turn=sign * by)).tip
            for sign in (1.0, -1.0)
        ]
        columns.append((ends[0] - ends[1]) / (2 * STEP_RAD))
    return np.stack(columns, axis=2) if columns else np.empty((len(q), 3, 0))
