"""A simulated bench: a table, a printed plate with three seats, and a user who measures them.

Three sessions of docs/tutorials/so101.md: `calibrate` and `check` with the plate in several
placements, `verify` with a near, a middle and a far seat.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from armd.arrays import F64
from armd.simulator.printed.arm import LIMITS_DEG, PrintedArm
from armd.simulator.truth.rotations import draw_directions, rotate_about

#: The plate: a triangle of 90° cones, measured with a calliper.
SEATS_MM = {"S1": (0.0, 0.0, 0.0), "S2": (120.0, 0.0, 0.0), "S3": (40.0, 90.0, 0.0)}
#: Single cones on the table: near, in the middle, far out.
CONES_MM = {
    "SPAT1": (120.0, 60.0, 60.0),
    "SPAT2": (220.0, -80.0, 90.0),
    "SPAT3": (330.0, 60.0, 80.0),
}
CALLIPER_MM = 0.03
SEAT_MM = 0.02  # standard deviation of a ball from the middle of a printed cone
PAUSE_S = 8.0  # from one reading to the next
WARM_K, WARM_S = 8.0, 600.0  # heat of the motors' electronics, with torque off
LINK_SHARE = 0.5  # share of the motor's temperature rise that its link has


BenchRow = dict[str, str | int]


@dataclass(frozen=True)
class Touch:
    placement: str
    target: str
    at_mm: F64


def measure(
    seed: int, progress: Callable[[float], None] = lambda _share: None
) -> tuple[PrintedArm, dict[str, str], int]:
    """Measure with an SO-101 drawn from *seed*.

    Returns the arm, the files of its three sessions by name, and the number of readings.
    """
    rng = np.random.default_rng([seed, 0x50101])
    arm = PrintedArm.draw(rng)
    true = {name: np.array(seat_mm) + rng.normal(0.0, 0.1, 3) for name, seat_mm in SEATS_MM.items()}
    files: dict[str, str] = {}
    total = 0
    sessions = {
        "calibrate": _plate_visits(rng, true, 6, 10),
        "check": _plate_visits(rng, true, 4, 6),
        "verify": _seat_visits(),
    }
    every = sum(map(len, sessions.values()))
    for name, visits in sessions.items():
        rows: list[BenchRow] = []
        for row in _take(arm, rng, visits, total * PAUSE_S):
            rows.append(row)
            progress((total + len(rows)) / every)
        total += len(rows)
        lengths = {} if name == "verify" else _measured(rng, true)
        files[f"{name}/readings.csv"] = _table(rows)
        files[f"{name}/session.toml"] = _description(rows, lengths)
    return arm, files, total


def _plate_visits(
    rng: np.random.Generator, true: dict[str, F64], places: int, postures: int
) -> list[Touch]:
    """Plan the plate around the arm, flat and on a wedge, low and on a box."""
    visits = []
    for i in range(places):
        angle = (i + 0.5) / places * 2.6 - 1.3 + rng.uniform(-0.1, 0.1)
        radius = (215.0, 280.0)[i % 2] + rng.uniform(-15, 15)
        height = (30.0, 80.0, 130.0)[i % 3] + rng.uniform(-10, 10)
        turn = rotate_about(np.array([0.0, 0.0, angle + rng.uniform(-0.5, 0.5)]))
        turn = turn @ rotate_about(draw_directions(rng, 1)[0] * rng.uniform(0.0, 0.5))
        middle = np.mean(list(true.values()), axis=0)
        corner = np.array([radius * np.cos(angle), radius * np.sin(angle), height]) - turn @ middle
        visits += [
            Touch(f"P{i + 1}", name, corner + turn @ seat_mm)
            for name, seat_mm in true.items()
            for _ in range(postures)
        ]
    return visits


def _seat_visits() -> list[Touch]:
    return [
        Touch("V1", name, np.array(cone_mm))
        for name, cone_mm in CONES_MM.items()
        for _ in range(10)
    ]


def _measured(rng: np.random.Generator, true: dict[str, F64]) -> dict[tuple[str, str], float]:
    """Return the seats' distances by a calliper."""
    return {
        pair: float(np.linalg.norm(true[pair[0]] - true[pair[1]]) + rng.normal(0.0, CALLIPER_MM))
        for pair in combinations(true, 2)
    }


def _take(
    arm: PrintedArm, rng: np.random.Generator, visits: list[Touch], started_s: float
) -> Iterator[BenchRow]:
    for i, visit in enumerate(visits):
        warmth_k = WARM_K * (1 - np.exp(-(started_s + i * PAUSE_S) / WARM_S))
        motor_c = 22.0 + warmth_k * np.array([0.7, 0.9, 1.0, 1.1, 1.2])
        link_c = 22.0 + LINK_SHARE * (motor_c - 22.0)
        seat = visit.at_mm + rng.normal(0.0, SEAT_MM, 3)
        counts = arm.counts(_posture(arm, rng, seat, link_c), rng)
        yield (
            {"time_s": f"{i * PAUSE_S:g}", "placement": visit.placement, "target": visit.target}
            | {f"q{k + 1}": int(count) for k, count in enumerate(counts)}
            | {f"servo{k + 2}": int(np.floor(c)) for k, c in enumerate(motor_c)}
        )


def _posture(arm: PrintedArm, rng: np.random.Generator, at_mm: F64, link_c: F64) -> F64:
    """Find angles with the ball in the seat, from random starting points."""
    low, high = np.radians(LIMITS_DEG).T
    for _ in range(400):
        angles = rng.uniform(0.95 * low, 0.95 * high)
        for _ in range(25):
            miss = at_mm - arm.tip(angles, link_c)
            if np.linalg.norm(miss) < 1e-6:
                break
            rigid = arm.tip_of_links(angles, link_c)  # nearly the whole arm's derivatives
            slope = np.stack(
                [arm.tip_of_links(angles + s, link_c) - rigid for s in np.eye(5) * 1e-6], 1
            )
            move = np.linalg.lstsq(slope / 1e-6, miss, rcond=1e-3)[0]
            angles = angles + move * min(1.0, 0.4 / max(np.abs(move).max(), 1e-12))
            if (angles < 1.5 * low).any() or (angles > 1.5 * high).any():
                break
        inside = (angles > low).all() and (angles < high).all()
        if inside and np.linalg.norm(at_mm - arm.tip(angles, link_c)) < 1e-6:
            return np.asarray(angles)
    raise RuntimeError(f"no posture reaches {at_mm}")


def _description(rows: list[BenchRow], lengths: dict[tuple[str, str], float]) -> str:
    """Return the text of session.toml."""
    names = list(dict.fromkeys(str(row["target"]) for row in rows))
    lines = [
        'schema = "armd.session/1"',
        'arm = "SO101"',
        "started = 2026-03-01T09:00:00Z",
        'angle_unit = "count"',
        "",
        "[artefact]",
        f'name = "{"printed plate with three cones" if lengths else "cones on the table"}"',
    ]
    for name in names:
        lines += ["", "[[artefact.target]]", f'name = "{name}"']
    for (a, b), length in lengths.items():
        lines += [
            "",
            "[[artefact.distance]]",
            f'between = ["{a}", "{b}"]',
            f"length_mm = {length:.2f}",
            f"standard_uncertainty_mm = {CALLIPER_MM}",
        ]
    return "\n".join(lines) + "\n"


def _table(rows: list[BenchRow]) -> str:
    """Return the text of readings.csv."""
    text = io.StringIO()
    table = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    return text.getvalue()
