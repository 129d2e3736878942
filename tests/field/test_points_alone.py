"""Tables of points alone, as a FARO or Hexagon arm's host writes them: no joint angles, no arm.

The figures of `xyz-only` are its README's, by numpy; what FARO's own routine reports is half of the
range per axis.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from armd.daemon.cli import main

SPAT = Path(__file__).parent / "xyz-only" / "spat.csv"


def test_articulation_of_one_seat(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "v.json"
    assert main(["verify", str(SPAT), "--json", str(out)]) == 0
    figures = json.loads(out.read_text())["figures"]
    assert figures["spat_max"]["value_mm"] == pytest.approx(0.0178, abs=5e-5)
    points = np.loadtxt(SPAT, delimiter=";", skiprows=1, usecols=(1, 2, 3),
                        converters=lambda cell: float(cell.replace(",", ".")))  # fmt: skip
    apart = np.linalg.norm(points - points.mean(axis=0), axis=1)
    assert figures["spat_2s"]["value_mm"] == pytest.approx(2 * np.sqrt((apart**2).sum() / 9))
    said = capsys.readouterr().out
    assert "SPAT1: half of the range in x, y, z: 14.0, 10.5, 11.0 µm" in said
    assert "0 of 10 articulations in SPAT2: ASME B89.4.22 wants three seats" in said


def test_the_report_names_the_table_by_its_contents(tmp_path: Path) -> None:
    report = tmp_path / "v.html"
    assert main(["verify", str(SPAT), "--report", str(report)]) == 0
    assert hashlib.sha256(SPAT.read_bytes()).hexdigest() in report.read_text()


def test_one_seat_passes_no_verification(tmp_path: Path) -> None:
    """With limits the standard's three seats must be there."""
    (tmp_path / "mpe.toml").write_text("[mpe]\nspat_max_mm = 1.0\n")
    assert main(["verify", str(SPAT), "--mpe", str(tmp_path / "mpe.toml")]) != 0


def test_three_seats_are_judged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    head, *rows = SPAT.read_text().splitlines()
    three = [row.replace("SPAT1", f"SPAT{k}") for k in (1, 2, 3) for row in rows]
    (tmp_path / "t.csv").write_text("\n".join([head, *three]) + "\n")
    for limit, code in ((0.0179, 0), (0.0178, 1)):
        (tmp_path / "mpe.toml").write_text(f"[mpe]\nspat_max_mm = {limit}\n")
        words = [str(tmp_path / "t.csv"), "--mpe", str(tmp_path / "mpe.toml")]
        assert main(["verify", *words, "--decision", "simple"]) == code
    assert "PASSED" in capsys.readouterr().out


def test_a_sphere_without_a_certificate_has_its_form(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A ball whose pole is 0.02 mm too high, at two positions: the fit takes a part of it."""
    lines, forms = ["target,x_mm,y_mm,z_mm"], []
    rng = np.random.default_rng(4)
    for position in (1, 2):
        way = rng.normal(size=(25, 3))
        way /= np.linalg.norm(way, axis=1)[:, None]
        radius = 12.7 + 0.02 * (way[:, 2] > 0.8)
        points = way * radius[:, None] + [300.0 * position, 40.0, 90.0]
        lines += [
            f"SPHERE{position}.{k:02d}," + ",".join(map(repr, point.tolist()))
            for k, point in enumerate(points, 1)
        ]
        a = np.column_stack([2 * points, np.ones(25)])  # the algebraic sphere, for a bound
        centre = np.linalg.lstsq(a, (points**2).sum(axis=1), rcond=None)[0][:3]
        forms.append(np.ptp(np.linalg.norm(points - centre, axis=1)))
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    out = tmp_path / "v.json"
    assert main(["verify", str(tmp_path / "t.csv"), "--json", str(out)]) == 0
    figures = json.loads(out.read_text())["figures"]
    assert figures["p_form"]["value_mm"] == pytest.approx(max(forms), abs=1e-4)
    assert "p_size" not in figures
    assert "p_size: left out: no certified length between SPHERE" in capsys.readouterr().out


def test_a_sphere_and_certified_lengths(tmp_path: Path) -> None:
    """A ball of 25 mm probed with a tip of 3 mm: points of the tip's centre are 15.5 mm off."""
    rng = np.random.default_rng(1)
    lines = ["target,x [in],y [in],z [in]"]
    for repeat in (1, 2, 3):
        for k in range(1, 10):
            way = rng.normal(size=3)
            way[2] = abs(way[2])
            point = (np.array([300.0, 50.0, 100.0]) + 15.5 * way / np.linalg.norm(way)) / 25.4
            lines.append(f"EFFDIA.{repeat}.{k}," + ",".join(map(repr, point.tolist())))
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    (tmp_path / "ball.toml").write_text(
        "[artefact]\nname = 'ball'\n[[artefact.distance]]\n"
        "between = ['SPHERE.a', 'SPHERE.b']\nlength_mm = 25.0\n"
    )
    out = tmp_path / "v.json"
    words = ["--artefact", str(tmp_path / "ball.toml"), "--tip-radius-mm", "3"]
    assert main(["verify", str(tmp_path / "t.csv"), *words, "--json", str(out)]) == 0
    diameter = json.loads(out.read_text())["figures"]["effective_diameter"]
    assert diameter["value_mm"] == pytest.approx(0.0, abs=1e-9)


def test_a_feature_of_points_alone(tmp_path: Path) -> None:
    (tmp_path / "p.csv").write_text(
        "x_mm,y_mm,z_mm,target\n" + "".join(
            f"{10 + 5 * x},{20 + 5 * y},{30 + 5 * z},S\n"
            for x, y, z in [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
        )
    )  # fmt: skip
    out = tmp_path / "f.json"
    assert main(["feature", "sphere", str(tmp_path / "p.csv"), "--json", str(out)]) == 0
    (feature,) = json.loads(out.read_text())["features"]
    assert feature["point_mm"] == pytest.approx([10, 20, 30])
    assert feature["radius_mm"] == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("target,x,y\nSPAT1,1,2\n", "z_mm: found no such column among target, x, y"),
        ("target,x,y,z\nSPAT1,1,2,soon\n", "found 'soon', expected a number"),
        ("target,x,y,z\nSPAT9,1,2,3\n", "row 1, target: found 'SPAT9', expected a name of docs"),
        ("target,x [ft],y,z\nSPAT1,1,2,3\n", "the unit 'ft', expected one of mm"),
    ],
)
def test_what_is_no_table_of_points(
    text: str, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "t.csv").write_text(text)
    assert main(["verify", str(tmp_path / "t.csv")]) == 2
    assert said in capsys.readouterr().err


def test_a_session_still_needs_its_arm(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", str(tmp_path)]) == 2
    assert "--arm: found nothing" in capsys.readouterr().err
