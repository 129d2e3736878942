"""`armd.Corrector`: bit for bit what `armd correct` writes, in this process or in another."""

from __future__ import annotations

import datetime
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import armd
from armd.compensation.model.calibration import Calibration, save_calibration
from armd.daemon.cli import main
from support import synthetic
from support.drawn import drawn
from support.measured_arm import measured_arm

NAMES = synthetic.arm().layout.names
POINTS = ["x_mm", "y_mm", "z_mm", "u_x_mm", "u_y_mm", "u_z_mm", "flags"]


def term(parameter: str, coefficient: float, *basis: dict[str, Any]) -> dict[str, Any]:
    return {"parameter": parameter, "coefficient": coefficient, "basis": list(basis)}


LAGGED = {"kind": "temperature", "weights": {"t2": 1.0}, "lag_s": 60.0}
HOURS = {"kind": "time", "since_unix_s": 1.7e9, "until_unix_s": 1.8e9}
CURVED = {"kind": "sin", "joint": 3}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A calibration as large as a thermal one is: every constant and 24 terms have a covariance."""
    folder = tmp_path_factory.mktemp("corrector")
    measured = measured_arm(folder, readings=12)
    rng = np.random.default_rng(4)
    terms = [term(f"a_{k}", 1e-3 * k, LAGGED) for k in range(1, 7)]
    terms += [term(f"d_{k}", 1e-4, HOURS) for k in range(1, 7)]
    terms += [term(f"theta_{k}", 1e-4, CURVED) for k in range(1, 7)]
    terms += [term(f"d_{k}", 1e-3, LAGGED | {"order": 2}) for k in range(1, 7)]
    of = [*NAMES[:33], *(f"term {i}" for i in range(24))]
    root = rng.normal(size=(len(of), len(of))) * 1e-5
    calibration = drawn(
        measured.arm,
        values=synthetic.disturbed(measured.arm, rng),
        temperature_range_c={"t2": [16.0, 24.0]},
        terms=terms,
        covariance_of=of,
        covariance=(root @ root.T).tolist(),
        noise={"encoder_rad": [1e-6] * 6, "reading_mm": 2e-3, "temperature_c": 0.05},
        provenance={"notes": ["a long story"] * 2000},
    )
    save_calibration(folder / "cal.json", calibration)
    return measured.arm_file, folder / "cal.json"


def readings(n: int = 60) -> pa.Table:
    """Rows with missing temperatures, missing angles, ranges left, and a text that is kept."""
    rng = np.random.default_rng(6)
    columns: dict[str, Any] = {"note": [f"row {i}" for i in range(n)], "time_s": 2.0 * np.arange(n)}
    columns |= {f"q{k}": rng.uniform(-2, 2, n) for k in range(1, 7)}
    columns |= {f"t{k}": 20 + 6 * np.sin(np.arange(n) / 9 + k) for k in range(1, 7)}
    columns["t2"][5:9] = np.nan
    columns["q4"][11] = np.nan
    return pa.table({name: pa.array(values, from_pandas=True) for name, values in columns.items()})


STARTED = "2026-03-01T09:00:00Z"


def test_it_is_bit_for_bit_what_the_command_writes(
    files: tuple[Path, Path], tmp_path: Path
) -> None:
    table = readings()
    source, target = tmp_path / "readings.parquet", tmp_path / "points.parquet"
    pq.write_table(table, source)
    command = ["correct", str(source), "--arm", str(files[0]), "--calibration", str(files[1])]
    assert main([*command, "-o", str(target), "--started", STARTED, "--quiet"]) == 0
    written = pq.read_table(target)
    when = datetime.datetime.fromisoformat(STARTED)
    for started in (STARTED, when):
        corrected = armd.Corrector(*files, started=started)(table)
        assert corrected.equals(written)
    assert corrected.column_names == [*table.column_names, *POINTS]
    assert corrected["flags"].to_pylist()[5] & armd.Flag.TEMPERATURE_STALE
    assert corrected["x_mm"].to_pylist()[11] is None


def test_a_batch_gives_a_batch_and_no_rows_give_none(files: tuple[Path, Path]) -> None:
    corrector = armd.Corrector(*files, started=STARTED)
    table = readings()
    batch = corrector(table.to_batches()[0])
    assert isinstance(batch, pa.RecordBatch)
    assert pa.Table.from_batches([batch]).equals(corrector(table))
    none = corrector(table.slice(0, 0))
    assert none.num_rows == 0 and none.schema == corrector(table).schema


def test_without_uncertainties_the_rest_is_the_same(files: tuple[Path, Path]) -> None:
    table = readings()
    whole = armd.Corrector(*files, started=STARTED)(table)
    short = armd.Corrector(*files, started=STARTED, uncertainty=False)(table)
    assert short.equals(whole.drop_columns(POINTS[3:6]))


def test_rows_together_are_what_each_is_alone(files: tuple[Path, Path], tmp_path: Path) -> None:
    """What is worked out once for rows of equal temperatures, or left out where no row asks for
    it, changes no bit: NaN, a turn off and a jump of temperature stand among the rows."""
    calibration = Calibration.model_validate_json(files[1].read_text())
    terms = [
        term("a_2", 1e-3, {"kind": "temperature", "weights": {"t2": 1.0}, "order": 3}),
        term("theta_3", 1e-5, {"kind": "temperature", "weights": {"t3": 1.0}}, CURVED),
    ]
    content = calibration.content() | {"terms": terms, "covariance_of": [], "covariance": []}
    save_calibration(tmp_path / "cal.json", Calibration.model_validate(content))
    corrector = armd.Corrector(files[0], tmp_path / "cal.json")
    rng = np.random.default_rng(3)
    columns = {f"q{k}": rng.uniform(-1, 1, 40) for k in range(1, 7)}
    columns |= {f"t{k}": np.repeat([20.0, 20.0, 23.0, 21.0], 10) + k for k in range(1, 7)}
    columns["q1"][7] += 2 * np.pi
    columns["q5"][20] = np.nan
    columns["t2"][33] = 26.0
    table = pa.table({name: pa.array(v, from_pandas=True) for name, v in columns.items()})
    together = corrector(table)
    alone = pa.concat_tables([corrector(table.slice(row, 1)) for row in range(40)])
    assert together.combine_chunks().equals(alone.combine_chunks())
    assert together["x_mm"].null_count == 1 and len(set(together["x_mm"].to_pylist())) == 40


def test_a_part_with_its_lead_in_is_as_in_the_whole(files: tuple[Path, Path]) -> None:
    table = readings(2000)
    corrector = armd.Corrector(*files, started=STARTED)
    rows = round(corrector.lead_in_s / 2.0)
    assert rows == 1200
    part = corrector(table.slice(1500 - rows, rows + 100)).slice(rows)
    for name in POINTS[:6]:
        whole = corrector(table).slice(1500, 100)[name].to_numpy()
        assert part[name].to_numpy() == pytest.approx(whole, abs=2e-9)  # both rounded to 1e-9


def test_it_pickles_small_and_needs_no_file_any_more(
    files: tuple[Path, Path], tmp_path: Path
) -> None:
    arm, calibration = tmp_path / "arm.toml", tmp_path / "cal.json"
    arm.write_bytes(files[0].read_bytes())
    calibration.write_bytes(files[1].read_bytes())
    corrector = armd.Corrector(arm, calibration, started=STARTED)
    data = pickle.dumps(corrector)
    assert len(data) <= 32 * 1024 < calibration.stat().st_size
    arm.unlink()
    calibration.unlink()
    table = readings()
    assert pickle.loads(data)(table).equals(corrector(table))
    short = armd.Corrector(*files, started=STARTED, uncertainty=False)
    assert len(pickle.dumps(short)) < 8 * 1024
    assert pickle.loads(pickle.dumps(short))(table).equals(short(table))


def test_what_it_cannot_correct_is_refused(files: tuple[Path, Path]) -> None:
    table = readings()
    with pytest.raises(armd.BadInput, match="table: --started: found nothing, expected an instant"):
        armd.Corrector(*files)(table)
    corrector = armd.Corrector(*files, started=STARTED)
    with pytest.raises(armd.BadInput, match="table: column flags: found it already"):
        corrector(corrector(table))
    with pytest.raises(armd.BadInput, match="table: column q6: found no such column"):
        corrector(table.drop_columns(["q6"]))
    with pytest.raises(armd.BadInput, match="Corrector: started: found '1 March', expected an ins"):
        armd.Corrector(*files, started="1 March")
    with pytest.raises(armd.BadInput, match="Corrector: angle_unit: found 'grad'"):
        armd.Corrector(*files, angle_unit="grad")  # type: ignore[arg-type]
