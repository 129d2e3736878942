"""`armd import`: tables as other programs write them, and drawings as URDF."""

from __future__ import annotations

import io
import tomllib
from pathlib import Path
from xml.etree import ElementTree as Xml

import numpy as np
import openpyxl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from armd.compensation.data.foreign.table import read_table
from armd.compensation.data.sessions.session import Session, load_session
from armd.compensation.model.arm import load_arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.cli import main
from armd.daemon.config import load_config
from support.plain_urdf import tip_poses

ARM = (
    """
schema = "armd.arm/1"
serial_number = "A-1"
[[temperature_sensor]]
name = "elbow"
[[temperature_sensor]]
name = "wrist"
"""
    + 3 * "[[joint]]\na_mm = 300.0\ncounts_per_turn = 4096\ntemperature = 'elbow'\n"
)
URDF = Path(__file__).parents[2] / "real" / "data" / "ball_in_socket" / "urdf"


class Bench:
    def __init__(self, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
        self.folder, self.capsys = folder, capsys
        (folder / "arm.toml").write_text(ARM)

    def run(self, name: str, *options: str) -> tuple[int, str]:
        words = ["import", str(self.folder / name), "-o", str(self.folder / "out"), *options]
        if "--arm" not in options:
            words += ["--arm", str(self.folder / "arm.toml")]
        code = main(words)
        told = self.capsys.readouterr()
        return code, told.out + told.err

    def session(self) -> Session:
        return load_session(self.folder / "out", load_arm(self.folder / "arm.toml"))


@pytest.fixture
def bench(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Bench:
    return Bench(tmp_path, capsys)


def test_a_table_is_never_written_over_by_its_own_session(bench: Bench) -> None:
    (bench.folder / "out").mkdir()
    table = bench.folder / "out" / "readings.csv"
    table.write_text("q1,q2,q3,what only this table has\n1,2,3,4\n")
    before = table.read_bytes()
    for force in ((), ("--force",)):
        code, told = bench.run("out/readings.csv", *force)
        assert code == 2 and ("an input of this run" in told or not force)
    assert table.read_bytes() == before and len(list(table.parent.iterdir())) == 1


def test_what_a_german_excel_writes(bench: Bench) -> None:
    text = (
        "Messung vom 1. März;;;;;;\r\n"
        "Achse 1 [°];Achse 2 [°];Achse 3 [°];Kugel;Temp 1 (°C);Bemerkung;wrist [F]\r\n"
        "10,5;-20,25;30;K1;21,5;gut;68\r\n"
        "\r\n"
        "11,5;-21,25;31;K2;22,5;;\r\n"
    )
    (bench.folder / "r.csv").write_bytes(text.encode("cp1252"))
    code, told = bench.run("r.csv", "--started", "2026-03-01T09:00")
    assert code == 0, told
    session = bench.session()
    assert np.degrees(session.states.q).tolist() == [
        pytest.approx([10.5, -20.25, 30]), pytest.approx([11.5, -21.25, 31]),
    ]  # fmt: skip
    assert session.states.temperature_c[:, 0].tolist() == [21.5, 22.5]
    assert session.states.temperature_c[0, 1] == pytest.approx(20.0)  # 68 °F
    assert np.isnan(session.states.temperature_c[1, 1])
    assert session.artefact.target_names == ["K1", "K2"]
    for sentence in (
        "cp1252", "separated by semicolons", "decimal comma", "line 2 is the header",
        "q1 is the column 'Achse 1 [°]', in deg", "left out: Bemerkung", "wrist is the column",
        "no column for the placement", "fixed points at unknown places", "2 readings, 2 targets",
    ):  # fmt: skip
        assert sentence in told


def test_a_workbook_in_inches(bench: Bench) -> None:
    book = openpyxl.Workbook()
    book.active.append(["notes"])
    sheet = book.create_sheet("Data")
    sheet.append(["Time (min)", "J1 (rad)", "J2 (rad)", "J3 (rad)", "X (in)", "Y (in)", "Z (in)"])
    sheet.append([0.5, 0.1, 0.2, 0.3, 1, 2, 3])
    book.save(bench.folder / "r.xlsx")
    code, told = bench.run("r.xlsx", "--sheet", "Data")
    assert code == 0, told
    session = bench.session()
    assert session.states.q.tolist() == [[0.1, 0.2, 0.3]]
    assert session.truth_mm.tolist() == [pytest.approx([25.4, 50.8, 76.2])]
    assert session.states.time_s[0] - session.started_unix_s == pytest.approx(30.0)
    assert "x_mm is the column 'X (in)', in in" in told
    assert bench.run("r.xlsx", "--sheet", "Dat")[1].startswith("armd: ")


def test_a_workbook_whose_numbers_are_text_with_a_comma(bench: Bench) -> None:
    book = openpyxl.Workbook()
    book.active.append(["J1 (°)", "J2 (°)", "J3 (°)"])
    book.active.append(["-178,059226", "0,5", "12"])
    book.save(bench.folder / "r.xlsx")
    code, told = bench.run("r.xlsx")
    assert code == 0 and "numbers have a decimal comma" in told
    assert np.degrees(bench.session().states.q).tolist() == [pytest.approx([-178.059226, 0.5, 12])]


def test_rates_in_degrees_and_temperatures_that_the_arm_has_no_sensor_for(bench: Bench) -> None:
    (bench.folder / "r.csv").write_text(
        "J1 [deg],J2 [deg],J3 [deg],Rate 1 [deg/s],w2,Temp 9 [°C],Artefact temp [°C]\n"
        "1,2,300,90,0.5,21,22\n"
    )
    code, told = bench.run("r.csv")
    assert code == 0, told
    states = bench.session().states
    assert states.rate[0, :2].tolist() == [pytest.approx(np.pi / 2), 0.5]
    assert bench.session().artefact_c.tolist() == [22.0]
    assert "w1 is the column 'Rate 1 [deg/s]', in deg/s" in told
    assert "column" not in bench.run("r.csv", "--force", "--quiet")[1]
    assert "Temp 9 [°C]: temperatures without a sensor; the arm.toml has only" in told
    (bench.folder / "r.csv").write_text("J1 [deg],J2 [deg],J3 [deg],Rate 1 [1/h]\n1,2,300,9\n")
    assert "the unit '1/h', expected one of rad/s, deg/s" in bench.run("r.csv")[1]


def test_named_columns_and_an_artefact(bench: Bench) -> None:
    (bench.folder / "r.txt").write_text("base\tJ2\tJ3\tball\n1\t2\t400\tB1\n")
    (bench.folder / "beam.toml").write_text(
        "[artefact]\nname = 'beam'\n"
        "[[artefact.target]]\nname = 'B1'\nposition_mm = [1.0, 2.0, 3.0]\n"
    )
    beam = ("--artefact", str(bench.folder / "beam.toml"))
    assert "q1: found no such column among base, J2, J3, ball" in bench.run("r.txt", *beam)[1]
    code, told = bench.run("r.txt", *beam, "--column", "q1=base")
    assert code == 0 and "angles are in deg: the largest is 400" in told
    assert bench.session().artefact.positions_mm().tolist() == [[1.0, 2.0, 3.0]]
    assert "not empty" in bench.run("r.txt", *beam, "--column", "q1=base")[1]


@pytest.mark.parametrize("above", ["Arm;7\n", "Made by;lab\nDate;2. March;2026\n\n", ""])
def test_the_header_is_found_below_what_a_program_says_of_itself(bench: Bench, above: str) -> None:
    table = "q1;q2;q3;ball;note\n1,5;2;40;left;first\n1,5;3;50;right;\n"
    (bench.folder / "r.csv").write_text(above + table)
    code, told = bench.run("r.csv", "--angle-unit", "deg")
    assert code == 0
    assert bench.session().n == 2
    line = above.count("\n") + 1
    assert (f"line {line} is the header; lines above it are skipped" in told) == bool(above)


def test_an_artefact_of_which_only_a_length_is_known(bench: Bench) -> None:
    (bench.folder / "r.csv").write_text("q1,q2,q3,ball\n1,2,40,left\n1,3,50,right\n")
    (bench.folder / "bar.toml").write_text(
        "[artefact]\nname = 'bar'\n[[artefact.distance]]\n"
        "between = ['left', 'right']\nlength_mm = 500.0\n"
    )
    bar = ("--artefact", str(bench.folder / "bar.toml"), "--operator", "A. Smith")
    assert bench.run("r.csv", *bar)[0] == 0
    session = bench.session()
    assert session.artefact.target_names == ["left", "right"]
    assert session.artefact.distances[0].length_mm == 500.0
    written = tomllib.loads((bench.folder / "out" / "session.toml").read_text())
    assert written["operator"] == "A. Smith"
    # What reads the folder need not know that they may be left out.
    assert [target["name"] for target in written["artefact"]["target"]] == ["left", "right"]
    (bench.folder / "r.csv").write_text("q1,q2,q3,ball\n1,2,40,left\n1,3,50,rihgt\n")
    said = "found 'rihgt', expected a target of the artefact: did you mean right?"
    assert said in bench.run("r.csv", *bar, "--force")[1]


@pytest.mark.parametrize(
    ("text", "options", "said"),
    [
        ("q1,q2,q3\n1,2,x\n", (), "row 1, column q3: found 'x', expected a number"),
        ("q1,q2,q3\n1,2,5000\n", (), "found 5000, expected --angle-unit"),
        ("q1 [deg],q2 [rad],q3\n1,2,3\n", (), "found deg and rad, expected one unit"),
        ("q1,j1,q2,q3\n1,2,3,4\n", (), "two columns, 'q1' and 'j1'"),
        ("q1,q2,q3,x [parsec],y,z\n1,2,3,4,5,6\n", (), "the unit 'parsec'"),
        ("q1,q2,q3\n", (), "found no rows"),
        ("", (), "found no rows"),
        ("q1,q2,q3\n1,2,3,4\n", (), "line 2: found 4 columns, expected 3"),
        ("q1,q2,q3\n1,2,3\n", ("--column", "q9=q1"), "expected a column"),
        ("q1,q2,q3\n1,2,3\n", ("--column", "q1=Q"), "--column: found 'Q'"),
        ("q1,q2,q3,elbow\n1,2,3,900\n", (), "a temperature in °C"),
    ],
)
def test_what_cannot_be_meant(bench: Bench, text: str, options: tuple[str, ...], said: str) -> None:
    (bench.folder / "r.csv").write_text(text)
    code, told = bench.run("r.csv", *options)
    assert (code, told.count("\n")) == (2, 1)
    assert (said in told and f"{bench.folder / 'r.csv'}" in told) or "command line" in told
    assert not (bench.folder / "out").exists()


@given(
    st.sampled_from([(",", "."), (";", ","), (";", "."), ("\t", ","), ("|", ",")]),
    st.lists(st.tuples(*[st.integers(-(10**6), 10**6)] * 3), min_size=1, max_size=6),
)
@settings(deadline=None, max_examples=40)
def test_any_dialect_gives_the_same_numbers(
    tmp_path_factory: pytest.TempPathFactory,
    dialect: tuple[str, str],
    rows: list[tuple[int, int, int]],
) -> None:
    mark, point = dialect
    path = tmp_path_factory.mktemp("table") / "t.csv"
    lines = [mark.join(("q1", "q2", "q3"))]
    lines += [mark.join(f"{n / 1000:.3f}".replace(".", point) for n in row) for row in rows]
    path.write_text("\n".join(lines) + "\n")
    read = [[float(cell) for cell in row] for row in read_table(path).rows]
    assert read == [[n / 1000 for n in row] for row in rows]


@pytest.mark.parametrize(("name", "link"), [("panda", "panda_link8"), ("iiwa14", "ball_link")])
def test_a_urdf_moves_as_its_own_chain_does(bench: Bench, name: str, link: str) -> None:
    """The tip by the URDF's own transformations, joint by joint, against arm.toml's rows."""
    path = URDF / f"{name}.urdf"
    out = bench.folder / "robot.toml"
    assert main(["import", str(path), "-o", str(out), "--tip-link", link]) == 0
    arm = load_arm(out)
    q = np.random.default_rng(3).uniform(-2, 2, (40, arm.n_joints))
    ours = compute_pose(q, arm.nominal())[0]
    theirs = tip_poses(Xml.parse(path).getroot(), q, link)[:, :3, 3]
    turn, rest = Rotation.align_vectors(theirs - theirs.mean(0), ours - ours.mean(0))
    assert rest < 1e-2  # mm over 40 points: these files print quarter turns to a few digits
    down = turn.as_matrix() @ np.array(arm.gravity)
    assert down == pytest.approx([0.0, 0.0, -1.0], abs=1e-6)
    assert arm.joint[1].min_deg is not None and arm.joint[1].min_deg < arm.joint[1].max_deg


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("<robot", "expected a URDF"),
        ("<robot><joint name='a' type='prismatic'><parent link='p'/><child link='c'/>"
         "</joint></robot>",
         "joint a: found the type 'prismatic'"),
        ("<robot/>", "the chain: found no joints"),
    ],
)  # fmt: skip
def test_what_is_no_arm(bench: Bench, text: str, said: str) -> None:
    (bench.folder / "r.urdf").write_text(text)
    code, told = bench.run("r.urdf")
    assert code == 2 and said in told


# --- armd init -----------------------------------------------------------------------------------


@pytest.mark.parametrize("start", ["so101", "panda", "rows.csv"])
def test_a_folder_to_start_from(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], start: str
) -> None:
    """What is written is accepted by `armd check`, and loads as the daemon's configuration."""
    (tmp_path / "rows.csv").write_text(
        "theta_deg;d_mm;a_mm;alpha_deg;min_deg;max_deg;temperature\n"
        "0;250,5;0;90;-170;170;foot\n90;0;400;0;;;elbow\n;0;350;;;;elbow\n"
    )
    source = {"panda": str(URDF / "panda.urdf"), "rows.csv": str(tmp_path / "rows.csv")}
    words = ["--from", source.get(start, start), "--serial-number", "MY-1", "--port", "/dev/none"]
    words += ["--tip-link", "panda_link8"] if start == "panda" else []
    folder = tmp_path / "mine"
    for _ in range(2):  # to write the same once more takes nothing away
        assert main(["init", str(folder), *words]) == 0
    assert main(["check", str(folder / "arm.toml"), str(folder / "armd.toml")]) == 0
    config = load_config(folder / "armd.toml")
    assert config.arm.serial_number == "MY-1" and config.driver.port == "/dev/none"
    assert (folder / "arm.toml").read_text().startswith("#")
    if start == "rows.csv":
        assert [joint.d_mm for joint in config.arm.joint] == [250.5, 0.0, 0.0]
        assert [joint.min_deg for joint in config.arm.joint] == [-170.0, None, None]
        assert config.arm.joint[2].counts_per_turn == 1 << 20
        assert config.arm.sensors == ["foot", "elbow"]
        assert [joint.temperature for joint in config.arm.joint] == ["foot", "elbow", "elbow"]
    (folder / "arm.toml").write_text("mine")
    assert main(["init", str(folder), *words]) == 2
    assert "--force to write over it" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "--from: found nothing"),
        (["--from", "so10"], "did you mean so101?"),
        (
            ["--from", "t.csv"],
            "the header: found 'tetha_deg', expected a key of a joint: did you mean",
        ),
        (["--from", "u.csv"], "column d [ft]: found the unit 'ft', expected one of mm, cm, m,"),
        (["--from", "n.csv"], "row 2, column d_mm: found 'long', expected a number"),
        (["--from", "l.csv"], "expected a column d_mm or a_mm: an arm without lengths"),
        (["--from", "a.csv"], "the header: found theta, d, a, expected a column alpha_deg too"),
        (["--from", "r.csv"], "column alpha: found angles of 1.5708 degrees at most, expected"),
        (["--from", "m.csv"], "the lengths: found 0.75 mm, all of d and a together, expected mm"),
        (["--from", "d.csv"], "d_mm: found two columns, 'd_mm' and 'd (in)', expected one"),
    ],
)
def test_init_without_sense(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str],
    words: list[str], said: str,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.stdin", io.StringIO())
    (tmp_path / "t.csv").write_text("tetha_deg,d_mm\n1,2\n")
    (tmp_path / "u.csv").write_text("theta,d [ft]\n1,2\n")
    (tmp_path / "n.csv").write_text("theta,d_mm,alpha\n1,2,0\n3,long,0\n")
    (tmp_path / "l.csv").write_text("theta,alpha\n1,2\n")
    (tmp_path / "a.csv").write_text("theta,d,a\n0,200,0\n0,0,300\n0,0,250\n")
    (tmp_path / "r.csv").write_text("d,a,alpha\n200,0,1.5708\n0,300,0\n0,250,-1.5708\n")
    (tmp_path / "m.csv").write_text("d,a,alpha\n0.2,0,90\n0,0.3,0\n0,0.25,0\n")
    (tmp_path / "d.csv").write_text("d_mm,d (in)\n1,2\n")
    assert main(["init", "mine", *words]) == 2
    assert said in capsys.readouterr().err
    assert not (tmp_path / "mine").exists()


def test_what_a_drawing_does_not_say_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "dh.csv").write_text("d;a (mm);alpha\n200;0;90\n0;300;\n0;250;0\n")
    words = ["init", str(tmp_path / "mine"), "--from", str(tmp_path / "dh.csv")]
    words += ["--serial-number", "A", "--port", "/dev/none"]
    assert main(words) == 0
    told = capsys.readouterr().out.splitlines()
    for sentence in (
        "d_mm is the column 'd', in mm: its header says no unit",
        "a_mm is the column 'a (mm)'",
        "alpha_deg is the column 'alpha', in degrees: its header says no unit",
        "theta_deg: there is no such column, it is 0 in each joint",
        "alpha_deg: empty for joint 2, which makes it 0",
        "the lengths d and a add up to 750 mm",
    ):
        assert f"armd: {sentence}" in told
    assert main([*words, "-q"]) == 0
    assert "is the column" not in capsys.readouterr().out


@pytest.mark.parametrize(
    "header",
    [
        "Joint;theta (deg);d (in);a [inch];alpha °",
        "i;θ;d in;a_in;α",
        "No;theta [°];d (in);a (in);alpha",
    ],
)
def test_a_drawing_in_inches(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], header: str
) -> None:
    table = tmp_path / "dh.csv"
    table.write_text(header + "\n1;0;11,5;0;90\n2;90;0;1,5;-90\n3;0;4,25;0;0\n", encoding="utf-8")
    assert main(["init", str(tmp_path / "mine"), "--from", str(table), "--port", "/dev/none"]) == 0
    said = capsys.readouterr().out
    assert "d_mm is the column 'd" in said
    joints = load_arm(tmp_path / "mine" / "arm.toml").joint
    assert [joint.d_mm for joint in joints] == [292.1, 0.0, 107.95]
    assert [joint.a_mm for joint in joints] == [0.0, 38.1, 0.0]
    assert [joint.theta_deg for joint in joints] == [0.0, 90.0, 0.0]
    assert [joint.alpha_deg for joint in joints] == [90.0, -90.0, 0.0]


def test_a_drawing_in_radians(tmp_path: Path) -> None:
    (tmp_path / "dh.csv").write_text(
        "theta_rad,d_m,alpha (rad)\n1.5707963267948966,0.5,-0.5\n,0.2,\n,0.1,\n"
    )
    words = ["--from", str(tmp_path / "dh.csv"), "--port", "/dev/none"]
    assert main(["init", str(tmp_path / "mine"), *words]) == 0
    first = load_arm(tmp_path / "mine" / "arm.toml").joint[0]
    assert (first.theta_deg, first.d_mm) == (90.0, 500.0)
    assert first.alpha_deg == pytest.approx(np.degrees(-0.5))


def test_a_person_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    answers = iter(["koch", "", "/dev/ttyACM3"])
    monkeypatch.setattr("sys.stdin", type("Terminal", (io.StringIO,), {"isatty": lambda _: True})())
    monkeypatch.setattr("builtins.input", lambda question: next(answers))
    assert main(["init", str(tmp_path / "mine")]) == 0
    config = load_config(tmp_path / "mine" / "armd.toml")
    assert (config.arm.serial_number, config.driver.kind) == ("ARM-1", "dynamixel")
    assert config.driver.port == "/dev/ttyACM3"
