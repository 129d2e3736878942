"""Checks under a calibration of one temperature: the growth of the links is no change and no dirt,
it is reported, and a change beside it is found."""

from __future__ import annotations

import csv
import datetime
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from armd.compensation.data.sessions.session import load_session
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.interim.checks.open_growth import compute_rises_k, list_open_growth
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import load_calibration
from armd.daemon.cli import main
from armd.simulator.campaigns.calibration import plan_calibration
from armd.simulator.measured.measuring import measure_campaign, write_session
from armd.simulator.measured.noise import Noise
from armd.simulator.measured.plan import Climate, SessionPlan, Visit
from armd.simulator.truth.arm import Materials

#: Of the checks, a week apart, as an owner makes them in a room without climate.
CELSIUS = (20, 26, 32, 14, 38, 20)
READINGS = 24
Row = dict[str, str]
Change = Callable[[int, int, Row], None]  # of check i, row j


def as_it_is(check: int, row: int, values: Row) -> None:
    pass


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Sessions at five temperatures, and a calibration of the one at 20 °C."""
    folder = tmp_path_factory.mktemp("measured")
    campaign = plan_calibration(5, Noise())
    (folder / "arm.toml").write_text(campaign.arm_toml)
    for session in measure_campaign(campaign, np.random.default_rng(5)):
        write_session(folder / session.plan.name, session)
    words = ["calibrate", str(folder / "T20"), "--arm", str(folder / "arm.toml")]
    assert main([*words, "-o", str(folder / "T20.json")]) == 0
    return folder


def checks(measured: Path, folder: Path, change: Change = as_it_is) -> list[str]:
    """Twenty-four readings of each session, a week apart, changed by *change*."""
    rng, paths = np.random.default_rng(7), []
    for i, celsius in enumerate(CELSIUS):
        source, place = measured / f"T{celsius}", folder / f"check-{i + 1}"
        with (source / "readings.csv").open(newline="") as file:
            rows = list(csv.DictReader(file))
        picked = np.sort(rng.choice(len(rows), READINGS, replace=False))
        rows = [rows[j] for j in picked]
        for j, row in enumerate(rows):
            change(i, j, row)
        place.mkdir(parents=True)
        when = datetime.datetime(2026, 4, 1, 9) + datetime.timedelta(days=7 * i)
        head = (source / "session.toml").read_text().splitlines()
        head = [f"started = {when:%Y-%m-%dT%H:%M:%SZ}" if "started =" in x else x for x in head]
        (place / "session.toml").write_text("\n".join(head) + "\n")
        with (place / "readings.csv").open("w", newline="") as file:
            table = csv.DictWriter(file, list(rows[0]))
            table.writeheader()
            table.writerows(rows)
        paths.append(str(place))
    return paths


def judged(measured: Path, history: Path, paths: list[str], capsys: Any) -> dict[str, Any]:
    capsys.readouterr()
    main(
        ["interim", "add", *paths, "--arm", str(measured / "arm.toml"), "--calibration",
         str(measured / "T20.json"), "--history", str(history), "--future", "--json"]
    )  # fmt: skip
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_growth_is_neither_a_change_nor_dirt(measured: Path, tmp_path: Path, capsys: Any) -> None:
    result = judged(measured, tmp_path / "h", checks(measured, tmp_path), capsys)
    assert result["state"] == "in_control"
    assert [check["verdict"] for check in result["checks"]] == ["in_control"] * 6
    assert result["changes"] == []


@pytest.mark.slow
def test_the_growth_is_reported_and_written(measured: Path, tmp_path: Path, capsys: Any) -> None:
    """Beside the simulator's materials; and on all sessions, of which the checks had an eighth."""
    result = judged(measured, tmp_path / "h", checks(measured, tmp_path), capsys)
    links = {one["location"]: one["parameters"][0] for one in result["growth"]["links"]}
    true = Materials.for_demo_arm()
    for name, per_k in (("link 2", (130**2 * true.along_d[1] + 520**2 * true.along_a[1])
                         / (130**2 + 520**2)), ("link 4", true.along_d[3])):  # fmt: skip
        off = abs(links[name]["value"] - per_k)
        assert off < 4 * links[name]["standard_uncertainty"] + 0.02 * per_k
    before_um = result["growth"]["heldout_rms_um_before"]
    assert result["growth"]["heldout_rms_um_after"] < 0.2 * before_um
    arm = load_arm(measured / "arm.toml")
    grown = load_calibration(tmp_path / "h" / result["growth"]["calibration_from"], arm).content
    sessions = [load_session(measured / f"T{celsius}", arm) for celsius in (14, 26, 32, 38)]
    assert (
        evaluate(sessions, arm, grown).rms_um < 4.0
    )  # 29 µm without, 2.7 µm by a calibration of all five
    assert grown.temperature_range_c["t2"][0] < 16 and grown.temperature_range_c["t2"][1] > 38


@pytest.mark.slow
def test_a_slip_beside_the_growth_is_found(measured: Path, tmp_path: Path, capsys: Any) -> None:
    def slip(check: int, row: int, values: Row) -> None:
        if check >= 4:
            values["q3"] = f"{float(values['q3']) + 30 * np.pi / 180 / 3600:.12f}"

    result = judged(measured, tmp_path / "h", checks(measured, tmp_path, slip), capsys)
    (change,) = result["changes"]
    assert (change["cause"], change["location"]) == ("encoder_slip", "joint 3")
    assert change["between"][0] > "2026-04-22" and change["between"][1] < "2026-04-30"
    assert result["growth"]["links"]
    corrected = load_calibration(tmp_path / "h" / change["calibration_from"]).content
    assert any(term.effect == "link_expansion" for term in corrected.terms)


@pytest.mark.slow
def test_a_moved_seat_beside_the_growth_is_bad_by_itself(
    measured: Path, tmp_path: Path, capsys: Any
) -> None:
    """One ball's readings are 40″ off in the warmest of the checks but one."""

    def dirt(check: int, row: int, values: Row) -> None:
        if check == 2 and row % 4 == 0:
            values["q2"] = f"{float(values['q2']) + 4e-4:.12f}"

    result = judged(measured, tmp_path / "h", checks(measured, tmp_path, dirt), capsys)
    verdicts = [check["verdict"] for check in result["checks"]]
    assert verdicts == ["in_control"] * 2 + ["bad_check"] + ["in_control"] * 3


def warming(folder: Path, count: int, repeats: int, seed: int) -> list[str]:
    """Sessions a week apart, each eight kelvin warmer at its end, two hours later."""
    campaign = plan_calibration(5, Noise())
    artefact = campaign.sessions[0][1]
    visit = Visit("P1", artefact.targets[:8], repeats)
    plans = [
        (SessionPlan(f"warm-{i}", 800.0 + 168 * i, Climate(19.0, 4.0, 0.0), (visit,),
                     7200.0 / (8 * repeats)), artefact)
        for i in range(count)
    ]  # fmt: skip
    for session in measure_campaign(replace(campaign, sessions=plans), np.random.default_rng(seed)):
        write_session(folder / session.plan.name, session)
    return [str(folder / plan.name) for plan, _ in plans]


@pytest.mark.slow
def test_a_check_that_warms_up_while_it_is_measured_is_in_control(
    measured: Path, tmp_path: Path, capsys: Any
) -> None:
    """Three weeks one after another."""
    result = judged(measured, tmp_path / "h", warming(tmp_path, 3, 3, 3), capsys)
    assert [check["verdict"] for check in result["checks"]] == ["in_control"] * 3
    assert (
        result["growth"]["heldout_rms_um_after"] < 0.5 * result["growth"]["heldout_rms_um_before"]
    )


@pytest.mark.slow
def test_one_session_that_warms_up_is_diagnosed_as_growth(measured: Path, tmp_path: Path) -> None:
    """And what is written of it holds for sessions at other temperatures."""
    (warm,) = warming(tmp_path, 1, 15, 3)
    given = ["--arm", str(measured / "arm.toml"), "--calibration"]
    written = tmp_path / "extended.json"
    words = ["diagnose", warm, *given, str(measured / "T20.json"), "--extended", str(written)]
    assert main([*words, "--json", str(tmp_path / "diagnosis.json")]) == 0
    result = json.loads((tmp_path / "diagnosis.json").read_text())
    assert {one["cause"] for one in result["findings"]} == {"link_expansion"}
    assert "has no thermal model" in result["verdict"]
    arm = load_arm(measured / "arm.toml")
    sessions = [load_session(measured / f"T{celsius}", arm) for celsius in (14, 38)]
    models = [load_calibration(path, arm).content for path in (measured / "T20.json", written)]
    before, after = (evaluate(sessions, arm, model).distance_um.mean() for model in models)
    assert after < 0.3 * before


def test_only_what_a_calibration_could_not_know_is_open(measured: Path, tmp_path: Path) -> None:
    arm = load_arm(measured / "arm.toml")
    one = load_calibration(measured / "T20.json", arm).content
    growth = list_open_growth(arm, one)
    assert {"growth a_2", "growth d_4", "growth d_1"} <= {each.name for each in growth}
    wide = {name: (low - 3, high + 3) for name, (low, high) in one.temperature_range_c.items()}
    assert list_open_growth(arm, one.model_copy(update={"temperature_range_c": wide})) == ()
    assert list_open_growth(arm, one.model_copy(update={"temperature_range_c": {}})) == ()
    session = load_session(measured / "T26", arm)
    rise = compute_rises_k(growth, session.states, arm, one)
    assert np.allclose(rise, 6.0, atol=0.3)
