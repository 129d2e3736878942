"""The alarm's statistic by brute force, and whole histories with changes of several kinds."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import logsumexp
from scipy.stats import multivariate_t
from test_interim_history import files_of, measured, run, true_calibration

from armd.compensation.data.sessions.session import load_sessions
from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.effects.location import joint
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.bad_check import OtherChecks
from armd.compensation.interim.evidence.likelihood import (
    NOISE_WEIGHT,
    SIZES,
    compute_log_marginal,
    fit_standing_share,
    weigh,
)
from armd.compensation.interim.evidence.stack import ALL_ALONG, RAMP_DAYS, RunningSums, Stack
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import load_calibration
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.measure.plan.poses import read_poses
from armd.daemon.measure.plan.proposed import load_proposed_check
from armd.errors import BadInput


def a_stack(rng: np.random.Generator) -> tuple[Stack, list[Cause]]:
    """Five checks of a few numbers each, one cause of one column and one of two."""
    rows = [4, 6, 3, 5, 4]
    columns = tuple(rng.normal(size=(r, 3)) for r in rows)
    known = tuple(rng.normal(size=(r, 2)) for r in rows)
    residual = tuple(rng.normal(size=r) for r in rows)
    time_d = np.cumsum(rng.uniform(0.5, 2.0, len(rows)))
    one, two = (
        Candidate(
            "geometry_shift", joint(k), tuple(Column(f"{i}", "mm", 1.0) for i in range(n)), ()
        )
        for k, n in ((2, 1), (3, 2))
    )
    causes = [Cause(one, 0.25, 0.25), Cause(two, 0.25, 0.25)]
    none = tuple(np.zeros((r, 0)) for r in rows)
    return Stack(time_d, residual, columns, known, none, (slice(0, 1), slice(1, 3))), causes


def density(of: Stack, more: list[np.ndarray], size: float) -> float:
    """Log of Student's density of all readings, the covariance written out in full."""
    z = np.concatenate(of.residual)
    known, extra = np.concatenate(of.error_columns), np.concatenate(more)
    shape = np.eye(len(z)) + known @ known.T + size**2 * extra @ extra.T
    return float(multivariate_t.logpdf(z, np.zeros(len(z)), shape, df=NOISE_WEIGHT))


@pytest.mark.parametrize("seed", range(3))
def test_the_weights_are_likelihood_ratios(seed: int) -> None:
    of, causes = a_stack(np.random.default_rng(seed))
    first = np.arange(of.n)
    weighed = weigh(RunningSums(of), causes, of.n, first)
    nothing = [np.zeros((len(z), 1)) for z in of.residual]
    days = of.time_d / RAMP_DAYS
    gap = np.median(np.diff(days))
    for onset in first:
        origin = days[onset - 1] if onset else days[0] - gap
        step = (first >= onset).astype(float)
        ramp = np.where(first >= onset, days - origin, 0.0)
        for shape, course in enumerate((step, ramp)):
            for k, block in enumerate(of.blocks):
                more = [w * x[:, block] for w, x in zip(course, of.columns, strict=True)]
                by_hand = [density(of, more, size) - density(of, nothing, 0.0) for size in SIZES]
                expected = logsumexp(by_hand) - np.log(len(SIZES)) + np.log(0.25)
                assert weighed.log_weight[onset, k, shape] == pytest.approx(expected, abs=1e-8)


def judged(folder: Path, *plants: str) -> tuple[dict, Path]:
    checks = measured(folder / "checks", *plants)
    true_calibration(checks)
    days = sorted(checks.glob("day-*"))
    run("add", *days, *files_of(checks), "--history", folder / "history")
    return json.loads((folder / "history" / "report.json").read_text()), checks


def rms_um(checks: Path, calibration: Path, day: int) -> float:
    arm = load_arm(checks / "arm.toml")
    sessions = load_sessions([checks / f"day-{day:02}"], arm)
    return evaluate(sessions, arm, load_calibration(calibration, arm).content).rms_um


@pytest.mark.slow
def test_a_wrong_artefact_right_before_a_change_hides_neither(tmp_path: Path) -> None:
    result, _ = judged(
        tmp_path, "--plant", "encoder_slip@joint 3=15@6", "--bad", "wrong-artefact@5"
    )
    (change,) = result["changes"]
    assert (change["cause"], change["location"]) == ("encoder_slip", "joint 3")
    assert [c["name"] for c in result["checks"] if c["verdict"] == "bad_check"] == ["day-05"]
    # A bad check cannot say whether the arm had changed by then: the interval begins before it.
    assert change["between"][0][:10] == result["checks"][3]["started"][:10]


def turned(arm: Arm, constants: np.ndarray, q: np.ndarray, by: np.ndarray) -> np.ndarray:
    """Tips (n, 3) mm where joint 3's angles are off *by* so much, rad."""
    off = q.copy()
    off[:, 2] += by
    return compute_pose(off, np.tile(constants, (len(q), 1)))[0]


@pytest.mark.slow
def test_tomorrows_poses_tell_a_doubtful_cause_from_its_rival(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result, checks = judged(
        tmp_path, "--plant", "encoder_eccentricity@joint 3=0.4@5", "--artefact", "sphere"
    )
    (change,) = result["changes"]
    both = {change["cause"], change["alternatives"][0]["cause"]}
    assert both == {"encoder_eccentricity", "encoder_scale"} and change["location"] == "joint 3"
    table = tmp_path / "poses.csv"
    run("report", "--history", tmp_path / "history", "--poses", table)
    arm = load_arm(checks / "arm.toml")
    poses = read_poses(table, arm.n_joints, arm.sensors)
    assert "come to rest turning joints" in poses[0].how
    told = capsys.readouterr().out
    assert f"armd measure interim --proposed --history {tmp_path / 'history'} -o SESSION" in told
    # That command asks for the poses of the table, one seat and the other in turn.
    asked = load_proposed_check(tmp_path / "history", arm)
    for ours, theirs in zip(asked, poses, strict=True):
        assert ours.posture_deg == pytest.approx(theirs.posture_deg, abs=0.06)
        assert ours.tip_mm == pytest.approx(theirs.tip_mm, abs=0.06)
        assert ours.how.partition(";")[2] == theirs.how.partition(";")[2]
    constants = load_calibration(checks / "calibration.json", arm).content.vector(arm.n_joints)
    q = np.radians([pose.posture_deg for pose in poses])
    after = result["next_check"]
    chance = after["chance_wrong"]
    assert chance["after_this"] < 0.9 * chance["after_usual"]
    seats = np.resize(after["seats_mm"], (len(q), 3))  # touched in turn
    there = turned(arm, constants, q, np.zeros(len(q)))
    assert np.linalg.norm(there - seats, axis=1).max() < 0.7  # on them, but for roundings
    # What a gain of joint 3 does there, no eccentricity and no shift of the seats does.
    small = 1e-5
    scale, cosine, sine = (
        (turned(arm, constants, q, small * of) - there).reshape(-1) / small
        for of in (q[:, 2], np.cos(q[:, 2]), np.sin(q[:, 2]))
    )
    shifts = np.kron(np.resize(np.eye(2), (len(q), 2)), np.eye(3))
    others = np.column_stack([cosine, sine, shifts])
    left = scale - others @ np.linalg.lstsq(others, scale, rcond=None)[0]
    assert np.linalg.norm(left) > 0.05 * np.linalg.norm(scale)


@pytest.mark.slow
def test_without_a_doubt_there_are_no_poses(tmp_path: Path) -> None:
    judged(tmp_path, "--days", "4")
    with pytest.raises(BadInput, match="--poses"):
        run("report", "--history", tmp_path / "history", "--poses", tmp_path / "poses.csv")
    arm = load_arm(tmp_path / "checks" / "arm.toml")
    with pytest.raises(BadInput, match="next_check: found no poses"):
        load_proposed_check(tmp_path / "history", arm)
    assert not (tmp_path / "poses.csv").exists()


@pytest.mark.slow
def test_wear_is_one_growth_and_its_calibration_grows(tmp_path: Path) -> None:
    result, checks = judged(
        tmp_path, "--days", "26", "--plant", "geometry_shift@joint 4=40@9+",
        "--bad", "wrong-artefact@17",
    )  # fmt: skip
    (change,) = result["changes"]
    assert change["gradual"] and change["location"] == "joint 4"
    assert change["cause"] == "geometry_shift" and "per_day" in change["parameters"][0]
    assert [c["name"] for c in result["checks"] if c["verdict"] == "bad_check"] == ["day-17"]
    mended = tmp_path / "history" / change["calibration_from"]
    for day in (16, 26):  # on the way, and at the end
        before = rms_um(checks, checks / "calibration.json", day)
        assert rms_um(checks, mended, day) < 0.25 * before
    content = load_calibration(mended, load_arm(checks / "arm.toml")).content
    ends = [f.until_unix_s for t in content.terms for f in t.basis if f.kind == "time"]
    assert ends and all(end is not None for end in ends)  # held after the last check


@pytest.mark.slow
def test_a_second_change_is_another_and_its_calibration_has_both(tmp_path: Path) -> None:
    result, checks = judged(
        tmp_path, "--days", "24", "--plant", "encoder_slip@joint 2=-6@9",
        "--plant", "tip_offset@tip=20@17",
    )  # fmt: skip
    first, second = result["changes"]
    assert (first["cause"], first["location"]) == ("encoder_slip", "joint 2")
    assert (second["cause"], second["location"]) == ("tip_offset", "tip")
    history = tmp_path / "history"
    usual = rms_um(checks, checks / "calibration.json", 5)
    assert rms_um(checks, history / second["calibration_from"], 22) < 2 * usual
    assert rms_um(checks, history / first["calibration_from"], 12) < 2 * usual
    assert rms_um(checks, history / first["calibration_from"], 22) > 2 * usual


@pytest.mark.slow
def test_clean_checks_stay_in_control(tmp_path: Path) -> None:
    result, _ = judged(tmp_path, "--days", "30", "--artefact", "seats")
    assert result["state"] == "in_control" and not result["changes"]
    assert {check["verdict"] for check in result["checks"]} == {"in_control"}


def test_simulate_says_what_it_does_not_know(tmp_path: Path) -> None:
    for words in (
        ["--plant", "encoder_slip@joint 3=15@x"],
        ["--plant", "encoder_slip@joint 3=15@99"],
        ["--bad", "dirty-seat"],
        ["--bad", "dirty-seat@0"],
    ):
        with pytest.raises(BadInput):
            measured(tmp_path / "x", *words)


def with_standing(seed: int) -> tuple[Stack, list[Cause]]:
    """The small stack, its second known error one of those that the model does not have."""
    of, causes = a_stack(np.random.default_rng(seed))
    return replace(of, standing=(1, 2), share=0.1), causes


@pytest.mark.parametrize("seed", range(3))
def test_how_large_standing_errors_are_is_averaged_over(seed: int) -> None:
    """Densities with a change and without one, each the mean over all sizes, written out."""
    of, causes = with_standing(seed)
    weighed = weigh(RunningSums(of), causes, of.n, np.array([2]))
    nothing = [np.zeros((len(z), 1)) for z in of.residual]
    step = [float(i >= 2) * x[:, of.blocks[1]] for i, x in enumerate(of.columns)]
    each = [of.rescale(share / of.share) for share in ALL_ALONG]
    without = logsumexp([density(one, nothing, 0.0) for one in each])
    for s, size in enumerate(SIZES):
        with_it = logsumexp([density(one, step, size) for one in each])
        expected = with_it - without - np.log(len(SIZES)) + np.log(0.25)
        assert weighed.log_by_size[0, 1, 0, s] == pytest.approx(expected, abs=1e-8)
    marginal = compute_log_marginal(of, of.sum_checks(range(of.n)))
    assert marginal == pytest.approx(without - np.log(len(ALL_ALONG)), abs=1e-8)


@pytest.mark.parametrize("seed", range(3))
def test_a_usual_check_beside_the_rest_is_all_of_them(seed: int) -> None:
    """Whatever the standing errors' size: the others' density times the check's is that of all."""
    of, _ = with_standing(seed)
    of = replace(of, targets=tuple(np.ones((len(z), 3)) for z in of.residual))
    other_checks = OtherChecks(of, of.sum_checks(range(of.n)))
    together = other_checks.log_densities(3)[:, :2].sum(axis=1)
    nothing = [np.zeros((len(z), 1)) for z in of.residual]
    expected = np.array(
        [density(of.rescale(share / of.share), nothing, 0.0) for share in ALL_ALONG]
    )
    assert np.ptp(expected) > 0.1  # the sizes are told apart
    assert together - expected == pytest.approx(np.full(4, together[0] - expected[0]), abs=1e-8)


@pytest.mark.parametrize("share", ALL_ALONG)
def test_the_checks_tell_how_large_standing_errors_are(share: float) -> None:
    rng = np.random.default_rng(5)
    known = tuple(100.0 * rng.normal(size=(30, 40)) for _ in range(4))
    errors = share * rng.normal(size=40)
    residual = tuple(k @ errors + rng.normal(size=30) for k in known)
    nothing = tuple(np.zeros((30, 0)) for _ in range(4))
    of = Stack(np.arange(4.0), residual, nothing, known, nothing, (), (0, 40))
    assert fit_standing_share(of).share == pytest.approx(share)
