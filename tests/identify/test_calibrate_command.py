"""`armd calibrate` and `armd evaluate` from the command line: results, and refusals with exit 2."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import pytest

from armd.compensation.model.calibration import load_calibration
from armd.daemon.cli import main as armd
from support.simulated_sessions import simulate_sessions


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return simulate_sessions(tmp_path_factory.mktemp("paper"), "paper")


def calibrate(measured: Path, out: Path, *sessions: str | Path, more: tuple[str, ...] = ()) -> int:
    paths = [str(measured / session) for session in sessions]
    arm = str(measured / "arm.toml")
    return armd(["calibrate", *paths, "--arm", arm, "-o", str(out / "cal.json"), *more])


def changed(measured: Path, to: Path, **changes: tuple[str, str]) -> Path:
    """A copy of session T20 with a regular expression replaced in a file."""
    to.mkdir()
    for name in ("session.toml", "readings.csv"):
        text = (measured / "T20" / name).read_text()
        if name.split(".")[0] in changes:
            text = re.sub(*changes[name.split(".")[0]], text, flags=re.MULTILINE)
        (to / name).write_text(text)
    return to


@pytest.mark.slow
def test_calibrate_then_evaluate(measured: Path, tmp_path: Path) -> None:
    result, report = tmp_path / "result.json", tmp_path / "report.html"
    more = ("--json", str(result), "--report", str(report))
    assert calibrate(measured, tmp_path, "T16", "T18", "T26", "T30", more=more) == 0
    figures = json.loads(result.read_text())
    assert figures["rms_um"] < 4
    assert figures["heldout_rms_um"] < 4
    assert figures["thermal_order"] == 1
    assert figures["certificate"]["granted"]
    low, high = figures["temperature_range_c"]
    assert 15 < low < 19
    assert 30 < high < 34
    assert any(line.startswith("theta_6 with") for line in figures["unidentifiable"])
    models = {trial["model"]: trial["heldout_rms_um"] for trial in figures["thermal_trials"]}
    assert models["all at once, order 1"] < 0.5 * models["no thermal model"]
    assert {"two zones", "principal components", "per temperature, order 1 and offset"} <= set(
        models
    )
    page = report.read_text()
    assert "<script" not in page and len(page) < 500_000
    for words in (
        "Before and after",
        ">GRANTED<",
        "identification record, not an ISO 17025 certificate: every 8th placement left out",
        "Residual vectors",
        "Parameters",
        "SHA-256",
        "tip_z",
    ):
        assert words in page

    calibration = load_calibration(tmp_path / "cal.json").content
    assert calibration.provenance["sessions"][0]["name"] == "T16"
    assert len(calibration.provenance["sessions"][0]["sha256"]) == 64
    assert calibration.provenance["certificate"] == figures["certificate"]
    assert set(calibration.temperature_range_c) <= {f"t{k}" for k in range(1, 7)}
    assert calibration.noise.reading_mm > 0
    assert 0.001 < calibration.noise.temperature_c < 0.05  # sensors of 0.01 °C

    evaluated = tmp_path / "evaluated.json"
    heldout = str(measured / "heldout-T22")
    arm = str(measured / "arm.toml")
    assert armd(["evaluate", heldout, "--arm", arm, "--json", str(evaluated)]) == 0
    before = json.loads(evaluated.read_text())
    with_calibration = ["--calibration", str(tmp_path / "cal.json"), "--json", str(evaluated)]
    assert armd(["evaluate", heldout, "--arm", arm, *with_calibration]) == 0
    after = json.loads(evaluated.read_text())
    assert after["n"] == before["n"] == after["by_session"]["heldout-T22"]["n"]
    assert after["rms_um"] < 4 < 50 < before["rms_um"]
    assert after["rms_um"] <= after["max_um"]


def test_what_the_papers_own_way_needs_is_said(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(measured, tmp_path, "T16", "T20", "T24", more=("--offset",)) == 2
    assert "--offset: found polynomial, expected" in capsys.readouterr().err
    few = ("--thermal-method", "per-temperature", "--thermal", "1")
    assert calibrate(measured, tmp_path, "T16", "T20", more=few) == 2
    assert "found 2 temperatures, expected at least 3 for order 1" in capsys.readouterr().err
    assert not (tmp_path / "cal.json").exists()


@pytest.mark.slow
def test_the_papers_own_way(measured: Path, tmp_path: Path) -> None:
    result = tmp_path / "result.json"
    sessions = ("T16", "T20", "T24", "T28", "T30")
    method = ("--thermal-method", "per-temperature", "--json", str(result))
    report = ("--report", str(tmp_path / "report.html"))
    heldout, arm = str(measured / "heldout-T22"), str(measured / "arm.toml")
    for more, offset in ((), "0"), (("--offset",), "identified"):
        assert calibrate(measured, tmp_path, *sessions, more=(*method, *more, *report)) == 0
        figures = json.loads(result.read_text())
        assert figures["thermal_method"] == "per-temperature"
        assert figures["heldout_by"] == "temperature"
        calibration = load_calibration(tmp_path / "cal.json").content
        assert calibration.provenance["thermal_offset"] == offset
        assert calibration.covariance_of[-1] == f"term {len(calibration.terms) - 1}"
        written = ["--calibration", str(tmp_path / "cal.json"), "--json", str(result)]
        assert armd(["evaluate", heldout, "--arm", arm, *written]) == 0
        # Near what all at once gives (3 µm), although each temperature alone tells less.
        assert json.loads(result.read_text())["rms_um"] < 10


def test_one_temperature_gives_geometry_and_says_so(measured: Path, tmp_path: Path) -> None:
    result, report = tmp_path / "result.json", tmp_path / "report.html"
    more = ("--json", str(result), "--report", str(report))
    assert calibrate(measured, tmp_path, "T20", more=more) == 0
    figures = json.loads(result.read_text())
    assert figures["thermal_order"] == 0
    low, high = figures["temperature_range_c"]
    assert 19 < low < high < 25
    assert any("one temperature only" in note for note in figures["notes"])
    assert "one temperature only" in report.read_text()


@pytest.mark.slow
def test_readings_without_a_temperature_are_left_out_and_counted(
    measured: Path, tmp_path: Path
) -> None:
    """Field 18 is sensor t3: empty in three rows."""
    holes = changed(
        measured,
        tmp_path / "holes",
        readings=(r"^((?:1|2|4)\d\.[^,]*(?:,[^,]*){16}),[^,]*", r"\1,"),
    )
    result = tmp_path / "result.json"
    assert calibrate(measured, tmp_path, holes, "T16", more=("--json", str(result))) == 0
    figures = json.loads(result.read_text())
    assert any("without a temperature, not used" in note for note in figures["notes"])
    assert figures["n"] < 400
    assert figures["rms_um"] < 4


@pytest.mark.slow
def test_evaluate_without_a_needed_temperature_names_session_and_column(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Field 18 is sensor t3: empty in every row."""
    assert calibrate(measured, tmp_path, "T16", "T26", more=("--thermal", "1")) == 0
    blind = changed(
        measured, tmp_path / "blind", readings=(r"^(\d[^,]*(?:,[^,]*){16}),[^,]*", r"\1,")
    )
    arm, calibration = str(measured / "arm.toml"), str(tmp_path / "cal.json")
    assert armd(["evaluate", str(blind), "--arm", arm, "--calibration", calibration]) == 2
    message = capsys.readouterr().err
    assert "blind: column t3: found a temperature in 0 of " in message
    assert "expected readings with every temperature the calibration needs (t2, t3, " in message


def test_truth_in_metres_is_refused(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    metres = changed(measured, tmp_path / "metres")
    text = (metres / "session.toml").read_text()
    numbers = re.compile(r"position_mm = \[(.*), (.*), (.*)\]")
    text = numbers.sub(
        lambda found: f"position_mm = {[float(group) / 1e3 for group in found.groups()]}", text
    )
    (metres / "session.toml").write_text(text)
    assert calibrate(measured, tmp_path, metres) == 2
    message = capsys.readouterr().err
    assert message.startswith("armd: ") and not (tmp_path / "cal.json").exists()
    assert "metres: the session: found readings that miss by up to" in message
    assert "if its positions are taken as metres, expected positions in mm" in message


def test_a_thermal_model_of_one_temperature_is_refused(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(measured, tmp_path, "T20", more=("--thermal", "1")) == 2
    message = capsys.readouterr().err
    assert "temperatures: found 1 (" in message
    assert "expected at least 2 for a thermal model of order 1" in message
    assert not (tmp_path / "cal.json").exists()


def test_few_readings_help_and_get_no_certificate(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Eight readings of one placement: the drawing holds what they do not tell."""
    few = changed(measured, tmp_path / "few", readings=(r"\A((?:.*\n){9})(?:.*\n)*", r"\1"))
    result = tmp_path / "result.json"
    assert calibrate(measured, tmp_path, few, more=("--json", str(result))) == 0
    figures = json.loads(result.read_text())
    assert not figures["certificate"]["granted"]
    assert "8 readings, expected at least 30" in figures["certificate"]["reason"]
    step = figures["certificate"]["next_step"]
    assert f" --with {few}` " in step
    assert f". Next: {step}\n" in capsys.readouterr().out  # in one line, to be copied
    assert any("the drawing holds what they do not tell" in note for note in figures["notes"])
    arm, heldout = str(measured / "arm.toml"), str(measured / "heldout-T20")
    evaluated = tmp_path / "evaluated.json"
    rms = []
    for more in ([], ["--calibration", str(tmp_path / "cal.json")]):
        assert armd(["evaluate", heldout, "--arm", arm, "--json", str(evaluated), *more]) == 0
        rms.append(json.loads(evaluated.read_text())["rms_um"])
    assert rms[1] < rms[0]


@pytest.mark.slow
def test_a_wrong_drawing_is_named_as_a_suspect(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arm = tmp_path / "arm.toml"
    text = (measured / "arm.toml").read_text()
    lengths = re.compile(r"^d_mm = ([3-9]\d\d\.\d+)", re.MULTILINE)
    assert lengths.search(text)
    arm.write_text(lengths.sub(lambda found: f"d_mm = {float(found[1]) / 3}", text))
    out = str(tmp_path / "cal.json")
    assert armd(["calibrate", str(measured / "T20"), "--arm", str(arm), "-o", out]) == 2
    assert "arm.toml the drawing of it" in capsys.readouterr().err
    assert armd(["evaluate", str(measured / "T20"), "--arm", str(arm)]) == 0
    assert "is it the drawing of this arm?" in " ".join(capsys.readouterr().out.split())


def test_poses_that_say_nothing_are_refused(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """One and the same pose over and over: the readings are many, what they tell is not."""
    still = tmp_path / "still"
    still.mkdir()
    lines = (measured / "T20" / "readings.csv").read_text().splitlines()
    time_s, rest = lines[1].split(",", 1)
    assert lines[0].startswith("time_s,")
    timed = [f"{float(time_s) + i},{rest}" for i in range(200)]
    (still / "session.toml").write_text((measured / "T20" / "session.toml").read_text())
    (still / "readings.csv").write_text("\n".join([lines[0], *timed]) + "\n")
    assert calibrate(measured, tmp_path, still) == 2
    assert "poses: found rank" in capsys.readouterr().err
    (still / "readings.csv").write_text("\n".join([lines[0], *[lines[1]] * 200]) + "\n")
    assert calibrate(measured, tmp_path, still) == 2  # one row, 200 times: one reading
    assert "readings: found 1 poses" in capsys.readouterr().err


@pytest.mark.slow
def test_quiet_says_no_remarks(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = changed(measured, tmp_path / "T20", readings=(r"^(time_s,.*)$", r"\1,note"))
    lines = (session / "readings.csv").read_text().splitlines()
    (session / "readings.csv").write_text("\n".join([lines[0], *(f"{x},a" for x in lines[1:])]))
    assert calibrate(measured, tmp_path, session) == 0
    loud = capsys.readouterr()
    assert "columns not used: note" in " ".join(loud.err.split())
    assert calibrate(measured, tmp_path, session, more=("--quiet", "--force")) == 0
    quiet = capsys.readouterr()
    assert quiet.err == ""
    # The last line names the file's hash, which holds when it was made.
    assert quiet.out.splitlines()[:-1] == loud.out.splitlines()[:-1]


def test_names_are_printed_as_they_stand(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A square bracket is no markup, and a closing one no error of armd."""
    added = '\n[[artefact.distance]]\nbetween = ["[/x]", "B2"]\nlength_mm = {}\n'
    toml = (measured / "T20" / "session.toml").read_text()
    ends = re.findall(r"position_mm = \[(.*?)\]", toml)[:2]
    length = math.dist(*(map(float, end.split(",")) for end in ends))
    here = changed(
        measured, tmp_path / "T[red]:star:",
        session=(r"\Z", added.format(length)), readings=(r",B1,", ",[/x],"),
    )  # fmt: skip
    text = (here / "session.toml").read_text()
    (here / "session.toml").write_text(text.replace('name = "B1"', 'name = "[/x]"'))
    capsys.readouterr()
    assert armd(["evaluate", str(here), "--arm", str(measured / "arm.toml")]) == 0
    printed = capsys.readouterr().out
    assert "T[red]:star:" in printed
    assert "[/x]" in printed


def test_a_length_that_contradicts_positions_is_named(
    measured: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    added = '\n[[artefact.distance]]\nbetween = ["B1", "B2"]\nlength_mm = 9999.0\n'
    here = changed(measured, tmp_path / "typed", session=(r"\Z", added))
    assert armd(["evaluate", str(here), "--arm", str(measured / "arm.toml")]) == 2
    said = capsys.readouterr().err
    assert "session.toml: artefact" in said
    assert "distance[1]" in said
    assert "9999" in said
