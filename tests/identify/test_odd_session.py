"""The one bad session of several is named by its effect: planted in files, told by the commands."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armd.compensation.identify.admission.mistakes import measure_joint_motion
from armd.compensation.identify.calibrate import calibrate
from armd.daemon.cli import main as armd
from support import synthetic
from support.selection import mark_rest_slow, parametrize_default
from support.simulated_sessions import simulate_sessions

NAMES = ("T14", "T20", "T26", "T32", "T38")


def edited(file: Path, change: Callable[[str], str]) -> None:
    file.write_text(change(file.read_text()))


def numbers(line: str, by: float) -> str:
    return re.sub(r"-?\d+\.\d+", lambda found: f"{float(found[0]) * by:.9f}", line)


def in_inches(session: Path) -> None:
    edited(
        session / "session.toml",
        lambda text: re.sub(r"position_mm = .*", lambda line: numbers(line[0], 1 / 25.4), text),
    )


def exchanged(session: Path, a: str, b: str, placement: str = "") -> None:
    """Two targets' names, in all rows or in those of one placement."""

    def change(text: str) -> str:
        name = {f",{a},": f",{b},", f",{b},": f",{a},"}
        lines = [
            re.sub(r",B\d+,", lambda found: name.get(found[0], found[0]), line)
            if f",{placement}" in line
            else line
            for line in text.splitlines()
        ]
        return "\n".join(lines) + "\n"

    edited(session / "readings.csv", change)


def columns(session: Path, change: Callable[[dict[str, str]], dict[str, str]]) -> None:
    """Each row of the readings as a dictionary, changed."""
    header, *rows = [line.split(",") for line in (session / "readings.csv").read_text().split()]
    changed = [change(dict(zip(header, row, strict=True))) for row in rows]
    lines = [header, *([row[name] for name in header] for row in changed)]
    (session / "readings.csv").write_text("\n".join(map(",".join, lines)) + "\n")


def in_fahrenheit(row: dict[str, str]) -> dict[str, str]:
    for name in (f"t{k}" for k in range(1, 7)):
        row[name] = f"{float(row[name]) * 1.8 + 32.0:.2f}"
    return row


def crossed(row: dict[str, str]) -> dict[str, str]:
    return {**row, "q2": row["q3"], "q3": row["q2"]}


def turned(row: dict[str, str]) -> dict[str, str]:
    return {**row, "q4": row["q4"].removeprefix("-") if "-" in row["q4"] else "-" + row["q4"]}


def angles(session: Path, by: float, unit: str = "rad", turns: int = 0) -> None:
    """Each angle multiplied, and the unit that session.toml names; the wrist counts its turns."""

    def change(row: dict[str, str]) -> dict[str, str]:
        q = {f"q{k}": float(row[f"q{k}"]) + 2 * np.pi * turns * (k == 6) for k in range(1, 7)}
        return row | {name: f"{by * angle:.12f}" for name, angle in q.items()}

    columns(session, change)
    edited(
        session / "session.toml",
        lambda text: text.replace('angle_unit = "rad"', f'angle_unit = "{unit}"'),
    )


def lengths_alone(session: Path, unit_mm: float) -> None:
    """Seats that nobody has certified, with two lengths between them in a unit of one's own."""

    def change(text: str) -> str:
        found = re.findall(r'name = "(B\d+)"\nposition_mm = \[(.*)\]', text)
        at = {name: np.array(list(map(float, numbers.split(",")))) for name, numbers in found}
        text = re.sub(r"(position_mm|standard_uncertainty_mm) = .*\n", "", text)
        for a, b in (("B1", "B7"), ("B8", "B10")):
            length = np.linalg.norm(at[a] - at[b]) / unit_mm
            text += f'\n[[artefact.distance]]\nbetween = ["{a}", "{b}"]\n'
            text += f"length_mm = {length:.6f}\nstandard_uncertainty_mm = 0.001\n"
        return text

    edited(session / "session.toml", change)


PLANTED = {
    "radians": (
        lambda s: angles(s, 1.0, "deg", turns=2), "if its angles are taken as radians, expected",
    ),
    "inches": (in_inches, "if its positions are taken as inches, expected positions in mm"),
    "targets": (lambda s: exchanged(s, "B2", "B3"), "if its targets B2 and B3 are exchanged,"),
    "targets in one placement": (
        lambda s: exchanged(s, "B4", "B9", "P2,"), "if its targets B4 and B9 are exchanged in P2,",
    ),
    "columns": (lambda s: columns(s, crossed), "if its columns q2 and q3 are exchanged,"),
    "sign": (lambda s: columns(s, turned), "if its column q4 has the other sign,"),
}  # fmt: skip


@pytest.fixture(params=mark_rest_slow(PLANTED, 2))
def planted(request: pytest.FixtureRequest, measured: Path) -> Iterator[tuple[Path, str]]:
    plant, words = PLANTED[request.param]
    plant(measured / "T26")
    yield measured, words


def run(command: str, measured: Path, *more: str) -> int:
    sessions = [str(measured / name) for name in NAMES]
    if command == "check":
        return armd(["check", str(measured / "arm.toml"), *sessions])
    return armd([command, *sessions, "--arm", str(measured / "arm.toml"), *more])


def test_what_is_wrong_with_one_session_is_said(
    planted: tuple[Path, str], capsys: pytest.CaptureFixture[str]
) -> None:
    measured, words = planted
    out = measured.parent / "calibration.json"
    assert run("calibrate", measured, "-o", str(out)) == 2
    told = capsys.readouterr().err
    assert f"armd: {measured / 'T26'}: the session: found readings that miss by up to" in told
    assert words in told and "mm under what the other 4 identify" in told
    after_um = re.search(r", and by ([\d.]+) µm if", told)
    assert after_um is not None and float(after_um[1]) < 10.0  # the encoders' noise
    assert not out.exists()


@pytest.mark.slow
def test_check_and_diagnose_say_it_too(measured: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exchanged(measured / "T26", "B2", "B3")
    words = "if its targets B2 and B3 are exchanged, expected each target under its own name"
    assert run("check", measured) == 1
    told = capsys.readouterr()
    assert words in told.err and f"{measured / 'T26'}: ok" not in told.out
    assert f"{measured / 'T32'}: ok" in told.out
    assert run("diagnose", measured, "--json", str(measured / "out.json")) == 2
    assert words in capsys.readouterr().err


@pytest.mark.slow
def test_two_bad_sessions_are_both_named(
    measured: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    in_inches(measured / "T14")
    exchanged(measured / "T38", "B1", "B8")
    assert run("check", measured) == 1
    told = capsys.readouterr().err.splitlines()
    assert [line.split(": ")[1].rpartition("/")[2] for line in told] == ["T14", "T38"]
    assert "inches" in told[0] and "B1 and B8" in told[1]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("by", "unit", "said"),
    [(np.degrees(1.0), "rad", 'angle_unit = "deg" would fit'), (1.0, "deg", "like radians")],
)
def test_a_plain_unit_is_told_by_the_file_itself(
    measured: Path, capsys: pytest.CaptureFixture[str], by: float, unit: str, said: str
) -> None:
    angles(measured / "T26", by, unit)
    assert run("check", measured) == 1
    told = capsys.readouterr()
    assert f"{measured / 'T26'}/readings.csv: row 1 (line 2), column q1: found" in told.err
    assert said in told.err and f"{measured / 'T32'}: ok" in told.out


@pytest.mark.parametrize(
    ("plant", "told"),
    [
        (lambda s: lengths_alone(s, 25.4), "inches"),
        (lambda s: lengths_alone(s, 10.0), "centimetres"),
        pytest.param(lambda s: lengths_alone(s, 1.0), "", marks=pytest.mark.slow),
        pytest.param(
            lambda s: columns(s, in_fahrenheit), "if its temperatures are taken as °F",
            marks=pytest.mark.slow,
        ),
        (lambda s: None, ""),
    ],
    ids=["inches", "centimetres", "mm", "fahrenheit", "nothing"],
)  # fmt: skip
def test_check_tells_of_another_unit_alone(
    measured: Path, capsys: pytest.CaptureFixture[str], plant: Callable[[Path], None], told: str
) -> None:
    plant(measured / "T26")
    assert run("check", measured) == bool(told)
    printed = capsys.readouterr()
    assert told in printed.err and (f"armd: {measured / 'T26'}" in printed.err) == bool(told)
    assert told or (not printed.err and "does not fit" not in printed.out)


def test_a_lone_session_is_held_against_the_drawing(
    measured: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    in_inches(measured / "T20")
    command = ["calibrate", str(measured / "T20"), "--arm", str(measured / "arm.toml")]
    assert armd([*command, "-o", str(measured / "cal.json")]) == 2
    told = capsys.readouterr().err
    assert "under the drawing, and by" in told and "taken as inches" in told


@pytest.mark.slow
def test_another_arm_fits_none(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its own errors of manufacture, another arm's name."""
    other = simulate_sessions(tmp_path / "other", "calibration", "--seed", "99")
    shutil.rmtree(measured / "T26")
    shutil.copytree(other / "T26", measured / "T26")
    name = re.search(r'"(SIM-\d+)"', (measured / "T14/session.toml").read_text())
    assert name is not None
    edited(
        measured / "T26/session.toml",
        lambda text: re.sub(r'arm = ".*"', f'arm = "{name[1]}"', text),
    )
    assert run("calibrate", measured, "-o", str(tmp_path / "cal.json")) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "session T26 does not fit the others: its readings miss by up to" in told
    assert "Is it another arm's" in told
    others = re.search(r"theirs by up to ([\d.]+) µm", told)
    assert others is not None and float(others[1]) < 10.0
    # what is other in it is no cause of this arm's: four sessions tell what they would without it
    assert run("diagnose", measured, "--json", str(tmp_path / "with.json")) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "no cause explains session T26: the diagnosis is without it" in told
    shutil.rmtree(measured / "T26")
    sessions = [str(measured / name) for name in NAMES if name != "T26"]
    command = ["diagnose", *sessions, "--arm", str(measured / "arm.toml"), "--json"]
    assert armd([*command, str(tmp_path / "without.json")]) == 0
    found, alone = (
        json.loads((tmp_path / f"{name}.json").read_text()) for name in ("with", "without")
    )
    for key in ("findings", "baseline", "unexplained", "cannot_tell", "next_experiment"):
        assert found[key] == alone[key]


@pytest.mark.slow
def test_another_arm_among_ten_sessions_fits_none(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its readings are tails of the noise that nine sessions make: seven causes were named, and
    501 µm left."""
    for seed in ("1", "99"):
        simulate_sessions(tmp_path / seed, "diagnosis", "--seed", seed, "-q")
    session = tmp_path / "1/session-3"
    serial = re.search(r'arm = ".*"', (session / "session.toml").read_text())
    assert serial is not None
    shutil.rmtree(session)
    shutil.copytree(tmp_path / "99/session-3", session)
    edited(session / "session.toml", lambda text: re.sub(r'arm = ".*"', serial[0], text))
    sessions = sorted(map(str, (tmp_path / "1").glob("*-*")))
    out = tmp_path / "out.json"
    arm = str(tmp_path / "1/arm.toml")
    assert armd(["diagnose", *sessions, "--arm", arm, "--json", str(out)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "no cause explains session session-3: the diagnosis is without it" in told
    result = json.loads(out.read_text())
    assert result["findings"] == [] and result["baseline"]["rms_um"] < 15.0


def changed_once(
    change: dict[str, float], celsius: tuple[float, ...] = (20.0, 20.0, 20.0, 20.0)
) -> str:
    """What is said of four sessions of one arm, before the third of which its constants changed."""
    arm, rng = synthetic.arm(), np.random.default_rng(11)
    truth = synthetic.disturbed(arm, rng, 0.3)
    other = truth.copy()
    for name, by in change.items():
        other[arm.layout.index(name)] += by
    sessions = [
        synthetic.session(
            arm, other if k == 2 else truth, rng, readings=60, encoder_rad=5e-6,
            temperature_c=celsius[k], name=f"T{k}",
        )
        for k in range(4)
    ]  # fmt: skip
    result = calibrate(sessions, arm)
    (told,) = (note for note in result.notes if "does not fit" in note)
    assert told.startswith("session T2 does not fit the others")
    assert not result.certificate.granted
    assert "session T2 does not fit the others" in result.certificate.reason
    assert result.certificate.next_step.startswith("calibrate without session ")
    return told


@pytest.mark.slow
@parametrize_default("moved_mm", [(0.2, -0.3, 0.6), (4.0, 1.0, -35.0)])
def test_another_stylus_is_told_with_its_offset(moved_mm: tuple[float, float, float]) -> None:
    told = changed_once(dict(zip(("tip_x", "tip_y", "tip_z"), moved_mm, strict=True)))
    found = re.search(r"with the tip moved by \((.*), (.*), (.*)\) mm in the last frame, by", told)
    assert found is not None, told
    # the last frame is the drawing's: up to 0.3° from the arm's own
    off_mm = 0.05 + 0.01 * float(np.linalg.norm(moved_mm))
    np.testing.assert_allclose(list(map(float, found.groups())), moved_mm, atol=off_mm)
    assert "another stylus" in told


@pytest.mark.slow
def test_another_stylus_is_told_of_the_coldest_session() -> None:
    """Far from the others' temperatures, mm are no expansion; an expansion to the fourth power of
    them took up 8 mm, and the certificate was granted."""
    told = changed_once({"tip_x": 5.0, "tip_z": -6.0}, (20.0, 21.0, 14.0, 23.0))
    assert "with the tip moved by (5" in told


@pytest.mark.slow
def test_a_joint_that_was_knocked_is_no_other_stylus() -> None:
    told = changed_once({"theta_2": 0.004})
    assert "tip" not in told and "did the arm change" in told


@pytest.mark.slow
def test_an_arm_that_hardly_moves_explains_nothing(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Angles that nobody measured miss least as degrees: that arm stands still."""
    rng = np.random.default_rng(4)

    def invented(row: dict[str, str]) -> dict[str, str]:
        return {**row, **{f"q{j}": f"{rng.uniform(-1.5, 1.5):.6f}" for j in range(1, 7)}}

    columns(measured / "T20", invented)
    command = ["check", str(measured / "arm.toml"), str(measured / "T20")]
    armd(command)
    assert "taken as degrees" not in capsys.readouterr().err


@given(st.floats(0.001, 0.05), st.integers(1, 9), st.integers(0, 2**32 - 1))
def test_joint_motion_is_a_standard_deviation(spread: float, joints: int, seed: int) -> None:
    """Of small motions, wherever on the circle they are, missing rows left out."""
    rng = np.random.default_rng(seed)
    q = rng.uniform(-9.0, 9.0, joints) + rng.normal(0.0, spread, (200, joints))
    expected = np.sqrt(np.mean(np.var(q, axis=0)))
    turned = np.where(rng.random(joints) < 0.5, q + 2 * np.pi, q)
    with_gap = np.vstack([turned, np.full(joints, np.nan)])
    assert measure_joint_motion(with_gap) == pytest.approx(expected, rel=0.01)
    assert measure_joint_motion(rng.uniform(-np.pi, np.pi, (20_000, 1))) == pytest.approx(
        2**0.5, rel=0.02
    )
