"""Interim checks on a sphere, a plate and a gauge block: tables of points touched anywhere."""

from __future__ import annotations

import datetime
from pathlib import Path

import numpy as np
import pytest
from test_points_over_time import FIRST, add, result_of, write_table

from armd.arrays import F64
from armd.compensation.data.foreign.points import read_points
from armd.compensation.interim.points.figures import compute_figures
from armd.compensation.interim.points.surface_figures import (
    compute_sphere_figures,
    compute_surface_figures,
)
from armd.daemon.files.session_folder import load_artefact

ARTEFACT = """[artefact]
name = "corner"
[[artefact.surface]]
name = "ball"
kind = "sphere"
radius_mm = 12.7
[[artefact.surface]]
name = "foot"
kind = "plane"
[[artefact.surface]]
name = "head"
kind = "plane"
[[artefact.distance]]
between = ["foot", "head"]
length_mm = 25.0
"""
TIP_MM, NOISE_MM = 3.0, 0.01


def table(path: Path, rng: np.random.Generator, week: int, worn_mm: float = 0.0) -> Path:
    """Twenty points on the ball and ten on each face, by a tip that is *worn_mm* smaller."""
    way = rng.normal(size=(20, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    radius_mm = TIP_MM - worn_mm
    points: list[tuple[str, F64]] = [("ball", (12.7 + radius_mm) * one) for one in way]
    for name, height in (("foot", 100.0 - radius_mm), ("head", 125.0 + radius_mm)):
        points += [(name, np.array([*rng.uniform(0.0, 40.0, 2), height])) for _ in range(10)]
    noisy = ((name, at + NOISE_MM * rng.normal(size=3)) for name, at in points)
    return write_table(path, week, noisy)


def artefact_file(folder: Path) -> Path:
    path = folder / "corner.toml"
    path.write_text(ARTEFACT, encoding="utf-8")
    return path


def test_the_figures_are_size_form_and_length(tmp_path: Path) -> None:
    path = table(tmp_path / "t.csv", np.random.default_rng(1), 0, worn_mm=0.05)
    artefact = load_artefact(artefact_file(tmp_path), [])
    found = {f.name: f for f in compute_figures(path, read_points(path), artefact, TIP_MM)}
    assert list(found) == ["size ball", "form ball", "form foot", "form head",
                           "length foot to head"]  # fmt: skip
    for name in ("size ball", "length foot to head"):  # twice the wear
        assert abs(found[name].value_mm + 0.1) < 3 * found[name].own_mm < 0.03
    assert found["length foot to head"].longest_mm == 25.0
    for name, freedom in (("form ball", 16), ("form foot", 7), ("form head", 7)):
        assert found[name].freedom == freedom
        assert 0.4 * NOISE_MM < found[name].value_mm < 1.8 * NOISE_MM


def test_too_few_points_on_a_surface_have_no_figure(tmp_path: Path) -> None:
    artefact = load_artefact(artefact_file(tmp_path), [])
    rng = np.random.default_rng(4)
    flat = np.column_stack([rng.uniform(0.0, 40.0, (4, 2)), np.zeros(4)])
    assert list(compute_surface_figures(artefact, {("1", "foot"): flat}, TIP_MM)) == []
    assert list(compute_sphere_figures("ball", rng.normal(size=(5, 3)), 25.4, TIP_MM)) == []
    assert list(compute_sphere_figures("ball", np.vstack([flat, flat]), 25.4, TIP_MM)) == []


def test_a_worn_tip_is_seen_when_it_wore(tmp_path: Path) -> None:
    artefact, rng = artefact_file(tmp_path), np.random.default_rng(2)
    tables = [
        table(tmp_path / f"w{week:02}.csv", rng, week, worn_mm=0.05 * (week >= 6))
        for week in range(10)
    ]
    tip = ("--tip-radius-mm", str(TIP_MM))
    assert add(tables[:6], artefact, *tip) == 0
    assert add(tables[6:], artefact, *tip) == 1
    (change,) = result_of(artefact)["changes"]
    low, high = map(datetime.datetime.fromisoformat, change["between"])
    assert low < FIRST + datetime.timedelta(weeks=5.9) < high
    moved = {figure["name"]: figure for figure in change["figures"]}
    for name in ("size ball", "length foot to head"):
        assert moved[name]["significant"]
        assert moved[name]["change_um"] == pytest.approx(-100.0, abs=25.0)
    assert not moved["form ball"]["significant"]
