"""A case as a user's files.

The folder gets arm.toml, sessions `before-*` (where a calibration from before is wanted),
`session-*` to diagnose, `further`, which is not diagnosed, and truth.json.
"""

from __future__ import annotations

import csv
import datetime
import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
from outsider.case import Case, session_name
from outsider.chain import F64, solve
from outsider.measured import Machine

BEGAN = datetime.datetime(2026, 3, 2, 6, tzinfo=datetime.UTC)
SENSOR_K, GROSS, TWICE = 0.02, 0.03, 0.2


def write(case: Case, folder: Path) -> None:
    """All files of the case into *folder*, which exists."""
    (folder / "arm.toml").write_text(_arm_toml(case.machine, case.mess), encoding="utf-8")
    (folder / "truth.json").write_text(json.dumps(asdict(case.truth), indent=1), encoding="utf-8")
    machine, readings, rng, mess = case.machine, case.readings, case.rng, case.mess
    shape = readings.q.shape

    def noise(size: tuple[int, ...]) -> F64:
        return rng.standard_t(3, size) / np.sqrt(3) if mess == "t3" else rng.standard_normal(size)

    diagnosed = (readings.session >= case.plan.before) & (
        readings.session < case.plan.sessions - 1
    )  # fmt: skip
    seated = noise((shape[0], 3))
    if mess == "repeats":  # a rest has one seat
        _, first, rest = np.unique(readings.q, axis=0, return_index=True, return_inverse=True)
        seated = seated[first[rest]]
    touched = readings.goal + case.alter.target + case.seat_mm[:, None] * seated
    if mess == "gross":
        off = diagnosed & (rng.random(shape[0]) < GROSS)
        away = rng.standard_normal((shape[0], 3))
        away *= rng.uniform(0.1, 1.0, (shape[0], 1)) / np.linalg.norm(away, axis=1, keepdims=True)
        touched = touched + away * off[:, None]
    true, miss = solve(machine.built, readings.q, touched, readings.warm, case.alter)
    assert miss.max() < 1e-6, "an altered arm does not reach its point"
    q = true + case.alter.encoder + machine.encoder_rad * noise(shape)
    if case.step_rad:
        q = case.step_rad * np.round(q / case.step_rad)
    sensors = 20 + readings.warm + case.alter.sensor + SENSOR_K * rng.standard_normal(shape)
    text = np.char.mod("%.2f", sensors).astype(object)
    if mess == "dead":
        k = int(rng.integers(1, machine.joints - 1))
        since = case.plan.before + case.plan.diagnosed // 2
        still = "" if rng.random() < 0.5 else text[0, k]
        text[diagnosed & (readings.session >= since), k] = still
    unit = str(rng.choice(["rad", "deg"]))
    for session in range(case.plan.sessions):
        rows = list(np.flatnonzero(readings.session == session))
        if mess == "doubled" and diagnosed[rows[0]]:
            rows = sorted(rows + [row for row in rows if rng.random() < TWICE])
        _write_session(case, folder, session, rows, q, text, unit)


def _write_session(
    case: Case, folder: Path, session: int, rows: list[int], q: F64, sensors: F64, unit: str
) -> None:
    readings, joints = case.readings, range(1, case.machine.joints + 1)
    tracked = case.tracked_mm
    rated = () if case.mess == "unsigned" else joints
    channels = [1] if case.mess == "ambient" else joints
    place = folder / session_name(case.plan, session)
    place.mkdir()
    began = float(np.floor(readings.time_s[rows[0]]))
    started = (BEGAN + datetime.timedelta(seconds=began)).strftime("%Y-%m-%dT%H:%M:%SZ")
    lines = [
        'schema = "armd.session/1"', 'arm = "OUTSIDER"', f"started = {started}",
        f'angle_unit = "{unit}"', "[artefact]", f'name = "{case.thing.name}"',
        f"expansion_per_k = {case.thing.per_k}",
    ]  # fmt: skip
    certified = [] if tracked is not None else case.thing.points
    if tracked is not None:
        lines += ["[[artefact.target]]", 'name = "B1"']
    for number, point in enumerate(certified, 1):
        lines += [
            "[[artefact.target]]", f'name = "B{number}"',
            f"position_mm = {json.dumps(point.tolist())}",
        ]  # fmt: skip
    (place / "session.toml").write_text("\n".join(lines) + "\n", encoding="utf-8")
    shown = np.degrees(q) if unit == "deg" else q
    with (place / "readings.csv").open("w", newline="", encoding="utf-8") as file:
        table = csv.writer(file)
        table.writerow(
            ["time_s", "placement", "target", *(f"q{k}" for k in joints),
             *(f"w{k}" for k in rated), *(f"t{k}" for k in channels), "artefact_c",
             *(() if tracked is None else ("x_mm", "y_mm", "z_mm"))]
        )  # fmt: skip
        placements = readings.placement[rows]
        first = np.append(True, placements[1:] != placements[:-1])
        for i, new in zip(rows, first, strict=True):
            read = new or case.mess != "unread"
            table.writerow(
                [f"{readings.time_s[i] - began:.2f}",
                 f"P{readings.placement[i] % case.plan.placements + 1}",
                 "B1" if tracked is not None else f"B{readings.target[i] + 1}",
                 *(f"{angle:.9f}" for angle in shown[i]),
                 *(f"{rate:.5f}" for rate in readings.rate[i, : len(rated)]),
                 *sensors[i, : len(channels)],
                 f"{20 + readings.artefact_k[i]:.2f}" if read else "",
                 *(() if tracked is None else (f"{value:.5f}" for value in tracked[i]))]
            )  # fmt: skip


def _arm_toml(machine: Machine, mess: str) -> str:
    drawn, lone = machine.drawn, mess == "ambient"
    lines = ['schema = "armd.arm/1"', 'serial_number = "OUTSIDER"']
    for k in range(1 if lone else machine.joints):
        lines += ["[[temperature_sensor]]", f'name = "t{k + 1}"']
    for k in range(machine.joints):
        middle = (-0.5 * machine.along(k)).round(2).tolist()
        lines += [
            "[[joint]]", f"theta_deg = {np.degrees(drawn.theta[k])}", f"d_mm = {drawn.d[k]}",
            f"a_mm = {drawn.a[k]}", f"alpha_deg = {np.degrees(drawn.alpha[k])}",
            f'temperature = "t{1 if lone else k + 1}"',
        ]  # fmt: skip
        if mess != "bare":
            weight = f"mass_kg = {machine.mass_kg[k]:.4f}"
            lines += [weight, f"centre_of_mass_mm = {json.dumps(middle)}"]
    lines += ["[tip]", f"offset_mm = {json.dumps(drawn.tip.tolist())}", "radius_mm = 3.0"]
    return "\n".join(lines) + "\n"
