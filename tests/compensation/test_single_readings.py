"""One reading of a verification in the air: it counts, and its row is named."""

from __future__ import annotations

import csv
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.verify.figures import correct_positions, evaluate_figures
from armd.compensation.verify.limits import PermissibleErrors, TestUncertainty
from armd.compensation.verify.results import Verification
from armd.compensation.verify.spheres import measure_distances_from_sphere
from armd.compensation.verify.verdict import judge
from support.plain_kinematics import tip_pose
from support.selection import parametrize_default
from support.simulated_sessions import simulate_sessions

Rows = list[list[str]]
PLACEMENT, TARGET, Q2 = 1, 2, 4
#: A reading of each test: target, placement, which of its readings there, and the figure it spoils.
READINGS = {
    "sphere": ("SPHERE1.07", "SPHERE1", 0, "p_form"),
    "posture": ("LDIA.2.3", "LDIA", 0, "l_dia"),
    "diameter": ("EFFDIA.2.4", "EFFDIA", 0, "effective_diameter"),
    "length": ("L3", "E_UNI2", 1, "e_uni"),
    "first end": ("L0", "E_UNI3", 2, "e_uni"),
    "articulation": ("SPAT2", "SPAT2", 4, "spat_max"),
}


def figures(session: Session, arm: Arm) -> Verification:
    return evaluate_figures(session, arm, correct_positions(session, arm, None), TestUncertainty())


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate_sessions(tmp_path_factory.mktemp("measured"), "verify", "--seed", "3")


def verified(good: Path, tmp_path: Path, edit: Callable[[Rows], None]) -> Verification:
    arm = load_arm(good / "arm.toml")
    session = Path(shutil.copytree(good / "verify", tmp_path / "verify"))
    file = session / "readings.csv"
    head, *rows = csv.reader(file.read_text().splitlines())
    edit(rows)
    file.write_text("".join(",".join(row) + "\n" for row in [head, *rows]))
    return figures(load_session(session, arm), arm)


def row_of(rows: Rows, target: str, placement: str, nth: int) -> int:
    own = [i for i, row in enumerate(rows) if (row[TARGET], row[PLACEMENT]) == (target, placement)]
    return own[nth]


def lifted(good: Path, row: list[str], mm: float) -> None:
    """Joint 2 turned so that the tip is *mm* away."""
    arm = load_arm(good / "arm.toml")
    q = np.array([[float(cell) for cell in row[Q2 - 1 : Q2 - 1 + arm.n_joints]]])
    constants = arm.nominal()[None]
    by = np.eye(arm.n_joints)[1] * 1e-4
    lever = np.linalg.norm((tip_pose(q + by, constants) - tip_pose(q, constants))[0, :3, 3]) / 1e-4
    row[Q2] = repr(float(row[Q2]) + float(mm / lever))


def worst(verification: Verification) -> dict[str, float]:
    return {figure.key: abs(figure.worst.value_mm) for figure in verification.figures}


@pytest.mark.slow
def test_good_readings_are_not_told(good: Path, tmp_path: Path) -> None:
    verification = verified(good, tmp_path, lambda rows: None)
    assert verification.far_off == () and verification.remarks == ()


@parametrize_default("mm", [0.3, 4.0, 70.0, 350.0])
@pytest.mark.parametrize("where", READINGS)
def test_a_reading_in_the_air_is_named_and_counts(
    good: Path, tmp_path: Path, where: str, mm: float
) -> None:
    target, placement, nth, key = READINGS[where]
    found: list[int] = []

    def edit(rows: Rows) -> None:
        found.append(row_of(rows, target, placement, nth))
        lifted(good, rows[found[0]], mm)

    verification = verified(good, tmp_path, edit)
    (told,) = verification.far_off
    row = found[0] + 1
    assert told.startswith(
        f"verify/readings.csv row {row} (line {row + 1}), {target} in {placement}: "
    )
    off_mm = float(told.partition(": ")[2].partition(" mm off")[0])
    # Of a point on a sphere, what is off the sphere counts; of a turn, the chord.
    assert 0.1 * mm < off_mm < 1.1 * mm
    limits = PermissibleErrors.model_validate(
        {"schema": "armd.mpe/1", "mpe": {f"{key}_mm": 0.03}}  # good readings: below 0.027
    )
    verdict = judge(verification, limits)
    assert not verdict.passed or mm < 1.0  # along a chord, or one of nine, it is little
    assert f"far off, and counted as it was measured: {told}" in verdict.remarks
    assert not any("is arm.toml the drawing" in remark for remark in verdict.remarks)
    assert verdict.as_json()["far_off"] == [told]


def test_of_a_bar_both_ends_are_named(good: Path, tmp_path: Path) -> None:
    found: list[int] = []

    def edit(rows: Rows) -> None:
        found.extend(row_of(rows, f"BARL.{end}", "VOL4", 0) for end in "ab")
        lifted(good, rows[found[0]], 70.0)

    verification = verified(good, tmp_path, edit)
    assert sorted(told.partition(",")[0] for told in verification.far_off) == sorted(
        f"verify/readings.csv row {i + 1} (line {i + 2})" for i in found
    )
    assert worst(verification)["volumetric_max"] > 1.0


def test_several_are_named_beside_each_other(good: Path, tmp_path: Path) -> None:
    found: list[int] = []

    def edit(rows: Rows) -> None:
        for target, placement, nth, _ in READINGS.values():
            found.append(row_of(rows, target, placement, nth))
            lifted(good, rows[found[-1]], 70.0)

    told = verified(good, tmp_path, edit).far_off
    assert sorted(one.partition(" (")[0] for one in told) == sorted(
        f"verify/readings.csv row {i + 1}" for i in found
    )


def test_a_reading_more_than_the_test_wants_is_told(good: Path, tmp_path: Path) -> None:
    """It was taken again, it may be: the first ones count, and whoever looks at it knows."""

    def edit(rows: Rows) -> None:
        rows.append([*rows[row_of(rows, "L3", "E_UNI2", 1)]])
        rows.append([*rows[row_of(rows, "SPHERE1.07", "SPHERE1", 0)]])

    assert set(verified(good, tmp_path, edit).remarks) == {
        "L3 in E_UNI2: 4 readings, the first 3 count",
        "SPHERE1.07: 2 readings, their mean counts",
    }


def test_a_dead_thermometer_of_the_artefact_is_told(good: Path, tmp_path: Path) -> None:
    arm = load_arm(good / "arm.toml")
    session = load_session(good / "verify", arm)
    dead = replace(session, artefact_c=np.zeros(session.n))
    assert figures(dead, arm).remarks == (
        "artefact_c: 0 °C in every row, far from all other temperatures: does it show any?",
    )


def test_certified_lengths_in_another_unit_are_told(good: Path, tmp_path: Path) -> None:
    arm = load_arm(good / "arm.toml")
    session = Path(shutil.copytree(good / "verify", tmp_path / "verify"))
    file = session / "session.toml"
    text = file.read_text()
    file.write_text(
        re.sub(r"length_mm = ([\d.]+)", lambda m: f"length_mm = {float(m[1]) / 1e3}", text)
    )
    verdict = judge(figures(load_session(session, arm), arm), None)
    assert [remark for remark in verdict.remarks if remark.startswith("E_Uni: ")] == [
        "E_Uni: its certified lengths fit the arm if they are taken as metres: length_mm in"
        " session.toml is in mm"
    ]


def test_points_on_a_sphere_are_held_against_what_the_others_say() -> None:
    """Two of 25 are off by 3 and 90 mm, outward and inward."""
    rng = np.random.default_rng(4)
    normals = rng.normal(size=(25, 3))
    normals[:, 2] = np.abs(normals[:, 2])
    radius = np.full(25, 15.0)
    radius[[3, 17]] += [90.0, -3.0]
    points = [400.0, -200.0, 100.0] + radius[:, None] * (
        normals / np.linalg.norm(normals, axis=1, keepdims=True)
    )
    off = measure_distances_from_sphere(points, 15.0)
    assert off[[3, 17]] == pytest.approx([90.0, 3.0], abs=1e-3)
    assert np.delete(off, [3, 17]).max() < 1e-3
