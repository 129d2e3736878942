"""Files of others: what is no regular file, too much of one or hostile is refused in one line."""

from __future__ import annotations

import os
import socket
from pathlib import Path

import pytest

from armd import BadInput
from armd.compensation.data.tables.readings import load_readings, read_header
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.daemon.bridges.export.source import from_path
from armd.daemon.measure.log import load_beginning
from armd.files.inputs import MOST_JSON_BYTES, MOST_TOML_BYTES, read_input
from armd.files.schema import MOST_FAULTS, MOST_VALUES, load_json, load_toml


def test_a_file_is_read_as_it_stands(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"\x00\r\n")
    (tmp_path / "link").symlink_to("file")
    assert read_input(tmp_path / "file") == read_input(tmp_path / "link") == b"\x00\r\n"


def _fifo(path: Path) -> None:
    os.mkfifo(path)


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(path))


def _loop(path: Path) -> None:
    path.symlink_to(path)


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda path: None, "nothing"),
        (Path.mkdir, "a folder"),
        (_fifo, "a pipe (FIFO)"),
        (_socket, "a device or socket"),
        (_loop, "a symbolic link that leads back to itself"),
        (lambda path: path.symlink_to("/dev/zero"), "a device"),
        (lambda path: path.write_bytes(bytes(11)), "11 bytes"),
    ],
)
def test_what_is_no_regular_file_is_refused_at_once(tmp_path, make, found) -> None:  # type: ignore[no-untyped-def]
    make(tmp_path / "file")
    with pytest.raises(BadInput) as refused:
        read_input(tmp_path / "file", at_most=10)
    assert refused.value.found == found


@pytest.mark.parametrize(
    ("name", "found"),
    [("x" * 300, "a name too long"), ("file/x", "a file where"), ("a\x00b", "a zero byte")],
)
def test_names_that_cannot_be_are_refused(tmp_path: Path, name: str, found: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BadInput, match=found):
        read_input(tmp_path / name)


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"[" * 1_000_000, "brackets in brackets"),
        (b'{"a":' * 100_000, "brackets in brackets"),
        (b'{"provenance":{"a":' + b"[" * 900 + b"]" * 900 + b"}}", "recursion"),
        (b'{"arm":' + b"1" * 5000 + b"}", "thousands of digits"),
        (b'{"terms":[' + b"1," * MOST_VALUES + b"1,1]}", f"{MOST_VALUES + 1} values"),
        (b" " * (MOST_JSON_BYTES + 1), f"{MOST_JSON_BYTES + 1} bytes"),
        (b'{"arm": "\xff"}', "not UTF-8"),
        (b"", "line 1 column 1: found the end, expected valid JSON"),
    ],
)
def test_hostile_json_is_refused(tmp_path: Path, content: bytes, found: str) -> None:
    (tmp_path / "calibration.json").write_bytes(content)
    with pytest.raises(BadInput, match=found):
        load_json(tmp_path / "calibration.json", Calibration)


@pytest.mark.parametrize(
    ("content", "where", "found"),
    [
        (b'{"arm": 1, "a": 2, "arm": 3}', "arm", "this key with 1 and with 3"),
        (b'{"arm": {"b": [{"x": "1", "x": "1"}]}}', "x", "this key with '1' and with '1'"),
        (b'{"a": 1' + b', "b": 2' * 90_000 + b"}", "b", "this key with 2 and with 2"),
    ],
)
def test_a_key_of_json_that_stands_twice_is_refused(
    tmp_path: Path, content: bytes, where: str, found: str
) -> None:
    """The last one would count, and nobody would hear of the first; TOML refuses it, too."""
    path = tmp_path / "file.json"
    path.write_bytes(content)
    with pytest.raises(BadInput) as refused:
        load_json(path, Calibration)
    told = refused.value
    assert (told.file, told.where, told.found) == (str(path), where, found)


def test_a_line_with_a_key_twice_is_not_called_torn(tmp_path: Path) -> None:
    (tmp_path / "measured.jsonl").write_text('{"seq": 1, "seq": 2}\n')
    (tmp_path / "measuring.jsonl").write_text('{"seq": 1, "seq": 2}\n')
    with pytest.raises(BadInput, match=r"line 1: seq: found this key with 1 and with 2"):
        from_path(tmp_path / "measured.jsonl")
    with pytest.raises(BadInput, match=r"line 1: seq: found this key with 1 and with 2"):
        load_beginning(tmp_path)


def test_of_a_great_many_faults_some_are_told(tmp_path: Path) -> None:
    (tmp_path / "calibration.json").write_text('{"terms":[' + "1," * (MOST_VALUES // 20) + "1]}")
    with pytest.raises(BadInput) as refused:
        load_json(tmp_path / "calibration.json", Calibration)
    assert len(refused.value.more) == MOST_FAULTS - 1


@pytest.mark.parametrize(
    ("content", "found"),
    [
        (b"a=" + b"[" * 100_000, "brackets in brackets"),
        (b"a=" + b"1" * 5000, "thousands of digits"),
        (b".".join([b"a"] * 50_000) + b"=1", "a line with 49999 dots"),
        (b"#" * (MOST_TOML_BYTES + 1), f"{MOST_TOML_BYTES + 1} bytes"),
    ],
)
def test_hostile_toml_is_refused(tmp_path: Path, content: bytes, found: str) -> None:
    (tmp_path / "arm.toml").write_bytes(content)
    with pytest.raises(BadInput, match=found):
        load_toml(tmp_path / "arm.toml", Arm)


@pytest.mark.parametrize(
    ("content", "where"),
    [
        (b"q1,q2," + b"x" * 20_000_000 + b"\n1,2,3\n", "line 1"),
        (b"q1,q2\n1,2\n" + b"9" * 20_000_000 + b",2\n", "line 3"),
        (b"q1,q2\n1,2\n" + b"x" * 50_000 + b",2\n", "row 2 (line 3), column q1"),
        pytest.param(b'q1,q2\n1,2\n"' + b"\n" * 20_000_000, "line", marks=pytest.mark.slow),
    ],
)
def test_endless_rows_are_refused(tmp_path: Path, content: bytes, where: str) -> None:
    (tmp_path / "readings.csv").write_bytes(content)
    with pytest.raises(BadInput) as refused:
        load_readings(tmp_path / "readings.csv", ["q1", "q2"], [])
    assert refused.value.where.startswith(where)
    assert len(str(refused.value)) < 400 + len(str(tmp_path))


def test_many_columns_are_no_matter(tmp_path: Path) -> None:
    names = [f"c{i:x}" for i in range(10_000)]
    (tmp_path / "readings.csv").write_text(",".join(names))
    assert read_header(tmp_path / "readings.csv") == names


def test_a_damaged_parquet_file_is_refused(tmp_path: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet

    path = tmp_path / "readings.parquet"
    pa.parquet.write_table(pa.table({"q1": [float(i) for i in range(1000)]}), path)
    whole = path.read_bytes()
    path.write_bytes(whole[:4] + bytes(len(whole) // 2) + whole[4 + len(whole) // 2 :])
    with pytest.raises(BadInput, match="a Parquet table"):
        load_readings(path, ["q1"], [])


@pytest.mark.parametrize("digits", ["0x" + "f" * 5000, "0b" + "1" * 64, "9" * 19])
def test_an_integer_beyond_64_bits_is_refused_at_its_key(tmp_path: Path, digits: str) -> None:
    path = tmp_path / "arm.toml"
    path.write_text(f"[[joint]]\nd_mm = 1.0\na_mm = {digits}\n")
    with pytest.raises(BadInput, match=r"arm.toml: joint\[1\].a_mm: found an integer of \d+ bits"):
        load_toml(path, Arm)
