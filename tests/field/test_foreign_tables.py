"""Tables that people have, each with its right answer in its README: beside it, other numbers."""

from __future__ import annotations

import math
import re
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.model.arm import load_arm
from armd.daemon.cli import main

FIELD = Path(__file__).parent
#: The four rows of `tables/`, in degrees.
ROWS = [[12.5, -33.1, 41.7], [14.5, -30.1, 40.2], [-7.25, 11.0, -5.5], [20.0, 8.25, 63.0]]


class Importer:
    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self.capsys = folder, capsys

    def run(self, table: Path, arm: Path, *options: str) -> tuple[int, str]:
        words = ["import", str(table), "--arm", str(arm), "-o", str(self.folder / "out")]
        code = main([*words, *options])
        said = self.capsys.readouterr()
        return code, said.out + said.err

    def field(self, name: str, *options: str) -> tuple[int, str]:
        folder = (FIELD / name).parent if Path(name).suffix else FIELD / name
        table = FIELD / name if Path(name).suffix else folder / "readings.csv"
        return self.run(table, folder / "arm.toml", *options)

    def text(self, text: str, arm: Path, *options: str) -> tuple[int, str]:
        (self.folder / "t.csv").write_text(text, encoding="utf-8")
        return self.run(self.folder / "t.csv", arm, *options)

    def session(self, arm: Path) -> Session:
        return load_session(self.folder / "out", load_arm(arm))


@pytest.fixture
def importer(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Importer:
    return Importer(tmp_path, capsys)


THREE, FIVE = FIELD / "tables" / "arm.toml", FIELD / "zero-based-joints" / "arm.toml"
SERVOS = FIELD / "temperature-names" / "arm.toml"


# --- joints that count from 0 --------------------------------------------------------------------


def test_joints_that_count_from_0(importer: Importer) -> None:
    code, said = importer.field("zero-based-joints")
    assert code == 0, said
    session = importer.session(FIVE)
    assert session.states.q[0].tolist() == [-0.829, -0.526, 0.603, 0.164, -0.812]
    assert (session.states.time_s - session.started_unix_s).tolist() == [0.0, 1.5, 3.0]
    assert "count from 0" in said and "left out: joint_5" in said


@pytest.mark.parametrize(
    "form", ["q{}", "j{}", "actual_q_{}", "q[{}]", "Axis {} [rad]", "joint{}_pos"]
)
def test_any_name_that_counts_from_0(importer: Importer, form: str) -> None:
    """q0…q4 have names of the session's own among them: q1 is joint 2."""
    text = ",".join(form.format(k) for k in range(5)) + "\n0.1,0.2,0.3,0.4,0.5\n"
    code, said = importer.text(text, FIVE)
    assert code == 0, said
    assert importer.session(FIVE).states.q.tolist() == [[0.1, 0.2, 0.3, 0.4, 0.5]]


def test_what_was_commanded_is_no_reading(importer: Importer) -> None:
    """Universal Robots' RTDE writes both, with rates and currents that count alike."""
    names = [f"{what}_{k}" for what in ("target_q", "actual_q", "actual_qd", "actual_current")
             for k in range(5)]  # fmt: skip
    values = [str(i / 100) for i in range(20)]
    code, said = importer.text(" ".join(names) + "\n" + " ".join(values) + "\n", FIVE)
    assert code == 0, said
    states = importer.session(FIVE).states
    assert states.q.tolist() == [[0.05, 0.06, 0.07, 0.08, 0.09]]
    assert states.rate.tolist() == [[0.1, 0.11, 0.12, 0.13, 0.14]]


def test_a_joint_that_is_missing_is_not_made_up(importer: Importer) -> None:
    code, said = importer.text("joint_0,joint_1,joint_2,joint_4\n1,2,3,4\n", FIVE)
    assert code == 2 and "q4: found no such column" in said


# --- temperatures --------------------------------------------------------------------------------


def test_a_servos_temperature_is_the_one_of_its_number(importer: Importer) -> None:
    code, said = importer.field("temperature-names")
    assert code == 0, said
    assert importer.session(SERVOS).states.temperature_c[0].tolist() == [32, 33, 34, 35, 36]
    assert "left out: Temp 1" in said


@pytest.mark.parametrize("form", ["T{}", "servo {} temperature [°C]", "motor_{}_temp", "Servo{}"])
def test_any_name_with_the_number(importer: Importer, form: str) -> None:
    names = [f"q{k}" for k in range(1, 6)] + [form.format(k) for k in (6, 5, 4, 3, 2, 1)]
    values = ["1", "2", "3", "4", "50", "26", "25", "24", "23", "22", "21"]
    code, said = importer.text(",".join(names) + "\n" + ",".join(values) + "\n", SERVOS)
    assert code == 0, said
    assert importer.session(SERVOS).states.temperature_c[0].tolist() == [22, 23, 24, 25, 26]


def test_temperatures_that_may_be_anybodys_are_asked_about(importer: Importer) -> None:
    joints = ",".join(f"q{k}" for k in range(1, 6))
    zero = ",".join(f"Temp {k}" for k in range(6))
    code, said = importer.text(f"{joints},{zero}\n1,2,3,4,50,21,22,23,24,25,26\n", SERVOS)
    assert code == 2 and "expected the numbers of servo2" in said
    five = ",".join(f"Temp {k}" for k in range(1, 6))  # servo 1 to 5, or the five sensors?
    code, said = importer.text(f"{joints},{five}\n1,2,3,4,50,21,22,23,24,25\n", SERVOS)
    assert code == 2 and "which is which: --column servo2=HEADER" in said
    code, said = importer.text(f"{joints},Temp 0,Temp 2\n1,2,3,4,50,21,22\n", SERVOS)
    assert code == 2 and "found numbers from 0, expected numbers as in servo2" in said
    arm = importer.folder / "named.toml"
    text = SERVOS.read_text()
    for k, name in enumerate(("waist", "lift", "bend", "nod", "roll"), 2):
        text = text.replace(f"servo{k}", name)
    arm.write_text(text)
    six = ",".join(f"Temp {k}" for k in range(1, 7))
    code, said = importer.text(f"{joints},{six}\n1,2,3,4,50,21,22,23,24,25,26\n", arm)
    assert code == 2 and "which is which: --column waist=HEADER" in said


def test_a_sensor_without_a_column_is_reported(importer: Importer) -> None:
    """As when its column is taken for the artefact's by an option."""
    text = "J1,J2,J3,T1\n12.5,-33.1,41.7,22.5\n"
    code, said = importer.text(text, THREE, "--column", "artefact_c=T1")
    assert code == 0 and "no column for the sensor t1: missing temperatures" in said


# --- time or temperature -------------------------------------------------------------------------


def test_a_column_t_is_asked_about(importer: Importer) -> None:
    code, said = importer.field("tables/T-column.csv")
    assert code == 2
    assert "column T: found a name that may mean time or temperature, expected which:" in said
    assert "--column time_s=T, or --column t1=T" in said
    code, said = importer.field("tables/T-column.csv", "--column", "t1=T")
    assert code == 0
    assert importer.session(THREE).states.temperature_c[:, 0].tolist() == [22.5, 22.6, 22.7, 22.8]


def test_a_column_t_of_an_arm_without_sensors(importer: Importer) -> None:
    """It is no time because nothing else is there to be."""
    code, said = importer.text("J1,J2,J3,J4,J5,T\n1,2,3,4,50,22.5\n", FIVE)
    assert code == 2 and "--column time_s=T, or --column artefact_c=T" in said
    code, said = importer.text("J1,J2,J3,J4,J5,t\n1,2,3,4,50,22.5\n", FIVE)
    assert code == 0 and "time_s is the column 't'" in said


@pytest.mark.parametrize(
    ("header", "values", "times"),
    [
        ("J1,J2,J3,T [°C]", (22.5, 22.6), None),
        ("J1,J2,J3,T,time", (22.5, 22.6), (3.0, 4.0)),
        ("J1,J2,J3,T,t", (22.5, 22.6), (0.0, 4.0)),
        ("J1,J2,J3,T1,T", (22.5, 22.6), (3.0, 4.0)),
        ("J1,J2,J3,Temperature", (22.5, 22.6), None),
    ],
)
def test_what_t_is_where_the_table_tells(
    importer: Importer, header: str, values: tuple[float, float], times: tuple[float, float] | None
) -> None:
    rows = [ROWS[0], ROWS[1]]
    lines = []
    for row, value, time in zip(rows, values, times or ("", ""), strict=True):
        cells = [*row, value] + ([time] if times else [])
        lines.append(",".join(map(str, cells)))
    code, said = importer.text(header + "\n" + "\n".join(lines) + "\n", THREE)
    assert code == 0, said
    session = importer.session(THREE)
    assert session.states.temperature_c[:, 0].tolist() == list(values)
    if times:
        assert (session.states.time_s - session.started_unix_s).tolist() == list(times)


def test_a_temperature_with_its_unit(importer: Importer) -> None:
    assert importer.field("tables/T-unit.csv")[0] == 0
    session = importer.session(THREE)
    assert session.states.temperature_c[:, 0].tolist() == [22.5, 22.6, 22.7, 22.8]
    assert np.isnan(session.states.time_s).all()


# --- dialects ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "name",
    [
        "spaces.txt",
        "units-row.csv",
        "dates.csv",
        "epoch.csv",
        "minus-sign.csv",
        "not-available.csv",
    ],
)
def test_one_table_as_programs_write_it(importer: Importer, name: str) -> None:
    code, said = importer.field(f"tables/{name}")
    assert code == 0, said
    session = importer.session(THREE)
    assert np.degrees(session.states.q) == pytest.approx(np.array(ROWS), abs=1e-12)
    seconds = session.states.time_s - session.started_unix_s
    if name in ("spaces.txt", "units-row.csv"):
        assert seconds.tolist() == [0.0, 0.5, 1.0, 1.5]
    if name == "dates.csv":
        assert seconds.tolist() == [0.0, 7.0, 14.0, 21.0]
        assert session.started_unix_s == 1772355600.0  # date -u -d 2026-03-01T09:00:00 +%s
    if name == "epoch.csv":
        assert seconds.tolist() == [0.0, 1.5, 3.0, 4.5]
        assert session.started_unix_s == 1764000000.0
    if name == "not-available.csv":
        celsius = session.states.temperature_c[:, 0]
        assert np.isnan(celsius).tolist() == [False, False, True, False]


@pytest.mark.parametrize("name", ["no-header.csv", "no-header-commas.csv"])
def test_a_table_without_a_header(importer: Importer, name: str) -> None:
    code, said = importer.field(f"tables/{name}")
    assert code == 2
    assert "line 1: found numbers and no header, expected a header: write a first line" in said
    assert "q1,q2,q3" in said


def test_joints_that_are_named_in_cells(importer: Importer) -> None:
    code, said = importer.field("tables/ros-topic.csv")
    assert code == 2
    assert "field.position0 is elbow, field.position1 is shoulder_lift" in said


def test_joints_of_a_known_arm_that_are_named_in_cells(importer: Importer) -> None:
    joints = ["elbow_flex", "shoulder_lift", "shoulder_pan", "wrist_flex", "wrist_roll"]
    header = [f"field.name{k}" for k in range(5)] + [f"field.position{k}" for k in range(5)]
    rows = [[*joints, "0.3", "0.2", "0.1", "0.4", "0.5"], [*joints, "1", "1", "1", "1", "1"]]
    code, said = importer.text("\n".join(map(",".join, [header, *rows])), FIVE)
    assert code == 0, said
    assert importer.session(FIVE).states.q[0].tolist() == [0.1, 0.2, 0.3, 0.4, 0.5]
    rows[1][0] = "shoulder_pan"  # another joint in another row: no column is any joint's
    code, said = importer.text("\n".join(map(",".join, [header, *rows])), FIVE)
    assert (code, "q1: found no such column" in said) == (2, True)


@pytest.mark.parametrize(
    ("text", "seconds", "started"),
    [
        ("Time\n2026/03/01 09:00\n2026/03/01 09:01\n", [0, 60], 1772355600),
        ("Time\n01.03.2026 09:00:00,5\n01.03.2026 09:00:02\n", [0, 1.5], 1772355600.5),
        ("Time\n2026-03-01T10:00:00+01:00\n2026-03-01T10:00:09+01:00\n", [0, 9], 1772355600),
        ("Time\n3/25/2026 9:00:00 PM\n3/25/2026 9:00:03 PM\n", [0, 3], 1774472400),
        ("Time\n23:59:58\n00:00:01\n", [0, 3], None),
        ("Date;Time\n2026-03-01;09:00:00\n2026-03-01;09:00:04\n", [0, 4], 1772355600),
        ("stamp_ns\n1764000000000000000\n1764000000250000000\n", [0, 0.25], 1764000000),
        ("time\n1764000000000\n1764000000250\n", [0, 0.25], 1764000000),
        ("time [ms]\n0\n250\n", [0, 0.25], None),
    ],
)
def test_any_way_to_say_when(
    importer: Importer, text: str, seconds: list[float], started: float | None
) -> None:
    """The instants are `date -u -d … +%s`."""
    head, *lines = text.splitlines()
    rows = zip(lines, ("12,5;-33,1;41,7", "14,5;-30,1;40,2"), strict=True)
    table = f"{head};J1;J2;J3\n" + "".join(f"{a};{b}\n" for a, b in rows)
    code, said = importer.text(table, THREE)
    assert code == 0, said
    session = importer.session(THREE)
    assert (session.states.time_s - session.started_unix_s).tolist() == pytest.approx(seconds)
    if started is not None:
        assert session.started_unix_s == started


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("Time,J1,J2,J3\n3/4/2026 9:00,1,2,40\n", "which of these is the month?"),
        ("Time,J1,J2,J3\nsoon,1,2,40\n", "found 'soon', expected seconds, or a date and time"),
        ("time,J1,J2,J3\ninf,1,2,40\n", "expected a finite number"),
        ("J1 [grad],J2 [grad],J3 [grad]\n1,2,40\n", "the unit 'grad', expected one of deg"),
        ("J1;J2;J3\nGrad;Grad;Grad\n1;2;40\n", "line 2: found no numbers (Grad, Grad, Grad)"),
        ("J1,J2,J3,t1\n1,2,40,#VALUE!\n", "found '#VALUE!', expected a number"),
        ("J1,J2,J3,Point\n1,2,40,\n", "row 1, column Point: found '', expected the name of a"),
        (f"J1,J2,J3,note\n1,2,40,{'x' * 40_000}\n", "found a cell of 40000 letters"),
        (",".join(f"c{k}" for k in range(20_000)) + "\n", "found 20000 columns, expected 16384"),
    ],
)
def test_what_cannot_be_meant(importer: Importer, text: str, said: str) -> None:
    code, told = importer.text(text, THREE)
    assert code == 2 and said in told
    assert len(told) < 1000 and not (importer.folder / "out").exists()


@pytest.mark.parametrize(
    ("unit", "factor"), [("mdeg", 1000.0), ("rev", 1 / 360), ("gon", 1 / 0.9), ("mrad", None)]
)
def test_angles_in_other_units(importer: Importer, unit: str, factor: float | None) -> None:
    scale = factor or 1000.0 * math.pi / 180
    cells = ",".join(repr(value * scale) for value in ROWS[0])
    code, said = importer.text(f"J1 [{unit}],J2 [{unit}],J3 [{unit}]\n{cells}\n", THREE)
    assert code == 0, said
    assert np.degrees(importer.session(THREE).states.q)[0] == pytest.approx(ROWS[0])


# --- LeRobot's logs ------------------------------------------------------------------------------


LEROBOT = FIELD / "lerobot-normalised"
WHOLE = FIELD / "lerobot-wrapped-sweep" / "whole.json"


def test_positions_of_lerobot_are_asked_about(importer: Importer) -> None:
    names = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
    options = [f"--column=q{k}={name}.pos" for k, name in enumerate(names, 1)]
    for given in ([], options):
        code, said = importer.field("lerobot-normalised", *given)
        assert code == 2 and "found LeRobot's positions, 82.87 at most" in said
        assert "--angle-unit deg" in said and "--lerobot CALIBRATION.json" in said
    bare = (LEROBOT / "readings.csv").read_text().replace(".pos", "")
    code, said = importer.text(bare, LEROBOT / "arm.toml")
    assert code == 2 and "found LeRobot's positions" in said
    code, said = importer.field("lerobot-normalised", "--angle-unit", "deg")
    assert code == 0
    first = np.degrees(importer.session(LEROBOT / "arm.toml").states.q[0])
    assert first == pytest.approx([-82.87, -52.638, 60.255, 16.432, -81.174])


def test_positions_of_lerobot_are_the_servos_counts(
    importer: Importer, capsys: pytest.CaptureFixture[str]
) -> None:
    """The same pose by LeRobot's own arithmetic: the raw position, as `_unnormalize` has it."""
    arm = importer.folder / "arm.toml"
    assert main(["arm", "import-lerobot", str(WHOLE), "-o", str(arm)]) == 0
    table = LEROBOT / "readings.csv"
    serial = load_arm(arm)
    assert importer.run(table, arm, "--lerobot", str(WHOLE))[0] == 0
    q = np.degrees(importer.session(arm).states.q[0])
    raw = (-82.870 + 100) / 200 * (3402 - 760) + 760
    assert q[0] == pytest.approx(serial.joint[0].direction * (raw - 2048) * 360 / 4096)
    assert re.search(r"became counts of its servos", capsys.readouterr().out) is None


# --- the artefact --------------------------------------------------------------------------------


def test_a_certificates_table_is_the_artefact(importer: Importer) -> None:
    certificate = importer.folder / "beam.csv"
    certificate.write_text(
        "Certificate;K-117;;;\nBall;X [mm];Y [mm];Z [mm];U [µm]\n"
        "B1;0,0000;0;0;1,0\nB2;500,0012;0,003;0;1,2\n"
    )
    text = "J1,J2,J3,Which\n12.5,-33.1,41.7,B2\n14.5,-30.1,40.2,B1\n"
    code, said = importer.text(text, THREE, "--artefact", str(certificate))
    assert code == 0, said
    artefact = importer.session(THREE).artefact
    assert artefact.positions_mm().tolist() == [[0, 0, 0], [500.0012, 0.003, 0]]
    # U is an expanded uncertainty, k = 2 (GUM 6.2.1)
    assert [t.standard_uncertainty_mm for t in artefact.targets] == pytest.approx([5e-4, 6e-4])
    assert "target is the column 'Which'" in said and "halved (k = 2)" in said


def test_a_table_of_lengths_is_the_artefact(importer: Importer) -> None:
    certificate = importer.folder / "bar.csv"
    certificate.write_text("from,to,length [in],u [mm]\nS1,S2,10,0.001\n")
    text = "J1,J2,J3,ball\n12.5,-33.1,41.7,S1\n14.5,-30.1,40.2,S2\n"
    code, said = importer.text(text, THREE, "--artefact", str(certificate))
    assert code == 0, said
    (distance,) = importer.session(THREE).artefact.distances
    assert (distance.length_mm, distance.standard_uncertainty_mm) == (254.0, 0.001)


def test_a_target_that_no_column_says_is_asked_for(importer: Importer) -> None:
    certificate = importer.folder / "beam.csv"
    certificate.write_text("name,x,y,z\nB1,0,0,0\nB2,500,0,0\n")
    code, said = importer.text(
        "J1,J2,J3,Nr\n1,2,40,1\n", THREE, "--artefact", str(certificate)
    )  # fmt: skip
    assert code == 2
    assert "target: found no such column among J1, J2, J3, Nr" in said and "'1'" not in said
    certificate.write_text("name,a,b\nB1,0,0\n")
    code, said = importer.text("J1,J2,J3\n1,2,40\n", THREE, "--artefact", str(certificate))
    assert code == 2 and "expected columns name, x, y, z, or from, to, length" in said
