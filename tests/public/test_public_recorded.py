"""Points of `armd record --lake` corrected again: `armd correct` and `armd.Corrector`."""

from __future__ import annotations

from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

import armd
from support.measured_arm import measured_arm
from support.published import make_lake, save_lagged

EPOCH = "1970-01-01T00:00:00Z"
DAYS = ("2026-03-01", "2026-03-02")
Files = tuple[Path, Path, Path]


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Files:
    """An arm, a calibration with a lag, and a lake of two days."""
    folder = tmp_path_factory.mktemp("recorded")
    measured = measured_arm(folder, readings=12)
    save_lagged(folder / "cal.json", "SYN-1", 0.5, seed=4)
    make_lake(folder / "lake", "SYN-1", DAYS, 3000)
    return measured.arm_file, folder / "cal.json", folder / "lake"


def day(files: Files, name: str = DAYS[0]) -> pa.Table:
    paths = sorted(files[2].glob(f"serial=SYN-1/day={name}/*.parquet"))
    return pa.concat_tables([pq.read_table(path, partitioning=None) for path in paths])


def test_it_is_as_a_table_of_readings_at_the_same_instants(files: Files) -> None:
    table = day(files)
    corrected = armd.Corrector(*files[:2])(table)
    readings = table.select([f"{letter}{k}" for k in range(1, 7) for letter in "qwt"])
    instants = pa.array(table["stamp_ns"].to_numpy() * 1e-9)
    expected = armd.Corrector(*files[:2], started=EPOCH)(readings.append_column("time_s", instants))
    for name in ("x_mm", "y_mm", "z_mm", "u_x_mm", "u_y_mm", "u_z_mm", "flags"):
        assert corrected[name].equals(expected[name]), name
    kept = [name for name in table.column_names if name not in {"flags", "x_mm", "y_mm", "z_mm"}]
    kept = [name for name in kept if not name.endswith("mm2")]
    assert corrected.column_names[: len(kept)] == kept
    identity = int.from_bytes(bytes.fromhex(armd.read_calibration(files[1]).sha256)[:8], "little")
    assert set(corrected["calibration"].to_pylist()) == {identity}
    assert armd.Corrector(*files[:2])(corrected).equals(corrected)  # corrected again, it stays
    assert armd.Corrector(files[0])(table)["calibration"].to_pylist() == [0] * len(table)


def test_flags_that_describe_the_sample_are_kept(files: Files) -> None:
    table = day(files).slice(0, 4)
    place = table.column_names.index("flags")
    flag = armd.Flag
    before = [
        int(flag.INVALID | flag.SAMPLES_LOST),
        int(flag.AT_REST | flag.NOT_CALIBRATED),
        int(flag.TEMPERATURE_RANGE | flag.END_STOP),
        int(flag.JOINT_WARNING | flag.CLOCK),
    ]
    table = table.set_column(place, "flags", pa.array(before, pa.uint32()))
    corrected = armd.Corrector(*files[:2])(table)
    assert corrected["x_mm"].is_null().to_pylist() == [True, False, False, False]
    assert corrected["flags"].to_pylist() == [
        int(flag.INVALID | flag.SAMPLES_LOST),
        int(flag.AT_REST),
        0,
        int(flag.JOINT_WARNING | flag.CLOCK),
    ]


def test_the_rows_that_following_ones_depend_on(files: Files) -> None:
    table = day(files)
    slow, plain = armd.Corrector(*files[:2]), armd.Corrector(files[0])
    assert slow.lead_in(table.slice(0, 2500)).num_rows == 2500  # 40 half seconds are longer
    assert plain.lead_in(table).equals(table.slice(len(table) - 1))
    place = table.column_names.index("t3")
    values = table["t3"].to_pylist()
    values[1200:] = [None] * (len(values) - 1200)
    gap = table.set_column(place, "t3", pa.array(values))
    lead = plain.lead_in(gap.slice(0, 2000))
    assert lead.equals(gap.slice(1199, 801))
    held = plain(pa.concat_tables([lead, gap.slice(2000)])).slice(len(lead))
    assert held.equals(plain(gap).slice(2000))
    assert plain.lead_in(table.slice(0, 0)).num_rows == 0
