"""What somebody may have meant is named, and what is far from everything is not guessed."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import pytest
from pydantic import Field

from armd import ArmdError, BadInput, connect
from armd.compensation.data.sessions.files import check_is_session
from armd.compensation.data.tables.readings import load_readings
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration
from armd.daemon.catalogue.known_arms import find_spelling
from armd.daemon.cli import main
from armd.files.schema import Strict, parse_json, parse_toml
from armd.terminal.suggest import format_names, list_keys_at, suggest, suggest_names


class Cat(Strict):
    kind: Literal["cat"]
    purrs: bool


class Dog(Strict):
    kind: Literal["dog"]
    barks: bool


class House(Strict):
    pet: Cat | Dog = Field(discriminator="kind")
    rooms: dict[str, Dog] = {}
    several: list[Cat | None] = Field([], alias="many")


@pytest.mark.parametrize(
    ("word", "expected"),
    [("alfa_deg", "alpha_deg"), ("Theta_Deg", "theta_deg"), ("a", None), ("", None)],
)
def test_the_nearest(word: str, expected: str | None) -> None:
    known = ["theta_deg", "alpha_deg", "d_mm"]
    assert suggest(word, known) == (f": did you mean {expected}?" if expected else "")
    if expected is None:
        assert suggest_names(word, known) == ": theta_deg, alpha_deg, d_mm"


def test_many_are_cut_short() -> None:
    assert format_names("abc") == "a, b, c"
    assert format_names(map(str, range(100))).endswith("10, 11, …")
    assert suggest_names("x", []) == ""


def test_keys_of_a_table_wherever_it_is() -> None:
    assert list_keys_at(House, []) == ["pet", "rooms", "many"]
    assert list_keys_at(House, ["pet", "dog"]) == ["kind", "barks"]
    assert list_keys_at(House, ["rooms", "kitchen"]) == ["kind", "barks"]
    assert list_keys_at(House, ["many", 3]) == ["kind", "purrs"]
    assert list_keys_at(House, ["nothing"]) == []
    assert "alpha_deg" in list_keys_at(Arm, ["joint", 0])
    assert "coefficient" in list_keys_at(Calibration, ["terms", 2])


def test_a_missing_key_with_its_misspelling_beside_it() -> None:
    with pytest.raises(BadInput) as fault:
        parse_toml("f", b'pet = {kind = "cat", purs = true}', House)
    assert str(fault.value).splitlines()[0].endswith("found 'purs' instead, expected this key")
    with pytest.raises(BadInput) as fault:
        parse_toml("f", b'pet = {kind = "cat"}', House)
    assert "found nothing, expected this key" in str(fault.value)


@pytest.mark.parametrize(
    ("start", "name"),
    [(b"\xef\xbb\xbf", "UTF-8"), (b"\xff\xfe", "UTF-16"), (b"\xfe\xff", "UTF-16")],
)
def test_a_byte_order_mark_is_told_as_one(start: bytes, name: str) -> None:
    for parse in (parse_toml, parse_json):
        with pytest.raises(BadInput, match=f"found a byte order mark of {name} before the text"):
            parse("file", start + b"a = 1", Arm)


def test_tables_of_excel(tmp_path: Path) -> None:
    path = tmp_path / "readings.csv"

    def refused() -> str:
        with pytest.raises(BadInput) as caught:
            load_readings(path, ["q1"], ["target"]).number("q1")
        return str(caught.value)

    path.write_text("time_s;q1;target\n0;0,5;S1\n")
    assert "the header: found columns separated by semicolons, expected commas" in refused()
    path.write_text("time_s\tq1\ttarget\n0\t0.5\tS1\n")
    assert "found columns separated by tabs" in refused()
    path.write_bytes("time_s,q1\n0,0\n".encode("utf-16"))
    assert "byte 0: found UTF-16 text" in refused()
    path.write_text("time_s,Q1,target\n0,0.5,S1\n")
    assert "column q1: found no such column, expected this column: is it Q1?" in refused()
    path.write_text("time_s,angle,target\n0,0.5,S1\n")
    assert "found no such column among time_s, angle, target" in refused()
    path.write_bytes(b"\xef\xbb\xbftime_s,q1\n0,0.5\n")
    assert load_readings(path, ["q1"], []).number("q1").tolist() == [0.5]


def test_folders_one_level_off(tmp_path: Path) -> None:
    session = tmp_path / "measured" / "T20"
    (session / "raw").mkdir(parents=True)
    (tmp_path / "empty").mkdir()
    for name in ("session.toml", "readings.csv"):
        (session / name).write_text("")

    def refused(path: Path) -> str:
        with pytest.raises(BadInput) as caught:
            check_is_session(path)
        return str(caught.value)

    above = refused(tmp_path / "measured")
    assert above.endswith(f"found a folder of 1 session, expected sessions, as {session}")
    (tmp_path / "measured" / "T30").mkdir()
    (tmp_path / "measured" / "T30" / "session.toml").write_text("")
    assert f"2 sessions, expected sessions, as {session} " in refused(tmp_path / "measured")
    assert f"expected its folder, {session}" in refused(session / "readings.csv")
    assert f"expected the session, {session}" in refused(session / "raw")
    check_is_session(session)


@pytest.mark.parametrize("endpoint", ["127.0.0.1:7447", "controller"])
def test_an_endpoint_without_its_protocol(endpoint: str) -> None:
    with pytest.raises(ArmdError, match=f"expected its protocol too: tcp/{endpoint}"):
        connect(endpoint=endpoint)


def test_a_command_and_an_arm(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["calibrte"]) == 2
    assert "did you mean calibrate?" in capsys.readouterr().err
    with pytest.raises(BadInput, match=r"did you mean so101\?"):
        find_spelling("so10")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("--verson", "armd: found --verson, expected an option: did you mean --version?"),
        ("check --quite a.toml", "armd check: found --quite, expected an option: did you mean --q"),
        ("calibrate t --am x -o y", "armd calibrate: found --am, expected an option"),
        ("calibrate t --arm x -o y --thermal of", "found 'of', expected one of auto, off, 1, 2"),
        ("measure seat -o s", "did you mean seats?"),
        ("interim ad t", "armd interim: argument ACTION: found 'ad', expected one of add, report"),
        ("interim report", "--history, as in: armd interim report --history checks"),
        ("schema arm foo", "found 'foo', expected nothing more"),
        ("calibrate arm.tml --arm arm.tml -o y", "arm.tml: the file: found nothing, expected"),
        ("check arm.tml", "did you mean arm.toml?"),
        ("run sub", "sub: the file: found a folder (it has armd.toml), expected a regular file"),
        ("run arm.toml", "schema: found an arm.toml ('armd.arm/1'), expected an armd.toml ('armd."),
        ("calibrate sub --arm arm.toml -o y", "found a folder without session.toml (it has armd."),
        ("calibrate t.csv --arm arm.toml -o y", "armd import makes one of a table"),
        ("check t.csv", "found a table alone, expected session.toml beside it: armd import"),
        ("correct sub --arm arm.toml -o y", "found a folder, expected .csv or .parquet (it has"),
        ("evaluate t9 --arm arm.toml", "readings.csv: there is T1"),
        ("evaluate t1x --arm arm.toml", "did you mean T1?"),
        ("verify T1 --arm arm.toml --calibration arm.toml", "line 1 column 1: found 'schema ="),
        ("watch --endpoint tcp://there:7447", "as Zenoh has it: tcp/there:7447"),
        (
            "design T1 --arm arm.toml -o y --poses tw",
            "--poses: found 'tw', expected a whole number",
        ),
        ("watch --endpoint tcp/there", "expected its port too: tcp/there:7447"),
    ],
)
def test_mistakes_of_the_first_hour(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    line: str, said: str,
) -> None:  # fmt: skip
    """One line on standard error, exit code 2 (1 of `check`), nothing on standard output."""
    monkeypatch.chdir(tmp_path)
    joint = "[[joint]]\nd_mm = 1.0\na_mm = 1.0\nalpha_deg = 90.0\n"
    Path("arm.toml").write_text(
        'schema = "armd.arm/1"\nserial_number = "A"\n[tip]\noffset_mm = [0, 0, 1]\n' + 3 * joint
    )
    for folder, file in (("sub", "armd.toml"), ("T1", "session.toml")):
        Path(folder).mkdir()
        (Path(folder) / file).touch()
    Path("t.csv").write_text("q1;q2;q3\n1;2;3\n")
    try:
        code = main(line.split())
    except SystemExit as ended:
        code = int(ended.code or 0)
    told = capsys.readouterr()
    assert said in told.err and told.err.count("\n") == 1 and told.out == ""
    assert code == (1 if line == "check t.csv" else 2)
