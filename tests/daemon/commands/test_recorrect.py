"""`armd recorrect`: old positions against new ones, from JSON lines and from a table alike."""

from __future__ import annotations

import csv
import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armd import __version__
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import save_calibration
from armd.compensation.model.slow_factors import Daily, Temperature, Time
from armd.compensation.model.terms import Term
from armd.daemon.cli import main
from support.drawn import drawn
from support.running_daemon import running_daemon
from support.simulated_arm import simulated_arm

ARM = """
schema = "armd.arm/1"
serial_number = "TEST"
[[temperature_sensor]]
name = "t1"
[[joint]]
d_mm = 300.0
alpha_deg = 90.0
temperature = "t1"
counts_per_turn = 1000000
[[joint]]
a_mm = 400.0
counts_per_turn = 1000000
[[joint]]
a_mm = 350.0
counts_per_turn = 1000000
[tip]
offset_mm = [80.0, 0.0, 20.0]
"""
START_NS = 1_700_000_000 * 10**9
DAY_S = 86400.0
ANGLES = np.random.default_rng(4).uniform(-2, 2, (20, 3))


def tip_mm(q: np.ndarray, a2_mm: float, offset_mm: tuple[float, ...] = (80.0, 0.0, 20.0)) -> Any:
    """By plain matrices: A = Rz(θ) Tz(d) Tx(a) Rx(α)."""
    pose = np.eye(4)
    for theta, d, a, alpha in zip(q, (300, 0, 0), (0, a2_mm, 350), (np.pi / 2, 0, 0), strict=True):
        c, s, ca, sa = np.cos(theta), np.sin(theta), np.cos(alpha), np.sin(alpha)
        pose = pose @ [
            [c, -s * ca, s * sa, a * c],
            [s, c * ca, -c * sa, a * s],
            [0, sa, ca, d],
            [0, 0, 0, 1],
        ]
    return (pose @ [*offset_mm, 1.0])[:3]


def measurements(**changes: Any) -> list[dict[str, Any]]:
    """One a day, as a daemon with the drawing's geometry made them."""
    return [
        {
            "seq": k, "stamp_ns": START_NS + k * round(DAY_S * 1e9), "count": 5, "flags": 512 + 128,
            "position_mm": tip_mm(q, 400.0).tolist(), "angles_rad": q.tolist(),
            "rates_rad_s": [0.0] * 3, "temperatures_c": {"t1": 20.0 + k},
            "covariance_mm2": [4e-4, 0, 0, 4e-4, 0, 4e-4], "calibration": "0011223344556677",
        }
        | changes
        for k, q in enumerate(ANGLES)
    ]  # fmt: skip


class Bench:
    """A folder with an arm and a calibration whose second link is 0.5 mm longer."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        (folder / "arm.toml").write_text(ARM)
        self.calibrate()
        self.write(measurements())

    def calibrate(self, terms: list[Term] = [], **changes: Any) -> None:  # noqa: B006
        arm = load_arm(self.folder / "arm.toml")
        values = arm.nominal()
        values[arm.layout.index("a_2")] += 0.5
        content = {
            "terms": terms, "temperature_range_c": {"t1": (15.0, 30.5)},
            "covariance_of": ["a_2"], "covariance": [[1e-4]],
        }  # fmt: skip
        save_calibration(self.folder / "new.json", drawn(arm, values=values, **content | changes))

    def rename(self, serial: str) -> None:
        (self.folder / "arm.toml").write_text(ARM.replace('"TEST"', f'"{serial}"'))
        self.calibrate(arm=serial)

    def write(self, told: list[dict[str, Any]]) -> None:
        (self.folder / "m.jsonl").write_text("".join(json.dumps(m) + "\n" for m in told))

    def run(self, *options: str, source: str = "m.jsonl") -> list[dict[str, str]]:
        assert self.call(*options, source=source) == 0
        return list(csv.DictReader((self.folder / "out.csv").read_text().splitlines()))

    def call(self, *options: str, source: str = "m.jsonl") -> int:
        files = {"--arm": "arm.toml", "--calibration": "new.json", "-o": "out.csv"}
        words = [word for o, name in files.items() for word in (o, str(self.folder / name))]
        return main(["recorrect", str(self.folder / source), *words, *options])


@pytest.fixture
def bench(tmp_path: Path) -> Bench:
    return Bench(tmp_path)


def vectors(rows: list[dict[str, str]], name: str) -> np.ndarray:
    return np.array([[float(row[name.format(axis)]) for axis in "xyz"] for row in rows])


def test_new_positions_and_flags_are_those_of_the_new_constants(bench: Bench) -> None:
    rows = bench.run("--tolerance", "0.45")
    assert [int(row["seq"]) for row in rows] == list(range(20))
    truth = np.array([tip_mm(q, 400.5) for q in ANGLES])
    new, old = vectors(rows, "{}_new_mm"), vectors(rows, "{}_old_mm")
    np.testing.assert_allclose(new, truth, atol=2e-6)
    np.testing.assert_allclose(old, [tip_mm(q, 400.0) for q in ANGLES], atol=2e-6)
    np.testing.assert_allclose(vectors(rows, "d{}_mm"), new - old, atol=2e-6)
    moved = np.linalg.norm(new - old, axis=1)
    assert [row["matters"] == "1" for row in rows] == (moved > 0.45).tolist()
    np.testing.assert_allclose(vectors(rows, "u_{}_old_mm"), 0.02, atol=1e-6)
    # A link known to 0.01 mm: the tip moves along it, so the three coordinates share that.
    u = np.linalg.norm(vectors(rows, "u_{}_new_mm"), axis=1)
    np.testing.assert_allclose(u, 0.01, atol=2e-6)
    # Calibrated now, at rest as before; from the eleventh day on warmer than was identified.
    assert [int(row["flags_new"]) for row in rows] == [512] * 11 + [512 + 2] * 9
    assert {row["calibration_old"] for row in rows} == {"0011223344556677"}


def test_since(bench: Bench) -> None:
    assert [row["seq"] for row in bench.run("--since", "2023-11-30T00:00Z")] == [
        str(k) for k in range(16, 20)
    ]


def test_what_follows_time_and_temperature_does_so(bench: Bench) -> None:
    """A link that creeps by 10 µm a day for ten days, and grows by 5 µm/K."""
    since = START_NS * 1e-9
    creep = Time(since_unix_s=since, until_unix_s=since + 10 * DAY_S)
    grows = Temperature(weights={"t1": 1.0})
    bench.calibrate(
        [
            Term(parameter="a_2", basis=[creep], coefficient=0.01 / 24),
            Term(parameter="a_2", basis=[grows], coefficient=0.005),
        ]
    )
    rows = bench.run()
    days = np.minimum(np.arange(20), 10)  # held at its last value after the period
    length = 400.5 + 0.01 * days + 0.005 * np.arange(20)
    truth = [tip_mm(q, a) for q, a in zip(ANGLES, length, strict=True)]
    np.testing.assert_allclose(vectors(rows, "{}_new_mm"), truth, atol=3e-6)
    assert all(int(row["flags_new"]) & 2 for row in rows[11:])


def test_the_day_is_held_outside_its_period_too(bench: Bench) -> None:
    """A link that breathes with the day, known for ten days and a quarter; measured at midnight."""
    since = START_NS * 1e-9
    day = Daily(kind="daily_sin", since_unix_s=since, until_unix_s=since + 10.25 * DAY_S)
    bench.calibrate([Term(parameter="a_2", basis=[day], coefficient=0.04)])
    rows = bench.run()
    length = 400.5 + 0.04 * (np.arange(20) > 10)  # its largest value, as at the period's end
    truth = [tip_mm(q, a) for q, a in zip(ANGLES, length, strict=True)]
    np.testing.assert_allclose(vectors(rows, "{}_new_mm"), truth, atol=3e-6)
    assert [bool(int(row["flags_new"]) & 2) for row in rows] == [k > 10 for k in range(20)]


def test_a_table_of_export_gives_the_same(bench: Bench) -> None:
    table = bench.folder / "m.csv"
    assert main(["export", str(bench.folder / "m.jsonl"), "-o", str(table)]) == 0
    lines, rows = bench.run(), bench.run(source="m.csv")
    np.testing.assert_allclose(vectors(rows, "{}_new_mm"), vectors(lines, "{}_new_mm"), atol=1e-6)
    np.testing.assert_allclose(vectors(rows, "u_{}_old_mm"), 0.02, atol=1e-6)


def test_another_tip_wants_its_configuration(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    bench.write(measurements(tip="long"))
    assert bench.call() == 2
    assert "tip: found 'long', expected --config" in capsys.readouterr().err
    config = bench.folder / "armd.toml"
    config.write_text(
        'schema = "armd.daemon/1"\narm = "arm.toml"\n[driver]\nkind = "serial"\nport = "x"\n'
        "[tips.long]\noffset_mm = [180.0, 0.0, 0.0]\n"
    )
    rows = bench.run("--config", str(config))
    truth = [tip_mm(q, 400.5, (180.0, 0.0, 0.0)) for q in ANGLES]
    np.testing.assert_allclose(vectors(rows, "{}_new_mm"), truth, atol=2e-6)


def test_the_tip_is_as_the_measurement_says_it_was(bench: Bench) -> None:
    """Calibrated anew in between: each measurement with the offset of its day, from table too."""
    told = measurements(tip="long")
    offsets = [(180.0 + (k >= 10), 0.0, 0.0) for k in range(len(told))]
    for measurement, offset in zip(told, offsets, strict=True):
        measurement |= {"tip_offset_mm": offset, "tip_radius_mm": 1.5}
    bench.write(told)
    truth = [tip_mm(q, 400.5, offset) for q, offset in zip(ANGLES, offsets, strict=True)]
    np.testing.assert_allclose(vectors(bench.run(), "{}_new_mm"), truth, atol=2e-6)
    table = bench.folder / "m.csv"
    assert main(["export", str(bench.folder / "m.jsonl"), "-o", str(table)]) == 0
    np.testing.assert_allclose(vectors(bench.run(source="m.csv"), "{}_new_mm"), truth, atol=2e-6)


def test_a_missing_temperature_is_said_and_not_made_up(bench: Bench) -> None:
    grows = Temperature(weights={"t1": 1.0})
    bench.calibrate([Term(parameter="a_2", basis=[grows], coefficient=0.005)])
    told = measurements()
    told[3]["temperatures_c"] = {"t1": None}
    bench.write(told)
    rows = bench.run()
    assert rows[3]["x_new_mm"] == rows[3]["distance_mm"] == rows[3]["u_x_new_mm"] == ""
    assert int(rows[3]["flags_new"]) & 5 == 5  # invalid, stale
    assert rows[4]["x_new_mm"] != ""


def test_pressed_in_vain_is_told(bench: Bench, capsys: pytest.CaptureFixture[str]) -> None:
    told = measurements()
    told[0] |= {"angles_rad": None, "position_mm": None, "rates_rad_s": None}
    bench.write(told)
    assert len(bench.run()) == 19
    assert "1 measurement without angles left out" in capsys.readouterr().out


def test_report(bench: Bench) -> None:
    report = bench.folder / "r.html"
    bench.run("--tolerance", "0.1", "--report", str(report))
    page = report.read_text()
    assert "Measurements that move by more than 0.1 mm" in page and "20 measurements" in page
    for name in ("arm.toml", "new.json", "m.jsonl"):  # what it was made from
        assert hashlib.sha256((bench.folder / name).read_bytes()).hexdigest() in page
    assert "TEST-" in page and "Checked by" in page and __version__ in page
    assert "not stated" in page  # who corrected again


def test_how_far_a_position_was_off_at_most(bench: Bench) -> None:
    """The link is 0.5 mm longer, known to 0.01 mm: with 95 % it is 0.5196 mm longer at most."""
    told = measurements()
    told[3]["calibration"] = "00112233aabbccdd"
    bench.write(told)
    report = bench.folder / "r.html"
    options = ("--tolerance", "0.51", "--operator", "A. Body", "--report", str(report))
    at_most_mm = [float(row["at_most_mm"]) for row in bench.run(*options)]
    worst = [np.linalg.norm(tip_mm(q, 400.5196) - tip_mm(q, 400.0)) for q in ANGLES]
    np.testing.assert_allclose(at_most_mm, worst, atol=1e-5)
    page = report.read_text()
    assert "0 by more than 0.51 mm, 20 more possibly" in page
    assert "off by at most 0.5196 mm (95 %)" in page
    assert "A. Body" in page and "00112233aabbccdd" in page

    bench.calibrate(covariance_of=[], covariance=[])
    assert {row["at_most_mm"] for row in bench.run("--force")} == {""}  # no uncertainty stated


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="no Chromium to print with")
def test_the_page_as_pdf(bench: Bench) -> None:
    bench.run("--pdf", str(bench.folder / "r.pdf"))
    assert (bench.folder / "r.pdf").read_bytes().startswith(b"%PDF-")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"angles_rad": [0.0] * 6}, ["angles_rad", "found 6 of seq 0", "expected 3"]),
        ({"temperatures_c": {"other": 20.0}}, ["temperature t1", "other"]),
        ({"temperatures_c": {"t1": 293.15}}, ["temperature t1: found 293.15 of seq 0", "°C"]),
        ({"flags": "x"}, ["line 1: flags", "'x'"]),
    ],
)
def test_faults_are_named(
    bench: Bench, capsys: pytest.CaptureFixture[str], changes: dict[str, Any], words: list[str]
) -> None:
    bench.write(measurements(**changes))
    assert bench.call() == 2
    told = capsys.readouterr().err
    assert all(word in told for word in ["m.jsonl", *words]), told
    assert not (bench.folder / "out.csv").exists()


def test_brackets_without_end_are_no_measurement(
    bench: Bench, capsys: pytest.CaptureFixture[str]
) -> None:
    (bench.folder / "m.jsonl").write_text("[" * 200_000 + "\n")
    assert bench.call() == 2
    assert "m.jsonl: line 1: found" in capsys.readouterr().err


@pytest.mark.parametrize("source", ["m.jsonl", "m.csv", "log"])
def test_whose_measurements_they_are(
    bench: Bench, capsys: pytest.CaptureFixture[str], source: str
) -> None:
    """Another arm's with as many joints and the same sensors: nothing else would tell."""

    def call(told: list[dict[str, Any]], folder: str = "A%2F1") -> tuple[int, str]:
        bench.write(told)
        lines = bench.folder / "m.jsonl"
        if source == "m.csv":
            assert main(["export", str(lines), "-o", str(bench.folder / source), "--force"]) == 0
        capsys.readouterr()
        name = source
        if source == "log":
            name = f"measurements/{folder}"
            (bench.folder / name).mkdir(parents=True, exist_ok=True)
            shutil.copy(lines, bench.folder / name / "000001.jsonl")
        code = bench.call("--force", source=name)
        return code, "".join(capsys.readouterr())

    bench.rename("A/1")
    ours, nobodys = measurements(serial="A/1"), measurements()
    others = [*ours[:-1], ours[-1] | {"serial": "A/2"}]
    assert call(ours)[0] == 0 and call(ours, "copied")[0] == 0
    code, said = call(others)
    assert code == 2
    assert f"serial of seq 19: found A/2, expected A/1, as {bench.folder / 'arm.toml'} has" in said
    code, said = call([*ours[:8], *nobodys[8:]])
    sentence = "12 measurements without the serial number of an arm"
    assert code == 0 and said.count(sentence) == (source != "log")  # the folder is called by it
    if source == "log":
        assert call(nobodys)[0] == 0
        code, said = call(nobodys, "copied again")
        assert code == 2 and "found copied again, expected A/1" in said


def test_nothing_to_recorrect_is_an_empty_table(bench: Bench) -> None:
    bench.write([])
    assert bench.run() == []


@pytest.mark.slow
def test_what_a_daemon_measured_is_found_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its own log, under the geometry it measured with: old and new agree."""
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    with (
        simulated_arm(tmp_path, seconds=60) as arm,
        running_daemon(tmp_path, arm.port) as daemon,
        daemon.listen() as heard,
    ):
        heard.wait_for(lambda: len(heard.json("measurement")) > 1)
    save_calibration(tmp_path / "same.json", drawn(load_arm(arm.arm_toml)))
    log = tmp_path / "state" / "measurements" / "SIM-0001"
    files = ["--arm", str(arm.arm_toml), "--calibration", str(tmp_path / "same.json")]
    assert main(["recorrect", str(log), *files, "-o", str(tmp_path / "out.csv")]) == 0
    rows = list(csv.DictReader((tmp_path / "out.csv").read_text().splitlines()))
    assert len(rows) > 1
    told = [json.loads(line) for line in (log / "000001.jsonl").read_text().splitlines()]
    assert {line["serial"] for line in told} == {"SIM-0001"}
    assert max(float(row["distance_mm"]) for row in rows) < 1e-3
