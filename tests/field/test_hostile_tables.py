"""Sheets and names that say what is not so, or too much: one sentence, within a screen, at once."""

from __future__ import annotations

import datetime
import re
import zipfile
from collections.abc import Callable
from pathlib import Path

import openpyxl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from armd.compensation.data.sessions.session import load_session
from armd.compensation.data.sessions.writing import write_session
from armd.compensation.model.arm import load_arm
from armd.daemon.cli import main

ARM = Path(__file__).parent / "tables" / "arm.toml"
SCREEN = 24 * 80
Change = Callable[[str, bytes], bytes | None]


def sheet(folder: Path, change: Change) -> Path:
    """A workbook of 20 readings, each of whose parts *change* may rewrite or leave out."""
    book = openpyxl.Workbook()
    book.active.append(["J1", "J2", "J3"])
    for k in range(20):
        book.active.append([k, 2 * k, 40 + k])
    book.save(folder / "plain.xlsx")
    path = folder / "r.xlsx"
    with zipfile.ZipFile(folder / "plain.xlsx") as plain, zipfile.ZipFile(
        path, "w", zipfile.ZIP_DEFLATED
    ) as changed:  # fmt: skip
        for part in plain.infolist():
            content = change(part.filename, plain.read(part))
            if content is not None:
                changed.writestr(part.filename, content)
    return path


def in_the_sheet(change: Callable[[bytes], bytes | None]) -> Change:
    return lambda name, content: change(content) if name.endswith("sheet1.xml") else content


def run(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, str]:
    code = main(["import", str(path), "--arm", str(ARM), "-o", str(path.parent / "out"), *options])
    said = capsys.readouterr()
    return code, said.out + said.err


@pytest.mark.parametrize("size", ["A1:C11", "A1:B21", "A1", "A1:XFD1048576"])
def test_every_row_and_column_is_read(
    size: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Whatever the sheet says of its size."""
    said = f'<dimension ref="{size}"'.encode()
    path = sheet(tmp_path, in_the_sheet(lambda xml: re.sub(rb'<dimension ref="[^"]*"', said, xml)))
    code, told = run(path, capsys)
    assert code == 0, told
    assert load_session(tmp_path / "out", load_arm(ARM)).n == 20


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda xml: None, "no sheet"),
        (lambda xml: b'<!DOCTYPE x [<!ENTITY a "aa">]>' + xml, "a document type or entity"),
        (lambda xml: xml[: len(xml) // 2], "no workbook that can be read"),
        (lambda xml: xml.replace(b"<v>40</v>", b"<v>" + b"4" * 40_000_000 + b"</v>"),
         "letters at most, Excel's own limit"),
    ],
)  # fmt: skip
def test_a_sheet_that_is_none(
    change: Callable[[bytes], bytes | None],
    said: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = sheet(tmp_path, in_the_sheet(change))
    code, told = run(path, capsys)
    assert code == 2 and said in told and len(told) < SCREEN


def test_no_message_is_longer_than_a_screen(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.csv").write_text(f"J1,J2,J3\n1,2,{'7' * 30_000}x\n")
    code, told = run(tmp_path / "a.csv", capsys)
    assert code == 2 and len(told) < SCREEN and "expected a number" in told
    (tmp_path / "b.csv").write_text(",".join(f"{'h' * 3000}{k}" for k in range(12)) + "\n1,2\n")
    code, told = run(tmp_path / "b.csv", capsys)
    assert code == 2 and len(told) < SCREEN
    code, told = run(tmp_path / f"{'n' * 5000}.csv", capsys)
    assert code == 2 and len(told) < SCREEN


@pytest.mark.parametrize(
    ("head", "cell"),
    [
        ("q" + "1" * 5001, "0.1"),
        ("t" + "1" * 5001, "20"),
        ("time", "2026-03-01 09:00:00." + "9" * 5001),
        ("time_s", "1" * 5001),
    ],
    ids=["joint", "sensor", "date", "seconds"],
)
def test_numbers_of_thousands_of_digits_are_no_fault_of_armd(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], head: str, cell: str
) -> None:
    (tmp_path / "a.csv").write_text(f"q1,q2,q3,target,{head}\n0.1,0.2,0.3,a,{cell}\n")
    code, told = run(tmp_path / "a.csv", capsys)
    assert code in (0, 2) and "fault of armd" not in told and len(told) < SCREEN


# --- sessions ------------------------------------------------------------------------------------


CONTENT = {
    "schema": "armd.session/1",
    "arm": "THREE",
    "started": datetime.datetime(2026, 3, 1, 9, tzinfo=datetime.UTC),
}
COLUMNS: dict[str, list[object]] = {
    "time_s": [1.0, 2.0], "placement": ["P1", "P1"], "target": ["a", "b"],
    "q1": [0.1, 0.2], "q2": [0.1, 0.2], "q3": [0.1, 0.2],
}  # fmt: skip


def written(folder: Path, artefact: dict[str, object], **columns: list[object]) -> Path:
    write_session(folder / "s", CONTENT | {"artefact": artefact}, COLUMNS | columns)
    (folder / "arm.toml").write_text(ARM.read_text())
    return folder / "s"


TWO = {"name": "seats", "target": [{"name": "a"}, {"name": "b"}]}


@pytest.mark.parametrize("column", ["placement", "target"])
def test_a_reading_without_a_name_is_refused(
    column: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """As an empty cell of CSV, and as null of Parquet."""
    folder = written(tmp_path, TWO)
    table = pa.table(COLUMNS | {column: pa.array([None, "a"], pa.string())})
    pq.write_table(table, folder / "readings.parquet")
    (folder / "readings.csv").unlink()
    for _ in ("parquet", "csv"):
        assert main(["check", str(folder), str(tmp_path / "arm.toml")]) == 1
        said = capsys.readouterr().err
        assert f"column {column}: found nothing, expected the name of a {column}" in said
        written(tmp_path, TWO, **{column: ["", "a"]})


def test_names_of_a_verification_need_no_target(tmp_path: Path) -> None:
    """Those of docs/how-to/verify.md: in readings, and as ends of certified lengths."""
    names = ["SPAT1", "SPHERE1.01"]
    folder = written(tmp_path, {"name": "seat"}, target=names)
    arm = load_arm(ARM)
    assert load_session(folder, arm).artefact.target_names == names
    artefact = {
        "name": "all",
        "target": [{"name": "a"}],
        "distance": [{"between": ["SPHERE.a", "SPHERE.b"], "length_mm": 25.0},
                     {"between": ["L0", "L5"], "length_mm": 500.0}],
    }  # fmt: skip
    session = load_session(written(tmp_path, artefact, target=["a", "EFFDIA.3.9"]), arm)
    assert session.artefact.target_names == ["a", "SPHERE.a", "SPHERE.b", "L0", "L5", "EFFDIA.3.9"]
    assert session.target.tolist() == [0, 5]


@pytest.mark.parametrize("name", ["SPAT4", "L6", "LDIA.6.1", "SPHERE3.01", "spat1", "B1"])
def test_any_other_name_needs_one(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = written(tmp_path, {"name": "seat"}, target=["SPAT1", name])
    assert main(["check", str(folder), str(tmp_path / "arm.toml")]) == 1
    assert f"found '{name}', expected a target of the artefact" in capsys.readouterr().err


@pytest.mark.parametrize("hidden", ["\x1b]0;owned\x07", "a\u202eb", "\x9b31m", "\u2066note"])
def test_names_that_a_terminal_would_obey_are_refused(
    hidden: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """In tables' cells and heads, in files, and in what is imported: shown, never sent."""
    said = []
    table = tmp_path / "r.csv"
    table.write_text(f"J1,J2,J3,ball,{hidden}\n1,2,40,{hidden},5\n", encoding="utf-8")
    said.append(run(table, capsys))
    table.write_text(f"J1,J2,J3,{hidden}\n1,2,40,5\n", encoding="utf-8")
    said.append(run(table, capsys))
    folder = written(tmp_path, TWO, **{hidden: [1.0, 2.0]})
    files = [str(folder), str(tmp_path / "arm.toml")]
    said.append((main(["check", *files]), capsys.readouterr().err))
    folder = written(tmp_path, {"name": "x", "target": [{"name": "a"}, {"name": hidden}]})
    said.append((main(["check", *files]), capsys.readouterr().err))
    assert [code for code, _ in said] == [2, 0, 1, 1]
    for _, text in said:
        assert "\\x" in text or "\\u" in text
        assert not set(text) & set("\x1b\x07\x9b\u202e\u2066")


@pytest.mark.parametrize(
    ("old", "new", "found"),
    [
        ('serial_number = "THREE"', "serial_number = ['T', 1]", "['T', 1]"),
        ("d_mm = 200.0", "d_mm = {a = 1}", "a table with a"),
        ("d_mm = 200.0", "d_mm = true", "true"),
        ('serial_number = "THREE"', 'serial_number = "THREE"\ngravity = [0.0, 0.0, -2.0]',
         "values that do not fit together, expected gravity of length 1, not [0.0, 0.0, -2.0]"),
        ('temperature = "t1"', 'temperature = "t2"', "sensors (t1), not 't2'"),
    ],
)  # fmt: skip
def test_no_message_has_an_object_of_python(
    old: str, new: str, found: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.toml").write_text(ARM.read_text().replace(old, new))
    assert main(["check", str(tmp_path / "arm.toml")]) == 1
    said = capsys.readouterr().err
    assert found in said and not re.search(r"\{'|True|None|\(\d", said)


@pytest.mark.parametrize("line", ["a_mm = 300,5", "a_mm = -300,5  # as drawn"])
def test_a_decimal_comma_is_named(
    line: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "arm.toml").write_text(ARM.read_text().replace("a_mm = 300.0", line))
    assert main(["check", str(tmp_path / "arm.toml")]) == 1
    said = capsys.readouterr().err
    assert "line 10: found" in said and "expected a decimal point:" in said and "300.5" in said


@pytest.mark.slow
def test_a_simulated_operators_plan_is_checked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = tmp_path / "plan.toml"
    text = (
        'schema = "armd.operator/1"\n[[target]]\nname = "B"\nposition_mm = [400.0, 0.0, 300.0]\n'
        '[[visit]]\nplacement = "P1"\n'
    )
    plan.write_text(text)
    assert main(["check", str(plan)]) == 0
    plan.write_text(text + "rounds = 0\n")
    assert main(["check", str(plan)]) == 1
    assert "visit[1].rounds: found 0" in capsys.readouterr().err
