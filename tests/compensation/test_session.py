"""Sessions: read as written, and refused with file, row, column, found and expected."""

from __future__ import annotations

import datetime
import re
from pathlib import Path

import numpy as np
import pytest

from armd import BadInput
from armd.compensation.data.sessions.session import load_session, load_sessions
from armd.compensation.data.sessions.writing import write_session
from armd.compensation.model.arm import Arm

STARTED = datetime.datetime(2026, 3, 1, 9, tzinfo=datetime.UTC)
ARM = Arm.model_validate(
    {
        "schema": "armd.arm/1",
        "serial_number": "TEST-1",
        "temperature_sensor": [{"name": "t1"}],
        "joint": [
            {"d_mm": 200.0, "alpha_deg": 90.0, "counts_per_turn": 4096, "temperature": "t1"},
            {"a_mm": 300.0, "counts_per_turn": 4096, "direction": -1},
            {"a_mm": 250.0, "counts_per_turn": 4096, "min_deg": -150.0, "max_deg": 150.0},
        ],
    }
)


def session_file(**changes: object) -> dict[str, object]:
    content: dict[str, object] = {
        "schema": "armd.session/1",
        "arm": "TEST-1",
        "started": STARTED,
        "angle_unit": "rad",
        "artefact": {
            "name": 'a "beam"',
            "expansion_per_k": 5e-7,
            "target": [{"name": "B1", "position_mm": [0.0, 0.0, 0.0]}, {"name": "S1"}],
            "distance": [{"between": ["B1", "S1"], "length_mm": 50.0}],
        },
    }
    return content | changes


def columns(n: int = 12) -> dict[str, list[object]]:
    rng = np.random.default_rng(1)
    table: dict[str, list[object]] = {
        "time_s": list(np.arange(n) * 2.0),
        "placement": ["P1", "P2"] * (n // 2),
        "target": ["B1", "B1", "S1"] * (n // 3),
    }
    for k in (1, 2, 3):
        table[f"q{k}"] = list(rng.uniform(-2, 2, n))
    return table


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return tmp_path / "first"


@pytest.mark.parametrize("parquet", [False, True])
def test_reads_what_was_written(folder: Path, parquet: bool) -> None:
    table = columns() | {
        "t1": [21.5, float("nan"), *[22.0] * 10],
        "w1": [0.1] * 12,
        "remark": ["x"] * 12,
        "artefact_c": [20.5] * 12,
        "x_mm": [1.0] + [float("nan")] * 11,
        "y_mm": [2.0] + [float("nan")] * 11,
        "z_mm": [3.0] + [float("nan")] * 11,
    }
    write_session(folder, session_file(), table, parquet=parquet)
    session = load_session(folder, ARM)
    assert session.name == "first"
    assert session.started_unix_s == STARTED.timestamp()
    assert session.placement_names == ["P1", "P2"]
    assert session.placement.tolist() == [0, 1] * 6
    assert session.target.tolist() == [0, 0, 1] * 4
    np.testing.assert_array_equal(session.states.q[:, 1], table["q2"])
    np.testing.assert_array_equal(session.states.time_s[:2] - STARTED.timestamp(), [0, 2])
    assert session.states.temperature_c[0, 0] == 21.5
    assert np.isnan(session.states.temperature_c[1, 0])
    assert np.isnan(session.states.rate[:, 1:]).all()
    assert session.truth_mm[0].tolist() == [1, 2, 3]
    assert np.isnan(session.truth_mm[1:]).all()
    assert session.unused_columns == ["remark"]
    assert session.artefact.name == 'a "beam"'
    assert session.artefact.distances[0].length_mm == 50.0
    assert np.isnan(session.artefact.positions_mm()[1]).all()
    assert len(session.fingerprint()) == 64


def test_times_may_be_missing_but_not_here_and_there(folder: Path) -> None:
    write_session(folder, session_file(), columns() | {"time_s": [float("nan")] * 12})
    assert np.isnan(load_session(folder, ARM).states.time_s).all()
    write_session(folder, session_file(), columns() | {"time_s": [0.0] * 11 + [float("nan")]})
    assert "row 12" in refusal(folder)


def test_counts_and_degrees_become_radians(folder: Path) -> None:
    table = columns()
    for k, sign in ((1, 1), (2, -1), (3, 1)):
        table[f"q{k}"] = [sign * 1024.0] * 12
    write_session(folder, session_file(angle_unit="count"), table)
    np.testing.assert_allclose(load_session(folder, ARM).states.q, np.pi / 2)
    for k in (1, 2, 3):
        table[f"q{k}"] = [90.0] * 12
    write_session(folder, session_file(angle_unit="deg"), table)
    np.testing.assert_allclose(load_session(folder, ARM).states.q, np.pi / 2)


def test_approach_is_given_or_the_tip_s_velocity(folder: Path) -> None:
    table = columns() | {f"w{k}": [0.0] * 12 for k in (1, 2, 3)}
    table["w1"] = [0.0] + [0.2] * 11
    write_session(folder, session_file(), table)
    session = load_session(folder, ARM)
    assert np.isnan(session.states.approach[0]).all()
    np.testing.assert_allclose(np.linalg.norm(session.states.approach[1:], axis=1), 1)
    # Joint 1 turns about z: its velocity is horizontal.
    np.testing.assert_allclose(session.states.approach[1:, 2], 0, atol=1e-12)
    given = {"approach_x": [0.0] * 12, "approach_y": [0.6] * 12, "approach_z": [-0.8] * 12}
    write_session(folder, session_file(), table | given)
    approach = load_session(folder, ARM).states.approach
    np.testing.assert_allclose(approach, np.tile([0.0, 0.6, -0.8], (12, 1)))


def refusal(folder: Path) -> str:
    with pytest.raises(BadInput) as refused:
        load_session(folder, ARM)
    return str(refused.value)


@pytest.mark.parametrize(
    ("column", "row", "value", "words"),
    [
        ("q2", 4, "abc", ["readings.csv", "row 5", "column q2", "'abc'", "a number"]),
        ("q2", 4, "", ["row 5", "column q2", "nothing", "a number"]),
        ("q1", 11, "NaN", ["row 12", "column q1", "nothing"]),
        ("q1", 0, "inf", ["row 1", "column q1", "infinite"]),
        ("time_s", 2, "1.77e9", ["row 3", "column time_s", "seconds since"]),
        ("target", 3, "B9", ["row 4", "column target", "'B9'", "B1, S1"]),
        ("target", 3, "NaN", ["row 4", "column target", "nothing"]),
        ("placement", 3, "", ["row 4", "column placement", "nothing"]),
        ("q3", 6, "270.5", ["row 7", "column q3", "270.5", "an angle in rad"]),
        ("t1", 6, "293.15", ["row 7", "column t1", "293.15", "°C"]),
        ("y_mm", 6, "", ["row 7", "column y_mm", "nan", "as in the other two"]),
        ("approach_x", 6, "3.0", ["row 7", "column approach_x", "length 1"]),
    ],
)
def test_a_bad_cell_is_named(
    folder: Path, column: str, row: int, value: str, words: list[str]
) -> None:
    table = columns() | {"t1": [21.0] * 12}
    table |= {name: [0.0] * 12 for name in ("x_mm", "y_mm", "z_mm", "approach_y", "approach_z")}
    table["approach_x"] = [1.0] * 12
    table[column] = [str(cell) for cell in table[column]]
    table[column][row] = value
    write_session(folder, session_file(), columns())
    lines = [",".join(table)]
    lines += [",".join(str(cells[i]) for cells in table.values()) for i in range(12)]
    (folder / "readings.csv").write_text("\n".join(lines) + "\n")
    message = refusal(folder)
    for word in words:
        assert word in message


def test_a_bad_table_is_named(folder: Path) -> None:
    table = columns()
    write_session(folder, session_file(), {name: table[name] for name in table if name != "q2"})
    assert "column q2: found no such column" in refusal(folder)
    write_session(folder, session_file(), table | {"x_mm": [1.0] * 12})
    assert "column y_mm: found no such column" in refusal(folder)
    write_session(folder, session_file(), {name: cells[:0] for name, cells in table.items()})
    assert "no readings" in refusal(folder)
    readings = folder / "readings.csv"
    readings.write_text("time_s,placement,target,q1,q2,q3\n0,P,B1,0,0,0\n1,P,B1,0,0\n")
    assert "row 2 (line 3): found 5 columns, expected 6" in refusal(folder)
    readings.write_text("time_s,placement,target,q1,q1,q3\n0,P,B1,0,0,0\n")
    assert "column q1: found 2 of it" in refusal(folder)
    readings.unlink()
    assert "found neither, expected one of them" in refusal(folder)
    assert "found nothing, expected a folder" in refusal(folder / "absent")


def test_an_open_quotation_mark_swallows_no_row(folder: Path) -> None:
    write_session(folder, session_file(), columns() | {"remark": ["x"] * 12})
    readings = folder / "readings.csv"
    lines = readings.read_text().splitlines()
    lines[5] = lines[5].replace('"x"', '"a line\nbreak"')
    readings.write_text("\n".join(lines) + "\n")
    assert load_session(folder, ARM).n == 12
    lines[-2:] = [
        line.replace('"x"', mark) for line, mark in zip(lines[-2:], ('"x', "x"), strict=True)
    ]
    lines[-1] = lines[-1].replace('"', "")
    readings.write_text("\n".join(lines) + "\n")
    with pytest.raises(BadInput, match="unexpected end of data, expected every quotation mark"):
        load_session(folder, ARM)


def test_degrees_that_look_like_radians_are_refused(folder: Path) -> None:
    write_session(folder, session_file(angle_unit="deg"), columns())
    assert "like radians" in refusal(folder)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"arm": "OTHER"}, ["arm", "'OTHER'", "'TEST-1'"]),
        ({"angle_unit": "gon"}, ["angle_unit", "'gon'", "'rad'"]),
        ({"started": "2026-03-01T09:00:00"}, ["started"]),
        ({"colour": 1}, ["colour", "unknown key"]),
    ],
)
def test_a_bad_session_file_is_named(
    folder: Path, changes: dict[str, object], words: list[str]
) -> None:
    write_session(folder, session_file(), columns())
    good = (folder / "session.toml").read_text()
    for key, value in changes.items():
        lines = [line for line in good.splitlines() if not line.startswith(f"{key} =")]
        shown = value if key == "started" else repr(value).replace("'", '"')
        (folder / "session.toml").write_text(f"{key} = {shown}\n" + "\n".join(lines))
    message = refusal(folder)
    assert "session.toml" in message
    for word in words:
        assert word in message


def test_targets_are_checked(folder: Path) -> None:
    write_session(folder, session_file(), columns())
    good = (folder / "session.toml").read_text()
    (folder / "session.toml").write_text(good.replace("[0.0, 0.0, 0.0]", "[0.0, nan, 0.0]"))
    assert "artefact.target[1].position_mm[2]" in refusal(folder)
    (folder / "session.toml").write_text(good.replace('["B1", "S1"]', '["B1", "S7"]'))
    assert "'S7'" in refusal(folder)


def test_a_session_counts_once(folder: Path) -> None:
    write_session(folder, session_file(), columns())
    (fitted,) = load_sessions([folder], ARM)
    for given in ([folder, folder.parent / "." / "first"], [folder]):
        with pytest.raises(BadInput, match="found given twice, expected every session once"):
            load_sessions(given, ARM, besides=[fitted] if len(given) == 1 else [])


@pytest.mark.parametrize("started", ["9999-12-31T23:59:59Z", "0001-01-01T00:00:00+10:00"])
def test_a_start_that_nobody_can_have_measured_at_is_refused(folder: Path, started: str) -> None:
    write_session(folder, session_file(), columns())
    path = folder / "session.toml"
    path.write_text(re.sub("(?m)^started = .*$", f"started = {started}", path.read_text()))
    with pytest.raises(BadInput, match=r"session\.toml: started: found .* of the years 1970"):
        load_session(folder, ARM)
