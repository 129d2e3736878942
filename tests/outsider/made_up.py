"""A small arm and its readings, made up for sums by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from outsider.chain import F64, Table
from outsider.measured import Machine, Readings, Thing
from outsider.scene import Scene

BALLS = Thing("beam", np.outer(np.arange(3) * 100.0, [1.0, 0.0, 0.0]), 1e-5)


def scene(q: F64, machine: Machine, **others: F64) -> Scene:
    n, joints = q.shape
    flat, number = np.zeros((n, joints)), np.arange(n)
    readings = Readings(
        q, flat + 1, flat + 1, 10.0 * number, number * 0, number * 0, number * 0, np.zeros((n, 3)),
        np.zeros((n, 3)), flat, number * 0.0,
    )  # fmt: skip
    return Scene(machine, replace(readings, **others), np.ones(n, dtype=bool), BALLS)


def four_joints() -> Machine:
    """Link 2 is 200 mm long along x and weighs something, the others neither."""
    flat = np.zeros(4)
    table = Table(flat, flat, np.array([10.0, 200, 10, 10]), flat, np.zeros(3), np.zeros((4, 2)))
    return Machine(table, table, flat + 3, np.array([0.0, 1.0, 0.0, 0.0]), 5e-6, 3e-3)
