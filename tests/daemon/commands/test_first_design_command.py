"""`armd design` without sessions, from the command line to `armd measure` and `armd correct`."""

from __future__ import annotations

import csv
import json
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.writing import write_session
from armd.compensation.design.reaching import solve_postures
from armd.compensation.estimate.placements.rigid_motions import fit_by_kabsch
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon import cli
from armd.daemon.measure.plan.kinds import make_plan
from armd.daemon.measure.plan.stations import Wishes
from armd.errors import BadInput
from support import synthetic

ARM = """schema = "armd.arm/1"
serial_number = "FIRST-1"
joint = [
  {d_mm = 300.0, a_mm = 20.0, alpha_deg = 90.0, min_deg = -170.0, max_deg = 170.0},
  {a_mm = 400.0, min_deg = -30.0, max_deg = 150.0},
  {a_mm = 20.0, alpha_deg = -90.0},
  {d_mm = 350.0, alpha_deg = 90.0},
]
[tip]
offset_mm = [10.0, 20.0, 120.0]
"""
BALLS = {"B1": (0.0, 0.0, 0.0), "B2": (200.0, 0.0, 0.0), "B3": (90.0, 120.0, 30.0)}
ARTEFACT = 'schema = "armd.artefact/1"\n[artefact]\nname = "balls"\n' + "".join(
    f'[[artefact.target]]\nname = "{name}"\nposition_mm = {list(at)}\n'
    for name, at in BALLS.items()
)


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Arm:
    monkeypatch.chdir(tmp_path)
    Path("arm.toml").write_text(ARM)
    Path("balls.toml").write_text(ARTEFACT)
    return load_arm("arm.toml")


def read(path: str) -> list[dict[str, str]]:
    with Path(path).open() as file:
        return list(csv.DictReader(file))


def test_a_table_a_result_and_a_page_of_a_trackers_points(
    arm: Arm, capsys: pytest.CaptureFixture[str]
) -> None:
    line = "design --arm arm.toml --readings 20 --reach 200 800 -o poses.csv --json out.json"
    assert cli.main([*line.split(), "--report", "page.html"]) == 0
    rows, result = read("poses.csv"), json.loads(Path("out.json").read_text())
    assert len(rows) == result["readings"] == len(result["poses"]) == 20
    q = np.array([[float(row[f"q{k}"]) for k in range(1, 5)] for row in rows])
    shown = np.array([[float(row[f"q{k}_deg"]) for k in range(1, 5)] for row in rows])
    tip = np.array([[float(row[f"{a}_mm"]) for a in "xyz"] for row in rows])
    low, high = arm.range_rad
    assert (q >= low).all() and (q <= high).all()
    np.testing.assert_allclose(np.degrees(q), shown, atol=0.051)
    np.testing.assert_allclose(compute_pose(q, arm.nominal())[0], tip, atol=0.051)
    assert (np.linalg.norm(tip, axis=1) > 199).all() and (np.linalg.norm(tip, axis=1) < 801).all()
    assert result["schema"] == "armd.design/1" and result["target_kind"] == "tracker"
    assert result["rank"] == result["structural_rank"] == 13
    assert set(result["observability"]) == {"O1", "O2", "O3", "O4", "O5"}
    assert result["condition_number"] == pytest.approx(1 / result["observability"]["O2"])
    printed = capsys.readouterr().out
    assert "20 postures for a first calibration" in printed and "Rank 13 of 13" in printed
    page = Path("page.html").read_text()
    assert "MEASURE 20 POSES" in page and "<svg" in page and "Observability O1" in page
    assert "SHA-256" in page and "started, UTC" not in page  # no session, no table of sessions
    # The angles are in rad as readings have them.
    assert cli.main(["correct", "poses.csv", "--arm", "arm.toml", "-o", "points.csv"]) == 0


@pytest.mark.slow
def test_without_a_number_as_many_as_a_certificate_wants_and_poses_is_the_older_name(
    arm: Arm,
) -> None:
    assert cli.main(["design", "--arm", "arm.toml", "--json", "out.json"]) == 0
    result = json.loads(Path("out.json").read_text())
    assert result["readings"] == result["certificate_readings"] == 3 * ((13 + 6 + 2) // 3 + 1)
    line = "design --arm arm.toml --poses 17 --lowest 0 --json out.json --force"
    assert cli.main(line.split()) == 0
    result = json.loads(Path("out.json").read_text())
    assert result["readings"] == 17 and result["below_base"] == 0


@pytest.mark.slow
def test_an_artefacts_table_is_the_plan_of_a_measurement(arm: Arm) -> None:
    line = "design --arm arm.toml --artefact balls.toml --lowest 0 -o poses.csv --json out.json"
    assert cli.main(line.split()) == 0
    rows, result = read("poses.csv"), json.loads(Path("out.json").read_text())
    assert result["target_kind"] == "artefact" and result["structural_rank"] == 13
    targets = [{"name": name, "position_mm": at} for name, at in BALLS.items()]
    balls = Artefact.model_validate({"name": "balls", "target": targets})
    plan = make_plan("poses", arm, balls, Wishes(poses=Path("poses.csv")))
    assert [(s.placement, s.target) for s in plan.stations] == [
        (row["placement"], row["target"]) for row in rows
    ]
    begins = [
        i for i, row in enumerate(rows) if not i or row["placement"] != rows[i - 1]["placement"]
    ]
    assert [i for i, s in enumerate(plan.stations) if "the artefact with B" in s.how] == begins
    assert len(begins) == 3
    assert plan.stations[0].posture_deg == tuple(float(rows[0][f"q{k}_deg"]) for k in range(1, 5))
    with pytest.raises(BadInput, match=r"target: found 'B.', expected targets of --artefact"):
        make_plan("poses", arm, None, Wishes(poses=Path("poses.csv")))


@pytest.mark.slow
@pytest.mark.parametrize("on_balls", [False, True])
def test_a_session_in_these_poses_is_granted_a_certificate(arm: Arm, on_balls: bool) -> None:
    """Of an arm up to 1 mm and 0.5° off its drawing, with 0.02 mm of noise; on the balls its joints
    are turned until the real tip is there."""
    options = ["--artefact", "balls.toml"] if on_balls else []
    assert cli.main(["design", "--arm", "arm.toml", "-o", "poses.csv", *options]) == 0
    rows, rng = read("poses.csv"), np.random.default_rng(3)
    q = np.array([[float(row[f"q{k}"]) for k in range(1, 5)] for row in rows])
    nominal, truth = arm.nominal(), synthetic.disturbed(arm, rng)
    columns: dict[str, object] = {"time_s": 5.0 * np.arange(len(q))}
    targets: list[dict[str, object]] = [{"name": "reflector"}]
    if on_balls:
        targets = [{"name": name, "position_mm": at} for name, at in BALLS.items()]
        wide = [joint.model_copy(update={"min_deg": None, "max_deg": None}) for joint in arm.joint]
        place = np.array([row["placement"] for row in rows])
        local = np.array([BALLS[row["target"]] for row in rows])
        wanted, drawn = np.zeros((len(q), 3)), compute_pose(q, nominal)[0]
        for one in ("P1", "P2", "P3"):
            of = place == one
            group = np.zeros(of.sum(), dtype=np.int64)
            turn, shift = fit_by_kabsch(local[of], drawn[of], np.ones(of.sum()), group, 1)
            wanted[of] = local[of] @ turn[0].T + shift[0]
        assert np.abs(wanted - drawn).max() < 1.0
        wanted += rng.normal(0.0, 0.02, wanted.shape)
        q, reached = solve_postures(arm.model_copy(update={"joint": wide}), truth, wanted, q)
        assert reached.all()
        columns |= {"placement": place, "target": [row["target"] for row in rows]}
    else:
        seen = compute_pose(q, truth)[0] + rng.normal(0.0, 0.02, (len(q), 3))
        columns |= {"placement": ["T"] * len(q), "target": ["reflector"] * len(q)}
        columns |= {f"{axis}_mm": seen[:, i] for i, axis in enumerate("xyz")}
    columns |= {f"q{k + 1}": q[:, k] for k in range(4)}
    file = {
        "schema": "armd.session/1",
        "arm": arm.serial_number,
        "started": synthetic.STARTED,
        "angle_unit": "rad",
        "artefact": {"name": "balls", "target": targets},
    }
    write_session(Path("measured"), file, columns)  # type: ignore[arg-type]
    line = "calibrate measured --arm arm.toml -o cal.json --json result.json"
    assert cli.main(line.split()) == 0
    certificate = json.loads(Path("result.json").read_text())["certificate"]
    assert certificate["granted"], certificate


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (
            "--readings 6",
            "--readings/--poses: value: found 6, expected 8 (fewer have no one answer)",
        ),
        ("--poses 601", "--readings/--poses: value: found 601, expected 8"),
        ("--reach 5000 6000", "--reach: value: found 0 of 60000 random postures"),
        ("--reach 900 300", "--reach: value: found 900 300, expected MIN MAX in mm"),
        ("--lowest 9000", "--reach and --lowest: value: found 0 of"),
        ("--artefact none.toml", "none.toml: the file: found nothing"),
        ("--artefact arm.toml", "arm.toml: "),
        ("none --reach 1 2", "--reach: found it beside sessions, expected it without sessions"),
    ],
)
def test_what_cannot_be_met_is_refused_and_nothing_is_written(
    arm: Arm, capsys: pytest.CaptureFixture[str], options: str, message: str
) -> None:
    before = sorted(Path().iterdir())
    line = f"design {options} --arm arm.toml -o poses.csv --json out.json --report page.html"
    assert cli.main(line.split()) == 2
    told = capsys.readouterr()
    assert message in told.err and told.err.startswith("armd: ") and not told.out
    assert sorted(Path().iterdir()) == before
