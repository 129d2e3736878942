"""Interim checks of an arm whose joints nobody reads: from simulated points to what is reported."""

from __future__ import annotations

import datetime
import json
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import integrate, stats

from armd.arrays import F64
from armd.compensation.interim.points.evidence import (
    LIMIT,
    OWN_SCATTER_CHECKS,
    OWN_SCATTER_FACTOR,
    ChangeCourse,
    Series,
    compute_log_ratios,
    fit_change_size,
)
from armd.compensation.interim.points.find import find_changes
from armd.daemon.cli import main

ARTEFACT = """[artefact]
name = "bar"
[[artefact.distance]]
between = ["A", "B"]
length_mm = 500.0
[[artefact.distance]]
between = ["A", "C"]
length_mm = 1000.0
[[artefact.distance]]
between = ["SPHERE.a", "SPHERE.b"]
length_mm = 25.0
"""
NOISE_MM, DAY_MM = 0.010, 0.004
FIRST = datetime.datetime(2026, 3, 1, 9, tzinfo=datetime.UTC)


def write_table(path: Path, week: int, rows: Iterable[tuple[str, F64]]) -> Path:
    """Points by name, ten seconds apart, measured so many weeks after `FIRST`."""
    begun = FIRST + datetime.timedelta(weeks=week)
    lines = ["date,target,X [mm],Y [mm],Z [mm]"]
    for i, (name, at) in enumerate(rows):
        instant = begun + datetime.timedelta(seconds=10 * i)
        lines.append(f"{instant:%Y-%m-%d %H:%M:%S},{name}," + ",".join(f"{x:.4f}" for x in at))
    path.write_text("\n".join(lines) + "\n")
    return path


def table(
    path: Path, rng: np.random.Generator, week: int, *, scale: float = 1.0, dirt_mm: float = 0.0
) -> Path:
    """Five rounds over a bar's three balls, and twelve points on a sphere of 25 mm."""
    ends = np.array([[0.0, 0, 0], [500.0, 0, 0], [1000.0, 0, 0]])
    ends += rng.normal(size=(3, 3)) * DAY_MM + [[0, 0, 0], [dirt_mm, 0, 0], [0, 0, 0]]
    way = rng.normal(size=(12, 3))
    way /= np.linalg.norm(way, axis=1)[:, None]
    rows = [
        (name, scale * end + rng.normal(size=3) * NOISE_MM + [300, -200, 50])
        for _ in range(5)
        for name, end in zip("ABC", ends, strict=True)
    ]
    sphere = scale * (12.5 * way) + rng.normal(size=(12, 3)) * NOISE_MM + [400, 100, 0]
    rows += [(f"SPHERE1.{i:02d}", at) for i, at in enumerate(sphere, 1)]
    return write_table(path, week, rows)


@pytest.fixture
def artefact(tmp_path: Path) -> Path:
    path = tmp_path / "bar.toml"
    path.write_text(ARTEFACT)
    return path


def add(tables: Sequence[Path], artefact: Path, *options: str) -> int:
    history = str(artefact.parent / "checks")
    words = [*map(str, tables), "--artefact", str(artefact), "--history", history, *options]
    return main(["interim", "add", *words, "-q"])


def result_of(artefact: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((artefact.parent / "checks" / "report.json").read_text())
    return found


def test_a_scale_that_changed_and_a_dirty_seat(
    tmp_path: Path, artefact: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """After ten weeks the arm is 60 µm/m too long; in the fifth a seat was dirty."""
    rng = np.random.default_rng(7)
    tables = [
        table(tmp_path / f"w{week:02}.csv", rng, week, scale=1 + 60e-6 * (week >= 10),
              dirt_mm=0.3 * (week == 4))
        for week in range(15)
    ]  # fmt: skip
    assert add(tables[:10], artefact) == 0
    assert result_of(artefact)["state"] == "in_control"
    assert add(tables[10:], artefact) == 1
    page = tmp_path / "checks.html"
    words = ["--history", str(tmp_path / "checks"), "--report", str(page)]
    capsys.readouterr()
    assert main(["interim", "report", *words, "--json"]) == 1
    found = json.loads(capsys.readouterr().out)
    assert found == result_of(artefact)
    assert found["schema"] == "armd.interim/1"
    verdicts = [check["verdict"] for check in found["checks"]]
    good = ["in_control"] * 5
    assert verdicts == [*good[:4], "bad_check", *good, *["changed"] * 5]
    (change,) = found["changes"]
    assert (change["cause"], change["location"], change["gradual"]) == ("unknown", "-", False)
    low, high = map(datetime.datetime.fromisoformat, change["between"])
    assert low < FIRST + datetime.timedelta(weeks=9.9) < high
    assert high - low < datetime.timedelta(weeks=2)
    moved = {figure["name"]: figure for figure in change["figures"]}
    for name, true_um in (("length A to B", 30.0), ("length A to C", 60.0), ("size SPHERE1", 1.5)):
        deviation_um = moved[name]["standard_uncertainty_um"]
        assert abs(moved[name]["change_um"] - true_um) < 3 * deviation_um < 18.0
    assert moved["length A to C"]["significant"] and not moved["form SPHERE1"]["significant"]
    text = page.read_text()
    assert "CHANGED" in text and text.count("<svg") == 1 + len(found["checks"][0]["figures_um"])


def test_the_figures_are_those_of_the_points(tmp_path: Path, artefact: Path) -> None:
    """Two placements of a bar, the second 20 µm long; a seat; lengths by hand."""
    lines = ["placement,target,x,y,z"]
    for placement, end in (("P1", 500.010), ("P2", 500.030)):
        lines += [f"{placement},A,10,20,30", f"{placement},B,{10 + end},20,30"]
    lines += [f"P1,C,{x},0,0" for x in (0.0, 0.02, -0.02, 0.0)]
    path = tmp_path / "t.csv"
    path.write_text("\n".join(lines) + "\n")
    targets = "".join(f"[[artefact.target]]\nname = '{name}'\n" for name in "ABC")
    length = "[[artefact.distance]]\nbetween = ['A', 'B']\nlength_mm = 500.0\n"
    artefact.write_text(f"[artefact]\nname = 'bar'\n{length}{targets}")
    assert add([path], artefact, "--started", "2026-03-01T09:00:00Z") == 0
    (check,) = result_of(artefact)["checks"]
    assert check["started"] == "2026-03-01T09:00:00Z"
    # 3-D deviations 0, 20, 20 and 0 µm of four readings: √(800/3)
    expected = {"length A to B": 20.0, "spread C": math.sqrt(800 / 3)}
    assert check["figures_um"] == pytest.approx(expected, abs=1e-6)


def test_the_order_of_adding_does_not_matter(tmp_path: Path, artefact: Path) -> None:
    rng = np.random.default_rng(1)
    tables = [table(tmp_path / f"w{week}.csv", rng, week) for week in range(4)]
    add(tables, artefact)
    at_once = result_of(artefact)
    other = tmp_path / "other" / "bar.toml"
    other.parent.mkdir()
    other.write_text(ARTEFACT)
    for week in (2, 0, 3, 1):
        assert add([tables[week]], other) == 0
    assert result_of(other) == at_once


def test_the_ratio_is_the_integral() -> None:
    """By brute force over level, size and noise, of a step in five checks of one figure."""
    y, own, g = np.array([1.0, -0.5, 0.2, 4.0, 5.5]), 0.8, 3.0
    series = Series(y[:, None], np.array([own]), np.zeros(1), 86400.0 * np.arange(5))
    step = ChangeCourse(3, gradual=False).shape(series.instant_s)
    rows = np.ones(5, bool)
    expected = compute_log_ratios(series, rows, [], step[:, None], [g])[0]
    scale = OWN_SCATTER_FACTOR * own
    sums = np.ones((5, 5)) / 5

    def likelihood(sigma: float, covariance: np.ndarray) -> float:
        """Of y without its level, which has a flat prior, times the prior of σ."""
        clear = np.linalg.eigh(np.eye(5) - sums)[1][:, 1:]
        seen = clear.T @ y
        within = clear.T @ covariance @ clear
        prior = stats.invgamma(OWN_SCATTER_CHECKS / 2, scale=OWN_SCATTER_CHECKS * scale**2 / 2)
        density = stats.multivariate_normal(np.zeros(4), sigma**2 * within).pdf(seen)
        return float(density * prior.pdf(sigma**2) * 2 * sigma)

    with_step = integrate.quad(
        lambda s: likelihood(s, np.eye(5) + g**2 * np.outer(step, step)), 1e-3, 60, limit=300
    )[0]
    without = integrate.quad(lambda s: likelihood(s, np.eye(5)), 1e-3, 60, limit=300)[0]
    assert expected == pytest.approx(math.log(with_step / without), abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("between_checks", [0.0, 1.0, 3.0])
def test_false_alarms_are_as_rare_as_promised(between_checks: float) -> None:
    """40 histories of 40 checks with 4 figures: at one in 500 checks, 3.2 would be expected, and 9
    or more have a probability of 0.6 %."""
    rng = np.random.default_rng(11)
    alarms = 0
    for _ in range(40):
        value = rng.normal(size=(40, 4)) * math.hypot(1.0, between_checks)
        instants = 7 * 86400.0 * np.arange(40)
        found = find_changes(Series(value, np.ones(4), np.full(4, 1e-3), instants))
        alarms += len(found.changes) + len(found.bad)
    assert alarms < 9


def test_a_figure_that_grows() -> None:
    rng = np.random.default_rng(4)
    weeks = np.arange(24)
    value = rng.normal(size=(24, 3))
    value[:, 1] += 1.5 * np.maximum(weeks - 9, 0)
    found = find_changes(
        Series(value, np.ones(3), np.full(3, 1e-3), 7 * 86400.0 * weeks.astype(float))
    )
    first = found.changes[0]
    assert first.course.gradual and first.earliest <= 10 <= first.latest
    assert found.statistic[9] < LIMIT


@pytest.mark.slow
def test_intervals_hold_the_change() -> None:
    """Of 120 drawn changes of three figures, 95 % intervals hold 342 of 360 (± 4.1, one σ)."""
    rng = np.random.default_rng(0)
    inside = total = 0
    for _ in range(120):
        true = np.array([30.0, 60.0, 1.5])
        value = rng.normal(size=(15, 3)) * 8.5
        value[10:] += true
        instants = 7 * 86400.0 * np.arange(15.0)
        made = fit_change_size(
            Series(value, np.full(3, 6.0), np.full(3, 0.1), instants),
            np.ones(15, bool), [], ChangeCourse(10, gradual=False),
        )  # fmt: skip
        half = stats.t.ppf(0.975, made.freedom) * made.deviation
        inside += int((np.abs(made.value - true) < half).sum())
        total += 3
    assert 325 <= inside <= total


@pytest.mark.parametrize(
    ("change", "options", "said"),
    [
        ({}, ["--arm", "arm.toml"], "--arm: found it with a table"),
        ({"target": "D"}, [], "found 'D', expected a target of the artefact"),
        ({"B": 19.7}, [], "length A to B: found -480.3"),
        ({"first": "2999-01-01"}, [], "started: found readings until 2999"),
        ({}, ["--tip-radius-mm", "-1"], "--tip-radius-mm: found -1, expected 0 to 1000"),
    ],
)
def test_what_is_no_check(
    change: dict[str, Any],
    options: list[str],
    said: str,
    tmp_path: Path,
    artefact: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    first, name = change.get("first", "2026-03-01"), change.get("target", "B")
    path = tmp_path / "t.csv"
    rows = [f"{first} 09:00,A,0,0,0", f"{first} 09:01,{name},{change.get('B', 500.0)},0,0"]
    path.write_text("\n".join(["date,target,x,y,z", *rows]) + "\n")
    assert add([path], artefact, *options) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "checks" / "history.jsonl").exists()


def test_what_was_added_stays_and_comes_once(
    tmp_path: Path, artefact: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(5)
    one, two = (table(tmp_path / f"w{week}.csv", rng, week) for week in range(2))
    assert add([one], artefact) == 0
    assert add([one], artefact) == 2
    assert "expected a check of its own" in capsys.readouterr().err
    session = tmp_path / "session"
    session.mkdir()
    assert add([two, session], artefact) == 2
    assert "beside tables" in capsys.readouterr().err
    (kept,) = (tmp_path / "checks" / "checks").glob("*/points.csv")
    kept.write_text(kept.read_text().replace("SPHERE1.01", "SPHERE1.13"))
    assert add([two], artefact) == 2
    assert "edited or damaged" in capsys.readouterr().err
    assert len((tmp_path / "checks" / "history.jsonl").read_text().splitlines()) == 1


def test_two_files_of_one_instant(
    tmp_path: Path, artefact: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Tables without dates are of their files' last change, which a copy may share."""
    rows = "target,x,y,z\nA,0,0,0\nB,500,0,0\n"
    for name in ("one", "two"):
        (tmp_path / f"{name}.csv").write_text(rows)
        os.utime(tmp_path / f"{name}.csv", (1_772_000_000, 1_772_000_000))
    assert add([tmp_path / "one.csv"], artefact) == 0
    assert add([tmp_path / "two.csv"], artefact) == 2
    assert "last change: a column of dates, or --started" in capsys.readouterr().err
    assert add([tmp_path / "two.csv"], artefact, "--started", "2026-03-02T00:00:00Z") == 0


def test_a_table_without_its_artefact(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = table(tmp_path / "t.csv", np.random.default_rng(0), 0)
    assert main(["interim", "add", str(path), "--history", str(tmp_path / "checks")]) == 2
    assert "--artefact: found nothing" in capsys.readouterr().err
