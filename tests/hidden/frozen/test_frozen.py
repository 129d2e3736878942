"""The frozen cases are drawn alike each time, and what is reported of them is scored by rule."""

from __future__ import annotations

import re
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hidden.frozen.case import Cause, Truth, digest, fingerprint, read_truth, rounded, sessions
from hidden.frozen.freeze import (
    COUNTS,
    Wanted,
    differing_from_record,
    draw_case,
    read_recorded,
    wanted_cases,
)
from hidden.frozen.oracle import BEFORE, DIAGNOSED, FURTHER, Problem
from hidden.frozen.other_kinds import _rounded
from hidden.frozen.revision import check_out, commit_of, is_dirty, make_environment
from hidden.frozen.run import Ran
from hidden.frozen.score import compare, score

from support.selection import parametrize_default

TRUTH = Truth("single", 1, "", (Cause("encoder_scale", "joint 3", 12.0, variables=("q3",)),),
              oracle_um=5.0)  # fmt: skip


def finding(cause: str, location: str, probability: float, *variables: str) -> dict[str, object]:
    return {
        "cause": cause, "location": location, "probability": probability,
        "depends_on": list(variables), "alternatives": [],
    }  # fmt: skip


def test_a_revisions_commands_inherit_no_settings_of_python_armd_and_pytest(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("PYTHONPATH", "ARMD_STATE", "PYTEST_XDIST_WORKER"):
        monkeypatch.setenv(name, "1")
    made = make_environment(tmp_path)
    assert not any(name.startswith(("PYTHON", "ARMD_", "PYTEST_")) for name in made)
    assert made["PATH"] and made["NUMBA_CACHE_DIR"] == str(tmp_path)


def test_there_are_three_hundred_cases_of_every_kind() -> None:
    assert sum(COUNTS.values()) >= 300
    first = wanted_cases("thermal-*,field", 1)
    assert [case.name for case in first] == [
        "thermal-1-00", "thermal-2-00", "thermal-4-00", "field-00"
    ]  # fmt: skip


@parametrize_default("kind", ["field", "thermal-1", "o-thermal-2", "real"])
def test_a_case_is_drawn_alike_each_time(kind: str, tmp_path: Path) -> None:
    for place in ("one", "two"):
        draw_case(Wanted(kind, 0), 5, tmp_path / place)
    assert digest(tmp_path / "one") == digest(tmp_path / "two")
    truth = read_truth(tmp_path / "one")
    assert truth.causes[0].due or truth.causes[0].units > 3
    assert sessions(tmp_path / "one", "session") and sessions(tmp_path / "one", "further")
    assert bool(sessions(tmp_path / "one", "before")) == bool(truth.given)


def test_what_is_recorded_is_of_cases_that_there_are() -> None:
    every = {case.name for case in wanted_cases()}
    recorded = [set(cases) for cases in read_recorded().values()]
    assert all(names <= every for names in recorded)  # some of each kind where a seed confirms
    assert every in recorded


def test_a_case_that_is_not_recorded_is_no_other_case(tmp_path: Path) -> None:
    draw_case(Wanted("field", 0), 5, tmp_path / "case")
    with pytest.raises(SystemExit, match=r"no record of 1 of 1 cases of seed 5 \(field-00\)"):
        differing_from_record(5, {"field-00": fingerprint(tmp_path / "case")})


def test_a_fingerprint_is_of_more_than_last_digits(tmp_path: Path) -> None:
    draw_case(Wanted("field", 0), 5, tmp_path / "case")
    path = next((tmp_path / "case").rglob("readings.csv"))
    drawn, text = fingerprint(tmp_path / "case"), path.read_text()
    angle = re.search(r"\d\.\d{12}", text)
    assert angle is not None
    for off, same in ((1e-12, True), (1e-4, False)):
        other = f"{float(angle[0]) + off:.12f}"
        path.write_text(text.replace(angle[0], other, 1))
        assert fingerprint(tmp_path / "case").agrees(drawn) is same
    path.write_text(text.replace("P1", "P2", 1))
    assert not fingerprint(tmp_path / "case").agrees(drawn)
    path.write_text(text)
    told = tmp_path / "case" / "truth.json"
    truth = told.read_text()
    assert '"oracle_um": 3.66,' in truth
    for oracle, same in (("3.661", True), ("3.76", False)):
        told.write_text(truth.replace('"oracle_um": 3.66,', f'"oracle_um": {oracle},'))
        assert fingerprint(tmp_path / "case").agrees(drawn) is same


def problem(effects: list[np.ndarray], noise: np.ndarray) -> Problem:
    """Forty readings, ten of them from before and ten held out; one constant, along x."""
    n = 40
    part = np.repeat([BEFORE, DIAGNOSED, DIAGNOSED, FURTHER], 10)
    constants = np.zeros((n, 3, 1))
    constants[:, 0, 0] = np.cos(np.arange(n))
    lever = np.random.default_rng(3).normal(0, 100, (n, 3))
    return Problem(constants, effects, noise, lever, part, part, np.full(n, 0.01))


def test_noise_units_are_clear_of_constants_and_poses() -> None:
    n = 40
    absorbed, seen = np.zeros((n, 3)), np.zeros((n, 3))
    absorbed[:, 0] = 0.3 * np.cos(np.arange(n)) + 0.2
    seen[10:30, 2] = 0.1 * np.resize([1.0, -1.0], 20)
    quiet = np.zeros((n, 3))
    assert problem([absorbed], quiet).noise_units()[0] < 1e-6
    assert 30 < problem([seen], quiet).noise_units()[0] < 0.1 / 0.01 * np.sqrt(20)


def test_a_fit_that_is_told_the_cause_takes_it_out() -> None:
    rng = np.random.default_rng(1)
    noise, effect = 0.01 * rng.standard_normal((40, 3)), np.zeros((40, 3))
    effect[10:, 1] = rng.standard_normal(30)
    exact = problem([effect], noise + 0.05 * effect)
    assert problem([], noise + 0.05 * effect).oracle_um() > 1.5 * exact.oracle_um()
    # 10 µm on each of 30 figures, six of which the placement's pose takes
    assert exact.oracle_um() == pytest.approx(10 * np.sqrt(3 * 24 / 30), rel=0.3)


def test_a_constant_that_the_poses_take_up_is_no_direction_to_fit() -> None:
    """What the poses leave of a shift is rounding, another one on each processor."""
    rng = np.random.default_rng(2)
    plain = problem([], 0.01 * rng.standard_normal((40, 3)))
    shifts = np.zeros((40, 3, 4))
    shifts[:, 0] = [1.0, 1.0, 1.0, 0.0]  # the last is a column of zeros
    shifts[:, 1, :2] = 1e-9 * rng.standard_normal((40, 2))  # as large as what a difference errs by
    shifted = replace(plain, constants=np.concatenate([plain.constants, shifts], axis=2))
    assert shifted.oracle_um() == pytest.approx(plain.oracle_um(), rel=1e-9)
    effect = np.where(np.arange(40)[:, None] >= 10, rng.standard_normal((40, 3)), 0.0)
    absorbed = shifts[:, :, 0]
    units = replace(shifted, effects=[effect, absorbed]).noise_units()
    assert units[0] == pytest.approx(replace(plain, effects=[effect]).noise_units()[0], rel=1e-9)
    assert rounded(units[1]) == 0.0


def test_findings_are_own_near_or_foreign() -> None:
    ran = Ran((finding("encoder_scale", "joint 3", 0.99, "q3"),), 10.0, 6.0)
    told = score(TRUTH, ran)
    assert (told.due, told.named, told.first, told.foreign) == (1, 1, True, 0)
    assert told.gain == pytest.approx((4.0, 5.0))
    near = replace(ran, findings=(finding("encoder_eccentricity", "joint 3", 0.99, "q3"),))
    assert (score(TRUTH, near).named, score(TRUTH, near).foreign) == (0, 0)
    wrong = replace(ran, findings=(finding("encoder_scale", "joint 4", 0.99, "q4"),), after_um=11)
    told = score(TRUTH, wrong)
    assert (told.named, told.foreign, told.sure_and_wrong, told.worse) == (0, 1, True, True)
    assert score(replace(TRUTH, causes=()), wrong).clean


def test_what_is_true_of_how_it_was_measured_does_not_count() -> None:
    truth = replace(TRUTH, causes=(), neutral=(("outliers", "rows"),), neutral_variables=("t1",))
    ran = Ran((finding("outliers", "rows", 1.0), finding("unknown", "-", 0.99, "t1")), 5.0, 5.0)
    assert score(truth, ran).foreign == 0
    assert score(replace(truth, neutral=()), ran).foreign == 1


def test_a_session_may_be_refused_by_its_name() -> None:
    truth = replace(TRUTH, refusable="session-2")
    assert not score(truth, Ran(refused="armd: session-2: found another arm's")).failed
    assert score(truth, Ran(refused="armd: session-1: found another arm's")).failed
    assert score(truth, Ran(refused="session-2: Traceback", failed=True)).failed


def test_two_revisions_are_compared_case_by_case() -> None:
    good = score(TRUTH, Ran((finding("encoder_scale", "joint 3", 0.99, "q3"),), 10.0, 5.0, 2.0))
    silent = score(TRUTH, Ran((), 10.0, 10.0, 4.0))
    lines = {line.name: line for line in compare([(silent, good)] * 8, np.random.default_rng(0))}
    named, gain = lines["named and located"], lines["gain, of the oracle's"]
    assert (named.before, named.after, named.interval) == ("0/8", "8/8", "+1.00 to +1.00")
    assert (gain.before, gain.after) == ("0/40", "40/40")
    assert lines["failed"].interval == "-0.38 to +0.38"  # none of eight differs
    few = compare([(silent, good)], np.random.default_rng(0))
    assert {line.interval for line in few} == {"few cases"}
    assert "false alarms, clean" not in lines


def test_a_revision_from_before_the_package_is_importable(tmp_path: Path) -> None:
    """umbrella/ was armd, and its rooms stood beside it."""
    root, git = tmp_path / "root", ["git", "-c", "user.name=a", "-c", "user.email=a@b"]
    for name in ("umbrella", "daemon", "drivers", "compensation", "simulator"):
        (root / name).mkdir(parents=True)
        (root / name / "__init__.py").write_text(f"NAME = {name!r}\n")
    (root / "daemon" / "cli.py").write_text(
        "import armd, sys\ndef main():\n    print(armd.NAME, *sys.argv[1:])\n    return 3\n"
    )
    for words in (["init", "-q"], ["add", "-A"], ["commit", "-q", "-m", "old"]):
        subprocess.run([*git, *words], cwd=root, check=True)
    old = check_out(root, commit_of(root, "HEAD"), tmp_path / "revisions")
    done = subprocess.run(
        old.command("diagnose", "x"), env=old.environment(tmp_path), cwd=tmp_path,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.stdout, done.returncode) == ("umbrella diagnose x\n", 3)
    assert not is_dirty(root)
    (root / "daemon" / "cli.py").write_text("")
    assert is_dirty(root)


def test_a_half_turn_has_one_sign_in_a_robots_file() -> None:
    told = "theta_deg = -180.0\nalpha_deg = -0.0\nd_mm = -180.0\na_mm = 0.12345678901"
    assert _rounded(told) == "theta_deg = 180.0\nalpha_deg = 0.0\nd_mm = -180.0\na_mm = 0.123456789"
