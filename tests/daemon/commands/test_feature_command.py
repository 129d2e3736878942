"""`armd feature` on measurements as published and as exported."""

import json

import numpy as np
import pytest

from armd.daemon.cli import main


def line(number, position_mm, **changes):
    return {
        "seq": number,
        "stamp_ns": 1_800_000_000 * 10**9 + number * 10**9,
        "position_mm": position_mm,
        "covariance_mm2": [1e-6, 0.0, 0.0, 4e-6, 0.0, 9e-6],
        "flags": 512,
        "temperatures_c": {},
    } | changes


@pytest.fixture
def measured(tmp_path):
    """Five points of the plane z = 2, then eight on a sphere of 10 mm (tip's centre) at z = 52."""
    corners = [(0, 0, 2), (100, 0, 2), (0, 100, 2), (100, 100, 2), (50, 50, 2)]
    rng = np.random.default_rng(1)
    normals = rng.normal(size=(8, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    ball = (np.array([30.0, 40.0, 52.0]) + 10.0 * normals).tolist()
    path = tmp_path / "measured.jsonl"
    points = [*map(list, corners), *ball]
    path.write_text("".join(json.dumps(line(i, p)) + "\n" for i, p in enumerate(points)))
    return path


def test_a_distance_with_its_uncertainty(measured, tmp_path, capsys):
    out = tmp_path / "distance.json"
    command = ["feature", "distance", f"plane={measured}:1-5", f"sphere={measured}:6-13"]
    assert main([*command, "--json", str(out)]) == 0
    assert "distance 50.0000 mm, U (k = 2) 0." in capsys.readouterr().out
    result = json.loads(out.read_text())
    assert result["value_mm"] == pytest.approx(50.0, abs=1e-6)
    assert [feature["shape"] for feature in result["features"]] == ["plane", "sphere"]
    assert result["features"][0]["uncertainty_from"] == "points"
    # The plane's height at the ball, from five points of 3 µm each, is at least 3/√5 µm uncertain.
    assert 0.0013 < result["standard_uncertainty_mm"] < 0.01


def test_a_table_of_armd_export_says_the_same(measured, tmp_path, capsys):
    table = tmp_path / "measured.csv"
    assert main(["export", str(measured), "-o", str(table)]) == 0
    told = []
    for path in (measured, table):
        out = tmp_path / f"{path.suffix[1:]}.json"
        options = ["--tip-radius-mm", "3", "--json", str(out)]
        assert main(["feature", "sphere", f"{path}:6-13", *options]) == 0
        told.append(json.loads(out.read_text()))
    assert told[0]["surface_radius_mm"] == pytest.approx(7.0, abs=1e-6)
    np.testing.assert_allclose(
        told[0]["features"][0]["point_standard_uncertainty_mm"],
        told[1]["features"][0]["point_standard_uncertainty_mm"],
        rtol=1e-6,
    )
    assert "surface    radius 7.0000 mm" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["plane", "{}:1-2"], "plane: found 2 points, expected at least 3"),
        (["plane", "{}:1-99"], "rows 1-99: found 13 measurements, expected rows of 1 to 13"),
        (["distance", "plane={}:1-5"], "armd feature distance: found 1 operands, expected 2"),
        (["distance", "{}", "{}"], "expected KIND=FILE[:ROWS]"),
        (["angle", "plane={}:1-5", "sphere={}:6-13"], "found a sphere has no direction"),
        (["plane", "{}:1-5", "--tip-radius-mm", "3"], "--tip-radius-mm: found it with plane"),
        (["sphere", "{}:6-13", "--inside"], "--inside: found no --tip-radius-mm"),
        (["sphere", "{}:6-13", "--tip-radius-mm", "30"], "less than the tip's 30 mm"),
    ],
)
def test_bad_usage(measured, arguments, words, capsys):
    assert main(["feature", *(word.format(measured) for word in arguments)]) == 2
    assert words in capsys.readouterr().err


def test_a_measurement_without_a_position_is_told(measured, capsys):
    with measured.open("a") as file:
        file.write(json.dumps(line(50, None)) + "\n")
    assert main(["feature", "sphere", f"{measured}:6-14"]) == 2
    assert "measurement 9 of those chosen: found no position" in capsys.readouterr().err
