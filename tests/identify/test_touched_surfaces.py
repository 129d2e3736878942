"""Calibration by surfaces of unknown place, touched by the simulator's own arm.

The truth is the simulator's: its arm, its surfaces and what its encoders show. armd's kinematics
only compare the arm that was found with it, over postures in which nothing was measured.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from armd.arrays import F64
from armd.compensation.data.sessions.points_only import INSTEAD
from armd.compensation.data.sessions.session import load_sessions
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.identify.result import Result
from armd.compensation.model.arm import load_arm
from armd.compensation.model.kinematics import compute_jacobian
from armd.daemon.cli import main
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects.effect import Conditions
from support.selection import parametrize_default
from support.touched_surfaces import Surface, Workshop, cylinder, distance, plane, sphere
from support.true_directions import errors_of

#: Of the block and of the radii, as certified.
CERTIFIED_MM = 0.0005
#: Standard deviations of a share of 0.95 and of a mean square of 1 that are believed.
MOST_SIGMA = 3.0


@dataclass(frozen=True)
class Kind:
    """A campaign: what is touched, how often, and whether it tells the arm's size."""

    surfaces: Callable[[float], list[Surface]]  # by how much the certificate errs, mm
    placements: int
    each: int
    sized: bool
    lengths: Sequence[str] = ()
    tilted: float = 0.6


KINDS = {
    "plate": Kind(lambda _: [plane("plate")], 6, 40, False),
    "ball": Kind(lambda off: [sphere("ball", 40.0 + off, (40.0, CERTIFIED_MM))], 6, 40, True),
    "ball of unknown radius": Kind(lambda _: [sphere("ball", 40.0)], 6, 40, False),
    "block from outside": Kind(
        lambda off: [plane("foot", -off, -1.0, 60.0), plane("head", 50.0, 1.0, 60.0)],
        6, 30, True, [distance("foot", "head", 50.0, CERTIFIED_MM)], 1.2,
    ),
    "block on a plate": Kind(
        lambda off: [plane("plate", -off), plane("head", 50.0, 1.0, 20.0)],
        6, 30, True, [distance("plate", "head", 50.0, CERTIFIED_MM)],
    ),
    "pin": Kind(lambda off: [cylinder("pin", 40.0 + off, (40.0, CERTIFIED_MM))], 6, 40, True),
    "ball above a plate": Kind(
        lambda off: [plane("plate"), sphere("ball", 30.0 + off, (30.0, CERTIFIED_MM),
                                            centre_mm=(0.0, 0.0, 60.0))], 4, 40, True,
    ),
}  # fmt: skip


def measured(folder: Path, kind: Kind, seed: int) -> Workshop:
    """A session in *folder*/session beside the drawing's arm.toml, by the arm of this *seed*."""
    workshop = Workshop(seed)
    off_mm = float(workshop.rng.normal(0.0, CERTIFIED_MM))
    surfaces = kind.surfaces(off_mm)
    workshop.session(
        folder / "session", surfaces, kind.placements, kind.each, kind.lengths, kind.tilted
    )
    (folder / "arm.toml").write_text(nominal.make_arm_toml(), encoding="utf-8")
    return workshop


def calibrated(folder: Path) -> Result:
    arm = load_arm(folder / "arm.toml")
    return calibrate(load_sessions([folder / "session"], arm), arm, Options())


def size_of(found: Result, true: TrueArm) -> float:
    """By which share all lengths together are wrong: the scale that best brings distances between
    the arm's tips onto the true ones."""
    low, high = nominal.get_limits_rad()
    q = np.random.default_rng(6).uniform(low, high, (400, 6))
    wanted = true.tip(q, Conditions.at_rest(len(q), 6))
    tips = compute_jacobian(q, np.tile(found.fit.constants, (len(q), 1)))[0]
    one, other = (np.linalg.norm(np.diff(points, axis=0), axis=1) for points in (tips, wanted))
    return float(one @ other / (other @ other)) - 1.0


def scale_named(found: Result) -> bool:
    return any("scale of the arm" in words for words in found.unidentifiable)


@parametrize_default("name", list(KINDS))
def test_the_arm_comes_back_within_what_is_stated(name: str, tmp_path: Path) -> None:
    kind = KINDS[name]
    workshop = measured(tmp_path, kind, 1)
    found = calibrated(tmp_path)
    errors = errors_of(found, workshop.arm)
    assert found.fit.converged
    assert found.fit.solution.rank == 20 + kind.sized
    assert np.mean(errors**2) < 2.2  # of 20 unit normals: one in a thousand has more
    assert scale_named(found) is not kind.sized
    assert found.certificate.scale_known is kind.sized
    assert found.certificate.granted
    assert 3.0 < found.rms_um < 12.0  # 5 µm of seating, 2″ of the encoders: no 3-D distance


@pytest.mark.slow
@pytest.mark.timeout(1800)  # forty calibrations, a minute of processor time
@pytest.mark.parametrize("name", list(KINDS))
def test_forty_arms_lie_within_their_stated_uncertainty_as_often_as_stated(
    name: str, tmp_path: Path
) -> None:
    kind = KINDS[name]
    errors, sizes = [], []
    for seed in range(1, 41):
        folder = tmp_path / str(seed)
        folder.mkdir()
        workshop = measured(folder, kind, seed)
        found = calibrated(folder)
        assert scale_named(found) is not kind.sized
        errors.append(errors_of(found, workshop.arm))
        sizes.append(size_of(found, workshop.arm))
    squares = np.concatenate(errors) ** 2
    n = len(squares)
    within = float(np.mean(squares < 1.96**2))
    assert abs(within - 0.95) < MOST_SIGMA * np.sqrt(0.95 * 0.05 / n)
    assert abs(squares.mean() - 1.0) < MOST_SIGMA * np.sqrt(2.0 / n)
    if kind.sized:  # scale kept: no arm is smaller or larger in the mean
        assert abs(np.mean(sizes)) < MOST_SIGMA * np.std(sizes) / np.sqrt(len(sizes))


@pytest.mark.slow
def test_a_length_certified_wrong_is_contradicted(tmp_path: Path) -> None:
    """Two blocks on one arm: what the one says of its size, the other's certificate must keep."""
    workshop = Workshop(3)
    planes = [plane("plate"), plane("head", 50.0, 1.0, 20.0), plane("step", 90.0, 1.0, 20.0)]
    lengths = [
        distance("plate", "head", 50.0, CERTIFIED_MM),
        distance("plate", "step", 90.3, CERTIFIED_MM),
    ]
    workshop.session(tmp_path / "one", planes, 4, 20, lengths)
    (tmp_path / "arm.toml").write_text(nominal.make_arm_toml(), encoding="utf-8")
    arm = load_arm(tmp_path / "arm.toml")
    found = calibrate(load_sessions([tmp_path / "one"], arm), arm, Options())
    assert not found.certificate.granted
    assert "certified length contradicts" in found.certificate.reason


@pytest.mark.slow
def test_readings_in_the_air_are_named_and_count_for_nothing(tmp_path: Path) -> None:
    workshop = measured(tmp_path, KINDS["ball"], 1)
    table = tmp_path / "session" / "readings.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    for row, joint, by_rad in ((50, 1, 0.03), (90, 0, -0.02), (120, 2, 0.2)):
        cells = lines[row].split(",")
        cells[3 + joint] = str(float(cells[3 + joint]) + by_rad)
        lines[row] = ",".join(cells)
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    found = calibrated(tmp_path)
    assert found.fit.outliers.tolist() == [49, 89, 119]
    assert np.mean(errors_of(found, workshop.arm) ** 2) < 2.2
    assert not found.certificate.granted


def thin(surface: Surface) -> Surface:
    """Touched within a tenth of a millimetre across."""

    def skin(rng: np.random.Generator, n: int) -> tuple[F64, F64]:
        points, out = surface.skin(rng, n)
        return points * [1.0, 1e-3, 1.0], out

    return Surface(surface.name, skin, surface.toml)


CAP = sphere("ball", 40.0, (40.0, CERTIFIED_MM), 0.97)
RING = cylinder("pin", 40.0, (40.0, CERTIFIED_MM), 0.2)
#: What is touched, in how many placements, how often in each; and what is said of the first.
REFUSED = {
    "spot": ([plane("plate", half_mm=0.2)], 3, 20, "a plane touched at one spot"),
    "line": ([thin(plane("plate"))], 3, 20, "a plane touched along one line"),
    "cap": ([CAP], 3, 20, "a sphere touched on one cap"),
    "circle": ([RING], 3, 20, "a cylinder touched around one circle"),
    "few": ([plane("plate"), plane("other", 30.0)], 12, 2, "2 readings, expected at least 3"),
}


@parametrize_default("name", list(REFUSED), default=3)
def test_surfaces_that_nobody_can_place_are_refused_by_name(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    surfaces, placements, each, words = REFUSED[name]
    Workshop(2).session(tmp_path / "session", surfaces, placements, each)
    first = f"/session: surface {surfaces[0].name}, placement P"
    arm = tmp_path / "arm.toml"
    arm.write_text(nominal.make_arm_toml(), encoding="utf-8")
    for command in ("calibrate", "evaluate"):
        json_file, output = tmp_path / "out.json", tmp_path / "cal.json"
        more = ["-o", str(output)] if command == "calibrate" else []
        code = main([command, str(tmp_path / "session"), "--arm", str(arm), *more,
                     "--json", str(json_file)])  # fmt: skip
        error = capsys.readouterr().err
        assert code == 2
        assert re.search(rf"{first}\d: found {words}", error)
        assert not json_file.exists() and not output.exists()


def test_what_takes_points_alone_says_so(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    Workshop(2).session(Path("session"), [plane("plate")], 2, 12)
    Path("arm.toml").write_text(nominal.make_arm_toml(), encoding="utf-8")
    code = main(["design", "session", "--arm", "arm.toml", "-o", "poses.csv"])
    error = capsys.readouterr().err
    assert code == 2
    assert "session.toml: artefact.surface[1]: found 'plate', a plane, expected points" in error
    assert f"`armd design` does not use surfaces: {INSTEAD['`armd design`']}" in error
    assert sorted(path.name for path in Path().iterdir()) == ["arm.toml", "session"]


def test_evaluate_measures_a_block_that_it_was_not_told_of(tmp_path: Path) -> None:
    """The length found by a calibration from points elsewhere: here, by the true arm's own rows."""
    workshop = Workshop(4)
    workshop.session(
        tmp_path / "session",
        [plane("plate"), plane("head", 50.0, 1.0, 20.0)],
        3,
        20,
        [distance("plate", "head", 50.2, 0.001)],
    )
    arm_file = tmp_path / "arm.toml"
    arm_file.write_text(
        nominal.make_arm_toml(rows=workshop.arm.rows, tip=workshop.arm.tip_offset), encoding="utf-8"
    )
    out = tmp_path / "out.json"
    assert (
        main(["evaluate", str(tmp_path / "session"), "--arm", str(arm_file), "--json", str(out)])
        == 0
    )
    (length,) = json.loads(out.read_text(encoding="utf-8"))["distances"]
    assert length["measured_mm"] == pytest.approx(50.0, abs=4 * length["measured_uncertainty_mm"])
    assert length["measured_uncertainty_mm"] < 0.005
    assert length["error_um"] == pytest.approx(-200.0, abs=20.0)
