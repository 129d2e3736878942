"""`armd design`: what it proposes settles what it was asked, on the same sick arm."""

import csv
import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.arm import load_arm
from armd.compensation.diagnose.design import design
from armd.compensation.diagnose.diagnose import Diagnosis, diagnose
from armd.compensation.diagnose.next import SURE, most_doubtful, next_experiment
from armd.compensation.session import load_session
from armd.daemon.cli import main
from armd.simulator.campaigns.hidden import DESIGNS, Design
from armd.simulator.hidden import HiddenCase, generate_case, measure_next
from armd.simulator.plan import Climate
from armd.simulator.plants.plant import Plant
from armd.simulator.truth.conditions import Conditions

#: Joint 3 turns through 75° only: a gain, an eccentricity and an ellipticity are nearly one curve.
CONFOUNDED = replace(DESIGNS["short range"], sessions=4, articulations=3, holdout=0)
CLEAN = Design(sessions=3, articulations=3, holdout=0)
#: Parameters that a placement or the tip's offset can do as well.
GAUGES = {"theta_1", "d_1", "theta_6", "d_6", "a_6", "alpha_6"}


def run_design(case: HiddenCase, folder: Path) -> tuple[dict, list[dict[str, str]], str, str]:
    table, out, page = folder / "poses.csv", folder / "poses.json", folder / "poses.html"
    command = [sys.executable, "-m", "armd.daemon.cli", "design", *map(str, case.sessions)]
    command += ["--arm", str(case.arm), "--poses", "9", "-o", str(table), "--json", str(out)]
    command += ["--report", str(page)]
    done = subprocess.run(command, check=True, timeout=200, capture_output=True, text=True)
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    return json.loads(out.read_text()), rows, page.read_text(), done.stdout


def test_nothing_in_doubt_the_command_tightens_a_parameter_that_is_no_gauge(tmp_path) -> None:
    case = generate_case(tmp_path / "case", 1, [], CLEAN)
    result, rows, page, said = run_design(case, tmp_path)
    assert result["schema"] == "armd.design/1"
    assert result["unit"] == "µm at the tip"
    assert not GAUGES & set(result["quantity"].split())
    assert 0.1 < result["after"] < 0.9 * result["before"] < 50.0
    assert f"{result['before']:.2f} µm at the tip" in said
    assert result["next_experiment"] in said
    assert f"{result['after']:.2f}" in page
    assert "http://" not in page.split("<body>")[1]
    assert [int(row["pose"]) for row in rows] == list(range(1, 10))
    arm = load_arm(case.arm)
    for k, joint in enumerate(arm.joint, 1):
        angles = np.array([float(row[f"q{k}_deg"]) for row in rows])
        assert joint.min_deg <= angles.min() and angles.max() <= joint.max_deg
        assert {row[f"approach_joint_{k}"] for row in rows} <= {"+", "-"}
    # The tips of the table are where the true arm would stand, but for its geometry's errors.
    q = np.radians([[float(row[f"q{k}_deg"]) for k in range(1, 7)] for row in rows])
    tips = np.array([[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows])
    true = case.present.rig.arm.tip(q, Conditions.at_rest(len(q), 6, 20.0))
    assert np.abs(tips - true).max() < 5.0


@pytest.mark.parametrize("poses", ["0", "-3", "100000"])
def test_a_number_of_poses_that_cannot_be_chosen_is_refused(poses: str, capsys) -> None:
    code = main(["design", "nowhere", "--arm", "none.toml", "--poses", poses])
    assert code == 2
    assert f"--poses: value: found {poses}" in capsys.readouterr().err


def resolved(diagnosis: Diagnosis, plant: Plant) -> bool:
    truth = (plant.cause, plant.location)
    return any(f.candidate.place == truth and f.probability > SURE for f in diagnosis.found)


@pytest.mark.slow
@pytest.mark.parametrize("n_seeds", [5])
def test_the_proposed_poses_resolve_what_a_short_range_confounds(n_seeds: int, tmp_path) -> None:
    """Of the cases in doubt, most are settled by twelve poses, and rightly."""
    settled = []
    for seed in range(1, n_seeds + 1):
        for plant in (
            Plant("encoder_scale", "joint 3", 8.0),
            Plant("encoder_eccentricity", "joint 3", 0.8),
        ):
            folder = tmp_path / f"{plant.cause}-{seed}"
            case = generate_case(folder, seed, [plant], CONFOUNDED)
            arm = load_arm(case.arm)
            sessions = [load_session(path, arm) for path in case.sessions]
            before = diagnose(sessions, arm)
            doubt = most_doubtful(before)
            if doubt is None:
                continue
            proposed = design(before)
            assert doubt.words in next_experiment(before)
            assert proposed.question.words == doubt.words
            assert proposed.after > 2.0 * proposed.before
            climate = Climate(proposed.climate.air_c)
            measured = measure_next(case, folder / "next", proposed.states.q, climate, seed=seed)
            after = diagnose([*sessions, load_session(measured, arm)], arm)
            settled.append(resolved(after, plant))
            print(
                f"{plant.cause} {seed}: {doubt.words}: {proposed.before:.1f} → "
                f"{proposed.after:.1f} noise units; "
                f"{'resolved' if settled[-1] else 'still open'}"
            )
    print(f"resolved {sum(settled)} of {len(settled)} in doubt")
    assert len(settled) >= n_seeds
    assert np.mean(settled) >= 0.8
