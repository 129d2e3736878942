"""`armd correct` as a user meets it: files in, files out, faults named."""

from __future__ import annotations

import csv
import datetime
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
import pytest

import armd
from armd import POINT, Flag
from armd.compensation.data.correction import correction as offline
from armd.compensation.data.correction import files as offline_files
from armd.compensation.data.correction import point_columns
from armd.compensation.data.tables import pieces
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration, save_calibration
from armd.compensation.model.kinematics import compute_jacobian, compute_pose
from armd.daemon.cli import main
from armd.daemon.live import flags
from support.drawn import drawn

ARM = """
schema = "armd.arm/1"
serial_number = "TEST"
[[temperature_sensor]]
name = "t1"
[[temperature_sensor]]
name = "unused"
[[joint]]
d_mm = 300.0
alpha_deg = 90.0
temperature = "t1"
counts_per_turn = 1000000
min_deg = -170.0
max_deg = 170.0
[[joint]]
a_mm = 400.0
counts_per_turn = 1000000
direction = -1
[[joint]]
a_mm = 350.0
counts_per_turn = 1000000
[tip]
offset_mm = [80.0, 0.0, 20.0]
"""
WARM = {"kind": "temperature", "weights": {"t1": 1.0}}


class Bench:
    """A folder with an arm, a calibration, and `armd correct` in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "arm.toml").write_text(ARM)
        self.arm = load_arm(folder / "arm.toml")
        self.calibrate([{"parameter": "d_1", "basis": [WARM], "coefficient": 0.007}])

    def calibrate(self, terms: list[dict[str, object]], term_variance: float = 1e-8) -> None:
        calibration = drawn(
            self.arm, terms=terms, temperature_range_c={"t1": [15.0, 30.0]},
            covariance_of=["d_1", "a_2", "term 0"],
            covariance=[[4e-6, 1e-6, 0.0], [1e-6, 9e-6, 0.0], [0.0, 0.0, term_variance]],
            noise={"encoder_rad": [2e-6, 3e-6, 4e-6], "temperature_c": 0.1},
        )  # fmt: skip
        save_calibration(self.folder / "cal.json", calibration)

    def readings(self, text: str) -> None:
        (self.folder / "readings.csv").write_text(text)

    def run(self, *more: str, source: str = "readings.csv", target: str = "points.csv") -> int:
        files = [str(self.folder / source), "-o", str(self.folder / target)]
        return main(["correct", *files, "--arm", str(self.folder / "arm.toml"), *more])

    def calibrated(self, *more: str, **files: str) -> int:
        return self.run("--calibration", str(self.folder / "cal.json"), *more, **files)

    def points(self) -> list[dict[str, str]]:
        with (self.folder / "points.csv").open(newline="") as file:
            return list(csv.DictReader(file))

    def expected(self, q: np.ndarray, celsius: np.ndarray, time_s: np.ndarray) -> np.ndarray:
        """Position and standard uncertainty (n, 6) of each row by the live path."""
        model = Model(self.arm, load_calibration(self.folder / "cal.json", self.arm))
        points, nothing = np.zeros(1, POINT), np.full((1, 3), np.nan)
        rows = []
        for angles, warm_c, at_s in zip(q, celsius, time_s, strict=True):
            model.fold(np.array([warm_c, 20.0]), at_s)
            model.correct(angles[None, :], nothing, nothing, points)
            rows.append(
                [*points["position_mm"][0], *np.sqrt(points["covariance_mm2"][0, [0, 3, 5]])]
            )
        return np.array(rows)

    def lifted_mm(self) -> list[float | None]:
        """How much higher than by the drawing each point is, joints 2 and 3 at zero."""
        nominal_mm = compute_pose(np.zeros((1, 3)), self.arm.nominal())[0][0, 2]
        heights = [row["z_mm"] for row in self.points()]
        return [round(float(z) - nominal_mm, 6) if z else None for z in heights]


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def positions(rows: list[dict[str, str]]) -> np.ndarray:
    return np.array([[float(row[name]) for name in point_columns.COLUMNS[:3]] for row in rows])


def figures(rows: list[dict[str, str]]) -> np.ndarray:
    return np.array([[float(row[name]) for name in point_columns.COLUMNS[:-1]] for row in rows])


def test_columns_are_kept_and_points_added(bench: Bench) -> None:
    bench.readings('note,q1,q2,q3,t1\n"a, ""b""",0.10,0.2,-0.3,26.0\n c ,1e0,0,0,20\n')
    assert bench.calibrated() == 0
    rows = bench.points()
    assert list(rows[0]) == ["note", "q1", "q2", "q3", "t1", *point_columns.COLUMNS]
    assert [row["note"] for row in rows] == ['a, "b"', " c "]
    assert [row["q1"] for row in rows] == ["0.10", "1e0"]
    q, celsius = np.array([[0.1, 0.2, -0.3], [1.0, 0, 0]]), np.array([26.0, 20.0])
    expected = bench.expected(q, celsius, np.zeros(2))
    assert figures(rows)[:, :3] == pytest.approx(expected[:, :3], abs=1e-8)
    assert figures(rows)[:, 3:] == pytest.approx(expected[:, 3:], rel=1e-4)
    # u² of z: d_1 and its coefficient at 6 K, the sensor, joints 2 and 3 by their levers
    nominal = bench.arm.nominal()
    lever = compute_jacobian(q, nominal)[1][0, 2]
    by_hand = 4e-6 + 36 * 1e-8 + (0.007 * 0.1) ** 2 + (lever[5] * 3e-6) ** 2
    by_hand += (lever[10] * 4e-6) ** 2 + 9e-6 * lever[7] ** 2 + 2e-6 * lever[7]
    assert figures(rows)[0, 5] == pytest.approx(by_hand**0.5, rel=1e-4)
    assert [row["flags"] for row in rows] == ["0", "0"]


def test_without_a_calibration_nominal_geometry_and_flag_7(bench: Bench) -> None:
    bench.readings("q1,q2,q3,t1\n0.1,0.2,0.3,25\n")
    assert bench.run() == 0
    (row,) = bench.points()
    assert int(row["flags"]) == Flag.NOT_CALIBRATED
    position = compute_pose(np.array([[0.1, 0.2, 0.3]]), bench.arm.nominal())[0]
    assert [float(row[name]) for name in point_columns.COLUMNS[:3]] == pytest.approx(
        position[0], abs=1e-8
    )
    assert [row[name] for name in point_columns.COLUMNS[3:6]] == ["", "", ""], (
        "nothing is known of them"
    )


def test_flags_and_missing_values(bench: Bench) -> None:
    bench.readings(
        "q1,q2,q3,t1,unused\n"
        "0,0,0,,25\n"  # no temperature yet: reference
        "0,0,0,25,\n"  # the sensor that no joint uses may miss
        "0,0,0,,\n"  # held at 25
        "0,,0,25,\n"  # a joint is missing
        "0,0,0,31,99\n"  # out of range
        "\n"
        "0,0,0,nan,25\n"
        "2.965,0,0,25,\n"  # 169.9°
    )
    assert bench.calibrated() == 0
    rows = bench.points()
    flags = [int(row["flags"]) for row in rows]
    stale = Flag.TEMPERATURE_STALE
    outside = Flag.TEMPERATURE_RANGE
    assert flags == [stale, 0, stale, Flag.INVALID, outside, stale | outside, Flag.END_STOP]
    assert bench.lifted_mm()[:5] == [0.0, 0.035, 0.035, None, 0.077]
    assert rows[3]["x_mm"] == ""


def test_counts_and_degrees(bench: Bench) -> None:
    bench.readings("q1,q2,q3\n250000,1000,500000\n")
    assert bench.run("--angle-unit", "count") == 0
    q = np.array([[np.pi / 2, -np.pi / 500, np.pi]])
    position = compute_pose(q, bench.arm.nominal())[0]
    assert positions(bench.points()) == pytest.approx(position, abs=1e-8)
    bench.readings("q1,q2,q3\n90,-0.36,180\n")
    assert bench.run("--angle-unit", "deg") == 0
    assert positions(bench.points()) == pytest.approx(position, abs=1e-8)


SESSION = """
schema = "armd.session/1"
arm = "TEST"
started = 2026-03-01T09:00:00Z
angle_unit = "deg"
[artefact]
name = "seat"
[[artefact.target]]
name = "S"
"""


def test_a_session_beside_the_readings_tells_unit_and_start(bench: Bench) -> None:
    started = datetime.datetime(2026, 3, 1, 9, tzinfo=datetime.UTC).timestamp()
    since = {"kind": "time", "since_unix_s": started, "until_unix_s": started + 7200}
    bench.calibrate([{"parameter": "d_1", "basis": [since], "coefficient": 1.0}])
    bench.readings("time_s,q1,q2,q3,t1\n7200,90,0,0,20\n")
    assert bench.calibrated() == 2, "the date is not known"
    (bench.folder / "session.toml").write_text(SESSION)
    assert bench.calibrated() == 0
    assert bench.lifted_mm() == [2.0]
    assert bench.calibrated("--started", "2026-03-01T09:00:00+01:00", "--angle-unit", "rad") == 2
    bench.readings("time_s,q1,q2,q3,t1\n7200,0,0,0,20\n")
    assert bench.calibrated("--started", "2026-03-01T09:00:00+01:00", "--angle-unit", "rad") == 0
    assert bench.lifted_mm() == [1.0]


def test_pieces_do_not_show(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    """Lags and held temperatures run on from piece to piece."""
    lagged = {**WARM, "lag_s": 30.0}
    bench.calibrate([{"parameter": "d_1", "basis": [lagged], "coefficient": 0.01}])
    rng = np.random.default_rng(0)
    n = 2000
    q, celsius = rng.uniform(-1, 1, (n, 3)), 20 + np.cumsum(rng.normal(0, 0.01, n))
    time_s = np.arange(n) * 0.5
    table = pa.table({"time_s": time_s, **{f"q{k + 1}": q[:, k] for k in range(3)}, "t1": celsius})
    pa.csv.write_csv(table, bench.folder / "readings.csv")
    pa.parquet.write_table(table, bench.folder / "readings.parquet")
    expected = bench.expected(q, celsius, time_s)
    monkeypatch.setattr(pieces, "PIECE_BYTES", 5000)
    monkeypatch.setattr(pieces, "PIECE_ROWS", 111)
    assert bench.calibrated() == 0
    first = figures(bench.points())
    assert first[:, :3] == pytest.approx(expected[:, :3], abs=1e-8)
    assert first[:, 3:] == pytest.approx(expected[:, 3:], rel=1e-3)
    assert bench.calibrated(source="readings.parquet") == 0
    again = figures(bench.points())
    assert again[:, :3] == pytest.approx(first[:, :3], abs=1e-8)
    assert again[:, 3:] == pytest.approx(first[:, 3:], rel=1e-3)
    assert bench.calibrated(source="readings.parquet", target="points.parquet") == 0
    written = pa.parquet.ParquetFile(bench.folder / "points.parquet")
    assert written.num_row_groups == 1
    points = written.read()
    assert points.column_names == [*table.column_names, *point_columns.COLUMNS]
    assert points["x_mm"].to_numpy() == pytest.approx(expected[:, 0], abs=1e-8)


BROKEN = [
    ("q1,q2,t1\n0,0,20\n", "column q3: found no such column"),
    ("q1,q2,q3\n0,0,0\n0,zero,0\n", "row 2 (line 3), column q2: found 'zero', expected a number"),
    ("q1,q2,q3\n0,0,0\n0,0\n", "row 2 (line 3): found 2 columns, expected 3"),
    (
        "q1,q2,q3\n0,0,0\n0,0,400\n",
        "row 2 (line 3), column q3: found 400, expected an angle in rad",
    ),
    ("q1,q2,q3,t1\n0,0,0,293\n", "row 1 (line 2), column t1: found 293, expected a temperature"),
    ("q1,q2,q3,q1\n0,0,0,0\n", "column q1: found 2 of it, expected one"),
    ("q1,q2,q3\n", "the file: found no readings"),
    ("", "the file: found nothing"),
]


@pytest.mark.parametrize(("text", "message"), BROKEN)
def test_bad_readings_are_named(
    bench: Bench, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    bench.readings(text)
    assert bench.calibrated() == 2
    error = capsys.readouterr().err
    assert error.startswith(f"armd: {bench.folder / 'readings.csv'}: {message}")
    assert not (bench.folder / "points.csv").exists()


def test_a_fault_in_a_later_piece_names_its_row(
    bench: Bench, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pieces, "PIECE_BYTES", 30)
    bench.readings("q1,q2,q3,t1\n" + "0,0,0,20\n" * 50 + "0,0,0,900\n")
    before = "q1,x_mm,y_mm,z_mm,flags\n"
    (bench.folder / "points.csv").write_text(before)
    assert bench.calibrated() == 2
    assert "row 51 (line 52), column t1: found 900" in capsys.readouterr().err
    assert (bench.folder / "points.csv").read_text() == before


def test_a_long_parquet_file_is_not_kept(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pieces, "PIECE_ROWS", 5000)
    monkeypatch.setattr(offline_files, "GROUP_ROWS", 5000)
    rng = np.random.default_rng(1)
    columns = {name: rng.uniform(0, 1, 100_000) for name in ("q1", "q2", "q3", "t1", "note")}
    source, target = bench.folder / "long.parquet", bench.folder / "points.parquet"
    pa.parquet.write_table(pa.table(columns), source, row_group_size=10_000)
    before, kept = pa.total_allocated_bytes(), list[int]()
    corrector = offline.Corrector(bench.arm, None, "rad", None)
    n = offline_files.correct_file(
        source, target, corrector, lambda _: kept.append(pa.total_allocated_bytes())
    )
    assert n == 100_000 and len(kept) == 20
    assert max(kept) - before < source.stat().st_size / 2


@pytest.mark.parametrize(
    ("column", "kind"),
    [
        (pa.array([[1, 2]]), "list<"),
        (pa.array([{"by": "hand"}]), "struct<"),
        (pa.array([b"\xff"]), "binary"),
    ],
)
def test_a_column_that_no_csv_file_can_hold_is_named(
    bench: Bench, capsys: pytest.CaptureFixture[str], column: pa.Array, kind: str
) -> None:
    angles = {f"q{k}": [0.1] for k in (1, 2, 3)}
    pyarrow.parquet.write_table(
        pa.table({**angles, "note": column}), bench.folder / "readings.parquet"
    )
    assert bench.run(source="readings.parquet", target="points.csv") == 2
    assert f"readings.parquet: column note: found {kind}" in capsys.readouterr().err
    assert not (bench.folder / "points.csv").exists()
    assert bench.run(source="readings.parquet", target="points.parquet") == 0


def test_true_and_false_are_no_angles(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    table = pa.table({"q1": [True], "q2": [0.1], "q3": [0.1]})
    pyarrow.parquet.write_table(table, bench.folder / "readings.parquet")
    assert bench.run(source="readings.parquet") == 2
    assert "column q1: found bool, expected double" in capsys.readouterr().err


@pytest.mark.parametrize("started", ["9999-12-31T23:59:59Z", "0001-01-01T00:00:00+10:00"])
def test_a_start_that_nobody_can_have_measured_at_is_refused(
    bench: Bench, capsys: pytest.CaptureFixture[str], started: str
) -> None:
    bench.readings("q1,q2,q3\n0,0,0\n")
    assert bench.run("--started", started) == 2
    assert f"--started: found {started!r}, expected an instant of the years" in (
        capsys.readouterr().err
    )


def test_bad_usage(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    bench.readings("q1,q2,q3\n0,0,0\n")
    assert bench.run("--started", "yesterday") == 2
    assert "--started: found 'yesterday'" in capsys.readouterr().err
    assert bench.run(target="points.parquet") == 2
    assert bench.run(source="missing.csv") == 2


def test_a_term_that_follows_time_is_held_outside_its_period_and_flagged(bench: Bench) -> None:
    started = datetime.datetime(2026, 3, 1, 9, tzinfo=datetime.UTC).timestamp()
    period = {"kind": "time", "since_unix_s": started, "until_unix_s": started + 7200}
    bench.calibrate([{"parameter": "d_1", "basis": [period], "coefficient": 1.0}])
    bench.readings("time_s,q1,q2,q3,t1\n-9,0,0,0,20\n3600,0,0,0,20\n1e8,0,0,0,20\n")
    assert bench.calibrated("--started", "2026-03-01T09:00:00Z") == 0
    assert bench.lifted_mm() == [0.0, 1.0, 2.0]
    assert [int(row["flags"]) & Flag.TEMPERATURE_RANGE for row in bench.points()] == [2, 0, 2]


def test_what_is_not_finite_is_invalid(bench: Bench) -> None:
    """As the daemon has it: no number, and flag 0."""
    bench.calibrate([{"parameter": "d_1", "basis": [WARM] * 2, "coefficient": 1e308}])
    (bench.folder / "readings.csv").write_text("q1,q2,q3,t1\n0.1,0.2,0.3,29\n0.1,0.2,0.3,20\n")
    assert bench.calibrated() == 0
    for row in bench.points():  # the position of the one; of the other what its sensor's noise does
        assert {row[name] for name in point_columns.COLUMNS[:6]} == {""}
        assert int(row["flags"]) & Flag.INVALID


@pytest.mark.parametrize("axis", ["x", "z"])
def test_an_uncertainty_that_is_not_finite_is_invalid(bench: Bench, axis: str) -> None:
    """In one coordinate, while the position and the other coordinates' are: no `inf`, flag 0."""
    parameter = {"x": "a_2", "z": "d_1"}[axis]
    terms = [{"parameter": parameter, "basis": [WARM] * 12, "coefficient": 0.0}]
    bench.calibrate(terms, term_variance=1e295)
    (bench.folder / "readings.csv").write_text("q1,q2,q3,t1\n0,0,0,29\n0,0,0,20\n0,0,,20\n")
    assert bench.calibrated() == 0
    far, at_reference, missing = bench.points()
    for row in (far, missing):
        assert {row[name] for name in point_columns.COLUMNS[:6]} == {""}
        assert int(row["flags"]) & Flag.INVALID
    assert not int(at_reference["flags"]) & Flag.INVALID
    assert np.isfinite([float(at_reference[name]) for name in point_columns.COLUMNS[:6]]).all()
    covariance = armd.Model(bench.folder / "arm.toml", bench.folder / "cal.json").covariance(
        np.zeros((2, 3)), np.array([[29.0, 20.0], [20.0, 20.0]])
    )
    assert np.isnan(covariance[0]).all() and np.isfinite(covariance[1]).all()


def test_a_live_point_of_whose_covariance_a_part_overflowed_is_not_finite() -> None:
    point = np.zeros(1, POINT)
    point["covariance_mm2"] = np.nan  # not known
    assert flags._is_finite(point[0])
    point["covariance_mm2"][0, 0] = 1e-6
    assert not flags._is_finite(point[0])
    point["covariance_mm2"] = 1e-6
    assert flags._is_finite(point[0])
    point["covariance_mm2"][0, 5] = -np.inf
    assert not flags._is_finite(point[0])
