"""`armd verify` of spheres and gauge blocks touched anywhere: size, form and length."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armd.compensation.verify.touched import fit_parallel_planes
from armd.daemon.cli import main
from armd.simulator.truth import nominal
from support.touched_surfaces import Workshop, distance, plane, sphere

#: What session.toml certifies: the sphere's radius, true; and the block, which is 0.2 mm shorter.
RADIUS_MM, BLOCK_MM, TRUE_MM = 40.0, 50.2, 50.0


def written(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))["figures"]


def values(figure: dict[str, Any]) -> list[float]:
    return [one["value_mm"] for one in figure["deviations"]]


@pytest.mark.slow
def test_a_sphere_and_a_block_are_measured_by_the_true_arm(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    workshop = Workshop(4, reach_size=3000)
    ball = sphere("ball", RADIUS_MM, (RADIUS_MM, 0.0005))
    faces = [plane("foot", 0.0, -1.0, 60.0), plane("head", TRUE_MM, 1.0, 60.0)]
    lengths = [distance("foot", "head", BLOCK_MM, 0.001)]
    workshop.session(Path("S"), [ball, *faces], 2, 26, lengths, 1.2)
    true = nominal.make_arm_toml(rows=workshop.arm.rows, tip=workshop.arm.tip_offset)
    Path("arm.toml").write_text(true, encoding="utf-8")
    Path("mpe.toml").write_text(
        'schema = "armd.mpe/1"\n[mpe]\np_size_mm = 0.05\np_form_mm = 0.2\nblock_length_mm = 0.05\n',
        encoding="utf-8",
    )
    words = ["verify", "S", "--arm", "arm.toml", "--mpe", "mpe.toml"]
    assert main([*words, "--json", "out.json", "--report", "out.html"]) == 1
    figures = written(Path("out.json"))
    assert sorted(figures) == ["block_length", "p_form", "p_size"]
    # A ball that sits to 5 µm, and encoders of 2″ at up to a metre.
    assert len(values(figures["p_size"])) == 2
    assert np.abs(values(figures["p_size"])).max() < 0.02
    assert figures["p_size"]["expanded_uncertainty_mm"] >= 0.002
    assert 0.02 < min(values(figures["p_form"])) <= max(values(figures["p_form"])) < 0.12
    assert values(figures["block_length"]) == pytest.approx([TRUE_MM - BLOCK_MM] * 2, abs=0.01)
    said = capsys.readouterr().out
    assert "verdict: FAILED: Block length: does not conform" in said
    assert "2 of 10 figures, partial test, and gauge blocks" in Path("out.html").read_text("utf-8")


def test_a_closed_arms_points_on_a_sphere_and_a_block(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A ball of 3 mm about a sphere of 12.7 mm that is 4 µm too large, and a block of 25 mm."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    out = rng.normal(size=(30, 3))
    out /= np.linalg.norm(out, axis=1, keepdims=True)
    table = [("ball", *(12.704 + 3.0) * x + [100.0, 50.0, 20.0]) for x in out]
    for name, height in (("foot", -3.0), ("head", 28.0)):
        table += [(name, *rng.uniform(0.0, 40.0, 2), height) for _ in range(6)]
    with Path("points.csv").open("w", encoding="utf-8", newline="") as file:
        csv.writer(file).writerows([("target", "x_mm", "y_mm", "z_mm"), *table])
    Path("artefact.toml").write_text(
        'schema = "armd.artefact/1"\n[artefact]\nname = "corner"\n'
        '[[artefact.surface]]\nname = "ball"\nkind = "sphere"\nradius_mm = 12.7\n'
        '[[artefact.surface]]\nname = "foot"\nkind = "plane"\n'
        '[[artefact.surface]]\nname = "head"\nkind = "plane"\n'
        '[[artefact.distance]]\nbetween = ["foot", "head"]\nlength_mm = 25.0\n',
        encoding="utf-8",
    )
    words = ["verify", "points.csv", "--artefact", "artefact.toml", "--tip-radius-mm", "3"]
    assert main([*words, "--json", "out.json"]) == 0
    figures = written(Path("out.json"))
    assert values(figures["p_size"]) == pytest.approx([0.008], abs=1e-9)
    assert values(figures["p_form"]) == pytest.approx([0.0], abs=1e-9)
    assert values(figures["block_length"]) == pytest.approx([0.0], abs=1e-9)
    said = " ".join(capsys.readouterr().out.split())
    assert "ball: one position; ISO 10360-12 wants two" in said
    assert "all 30 points count, of 25 wanted" in said


def test_a_plate_touched_at_one_spot_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    spots = [plane("foot", 0.0, -1.0, 0.2), plane("head", TRUE_MM, 1.0, 0.2)]
    lengths = [distance("foot", "head", TRUE_MM, 0.001)]
    Workshop(2, reach_size=3000).session(Path("S"), spots, 1, 8, lengths, 1.2)
    Path("arm.toml").write_text(nominal.make_arm_toml(), encoding="utf-8")
    assert main(["verify", "S", "--arm", "arm.toml", "--json", "out.json"]) == 2
    assert "surface foot and head, placement P1: found a plane touched" in capsys.readouterr().err
    assert not Path("out.json").exists()


def test_faces_that_tell_no_plane_have_no_distance() -> None:
    rng = np.random.default_rng(2)
    wide = np.column_stack([rng.uniform(0.0, 30.0, (5, 2)), np.zeros(5)])
    line = np.column_stack([np.linspace(0.0, 30.0, 5), np.zeros((5, 2))])
    up = [0.0, 0.0, 10.0]
    found = fit_parallel_planes([wide, wide + up])
    assert found is not None
    assert found.distance_mm == pytest.approx(10.0) and found.freedom == 6
    assert fit_parallel_planes([line, line + up]) is None
    assert fit_parallel_planes([wide, wide[:0]]) is None
    assert fit_parallel_planes([wide[:2], wide[:1] + up]) is None


def test_how_far_planes_are_apart_scatters_as_stated() -> None:
    rng = np.random.default_rng(3)
    errors, stated = [], []
    for _ in range(200):
        faces = [
            np.column_stack([rng.uniform(0.0, 60.0, (12, 2)), rng.normal(height, 0.01, 12)])
            for height in (0.0, 50.0)
        ]
        found = fit_parallel_planes(faces)
        assert found is not None
        errors.append(found.distance_mm - 50.0)
        stated.append(found.apart_uncertainty_mm)
    # The common tilt adds a little where the faces' middles are not above each other.
    assert np.std(errors) == pytest.approx(np.mean(stated), rel=0.25)
