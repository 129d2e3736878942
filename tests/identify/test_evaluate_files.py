"""Sessions evaluated in pieces: the same figures as with everything in memory."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session, load_sessions
from armd.compensation.data.tables import pieces
from armd.compensation.identify.evaluation import evaluate_files as streamed
from armd.compensation.identify.evaluation.condensed import compute_moments
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.identify.evaluation.tally import ErrorTally
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.errors import BadInput
from support.drawn import drawn
from support.measured_arm import write_folder
from support.selection import parametrize_default
from support.synthetic import arm as synthetic_arm
from support.synthetic import disturbed, session

LAGGED = {"kind": "temperature", "weights": {"t2": 1.0}, "lag_s": 300.0}


def calibration(arm: Arm) -> Calibration:
    # Of the second term, a missing temperature leaves two coordinates of the tip known.
    lagged = {"basis": [LAGGED], "coefficient": 0.01}
    terms = [lagged | {"parameter": parameter} for parameter in ("a_2", "d_1")]
    return drawn(arm, terms=terms, temperature_range_c={"t2": [10.0, 40.0]})


def write(folder: Path, made: Session, rng: np.random.Generator, *, parquet: bool) -> None:
    """A made-up session with a temperature missing here and there, and an artefact that warms:
    somebody reads its temperature every 900 readings, so that some pieces have none."""
    celsius = np.round(made.states.temperature_c, 2)
    celsius[rng.random(made.n) < 0.01, 1] = np.nan
    known = made.artefact.targets[0].position_mm is not None
    read_c = np.where(np.arange(made.n) % 900 == 100, rng.uniform(15, 25, made.n), np.nan)
    # Where all points are seats, its size from reading to reading would weakly tell where its
    # frame has its origin, and how weakly is a matter of rounding.
    artefact_c = np.round(read_c, 2) if known else np.full(made.n, 20.0)
    columns = {f"t{k}": column for k, column in enumerate(celsius.T, 1)}
    write_folder(
        folder, made, expansion_per_k=1.2e-5, parquet=parquet,
        time_s=np.arange(made.n) * 0.5, artefact_c=artefact_c, **columns,
    )  # fmt: skip


def write_some(folder: Path, arm: Arm, readings: int = 2000) -> list[str]:
    """Certified points, some with truths of their own; and seats with a certified length."""
    rng = np.random.default_rng(4)
    truth = disturbed(arm, rng, 0.1)
    common: Any = {"readings": readings, "placements": 5, "encoder_rad": 1e-5}
    points = session(arm, truth, rng, noise_mm=0.02, **common)
    points.truth_mm[rng.random(points.n) < 0.6] = np.nan
    seats = session(arm, truth, rng, known=False, targets=3, distances=[(0, 1)], **common)
    write(folder / "points", points, rng, parquet=False)
    write(folder / "seats", seats, rng, parquet=True)
    return [str(folder / "points"), str(folder / "seats")]


@pytest.fixture
def in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streamed, "MOST_AT_ONCE", 0)
    monkeypatch.setattr(pieces, "PIECE_ROWS", 700)
    monkeypatch.setattr(pieces, "PIECE_BYTES", 1 << 17)


@pytest.mark.slow
@pytest.mark.usefixtures("in_pieces")
@pytest.mark.parametrize("known", [False, True])
def test_same_as_in_memory(tmp_path: Path, known: bool) -> None:
    arm = synthetic_arm()
    model = calibration(arm) if known else None
    paths = write_some(tmp_path, arm)
    told: list[str] = []
    found, lengths = streamed.evaluate_files(paths, arm, model, told.append)
    whole = evaluate(load_sessions(paths, arm), arm, model)
    expected = whole.as_json()

    assert told[0] != told[-1]  # it went by in pieces
    assert bool(found["n_unused"]) == known
    assert found["n_unused"] == expected["n_unused"]
    assert list(found["by_session"]) == ["points", "seats"]
    for ours, theirs, near in (
        (found, expected, 1e-8),  # Gauss and Newton end within 1e-8 mm of the best seats
        (found["by_session"]["seats"], expected["by_session"]["seats"], 1e-8),
        (found["by_session"]["points"], expected["by_session"]["points"], 1e-11),
    ):
        assert ours["n"] == theirs["n"]
        for figure in ("rms_um", "max_um", "mean_um"):
            assert ours[figure] == pytest.approx(theirs[figure], rel=near)
        assert ours["median_um"] == pytest.approx(theirs["median_um"], rel=1e-4)
    assert len(lengths) == len(whole.lengths) == 1
    for length, other in zip(lengths, whole.lengths, strict=True):
        told_of, told_there = length.as_json(), other.as_json()
        assert told_of.pop("between") == told_there.pop("between")
        assert told_of == pytest.approx(told_there, rel=1e-6)


@pytest.mark.usefixtures("in_pieces")
def test_out_of_the_order_of_time_with_lags(tmp_path: Path) -> None:
    arm = synthetic_arm()
    paths, told = write_some(tmp_path, arm, 700)[:1], list[str]()
    readings = tmp_path / "points/readings.csv"
    table = readings.read_text().splitlines(keepends=True)
    readings.write_text("".join([table[0], *reversed(table[1:])]))
    found, _ = streamed.evaluate_files(paths, arm, calibration(arm), told.append)
    remarks = found.pop("remarks")
    assert found == evaluate(load_sessions(paths, arm), arm, calibration(arm)).as_json()
    assert all("no limit in arm.toml" in remark for remark in remarks)
    assert any("order of time" in text for text in told)


@pytest.mark.usefixtures("in_pieces")
@parametrize_default(
    ("break_it", "said"),
    [
        (lambda rows: [*rows[:1500], "0,P1,B1,zero" + rows[5][30:], *rows[1501:]], "row 1500"),
        (lambda rows: [*rows[:1500], rows[1500].replace("P", ""), *rows[1501:]], None),
        (lambda rows: [*rows[:1500], rows[1500][: rows[1500].index(",")] + "\n"], "row 1500"),
        (lambda rows: rows[:1], "no readings"),
    ],
    default=2,
)
def test_faults_are_told_alike(
    tmp_path: Path, break_it: Callable[[list[str]], list[str]], said: str | None
) -> None:
    arm = synthetic_arm()
    paths, faults = write_some(tmp_path, arm)[:1], list[str]()
    readings = tmp_path / "points/readings.csv"
    readings.write_text("".join(break_it(readings.read_text().splitlines(keepends=True))))
    for evaluated in (
        lambda: streamed.evaluate_files(paths, arm, None, lambda _: None)[0]["n"],
        lambda: evaluate(load_sessions(paths, arm), arm, None).as_json()["n"],
    ):
        try:
            faults.append(str(evaluated()))
        except BadInput as fault:
            faults.append(str(fault))
    assert faults[0] == faults[1]
    assert said is None or said in faults[0]


def test_few_points_stand_for_many() -> None:
    rng = np.random.default_rng(3)
    points = rng.normal(size=(500, 4)) @ rng.normal(size=(4, 4)) + 1000.0
    group = rng.integers(0, 3, 500)
    halves = [
        compute_moments(group[half], points[half]) for half in (slice(0, 90), slice(90, None))
    ]
    for key, moments in halves[0].items():
        moments.add(halves[1][key])
        few, all_of_it = moments.points(), points[group == key]
        assert moments.n == len(all_of_it)
        np.testing.assert_allclose(few.mean(axis=0), all_of_it.mean(axis=0), rtol=1e-13)
        np.testing.assert_allclose(
            np.cov(few.T, bias=True), np.cov(all_of_it.T, bias=True), rtol=1e-9, atol=1e-12
        )


def test_a_median_of_which_nothing_is_kept() -> None:
    rng = np.random.default_rng(2)
    for distances in (rng.lognormal(2, 1.5, 9001), np.array([3.0]), np.zeros(4)):
        tally = ErrorTally()
        for part in np.array_split(distances, 4):
            tally.add(part)
        assert tally.as_json()["median_um"] == pytest.approx(
            np.median(distances), rel=1e-4, abs=1e-5
        )
        assert tally.as_json()["rms_um"] == pytest.approx(np.sqrt(np.mean(distances**2)), rel=1e-12)
