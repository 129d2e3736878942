"""The outsider's generator: physics by hand, the same files again, nothing of armd."""

from __future__ import annotations

import ast
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from outsider.case import draw
from outsider.chain import Alteration, Table, by_angles, by_constants, posture
from outsider.faults import FAULTS, late
from outsider.files import write
from outsider.made_up import four_joints, scene
from outsider.run import ARMD
from outsider.scene import Scene
from outsider.seen import Seen
from outsider.sizes import read_exchanged

from support.selection import parametrize_default

HERE = Path(__file__).parent
RIGHT_ANGLE = np.pi / 2


def two_joints(per_k: float = 0.0) -> Table:
    return Table(
        theta=np.zeros(2),
        d=np.array([100.0, 0.0]),
        a=np.array([50.0, 200.0]),
        alpha=np.array([RIGHT_ANGLE, 0.0]),
        tip=np.array([0.0, 0.0, 10.0]),
        per_k=np.array([[per_k, 0.0], [0.0, 0.0]]),
    )


def test_it_imports_numpy_and_nothing_of_armd() -> None:
    allowed = {"numpy", "outsider", *sys.stdlib_module_names}
    for path in HERE.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            roots = {name.split(".")[0] for name in names}
            in_a_test = {"pytest", "support"} if path.name.startswith("test_") else set()
            assert roots <= allowed | in_a_test


def test_poses_worked_out_by_hand() -> None:
    """Straight out along x, the tip to the side; then a quarter turn of both joints."""
    q = np.array([[0.0, 0.0], [RIGHT_ANGLE, RIGHT_ANGLE]])
    tip = posture(two_joints(), q, np.zeros((2, 2))).tip
    np.testing.assert_allclose(tip, [[250, -10, 100], [10, 50, 300]], atol=1e-12)


def test_a_column_of_100_mm_grows_by_1_um_per_10_ppm_and_kelvin() -> None:
    q, warm = np.zeros((1, 2)), np.array([[10.0, 0.0]])
    tip = posture(two_joints(1e-5), q, warm).tip
    np.testing.assert_allclose(tip, [[250, -10, 100.01]], atol=1e-12)


def test_what_alters_an_arm_stands_in_its_own_frames() -> None:
    """After each link, x is the base's x, y its z; the tip is 10 mm off to the side. A shift along
    y lifts; link 1's turn about x swings the tip down, link 2's about y swings it on along x; the
    base's turn about z swings all of it."""
    none, q = Alteration.none(1, 2), np.zeros((1, 2))
    lift = np.zeros((1, 2, 3))
    lift[0, 0, 1] = 0.5
    raised = posture(two_joints(), q, q, replace(none, shift=lift)).tip
    np.testing.assert_allclose(raised, [[250, -10, 100.5]], atol=1e-12)
    swung = posture(two_joints(), q, q, replace(none, turn=2e-6 * np.eye(3)[None, :2])).tip
    np.testing.assert_allclose(swung[0] - [250, -10, 100], [2e-5, 0, -2e-5], atol=1e-9)
    turned = posture(two_joints(), q, q, replace(none, base=np.array([[0, 0, 0, 0, 0, 1e-6]]))).tip
    np.testing.assert_allclose(turned[0] - [250, -10, 100], [1e-5, 250e-6, 0], atol=1e-9)


def test_derivatives_are_those_of_the_chain() -> None:
    q = np.array([[0.3, -1.1]])
    step = 1e-6 * np.eye(2)
    tips = [posture(two_joints(), q + sign * step, np.zeros((2, 2))).tip for sign in (1, -1)]
    jacobian = by_angles(posture(two_joints(), q, np.zeros((1, 2))))
    np.testing.assert_allclose(jacobian[0].T, (tips[0] - tips[1]) / 2e-6, atol=1e-6)
    constants = by_constants(two_joints(), q, np.ones((1, 2)))
    np.testing.assert_allclose(constants[..., :2], jacobian, atol=1e-6)  # θ0 is the angle's own
    assert constants.shape == (1, 3, 4 * 2 + 3 + 2 * 2)


def test_a_level_link_sags_as_a_uniform_cantilever_does() -> None:
    """Deflection w·L³/8 EI, slope w·L²/6 EI: their ratio is 4/(3 L)."""
    (fault,) = FAULTS["sag"](
        np.random.default_rng(1), scene(np.zeros((1, 4)), four_joints())
    )  # fmt: skip
    assert fault.location == "link 2"
    np.testing.assert_allclose(fault.alter.shift[0, 1], [0, 0, -1], atol=1e-12)
    np.testing.assert_allclose(fault.alter.turn[0, 1], [0, 4 / 600, 0], atol=1e-12)


def test_a_carried_weight_bends_by_its_force_and_its_moment() -> None:
    """W at the end: L³/3; its moment W·r there: W·r·L²/2. With r = 15 mm of the last link's middle
    and 10 mm of the third, as far out."""
    machine = replace(four_joints(), mass_kg=np.array([0.0, 0.0, 0.0, 1.0]))
    (fault,) = FAULTS["sag"](np.random.default_rng(1), scene(np.zeros((1, 4)), machine))
    fall, slope = 200**3 / 3 + 15 * 200**2 / 2, 200**2 / 2 + 15 * 200
    np.testing.assert_allclose(fault.alter.turn[0, 1], [0, slope / fall, 0], atol=1e-12)


def test_on_an_even_ramp_a_link_is_late_by_its_time_constant() -> None:
    time_s = np.linspace(0, 6000, 41)
    behind = late(time_s, 1e-3 * time_s, 600.0)
    np.testing.assert_allclose(behind, -0.6 * (1 - np.exp(-time_s / 600)), atol=1e-12)


def test_friction_is_wound_up_to_the_side_of_approach_after_a_long_way() -> None:
    q = np.cumsum(np.ones((6, 4)), axis=0)
    side = np.array([1, -1, -1, 1, 1, -1.0])[:, None] * np.ones(4)
    (fault,) = FAULTS["dahl"](np.random.default_rng(1), scene(q, four_joints(), rate=side))
    joint = int(fault.location.split()[1]) - 1
    np.testing.assert_allclose(fault.alter.encoder[:, joint], side[:, joint], atol=1e-6)
    assert not np.delete(fault.alter.encoder, joint, axis=1).any()


@pytest.mark.slow
def test_what_constants_and_placements_absorb_has_no_size() -> None:
    """A zero that moved and a base that moved before everything; and the first one again, beside
    sessions from before it, whose rows hold the constants."""
    case = draw("clean", 2)  # with four sessions from before
    assert case.plan.before == 4
    everywhere = Scene(
        case.machine, case.readings, np.ones(len(case.readings.q), dtype=bool), case.thing
    )
    seen = Seen(case.machine, case.readings, case.machine.seat_mm)
    zero = everywhere.at_joint(2, np.full(len(case.readings.q), 1e-5))
    base = replace(everywhere.none(), base=np.full((len(case.readings.q), 6), 1e-5))
    assert seen.noise_units(zero) < 1e-3
    assert seen.noise_units(base) < 1e-3
    since = replace(everywhere, on=case.readings.session >= case.plan.before)
    later = since.at_joint(2, np.full(len(case.readings.q), 1e-5))
    assert seen.noise_units(later) > 5


@pytest.mark.slow
@parametrize_default("kind", ["disc", "settling", "sag", "offset"])
def test_a_case_is_as_large_as_wanted(kind: str) -> None:
    """Measured on what is planted, not on the small one by which it was sized."""
    assert 7.9 < draw(kind, 1).truth.noise_units < 25.3


@pytest.mark.slow
def test_a_rival_that_leaves_next_to_nothing_has_the_same_signal() -> None:
    """Over 222° this disc, 28 % oval, is a gain: 1.8 of its 20 noise units are none."""
    truth = draw("disc", 4711000).truth
    assert truth.same_signal == (("encoder_scale", truth.location),)
    assert "encoder_scale joint 3 leaves 1.8" in truth.words
    assert draw("disc", 1).truth.same_signal == ()


def test_exchanged_twice_is_as_it_was() -> None:
    warm = np.array([[1.0, 2, 3, 4], [2, 2, 5, 5]])
    whole = scene(np.zeros((2, 4)), four_joints(), warm=warm)
    once = read_exchanged(whole, whole.none(), 1, 2)
    np.testing.assert_allclose(once.sensor, [[0, 1, -1, 0], [0, 3, -3, 0]])
    assert not read_exchanged(whole, once, 1, 2).sensor.any()


@pytest.mark.slow
def test_a_link_that_is_late_is_so_from_each_session_on() -> None:
    case = draw("lag", 1)
    (k,) = np.flatnonzero(np.abs(case.alter.link).max(axis=0))
    assert case.truth.location == f"link {k + 1}"
    begin = np.flatnonzero(np.diff(case.readings.session, prepend=-1))
    assert not case.alter.link[begin].any()


@pytest.mark.slow
def test_nothing_planted_has_no_size() -> None:
    assert draw("doubled", 2).truth.noise_units == 0


def written(folder: Path, kind: str, seed: int) -> dict[str, bytes]:
    folder.mkdir()
    write(draw(kind, seed), folder)
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.slow
def test_kind_and_seed_say_all_of_a_case(tmp_path: Path) -> None:
    first = written(tmp_path / "first", "gross", 3)
    assert first == written(tmp_path / "again", "gross", 3)
    assert first != written(tmp_path / "other", "gross", 5)
    assert {"arm.toml", "truth.json", "before-4/readings.csv", "further/session.toml"} <= set(first)


@pytest.mark.slow
def test_the_command_takes_the_files(tmp_path: Path) -> None:
    write(draw("disc", 3), tmp_path)
    folders = [path for path in tmp_path.iterdir() if path.is_dir()]
    done = subprocess.run(
        [ARMD, "check", tmp_path / "arm.toml", *folders],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_one_session_of_those_diagnosed_stood_on_a_floor_that_shook() -> None:
    case = draw("floor", 2)
    (session,) = np.unique(case.readings.session[case.seat_mm > case.machine.seat_mm])
    assert case.plan.before <= session < case.plan.sessions - 1
    np.testing.assert_allclose(
        case.seat_mm[case.readings.session == session], 5 * case.machine.seat_mm
    )


@pytest.mark.slow
def test_the_artefact_is_read_once_in_each_placement(tmp_path: Path) -> None:
    write(draw("unread", 2), tmp_path)
    lines = (tmp_path / "further" / "readings.csv").read_text().splitlines()[1:]
    placements = [line.split(",")[1] for line in lines]
    read = [line.split(",")[1] for line in lines if not line.endswith(",")]
    assert read == list(dict.fromkeys(placements))
    assert "expansion_per_k = 1.15e-05" in (tmp_path / "further" / "session.toml").read_text()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["old_disc", "old_sag"])
def test_what_is_older_than_the_calibration_was_there_before_it(kind: str) -> None:
    case = draw(kind, 3)
    assert case.truth.held and 39.0 < case.truth.noise_units < 205.0
    moved = Seen(case.machine, case.readings, case.machine.seat_mm).displacement(case.alter)
    before = np.linalg.norm(moved[case.readings.session < case.plan.before], axis=1)
    assert (before > 0.0).all()
