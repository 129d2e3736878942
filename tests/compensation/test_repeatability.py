"""`armd feature repeatability`: scatter and drifts of one place, from tables and from sessions."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armd.compensation.verify.repeatability import fit_repeatability
from armd.daemon.cli import main

NAN = float("nan")
PER_H, PER_K = np.array([2.0, -1.0, 0.0]), np.array([-8.0, 0.0, 3.0])
NOISE_UM = np.array([6.0, 6.0, 12.0])


def visits(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Eight hours of a warm forenoon and a cool evening: mm, h, °C."""
    hours = np.linspace(0.0, 8.0, n)
    celsius = 21.0 + 3.0 * np.sin(hours * 0.6)
    drift = np.outer(hours, PER_H) + np.outer(celsius, PER_K)
    return 1e-3 * (drift + rng.normal(size=(n, 3)) * NOISE_UM) + [400, 0, 100], hours, celsius


def test_intervals_hold_what_is_true() -> None:
    """Of 200 drawn days: 95 % of the intervals hold the scatter, 95 % each drift within 1.96 u."""
    rng = np.random.default_rng(3)
    true = math.sqrt(float((NOISE_UM**2).sum()))
    scatter = drift = 0
    for _ in range(200):
        found = fit_repeatability(*visits(rng, 60))
        assert found.per_h is not None and found.per_k is not None
        scatter += found.interval_um[0] < true < found.interval_um[1]
        for seen, wanted in ((found.per_h, PER_H), (found.per_k, PER_K)):
            drift += int((np.abs(seen.value - wanted) < 1.96 * seen.standard_uncertainty).sum())
    assert scatter >= 0.90 * 200  # binomial: 190 ± 3
    assert 0.93 * 1200 <= drift <= 0.97 * 1200


def test_the_figures_are_those_of_the_normal_equations() -> None:
    position, hours, celsius = visits(np.random.default_rng(8), 25)
    found = fit_repeatability(position, hours, celsius)
    design = np.column_stack([np.ones(25), hours, celsius])
    inverse = np.linalg.inv(design.T @ design)
    solved = inverse @ design.T @ (1e3 * position)
    residual = 1e3 * position - design @ solved
    assert found.repeatability_um == pytest.approx(math.sqrt((residual**2).sum() / 22))
    assert found.per_h is not None and found.per_k is not None
    assert found.per_h.value == pytest.approx(solved[1], abs=1e-6)
    spread = np.sqrt(inverse[2, 2] * (residual**2).sum(axis=0) / 22)
    assert found.per_k.standard_uncertainty == pytest.approx(spread)
    distance = np.linalg.norm(residual, axis=1)
    assert found.rp_um == pytest.approx(distance.mean() + 3 * distance.std(ddof=1))


def test_a_drift_that_is_no_line_is_less_sure() -> None:
    rng = np.random.default_rng(2)
    hours = np.linspace(0.0, 8.0, 80)
    position = np.zeros((80, 3))
    position[:, 0] = 1e-3 * np.cumsum(rng.normal(size=80)) * 5.0  # a random walk
    position += 1e-3 * rng.normal(size=(80, 3))
    found = fit_repeatability(position, hours, np.full(80, NAN))
    assert found.per_k is None
    assert any("correlated" in remark for remark in found.remarks)
    assert any("no temperature" in remark for remark in found.remarks)


def test_time_and_temperature_that_move_together() -> None:
    position, hours, _ = visits(np.random.default_rng(1), 30)
    found = fit_repeatability(position, hours, 20.0 + hours + 1e-3 * np.sin(hours))
    assert any("moved together" in remark for remark in found.remarks)
    found = fit_repeatability(position, hours, 20.0 + hours)
    assert found.per_h is None and found.per_k is None
    with pytest.raises(ArithmeticError, match="5 visits, of 6 at least"):
        fit_repeatability(position[:5], hours[:5], np.array([20, 21, 20, 22, 20.5]))


def feature(path: Path, *options: str) -> tuple[int, dict[str, Any]]:
    out = path.parent / "out.json"
    out.unlink(missing_ok=True)
    code = main(["feature", "repeatability", str(path), "--json", str(out), *options])
    return code, json.loads(out.read_text()) if out.exists() else {}


def test_a_table_of_points(tmp_path: Path) -> None:
    position, hours, _ = visits(np.random.default_rng(5), 40)
    rows = (
        f"{3600 * t:.3f},S1," + ",".join(map(repr, p.tolist()))
        for t, p in zip(hours, position, strict=True)
    )
    path = tmp_path / "visits.csv"
    path.write_text("\n".join(["time_s,target,x_mm,y_mm,z_mm", *rows]) + "\n")
    page = tmp_path / "visits.html"
    code, found = feature(path, "--report", str(page))
    expected = fit_repeatability(position, hours, np.full(40, NAN))
    assert code == 0 and found["n"] == 40
    assert found["repeatability_um"] == pytest.approx(expected.repeatability_um)
    assert expected.per_h is not None
    drift = found["drift_um_per_h"]
    assert drift["value"] == pytest.approx(expected.per_h.value, abs=1e-6)
    assert drift["standard_uncertainty"] == pytest.approx(expected.per_h.standard_uncertainty)
    assert found["drift_um_per_k"] is None
    assert page.read_text().count("<svg") == 1


ARM_TOML = 'schema = "armd.arm/1"\nserial_number = "R"\n[[temperature_sensor]]\nname = "t1"\n' + (
    '[[joint]]\nd_mm = 100.0\nalpha_deg = 90.0\ntemperature = "t1"\n'
    "[[joint]]\na_mm = 300.0\n[[joint]]\na_mm = 200.0\n[tip]\noffset_mm = [50.0, 0.0, 0.0]\n"
)


def planar_tip(q: np.ndarray) -> np.ndarray:
    """(n, 3) of that arm by hand: a column of 100 mm, then 300 and 250 mm in a vertical plane."""
    reach = 300 * np.cos(q[:, 1]) + 250 * np.cos(q[:, 1] + q[:, 2])
    up = 100 + 300 * np.sin(q[:, 1]) + 250 * np.sin(q[:, 1] + q[:, 2])
    return np.column_stack([reach * np.cos(q[:, 0]), reach * np.sin(q[:, 0]), up])


def session(folder: Path, q: np.ndarray, hours: np.ndarray, celsius: np.ndarray) -> Path:
    folder.mkdir()
    (folder.parent / "arm.toml").write_text(ARM_TOML)
    (folder / "session.toml").write_text(
        'schema = "armd.session/1"\narm = "R"\nstarted = 2026-03-01T09:00:00Z\n'
        '[artefact]\nname = "seat"\n[[artefact.target]]\nname = "seat"\n'
    )
    rows = np.column_stack([3600 * hours, q, celsius])
    lines = [",".join(map(repr, row)).replace(",", ",1,seat,", 1) for row in rows.tolist()]
    text = "\n".join(["time_s,placement,target,q1,q2,q3,t1", *lines])
    (folder / "readings.csv").write_text(text + "\n")
    return folder


def test_a_session_with_temperatures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Joint angles that drift with time and temperature; the tip by hand."""
    rng = np.random.default_rng(4)
    _, hours, celsius = visits(rng, 50)
    q = np.array([0.3, 0.4, -0.9]) + rng.normal(size=(50, 3)) * 1e-5
    q[:, 0] += 1e-6 * hours
    q[:, 1] += 2e-6 * celsius
    folder = session(tmp_path / "visits", q, hours, celsius)
    code, found = feature(folder, "--arm", str(tmp_path / "arm.toml"))
    expected = fit_repeatability(planar_tip(q), hours, celsius)
    assert code == 0 and found["sensors"] == ["t1"]
    assert found["repeatability_um"] == pytest.approx(expected.repeatability_um, rel=1e-6)
    assert expected.per_k is not None
    assert found["drift_um_per_k"]["value"] == pytest.approx(expected.per_k.value, abs=1e-6)
    assert "drift x" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ([], "--arm: found nothing"),
        (["--arm", "arm.toml", "--inside"], "--inside: found it with repeatability"),
    ],
)
def test_what_is_refused(
    options: list[str],
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    folder = session(tmp_path / "v", np.zeros((9, 3)), np.arange(9.0), np.full(9, 20.0))
    assert feature(folder, *options) == (2, {})
    assert said in capsys.readouterr().err


def test_two_seats_are_no_visits_of_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "t.csv"
    path.write_text("target,x,y,z\nS1,1,2,3\nS2,1,2,4\n")
    assert feature(path) == (2, {})
    assert "S1 in 1, S2 in 1" in capsys.readouterr().err
