"""`armd.make_session`: readings in any table are the same session, bit for bit."""

from __future__ import annotations

import datetime
import json
import tomllib
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

import armd
from armd.files.toml_text import format_toml
from support.measured_arm import MeasuredArm


def evaluated(measured: MeasuredArm, table: Any, **options: Any) -> dict[str, Any]:
    options = {"artefact": measured.artefact} | options
    session = armd.make_session(table, measured.arm_file, **options)
    return armd.evaluate(session, measured.arm_file).to_dict()


@pytest.fixture(scope="module")
def expected(measured: MeasuredArm) -> dict[str, Any]:
    return evaluated(measured, measured.columns)


@pytest.mark.parametrize(
    "kind", ["table", "batch", "dictionary", "lists", "stream", "pandas", "polars"]
)
def test_any_table_is_the_same_session(
    measured: MeasuredArm, expected: dict[str, Any], kind: str
) -> None:
    table = pa.table(measured.columns)
    if kind == "batch":
        table = table.to_batches()[0]
    elif kind == "dictionary":
        table = table.set_column(2, "target", table["target"].dictionary_encode())
    elif kind == "lists":
        table = {name: list(values) for name, values in measured.columns.items()}
    elif kind == "stream":
        table = Stream(table)
    elif kind in ("pandas", "polars"):
        table = import_module(kind).DataFrame(measured.columns)
    assert evaluated(measured, table) == expected


class Stream:
    """What has nothing but the Arrow C interface."""

    def __init__(self, table: pa.Table) -> None:
        self._table = table

    def __arrow_c_stream__(self, requested_schema: object = None) -> object:
        return self._table.__arrow_c_stream__(requested_schema)


def test_the_folder_written_is_the_same_session(
    measured: MeasuredArm, expected: dict[str, Any], tmp_path: Path
) -> None:
    started = datetime.datetime(2026, 3, 1, 9, tzinfo=datetime.UTC)
    session = armd.make_session(
        measured.columns, measured.arm_file, artefact=measured.artefact, started=started
    )
    session.save(tmp_path / "session")
    file = tomllib.loads((tmp_path / "session" / "session.toml").read_text())
    assert file["started"] == started == session.started
    assert file["artefact"]["target"] == measured.artefact["target"]
    read = armd.read_session(tmp_path / "session")
    assert armd.evaluate(read, measured.arm_file).to_dict() == expected
    assert read.readings["q3"].to_pylist() == measured.columns["q3"].tolist()
    read.save(tmp_path / "copy")
    name = "copy/readings.csv"
    assert (tmp_path / name).read_bytes() == (tmp_path / "session/readings.csv").read_bytes()


def test_degrees_and_counts_are_angles_too(measured: MeasuredArm, expected: dict[str, Any]) -> None:
    columns = measured.columns
    degrees = columns | {f"q{k}": np.degrees(columns[f"q{k}"]) for k in range(1, 7)}
    found = evaluated(measured, degrees, angle_unit="deg")
    assert found["rms_um"] == pytest.approx(expected["rms_um"], rel=1e-9)
    with pytest.raises(armd.BadInput, match=r"session: row 1, column q1: found .* in deg"):
        evaluated(measured, columns, angle_unit="deg")
    arm = tomllib.loads(measured.arm_file.read_text())
    for joint in arm["joint"]:
        joint |= {"counts_per_turn": 1 << 30, "direction": -1}
    counting = measured.arm_file.parent / "counting.toml"
    counting.write_text(format_toml(arm))
    turn = -(1 << 30) / (2 * np.pi)
    counts = columns | {f"q{k}": np.round(turn * columns[f"q{k}"]) for k in range(1, 7)}
    session = armd.make_session(counts, counting, artefact=measured.artefact, angle_unit="count")
    rms_um = armd.evaluate(session, counting).rms_um
    assert rms_um == pytest.approx(expected["rms_um"], abs=0.02)


def test_an_artefact_is_a_dict_a_file_or_unknown_points(
    measured: MeasuredArm, expected: dict[str, Any], tmp_path: Path
) -> None:
    file = tmp_path / "artefact.toml"
    file.write_text(format_toml({"artefact": measured.artefact}))
    assert evaluated(measured, measured.columns, artefact=file) == expected
    armd.make_session(measured.columns, measured.arm_file, artefact=measured.artefact).save(
        tmp_path / "A"
    )
    inside = tmp_path / "A" / "session.toml"
    assert evaluated(measured, measured.columns, artefact=inside) == expected
    target = [one | {"position_mm": np.array(one["position_mm"])}
              for one in measured.artefact["target"]]  # fmt: skip
    arrays = measured.artefact | {"target": target}
    assert evaluated(measured, measured.columns, artefact=arrays) == expected
    unknown = evaluated(measured, measured.columns, artefact=None)
    assert unknown["rms_um"] < expected["rms_um"]  # seats are fitted along


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"q2": None}, "session: column q2: found no such column"),
        ({"target": "B9"}, "session: row 1, column target: found 'B9', expected a target"),
        ({"q1": [True] * 72}, "session: column q1: found bool, expected double"),
        ({"q1": [1.0]}, "session: the table: found "),
        ({"q1": [10**25] * 72}, "session: the table: found Python int too large"),
        ({"q1": np.zeros((72, 2))}, r"session: the table: found an array of shape \(72, 2\)"),
        ({"time_s": np.full(72, np.inf)}, "session: row 1, column time_s: found an infinite"),
    ],
)
def test_a_table_that_does_not_hold_is_refused(
    measured: MeasuredArm, change: dict[str, Any], said: str
) -> None:
    columns = measured.columns | {
        name: [value] * 72 if isinstance(value, str) else value for name, value in change.items()
    }
    columns = {name: values for name, values in columns.items() if values is not None}
    with pytest.raises(armd.BadInput, match=said):
        evaluated(measured, columns)


def test_options_that_do_not_hold_are_refused(measured: MeasuredArm) -> None:
    for options, said in (
        ({"angle_unit": "grad"}, "session: angle_unit: found 'grad', expected 'rad', 'deg' or"),
        ({"started": "2026-03-01T09:00:00"}, "session: started: found '2026-03-01T09:00:00'"),
        ({"artefact": {"name": "x", "targets": []}}, "session: artefact.targets: found an unknown"),
    ):
        with pytest.raises(armd.BadInput, match=said):
            armd.make_session(measured.columns, measured.arm_file, **options)  # type: ignore[arg-type]
    with pytest.raises(armd.BadInput, match="session: the table: found a int, expected a pandas"):
        armd.make_session(7, measured.arm_file)


def test_sessions_in_memory_are_numbered(measured: MeasuredArm) -> None:
    made = [
        armd.make_session(measured.columns, measured.arm_file, artefact=measured.artefact)
        for _ in range(2)
    ]
    found = armd.evaluate(made, measured.arm_file)
    assert set(found.residuals["session"]) == {"session", "session-2"}
    with pytest.raises(armd.BadInput, match="session: the session: found given twice"):
        armd.evaluate([made[0], made[0]], measured.arm_file)
    with pytest.raises(armd.BadInput, match="sessions: the list: found no session"):
        armd.evaluate([], measured.arm_file)
    assert json.loads(json.dumps(made[0].artefact))["name"] == "points"


def test_a_message_of_a_library_obeys_no_terminal_characters(measured: MeasuredArm) -> None:
    columns = measured.columns | {"\x9b[J\x1b]0;all is well\x07": [1.0, 2.0]}
    with pytest.raises(armd.BadInput, match=r"\\x9b\[J\\x1b\]0;all is well\\x07") as refused:
        armd.make_session(columns, measured.arm_file, artefact=measured.artefact)
    assert str(refused.value).isprintable()
