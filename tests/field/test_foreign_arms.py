"""Drawings and calibrations that people have, each with its right answer in its README.

The positions are those of the READMEs, which numpy has by the specifications of URDF, of `<mimic>`
and of Denavit and Hartenberg's rows; whole chains are walked here with scipy's rotations.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armd.arrays import F64
from armd.compensation.model.arm import load_arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.cli import main

FIELD = Path(__file__).parent
Said = pytest.CaptureFixture[str]


def imported(capsys: Said, path: Path, out: Path, *options: str) -> tuple[int, str]:
    code = main(["import", str(path), "-o", str(out), *options])
    said = capsys.readouterr()
    return code, said.out + said.err


def tips(arm_toml: Path, angles: list[list[float]]) -> F64:
    return compute_pose(np.array(angles), load_arm(arm_toml).nominal())[0]


def misfit_mm(ours: F64, theirs: F64) -> float:
    """What is left after the best rigid motion, largest."""
    turn, _ = Rotation.align_vectors(theirs - theirs.mean(0), ours - ours.mean(0))
    moved = turn.apply(ours - ours.mean(0)) + theirs.mean(0)
    return float(np.abs(moved - theirs).max())


# --- URDF ----------------------------------------------------------------------------------------


def step(xyz_m: list[float], turn: Rotation) -> F64:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn.as_matrix(), 1e3 * np.array(xyz_m)
    return matrix


def about(axis: list[float], angle: float) -> F64:
    return step([0, 0, 0], Rotation.from_rotvec(angle * np.array(axis)))


NONE = Rotation.identity()


def quat_tip(q: F64) -> F64:
    a, b, c = q
    pose = step([0, 0, 0.2], NONE) @ about([0, 0, 1], a)
    pose = pose @ step([0.05, 0, 0.1], Rotation.from_euler("x", 90, degrees=True))
    pose = pose @ about([0, 0, 1], b)
    pose = pose @ step([0.3, 0, 0], Rotation.from_euler("z", 30, degrees=True))
    return (pose @ about([0, 0, 1], c) @ step([0.25, 0, 0], NONE))[:3, 3]


def plain_tip(q: F64) -> F64:
    a, b, c = q
    pose = step([0, 0, 0.2], NONE) @ about([0, 0, 1], a)
    pose = pose @ step([0.05, 0, 0.1], Rotation.from_euler("x", np.pi / 2)) @ about([0, 0, 1], b)
    return (pose @ step([0.3, 0, 0], NONE) @ about([0, 0, 1], c) @ step([0.25, 0, 0], NONE))[:3, 3]


def near_parallel_tip(q: F64) -> F64:
    quarter = Rotation.from_euler("x", np.pi / 2)
    pose = about([0, 0, 1], q[0]) @ step([0.0003, 0, 0.15], quarter) @ about([0, 0, 1], q[1])
    pose = pose @ step([0.42, 0, 0.0002], Rotation.from_euler("xyz", [0.0003, 0.0008, 0]))
    pose = pose @ about([0, 0, 1], q[2]) @ step([0.39, 0, 0.11], quarter) @ about([0, 0, 1], q[3])
    return (pose @ step([0, 0, 0.1], NONE))[:3, 3]


@pytest.mark.parametrize(
    ("name", "tip", "known"),
    [
        ("urdf-quat/quat.urdf", quat_tip,
         {(0, 0, 0): (566.5064, 0, 425.0), (0.3, -0.4, 0.5): (505.6251, 156.4082, 329.1646)}),
        ("urdf-unbound-prefix/prefix.urdf", plain_tip,
         {(0, 0, 0): (600, 0, 300), (0.3, -0.4, 0.5): (549.3847, 169.9446, 208.1329)}),
        ("urdf-gazebo-joint/gazebo.urdf", plain_tip,
         {(0, 0, 0): (600, 0, 300), (0.3, -0.4, 0.5): (549.3847, 169.9446, 208.1329)}),
        ("urdf-near-parallel/arm.urdf", near_parallel_tip,
         {(0, 0, 0, 0): (810.3879, -109.858, 49.967),
          (0.3, -0.4, 0.5, 0.2): (782.6596, 127.0486, -74.1857)}),
    ],
)  # fmt: skip
def test_a_urdf_has_its_chains_positions(
    name: str, tip: object, known: dict[tuple[float, ...], tuple[float, ...]],
    tmp_path: Path, capsys: Said,
) -> None:  # fmt: skip
    assert callable(tip)
    out = tmp_path / "arm.toml"
    code, said = imported(capsys, FIELD / name, out)
    assert code == 0, said
    for q, position in known.items():  # the walk above is the README's
        assert tip(np.array(q)) == pytest.approx(position, abs=1e-4)
    shown = ", ".join(f"{x:.10g}" for x in np.round(tip(np.zeros(len(next(iter(known))))), 3) + 0.0)
    assert f"the tip at zero angles: ({shown}) mm in the frame of base" in said
    assert "Rz(theta) Tz(d) Tx(a) Rx(alpha) Ry(beta)" in said
    q = np.random.default_rng(2).uniform(-2, 2, (40, len(next(iter(known)))))
    theirs = np.array([tip(row) for row in q])
    assert misfit_mm(tips(out, q.tolist()), theirs) < 1e-6
    assert main(["check", str(out)]) == 0


@pytest.mark.parametrize("angle_deg", [0.0, 1e-4, 0.003, 0.2, 3.0, 179.9, 180.0])
def test_axes_at_any_small_angle_have_a_row(angle_deg: float, tmp_path: Path, capsys: Said) -> None:
    """The two long axes stand at *angle_deg* to each other, about a direction of no frame."""
    text = (FIELD / "urdf-near-parallel" / "arm.urdf").read_text()
    roll, pitch = np.radians(angle_deg) * np.array([0.6, 0.8])
    turn = Rotation.from_rotvec([roll, pitch, 0.0])
    rpy = " ".join(map(repr, turn.as_euler("xyz").tolist()))
    (tmp_path / "a.urdf").write_text(text.replace('rpy="0.0003 0.0008 0"', f'rpy="{rpy}"'))
    out = tmp_path / "arm.toml"
    code, said = imported(capsys, tmp_path / "a.urdf", out)
    assert code == 0, said

    def tip(q: F64) -> F64:
        quarter = Rotation.from_euler("x", np.pi / 2)
        pose = about([0, 0, 1], q[0]) @ step([0.0003, 0, 0.15], quarter) @ about([0, 0, 1], q[1])
        pose = pose @ step([0.42, 0, 0.0002], turn) @ about([0, 0, 1], q[2])
        pose = pose @ step([0.39, 0, 0.11], quarter) @ about([0, 0, 1], q[3])
        return (pose @ step([0, 0, 0.1], NONE))[:3, 3]

    q = np.random.default_rng(2).uniform(-2, 2, (40, 4))
    assert misfit_mm(tips(out, q.tolist()), np.array([tip(row) for row in q])) < 1e-6
    assert max(abs(joint.d_mm) for joint in load_arm(out).joint) < 5000.0


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("urdf-mimic/mimic.urdf", "joint j3_back: found one that follows joint j3 (mimic)"),
        ("urdf-messages/arm.urdf.xacro",
         "found a xacro, from which a URDF is made, expected a URDF: expand it first, "
         "`xacro arm.urdf.xacro > arm.urdf`"),
        ("urdf-messages/model.xml", "found MuJoCo's format (MJCF), expected the same robot's URDF"),
        ("urdf-messages/zero-axis.urdf", "joint j1, axis: found '0 0 0', expected a direction"),
    ],
)  # fmt: skip
def test_what_is_no_urdf_of_an_arm(name: str, said: str, tmp_path: Path, capsys: Said) -> None:
    code, told = imported(capsys, FIELD / name, tmp_path / "a.toml")
    assert code == 2 and said in told and told.count("\n") == 1
    assert not (tmp_path / "a.toml").exists()


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("<robot name", "<!DOCTYPE robot [<!ENTITY e 'x'>]><robot name", "found the entity e"),
        ('xyz="0 0 1"/><limit lower="-3"', '/><limit lower="-3"', None),
        ('<axis xyz="0 0 1"/><limit lower="-3"', '<axis><xyz>0 0 1</xyz></axis><limit lower="-3"',
         "joint j1, axis: found xyz, expected xyz alone"),
        ('quat_xyzw="0 0 0.25881904510252074', 'quat_wxyz="0 0 0.25881904510252074',
         "joint j3, origin: found quat_wxyz, expected quat_xyzw or rpy or xyz alone"),
        ('xyz="0.3 0 0" quat', 'xyz="0.3 0 0" rpy="0 0 0" quat', "found both rpy and quat_xyzw"),
        ('"0 0 0.25881904510252074 0.96592582628906831"', '"0 0 0 0"', "a quaternion, not 0"),
        ('<child link="l3"/>', '<child link="l2"/>', "link l2: found two joints, j2 and j3"),
    ],
)  # fmt: skip
def test_what_a_urdf_may_not_say_in_silence(
    old: str, new: str, said: str | None, tmp_path: Path, capsys: Said
) -> None:
    text = (FIELD / "urdf-quat" / "quat.urdf").read_text().replace('<?xml version="1.0"?>\n', "")
    assert old in text
    (tmp_path / "a.urdf").write_text(text.replace(old, new, 1))
    code, told = imported(capsys, tmp_path / "a.urdf", tmp_path / "a.toml")
    assert (code == 0) if said is None else (code == 2 and said in told)


def test_a_xacro_by_another_name_is_one(tmp_path: Path, capsys: Said) -> None:
    text = (FIELD / "urdf-messages" / "arm.urdf.xacro").read_text()
    (tmp_path / "arm.urdf").write_text(text)
    assert "expand it first" in imported(capsys, tmp_path / "arm.urdf", tmp_path / "a.toml")[1]


# --- rows of Denavit and Hartenberg --------------------------------------------------------------


def started(capsys: Said, table: Path, folder: Path, *options: str) -> tuple[int, str]:
    words = ["--serial-number", "M", "--port", "/dev/ttyUSB0", *options]
    code = main(["init", str(folder), "--from", str(table), *words])
    said = capsys.readouterr()
    return code, said.out + said.err


MDH = FIELD / "mdh-table" / "rows.csv"


def test_columns_in_craigs_order_are_asked_about(tmp_path: Path, capsys: Said) -> None:
    code, said = started(capsys, MDH, tmp_path / "arm")
    assert code == 2 and "--modified, if alpha and a are of the link before" in said
    assert not (tmp_path / "arm").exists()


def test_a_modified_table_has_its_positions(tmp_path: Path, capsys: Said) -> None:
    code, said = started(capsys, MDH, tmp_path / "arm", "--modified")
    assert code == 0, said
    assert "rows are read in the modified convention, Rx(alpha) Tx(a) Rz(theta) Tz(d)" in said
    assert "the tip at zero angles: (805, 0, 1180) mm" in said
    ours = tips(tmp_path / "arm" / "arm.toml", [[0] * 6, [0.3, -0.4, 0.5, 0.2, 0.6, -0.1]])
    known = np.array([[805, 0, 1180], [539.3571, 176.2364, 1016.2041]])
    assert ours == pytest.approx(known, abs=1e-4)
    code, said = started(capsys, MDH, tmp_path / "other", "--standard")
    assert code == 0 and "in the standard convention, Rz(theta) Tz(d) Tx(a) Rx(alpha)" in said


def craig(rows: F64, q: F64) -> F64:
    """The last frame's origin, by Craig's (3.6): rows of α, a, d, θ in degrees and mm."""
    pose = np.eye(4)
    for (alpha, a, d, theta), angle in zip(rows, q, strict=True):
        first, last = np.eye(4), np.eye(4)
        first[:3, :3] = Rotation.from_euler("x", alpha, degrees=True).as_matrix()
        first[0, 3] = a
        turn = Rotation.from_euler("z", np.radians(theta) + angle)
        last[:3, :3], last[2, 3] = turn.as_matrix(), d
        pose = pose @ first @ last
    return pose[:3, 3]


def test_any_modified_table_places_points_alike(tmp_path: Path, capsys: Said) -> None:
    """With a first row that turns and shifts the base, and a flange that is no joint."""
    rng = np.random.default_rng(5)
    rows = np.round(rng.uniform(-180, 180, (5, 4)), 2)
    table = tmp_path / "t.csv"
    names = ["Joint 1", "Joint 2", "Joint 3", "Joint 4", "Flange"]
    lines = [";".join([n, *map(str, row)]) for n, row in zip(names, rows.tolist(), strict=True)]
    table.write_text("Joint;α_{i-1} (deg);a_{i-1} (mm);d_i;θ_i\n" + "\n".join(lines) + "\n")
    code, said = started(capsys, table, tmp_path / "arm")
    assert code == 0, said
    assert "the table is of the modified form" in said and "'Flange' is no joint" in said
    zero = ", ".join(f"{x:.10g}" for x in np.round(craig(rows, np.zeros(5)), 3))
    assert f"the tip at zero angles: ({zero}) mm" in said
    q = rng.uniform(-3, 3, (30, 4))
    theirs = np.array([craig(rows, np.append(row, 0.0)) for row in q])
    out = tmp_path / "arm" / "arm.toml"
    ours = tips(out, q.tolist())
    assert misfit_mm(ours, theirs) < 1e-6
    turn, _ = Rotation.align_vectors(theirs - theirs.mean(0), ours - ours.mean(0))
    assert turn.apply(load_arm(out).gravity) == pytest.approx([0, 0, -1], abs=1e-9)


def test_a_table_of_nearly_parallel_axes(tmp_path: Path, capsys: Said) -> None:
    """Rows of a calibrated arm by the common normal: d of half a kilometre."""
    rows = [[-90, 150, 0.3, 90], [20, -460273.6589, 391.2, 0.048957],
            [-20.5, 460383.9, 390, 90], [0, 0, 0, 0]]  # fmt: skip
    table = tmp_path / "t.csv"
    lines = "\n".join(",".join(map(repr, row)) for row in rows)
    table.write_text(f"theta,d,a,alpha\n{lines}\n")
    code, said = started(capsys, table, tmp_path / "arm")
    assert code == 0, said
    assert "Hayati's rows" in said
    q = np.random.default_rng(5).uniform(-2, 2, (30, 4))
    theirs = []
    for row in q:
        pose = np.eye(4)
        for (theta, d, a, alpha), angle in zip(rows, row, strict=True):
            turn, rest = np.eye(4), np.eye(4)
            turn[:3, :3] = Rotation.from_euler("z", np.radians(theta) + angle).as_matrix()
            rest[:3, :3] = Rotation.from_euler("x", alpha, degrees=True).as_matrix()
            rest[:3, 3] = a, 0, d
            pose = pose @ turn @ rest
        theirs.append(pose[:3, 3])
    # In armd's base frame, which is the table's: nothing is moved.
    out = tmp_path / "arm" / "arm.toml"
    assert np.abs(tips(out, q.tolist()) - np.array(theirs)).max() < 1e-5
    assert max(abs(joint.d_mm) for joint in load_arm(out).joint) < 1000


# --- LeRobot's calibrations ----------------------------------------------------------------------


SWEEPS, OTHERS = FIELD / "lerobot-wrapped-sweep", FIELD / "lerobot-other-files"


def calibrated(capsys: Said, path: Path, out: Path, *options: str) -> tuple[int, str]:
    words = ["arm", "import-lerobot", str(path), "-o", str(out), *options]
    code = main(words if "--arm" in options else [*words, "--arm", "so101"])
    said = capsys.readouterr()
    return code, said.out + said.err


def test_a_sweep_from_stop_to_stop_is_taken_without_a_word(tmp_path: Path, capsys: Said) -> None:
    code, said = calibrated(capsys, SWEEPS / "whole.json", tmp_path / "a.toml")
    assert code == 0 and "a sweep of" not in said
    joint = load_arm(tmp_path / "a.toml").joint[2]
    # the elbow's zero is raw 1976.5, and armd's is 2048
    drawn = 73.8245483080259
    assert joint.theta_deg == pytest.approx(drawn + (2048 - 1976.5) * 360 / 4096)


@pytest.mark.parametrize(
    ("name", "key", "swept", "travel"),
    [("wrapped", "shoulder_lift", "359° (3 … 4090)", "200°"),
     ("half", "elbow_flex", "90° (872 … 1896)", "194°")],
)  # fmt: skip
def test_a_sweep_that_has_no_middle(
    name: str, key: str, swept: str, travel: str, tmp_path: Path, capsys: Said
) -> None:
    code, said = calibrated(capsys, SWEEPS / f"{name}.json", tmp_path / "a.toml")
    assert code == 2 and f"{key}.range_min … range_max: found a sweep of {swept}" in said
    assert f"expected {travel}, its travel" in said and not (tmp_path / "a.toml").exists()


def test_a_joint_that_turns_no_farther_is_taken_when_said(tmp_path: Path, capsys: Said) -> None:
    half = SWEEPS / "half.json"
    options = ["--short-sweep", "elbow_flex"]
    code, said = calibrated(capsys, half, tmp_path / "a.toml", *options)
    assert code == 0 and "elbow_flex: a sweep of 90°" in said
    wrapped = SWEEPS / "wrapped.json"
    code, said = calibrated(
        capsys, wrapped, tmp_path / "b.toml", "--short-sweep", "shoulder_lift"
    )  # fmt: skip
    assert code == 2 and "across the encoder's seam" in said


def test_a_sweep_that_is_somewhat_short_is_remarked_on(tmp_path: Path, capsys: Said) -> None:
    """160° of 194°: the zero may be 17° off."""
    content = json.loads((SWEEPS / "whole.json").read_text())
    content["elbow_flex"]["range_max"] = 872 + 1820
    (tmp_path / "c.json").write_text(json.dumps(content))
    code, said = calibrated(capsys, tmp_path / "c.json", tmp_path / "a.toml")
    assert code == 0
    assert "elbow_flex: a sweep of 160° (872 … 2692), and the drawing's travel is 194°" in said


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("before-june-2025", "found LeRobot's format of before June 2025, whose zero is another"),
        ("phosphobot", "found phosphobot's calibration, expected LeRobot's"),
        ("two-arms", "found those of 2 arms (left_arm_, right_arm_), expected one arm: "
                     "--prefix left_arm_ or --prefix right_arm_"),
        ("below-zero", "shoulder_pan.range_min: found -118, expected 0 or more"),
    ],
)  # fmt: skip
def test_files_of_others_are_named(name: str, said: str, tmp_path: Path, capsys: Said) -> None:
    code, told = calibrated(capsys, OTHERS / f"{name}.json", tmp_path / "a.toml")
    assert code == 2 and said in told and told.count("\n") == 1
    assert not (tmp_path / "a.toml").exists()


@pytest.mark.parametrize(
    ("name", "options"),
    [("joint-name-key", ()), ("main-prefix", ()), ("4096", ()),
     ("two-arms", ("--prefix", "left_arm_")), ("two-arms", ("--prefix", "right_arm"))],
)  # fmt: skip
def test_files_that_say_the_same_give_the_same_arm(
    name: str, options: tuple[str, ...], tmp_path: Path, capsys: Said
) -> None:
    assert calibrated(capsys, SWEEPS / "whole.json", tmp_path / "whole.toml")[0] == 0
    code, said = calibrated(capsys, OTHERS / f"{name}.json", tmp_path / "a.toml", *options)
    assert code == 0, said
    assert load_arm(tmp_path / "a.toml") == load_arm(tmp_path / "whole.toml")


def test_a_dynamixel_counts_below_zero(tmp_path: Path, capsys: Said) -> None:
    """Koch's middle is raw 1206, and a whole turn on or off it is the same place."""
    path = OTHERS / "below-zero.json"
    code, said = calibrated(capsys, path, tmp_path / "a.toml", "--arm", "koch")
    assert code == 0, said
    joint = load_arm(tmp_path / "a.toml").joint[0]
    middle = joint.direction * (1206 - 2048) * 360 / 4096
    assert joint.theta_deg == pytest.approx(0.0 - middle)
    assert joint.min_deg is not None and joint.max_deg is not None
    assert (joint.min_deg + joint.max_deg) / 2 == pytest.approx(middle, abs=1e-3)
    content = json.loads(path.read_text())
    for key in ("range_min", "range_max"):
        content["shoulder_pan"][key] -= 4096
    (tmp_path / "turn.json").write_text(json.dumps(content))
    turn = tmp_path / "turn.toml"
    assert calibrated(capsys, tmp_path / "turn.json", turn, "--arm", "koch")[0] == 0
    assert load_arm(turn) == load_arm(tmp_path / "a.toml")
