"""What a history of interim checks does to the daemon's state, health and events; and from daily
checks to the points: the daemon takes the calibration that the history wrote."""

from __future__ import annotations

import datetime
import json
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armd.daemon.commands.live.status import _write_lines as status_lines
from armd.daemon.interim_checks import InterimChecks, explain_complaints
from support.interim_history import write_history
from support.program import run_armd
from support.running_daemon import Heard, running_daemon
from support.simulated_arm import simulated_arm

NOON = 1_772_971_200.0  # 2026-03-08 12:00 UTC
SEED, SLIP = "6", "encoder_slip@joint 3=60"
EXTRA = '[interim]\nhistory = "history"\n[commands]\nenabled = true\n'
POINTS = 1000


def result(**more: object) -> dict:
    return {
        "schema": "armd.interim/1",
        "state": "in_control",
        "calibration": "abc",
        "checks": [{"name": "day-04", "started": "2026-03-07T12:00:00Z"}],
        "changes": [],
        **more,
    }


CHANGED = result(
    state="changed",
    changes=[
        {
            "between": ["2026-03-05T09:00:00Z", "2026-03-06T09:00:00Z"],
            "cause": "encoder_slip",
            "location": "joint 3",
            "judged_under": "abc",
        }
    ],
)


def read(folder: Path, text: str) -> InterimChecks:
    (folder / "report.json").write_text(text)
    checks = InterimChecks(folder, "SIM-0001")
    checks.look()
    return checks


def test_an_old_check_is_due_and_one_dated_after_now_has_no_age(tmp_path: Path) -> None:
    """The latter would never become old: a clock is wrong, and that is told."""
    last = read(tmp_path, json.dumps(result())).last
    assert explain_complaints(last, {}, NOON, 26.0) == ("", "")
    changed, due = explain_complaints(last, {}, NOON + 8 * 3600, 26.0)
    assert not changed and "day-04, is 32 h old (26)" in due
    assert explain_complaints(last, {}, NOON + 1e6, None) == ("", "")
    _, due = explain_complaints(last, {}, NOON - 48 * 3600, 26.0)

    assert "day-04 is dated 24 h after now" in due
    assert explain_complaints(last, {}, NOON - 48 * 3600, None) == ("", "")
    assert explain_complaints(last, {}, NOON - 24.5 * 3600, 26.0) == ("", "")


def test_a_change_is_told_until_the_calibration_has_it(tmp_path: Path) -> None:
    last = read(tmp_path, json.dumps(CHANGED)).last
    changed, _ = explain_complaints(last, {}, NOON, None)
    assert "encoder slip, joint 3, since 2026-03-05 09:00 UTC" in changed
    mended = {"interim": {"calibration": "abc", "changes": ["encoder_slip joint 3 since …"]}}
    assert explain_complaints(last, mended, NOON, None) == ("", "")
    of_another = {"interim": {"calibration": "xyz", "changes": ["…"]}}
    assert explain_complaints(last, of_another, NOON, None)[0]
    of_none = {"interim": {"calibration": "abc", "changes": []}}
    assert explain_complaints(last, of_none, NOON, None)[0]


NO_RESULTS = (
    "", "{", "[]", '{"schema": "armd.interim/1"}', "null", "[" * 100_000,
    json.dumps(CHANGED | {"changes": [{"between": ["", ""], "location": "-", "cause": 5}]}),
    json.dumps(result(checks=[{"name": "x", "started": "0001-01-01T00:00:00"}])),
    json.dumps(result(checks={"-1": 0})),
)  # fmt: skip


@pytest.mark.parametrize("text", NO_RESULTS, ids=range(len(NO_RESULTS)))
def test_a_history_that_cannot_be_read_is_told(tmp_path: Path, text: str) -> None:
    last = read(tmp_path, text).last
    changed, due = explain_complaints(last, {}, NOON, None)
    assert not changed and "report.json cannot be read" in due


def test_a_history_of_another_arm_says_nothing_of_this_one(tmp_path: Path) -> None:
    last = read(tmp_path, json.dumps(CHANGED | {"arm": "SIM-0002"})).last
    changed, due = explain_complaints(last, {}, NOON, None)
    assert not changed
    assert due.endswith("report.json is of arm SIM-0002, expected one of SIM-0001")
    own = read(tmp_path, json.dumps(CHANGED | {"arm": "SIM-0001"})).last
    assert explain_complaints(own, {}, NOON, None)[0]


def test_a_missing_history_is_told_and_found_when_it_comes(tmp_path: Path) -> None:
    checks = InterimChecks(tmp_path, "SIM-0001")
    checks.look()
    assert "is not there" in explain_complaints(checks.last, {}, NOON, None)[1]
    (tmp_path / "report.json").write_text(json.dumps(result()))
    checks.look()
    assert explain_complaints(checks.last, {}, NOON, None) == ("", "")
    (tmp_path / "report.json").write_text(json.dumps(CHANGED))
    os.utime(tmp_path / "report.json", (NOON, NOON))
    checks.look()
    assert explain_complaints(checks.last, {}, NOON, None)[0]


def looked(checks: InterimChecks) -> str:
    checks.look()
    return explain_complaints(checks.last, {}, NOON, None)[1]


def test_a_history_cut_short_is_told_at_the_next_look(tmp_path: Path) -> None:
    names = ["day-01", "day-02", "day-03", "day-04"]
    write_history(tmp_path, names)
    checks = read(tmp_path, json.dumps(result()))
    assert looked(checks) == ""
    history = tmp_path / "history.jsonl"
    whole = history.read_text()
    history.write_text("".join(whole.splitlines(keepends=True)[:3]))
    assert "found 3 checks, expected 4, as head.json has them" in looked(checks)
    assert checks.last is not None and not checks.last.name
    history.write_text(whole)
    assert looked(checks) == ""
    # With its head, so that it is a whole history, of fewer checks than this daemon saw.
    write_history(tmp_path, names[:3])
    assert "history.jsonl has 3 checks, and had 4" in looked(checks)
    assert "had 4" in looked(checks)  # and is not forgotten
    write_history(tmp_path, [*names[:3], "day-05", "day-06"])
    assert "history.jsonl has other checks than it had" in looked(checks)
    write_history(tmp_path, [*names, "day-05"])
    assert looked(checks) == ""
    for name in ("history.jsonl", "head.json"):
        (tmp_path / name).unlink()
    assert "history.jsonl has 0 checks, and had 5" in looked(checks)


def test_a_result_is_of_all_checks_of_the_history_or_of_those_before(tmp_path: Path) -> None:
    two = [{"name": f"day-{k:02}", "started": "2026-03-07T12:00:00Z"} for k in (3, 4)]
    text = json.dumps(result(checks=two))
    write_history(tmp_path, ["day-03"])
    assert "history.jsonl has 1 checks, and report.json is of 2" in looked(read(tmp_path, text))
    # Kept, and not judged yet.
    write_history(tmp_path, ["day-03", "day-04", "day-05"])
    assert looked(read(tmp_path, text)) == ""
    broken = tmp_path / "history.jsonl"
    broken.write_text(broken.read_text().replace("day-04", "day-44"))
    assert "line 3: found a line that does not follow" in looked(read(tmp_path, text))


def test_status_names_the_last_check() -> None:
    last = {"check": "day-04", "age_h": 31.6, "state": "in_control", "reason": ""}
    health = {
        "serial": "S", "state": "READY", "reason": "", "calibration": None, "drops": {},
        "rates": {"points_hz": 9.0}, "points": {"published": 7}, "temperatures_c": {},
    }  # fmt: skip
    assert "interim      day-04, 32 h old, in control" in status_lines(health | {"interim": last})
    nothing = {"check": None, "age_h": None, "state": None, "reason": "checks is not there"}
    assert "interim      checks is not there" in status_lines(health | {"interim": nothing})
    assert not any(line.startswith("interim") for line in status_lines(health | {"interim": None}))


@pytest.mark.slow
def test_health_state_and_event_follow_the_history(tmp_path: Path) -> None:
    """Over the wire: the last check and its age, a change, an overdue check, an event of each."""
    history = tmp_path / "checks"
    history.mkdir()
    write_history(history, ["day-03", "day-04"])
    extra = '[interim]\nhistory = "checks"\nat_most_h = 26\n'
    recent = [{"name": "day-04", "started": f"{datetime.datetime.now(datetime.UTC):%FT%TZ}"}]
    (history / "report.json").write_text(json.dumps(result(checks=recent)))
    with (
        simulated_arm(tmp_path, rate_hz=100) as arm,
        running_daemon(tmp_path, arm.port, extra) as daemon,
        daemon.listen() as heard,
    ):
        heard.wait_for(lambda: heard.json("health"))
        heard.wait_for(lambda: heard.json("health")[-1]["interim"]["check"])
        told = heard.json("health")[-1]["interim"]
        assert (told["check"], told["state"]) == ("day-04", "in_control")
        assert 0 <= told["age_h"] < 0.1
        assert not heard.events("interim_changed") and not heard.events("interim_due")
        (history / "report.json").write_text(json.dumps(CHANGED | {"checks": recent}))
        heard.wait_for(lambda: heard.events("interim_changed"))
        heard.wait_for(lambda: heard.json("health")[-1]["state"] == "INACCURATE")
        assert "encoder slip, joint 3" in heard.json("health")[-1]["reason"]
        assert not heard.events("interim_due")
        (history / "report.json").write_text(json.dumps(result()))  # in control, months ago
        heard.wait_for(lambda: heard.events("interim_due"))
        heard.wait_for(lambda: "overdue" in heard.json("health")[-1]["reason"])
        assert heard.json("health")[-1]["state"] == "INACCURATE"
        (history / "report.json").write_text(json.dumps(result(checks=recent)))
        heard.wait_for(lambda: len(heard.events("interim_due")) == 2)
        heard.wait_for(lambda: "interim" not in heard.json("health")[-1]["reason"])
        (history / "report.json").write_text("[" * 100_000)  # the thread that looks goes on
        heard.wait_for(lambda: "cannot be read" in heard.json("health")[-1]["reason"])
        (history / "report.json").write_text(json.dumps(result(checks=recent, arm="SIM-0001")))
        heard.wait_for(lambda: "interim" not in heard.json("health")[-1]["reason"])
        assert daemon.stop()[0] == 0


def from_now_on(heard: Heard) -> np.ndarray:
    """The next points."""
    begin = len(heard.points())
    heard.wait_for(lambda: len(heard.points()) >= begin + POINTS)
    return heard.points()[begin : begin + POINTS]


def off_um(points: np.ndarray, truth: np.ndarray) -> float:
    """RMS distance of points to the simulator's own tips, µm; apart from a rigid motion, for where
    the base stands no calibration knows."""
    known = np.searchsorted(truth["seq"], points["seq"])
    assert (truth["seq"][known] == points["seq"]).all()
    tip = truth["position_mm"][known]
    shown, tip = points["position_mm"] - points["position_mm"].mean(axis=0), tip - tip.mean(axis=0)
    turn, _ = Rotation.align_vectors(tip, shown)
    off = turn.apply(shown) - tip
    return 1e3 * float(np.sqrt((off**2).sum(axis=1).mean()))


@pytest.mark.slow
def test_the_daemon_takes_the_calibration_that_a_history_of_checks_wrote(tmp_path: Path) -> None:
    """The arm slips, the checks say so and the daemon is INACCURATE; with `calibration_from` it is
    READY, and its points are where the tip is."""
    made, checks = tmp_path / "made", tmp_path / "checks"
    run_armd("simulate", "--session", "calibration", "-o", made, "--seed", SEED, check=True)
    calibration = tmp_path / "calibration.json"
    files = ("--arm", made / "arm.toml")
    run_armd("calibrate", *sorted(made.glob("T*")), *files, "-o", calibration, check=True)
    words = ("--session", "interim", "--days", "12", "--seed", SEED, "--plant", f"{SLIP}@8")
    run_armd("simulate", *words, "-o", checks, check=True)
    history, files = tmp_path / "history", (*files, "--calibration", calibration)
    words = ("interim", "add", *sorted(checks.glob("day-*")), *files, "--history", history)
    assert run_armd(*words).returncode == 1
    (change,) = json.loads((history / "report.json").read_text())["changes"]
    assert (change["cause"], change["location"]) == ("encoder_slip", "joint 3")

    top = 'calibration = "calibration.json"'
    with (
        simulated_arm(tmp_path, "--seed", SEED, "--plant", SLIP, rate_hz=100) as arm,
        running_daemon(tmp_path, arm.port, EXTRA, top) as daemon,
        daemon.listen() as heard,
    ):
        heard.wait_for(lambda: heard.json("health"))
        heard.wait_for(lambda: "encoder slip, joint 3" in heard.json("health")[-1]["reason"])
        assert heard.json("health")[-1]["state"] == "INACCURATE"
        before = from_now_on(heard)

        shutil.copy(history / change["calibration_from"], calibration)
        assert daemon.get("command/reload")[0]
        heard.wait_for(lambda: heard.points()["calibration"][-1] != before["calibration"][-1])
        heard.wait_for(lambda: heard.json("health")[-1]["state"] == "READY")
        after = from_now_on(heard)
        assert daemon.stop()[0] == 0
        arm.stop()  # its truth is whole then
    wrong, right = (off_um(points, arm.truth()) for points in (before, after))
    print(f"off by {wrong:.1f} µm, with {change['calibration_from']} by {right:.1f} µm")
    assert right < 0.3 * wrong
