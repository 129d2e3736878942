"""`armd export`: what each format says, where measurements come from, what is refused."""

from __future__ import annotations

import csv
import json
import math
import uuid
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from measurement import MEASUREMENT

from armd.daemon.bridges.export import source
from armd.daemon.bridges.export.qif import NAMESPACE
from armd.daemon.cli import main
from support.program import run_armd, start_recording
from support.running_daemon import running_daemon
from support.simulated_arm import simulated_arm

PRESSED_IN_VAIN = MEASUREMENT | {
    "seq": 8, "stamp_ns": MEASUREMENT["stamp_ns"] + 1, "position_mm": None, "count": 0,
    "standard_deviation_mm": None, "covariance_mm2": None, "orientation": None,
    "angles_rad": None, "approach": None, "flags": 1, "flag_names": ["INVALID"],
}  # fmt: skip


def written(path: Path, *measurements: dict[str, Any]) -> Path:
    path.write_text("".join(json.dumps(m) + "\n" for m in measurements))
    return path


def export(tmp_path: Path, suffix: str, *measurements: dict[str, Any]) -> str:
    path = written(tmp_path / "m.jsonl", *measurements)
    for _ in range(2):  # the second time over the first one's file
        assert main(["export", str(path), "-o", str(tmp_path / f"out{suffix}")]) == 0
    return (tmp_path / f"out{suffix}").read_text()


def test_csv_has_every_measurement_and_all_that_is_known(tmp_path: Path) -> None:
    rows = list(csv.DictReader(export(tmp_path, ".csv", PRESSED_IN_VAIN, MEASUREMENT).splitlines()))
    good, bad = rows  # by time, whatever the order of the lines
    assert [float(good[name]) for name in ("x_mm", "y_mm", "z_mm")] == [1.5, -2.25, 3.0]
    assert [float(good[name]) for name in "ijk"] == [0.0, -0.6, 0.8]
    assert [float(good[f"u_{a}_mm"]) for a in "xyz"] == pytest.approx([0.01, 0.02, 0.03])
    assert [float(good[f"sd_{a}_mm"]) for a in "xyz"] == [0.001, 0.002, 0.003]
    assert (good["stamp_ns"], good["flags"], good["q2"], good["w2"], good["t1"], good["t2"]) == (
        "1700000000123456789", "512", "-1.5", "0.001", "20.5", "",
    )  # fmt: skip
    assert bad["x_mm"] == bad["i"] == bad["u_x_mm"] == bad["q1"] == "" and bad["flags"] == "1"


def test_a_sensor_may_be_called_like_a_column(tmp_path: Path) -> None:
    text = export(tmp_path, ".csv", MEASUREMENT | {"temperatures_c": {"tip": 21.0}})
    (row,) = csv.DictReader(text.splitlines())
    assert (row["tip"], row["temperature_tip"]) == ("", "21.0")


def test_a_table_is_read_as_it_was_written_and_an_unknown_column_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = export(tmp_path, ".csv", MEASUREMENT | {"temperatures_c": {"q3": 21.0, "elbow": None}})
    assert text.splitlines()[0].endswith(
        ",w1,w2,approach_x,approach_y,approach_z,temperature_q3,elbow"
    )
    path, again = tmp_path / "out.csv", tmp_path / "again.csv"
    assert main(["export", str(path), "-o", str(again)]) == 0
    rows = [next(csv.DictReader(table.splitlines())) for table in (text, again.read_text())]
    for row in rows:  # a table has no orientation
        del row["i"], row["j"], row["k"]
    assert rows[0] == rows[1]
    again.unlink()
    path.write_text(text.replace(",seq,", ",humidity,").replace(",elbow", ",seq"))
    capsys.readouterr()
    assert main(["export", str(path), "-o", str(again)]) == 2
    said = capsys.readouterr().err
    assert "out.csv: the header: found column 'humidity'" in said, said
    assert not again.exists()


def test_xyz_is_six_numbers_a_line(tmp_path: Path) -> None:
    points = np.loadtxt(export(tmp_path, ".xyz", MEASUREMENT, PRESSED_IN_VAIN).splitlines())
    assert points.tolist() == [1.5, -2.25, 3.0, 0.0, -0.6, 0.8]


def test_ply_says_what_it_holds(tmp_path: Path) -> None:
    without = MEASUREMENT | {"seq": 9, "covariance_mm2": None, "approach": None}
    text = export(tmp_path, ".ply", MEASUREMENT, without | {"orientation": None})
    header, _, body = text.partition("end_header\n")
    names = [line.split()[-1] for line in header.splitlines() if line.startswith("property")]
    assert header.startswith("ply\nformat ascii 1.0\n") and "element vertex 2\n" in header
    rows = [dict(zip(names, line.split(), strict=True)) for line in body.splitlines()]
    assert float(rows[0]["standard_uncertainty"]) == pytest.approx(math.sqrt(14e-4), abs=1e-6)
    assert rows[1]["standard_uncertainty"] == "nan"
    assert [float(rows[1][name]) for name in ("nx", "ny", "nz")] == [0, 0, 0]


#: Children by parent, in the schema's order, those that must be there with "!"; of the published
#: QIF 3.0 schemas, as far as this document goes. Nothing else may stand in it.
QIF_ORDER = {
    "QIFDocument": ["QPId!", "Header", "FileUnits", "MeasurementResources", "Results"],
    "Header": ["Application"],
    "Application": ["Name!", "Organization"],
    "FileUnits": ["PrimaryUnits!"],
    "PrimaryUnits": ["LinearUnit"],
    "LinearUnit": ["SIUnitName!", "UnitName", "UnitConversion"],
    "UnitConversion": ["Factor!"],
    "MeasurementResources": ["MeasurementDevices"],
    "MeasurementDevices": ["MeasurementDevice"],
    "MeasurementDevice": ["Name!"],
    "Results": ["MeasurementResultsSet!"],
    "MeasurementResultsSet": ["MeasurementResults!"],
    "MeasurementResults": ["MeasuredFeatures", "InspectionStatus!"],
    "MeasuredFeatures": ["PointFeatureMeasurement"],
    "PointFeatureMeasurement": [
        "FeatureName", "TimeStamp", "MeasurementDeviceIds", "Location", "Normal",
    ],
    "MeasurementDeviceIds": ["Id!"],
    "InspectionStatus": ["InspectionStatusEnum!"],
}  # fmt: skip


def test_qif_keeps_the_schema_s_order_identifiers_and_counts(tmp_path: Path) -> None:
    """A structural test: no package carries the schemas, so no validator has run."""
    second = MEASUREMENT | {"seq": 9, "covariance_mm2": None, "approach": None}
    text = export(tmp_path, ".qif", MEASUREMENT, second | {"orientation": None}, PRESSED_IN_VAIN)
    document = ElementTree.fromstring(text)
    own = f"{{{NAMESPACE}}}"
    assert document.tag == f"{own}QIFDocument" and document.get("versionQIF") == "3.0.0"
    identities = []
    for element in document.iter():
        name = element.tag.removeprefix(own)
        order = QIF_ORDER.get(name, [])
        children = [child.tag.removeprefix(own) for child in element]
        places = [[rule.rstrip("!") for rule in order].index(child) for child in children]
        assert places == sorted(places), name
        assert {rule.rstrip("!") for rule in order if rule.endswith("!")} <= set(children), name
        if "n" in element.keys():  # noqa: SIM118  an Element is no mapping
            assert int(element.get("n", "")) == len(children) > 0
        if "id" in element.keys():  # noqa: SIM118
            identities.append(int(element.get("id", "")))
    assert len(identities) == len(set(identities)) and max(identities) == int(document.get("idMax"))
    uuid.UUID(document.findtext(f"{own}QPId"))
    assert {e.text for e in document.iter(f"{own}Id")} == {
        e.get("id") for e in document.iter(f"{own}MeasurementDevice")
    }
    first, other = document.iter(f"{own}PointFeatureMeasurement")
    location = first.find(f"{own}Location")
    assert [float(x) for x in location.text.split()] == [1.5, -2.25, 3.0]
    assert float(location.get("yCombinedUncertainty")) == pytest.approx(0.02)
    assert float(location.get("combinedUncertainty")) == pytest.approx(math.sqrt(14e-4), abs=1e-6)
    assert first.findtext(f"{own}TimeStamp") == "2023-11-14T22:13:20.123456789Z"
    assert [float(x) for x in first.findtext(f"{own}Normal").split()] == [0, -0.6, 0.8]
    assert other.find(f"{own}Normal") is None
    assert not other.find(f"{own}Location").attrib


def test_nothing_measured_is_a_file_all_the_same(tmp_path: Path) -> None:
    for suffix in (".csv", ".xyz", ".ply", ".qif"):
        export(tmp_path, suffix)
    ElementTree.parse(tmp_path / "out.qif")


def test_since(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    later = MEASUREMENT | {"seq": 9, "stamp_ns": 1_800_000_000 * 10**9}
    path = written(tmp_path / "m.jsonl", MEASUREMENT, later)
    for since in ("2023-11-15T00:00", "2023-11-14T23:00:00+00:00", "1750000000", "2023-11-15"):
        command = ["export", str(path), "--since", since, "-o", str(tmp_path / "a.csv")]
        assert main(command) == 0
        assert ": 1 measurement" in capsys.readouterr().out


def test_a_log_with_a_torn_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "SIM-0001"
    folder.mkdir()
    (folder / "000001.jsonl").write_text(json.dumps(MEASUREMENT) + '\n{"seq": 8, "pos')
    written(folder / "000002.jsonl", MEASUREMENT, MEASUREMENT | {"seq": 9})
    assert main(["export", str(folder), "-o", str(tmp_path / "a.csv")]) == 0
    told = capsys.readouterr().out
    assert ": 2 measurements" in told and "000001.jsonl: line 2: cut short" in told
    (folder / "000001.jsonl").write_text(json.dumps(MEASUREMENT) + "\n" + 40 * "\0")
    assert main(["export", str(folder), "--force", "-o", str(tmp_path / "a.csv")]) == 0
    told = capsys.readouterr().out
    assert ": 2 measurements" in told and "000001.jsonl: line 2: cut short" in told


@pytest.mark.parametrize("end", ["\n", ""], ids=["whole", "at-the-end"])
@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("x,y,z", ["line 1", "a measurement as JSON"]),
        ('{"seq": 1, "flags": 0, "stamp_ns": 5}', ["line 1: position_mm", "found nothing"]),
        (json.dumps(MEASUREMENT | {"position_mm": [1, 2]}), ["line 1: position_mm.2"]),
        ("[1]", ["line 1", "found [1]"]),
        (json.dumps(MEASUREMENT | {"stamp_ns": 1 << 63}), ["line 1: stamp_ns", "less than"]),
        (json.dumps(MEASUREMENT | {"seq": -1}), ["line 1: seq", "found -1"]),
        (json.dumps(MEASUREMENT | {"flags": 1 << 32}), ["line 1: flags", "less than"]),
    ],
)
def test_bad_lines_are_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], line: str, words: list[str], end: str
) -> None:
    (tmp_path / "m.jsonl").write_text(line + end)
    output = tmp_path / "a.csv"
    assert main(["export", str(tmp_path / "m.jsonl"), "-o", str(output)]) == 2
    told = capsys.readouterr().err
    assert all(word in told for word in ["m.jsonl", *words]), told
    assert not output.exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["m.jsonl", "-o", "a.txt"], ["a.txt", "suffix", ".qif"]),
        (["none.jsonl", "-o", "a.csv"], ["none.jsonl", "nothing"]),
        (["m.jsonl", "--since", "yesterday", "-o", "a.csv"], ["--since", "'yesterday'"]),
        (["m.mcap", "-o", "a.csv"], ["m.mcap"]),
        (["m.jsonl", "-o", "notes.csv"], ["notes.csv", "a file of another kind", "--force"]),
        (["empty", "-o", "a.csv"], ["empty", "a measurement log"]),
    ],
)
def test_bad_usage(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    words: list[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "m.jsonl", MEASUREMENT)
    (tmp_path / "m.mcap").write_text("no recording")
    (tmp_path / "notes.csv").write_text("what,a,person\nwrote,by,hand\n")
    (tmp_path / "empty").mkdir()
    assert main(["export", *arguments]) == 2
    told = capsys.readouterr().err
    assert all(word in told for word in words), told


numbers = st.floats(-1e4, 1e4)


@settings(deadline=None, max_examples=30)
@given(st.lists(st.tuples(st.integers(0, 2**62), numbers, numbers, numbers), max_size=5))
def test_any_measurements_are_those_of_the_csv(
    tmp_path_factory: pytest.TempPathFactory, told: list[tuple[int, float, float, float]]
) -> None:
    folder = tmp_path_factory.mktemp("any")
    measurements = [
        MEASUREMENT | {"seq": k, "stamp_ns": stamp, "position_mm": position}
        for k, (stamp, *position) in enumerate(told)
    ]
    rows = list(csv.DictReader(export(folder, ".csv", *measurements).splitlines()))
    assert [int(row["stamp_ns"]) for row in rows] == sorted(stamp for stamp, *_ in told)
    for row in rows:
        position = [float(row[name]) for name in ("x_mm", "y_mm", "z_mm")]
        assert position == pytest.approx(told[int(row["seq"])][1:], abs=1e-6)


@pytest.mark.slow
def test_from_a_daemon_its_log_and_a_recording(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The three sources agree, and `armd correct` reads the CSV."""
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    with (
        simulated_arm(tmp_path, seconds=60) as arm,
        running_daemon(tmp_path, arm.port) as daemon,
        daemon.listen() as heard,
    ):
        recorded = str(tmp_path / "r.mcap")
        with start_recording(daemon.endpoint, "-o", recorded) as recorder:
            before = len(heard.json("measurement"))
            heard.wait_for(lambda: len(heard.json("measurement")) > before + 1)
            recorder.terminate()
        for words in (
            ("SIM-0001", "--endpoint", daemon.endpoint, "-o", "live.csv"),
            ("--log", "-o", "log.csv"),
            (recorded, "-o", "recorded.csv"),
        ):
            run_armd("export", *words, check=True, cwd=tmp_path)
    live, log, played = (
        {row["stamp_ns"]: row for row in csv.DictReader((tmp_path / name).read_text().splitlines())}
        for name in ("live.csv", "log.csv", "recorded.csv")
    )
    assert len(played) > 0 and set(played) <= set(live) <= set(log)
    for stamp, row in live.items():
        # The log does not say how the tip sits; all else is the same.
        assert {k: v for k, v in row.items() if k not in "ijk"} == {
            k: v for k, v in log[stamp].items() if k not in "ijk"
        }
        assert played.get(stamp, row) == row
    words = ("correct", "live.csv", "--arm", arm.arm_toml, "-o", "again.csv")
    run_armd(*words, check=True, cwd=tmp_path)


def test_a_source_keeps_what_later_versions_add(tmp_path: Path) -> None:
    path = written(tmp_path / "m.jsonl", MEASUREMENT | {"torque_nm": [1.0]})
    (found,) = source.from_path(path).measurements
    assert found.model_dump()["torque_nm"] == [1.0]
