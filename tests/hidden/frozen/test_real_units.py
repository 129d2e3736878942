"""Noise units of a planted wave in readings of a robot, against a fit of every unknown by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hidden.frozen.real_units import compute_noise_units
from outsider.chain import Table, by_angles, by_constants, posture, rotation, solve

NOISE_MM, SEATS, BEFORE = 0.1, 6, 120
TABLE = Table(
    theta=np.array([0.3, -0.2, 0.1, 0.4, 0.0]),
    d=np.array([150.0, 20.0, 30.0, 210.0, 60.0]),
    a=np.array([10.0, 320.0, 25.0, 15.0, 0.0]),
    alpha=np.array([1.5, 0.6, -1.4, 1.5, 0.0]),
    tip=np.array([15.0, -10.0, 120.0]),
    per_k=np.zeros((5, 2)),
)


def write_arm(path: Path) -> Path:
    lines = ['schema = "armd.arm/1"', 'serial_number = "MADE"']
    angles = np.degrees(TABLE.theta), np.degrees(TABLE.alpha)
    for theta, alpha, d, a in zip(*angles, TABLE.d, TABLE.a, strict=True):
        lines += ["[[joint]]", f"theta_deg = {theta}", f"alpha_deg = {alpha}"]
        lines += [f"d_mm = {d}", f"a_mm = {a}"]
    path.write_text("\n".join([*lines, "[tip]", f"offset_mm = {TABLE.tip.tolist()}\n"]))
    return path


def hold_in_seats(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Angles that bring the tip into one of some seats, but for the noise; the seats' numbers."""
    seat = np.arange(n) % SEATS
    places = posture(TABLE, rng.uniform(-0.8, 0.8, (SEATS, 5)), np.zeros((SEATS, 5))).tip
    goal = places[seat] + NOISE_MM * rng.standard_normal((n, 3))
    warm = np.zeros((n, 5))
    start = rng.uniform(-0.9, 0.9, (n, 5))
    q, missed = solve(TABLE, start, goal, warm)
    return q[missed < 1e-6], seat[missed < 1e-6]


def as_rows(q: np.ndarray, targets: list[dict[str, str]]) -> list[dict[str, str]]:
    return [
        target | {f"q{k + 1}": repr(float(angle)) for k, angle in enumerate(angles)}
        for target, angles in zip(targets, q, strict=True)
    ]


def units_by_hand(q: np.ndarray, joint: int, error: np.ndarray, others: np.ndarray) -> float:
    """*others*: columns (n, 3, m) of whatever is unknown beside the angle's error."""
    effect = np.zeros((len(q), 3))
    jacobian = by_angles(posture(TABLE, q, np.zeros_like(q)))
    effect[BEFORE:] = jacobian[BEFORE:, :, joint - 1] * error[:, None]
    columns = others.reshape(3 * len(q), -1)
    columns = columns / np.linalg.norm(columns, axis=0)
    fitted = columns @ np.linalg.lstsq(columns, effect.ravel(), rcond=1e-9)[0]
    return float(np.linalg.norm(effect.ravel() - fitted) / NOISE_MM)


def constants_of(q: np.ndarray) -> np.ndarray:
    return by_constants(TABLE, q, np.zeros_like(q))[:, :, :-10]  # without growth


@pytest.mark.parametrize("joint", [2, 4])
def test_units_are_those_of_a_fit_of_constants_and_seats(joint: int, tmp_path: Path) -> None:
    q, seat = hold_in_seats(np.random.default_rng(3), 300)
    error = 0.001 * np.sin(2 * q[BEFORE:, joint - 1] - 0.5)
    rows = as_rows(q, [{"placement": "P", "target": f"S{number}"} for number in seat])
    units = compute_noise_units(
        write_arm(tmp_path / "arm.toml"), rows[:BEFORE], rows[BEFORE:], joint, error
    )
    seats = np.einsum("ns,ij->nisj", np.eye(SEATS)[seat], np.eye(3)).reshape(len(q), 3, -1)
    held = np.delete(constants_of(q), 5 + 6, axis=2)  # of d₁ … d₅, a₁ … a₅ a₂ is the longest
    expected = units_by_hand(q, joint, error, np.concatenate([held, seats], axis=2))
    assert units == pytest.approx(expected, rel=0.06)  # the noise is known to 1 in √(2 · 700)


def test_units_under_a_tracker_are_those_of_a_fit_of_constants_and_its_pose(
    tmp_path: Path,
) -> None:
    rng, joint = np.random.default_rng(4), 3
    q = rng.uniform(-1.0, 1.0, (300, 5))
    tip = posture(TABLE, q, np.zeros_like(q)).tip
    noise = NOISE_MM * rng.standard_normal(tip.shape)
    measured = (tip + noise - [500.0, 20.0, -80.0]) @ rotation(np.array([0.4, -1.1, 2.0]))
    names = ("x_mm", "y_mm", "z_mm")
    rows = as_rows(
        q,
        [
            {"placement": "tracker", "target": "T"}
            | {name: repr(float(x)) for name, x in zip(names, point, strict=True)}
            for point in measured
        ],
    )
    error = 0.001 * np.sin(q[BEFORE:, joint - 1] - 0.5)
    units = compute_noise_units(
        write_arm(tmp_path / "arm.toml"), rows[:BEFORE], rows[BEFORE:], joint, error
    )
    turns = -np.cross((tip - tip.mean(axis=0))[:, None, :], np.eye(3)[None])
    pose = np.concatenate([np.tile(np.eye(3), (300, 1, 1)), turns.swapaxes(1, 2)], axis=2)
    expected = units_by_hand(q, joint, error, np.concatenate([constants_of(q), pose], axis=2))
    assert units == pytest.approx(expected, rel=0.06)
