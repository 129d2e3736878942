"""`armd diagnose` on surfaces, touched by the simulator's own arm with a planted cause."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import armd
from armd.compensation.data.sessions.session import load_sessions
from armd.compensation.diagnose.problem.linear import ModelState
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.rests import collect_rests, count_spare_rows
from armd.compensation.effects.effect import ArtefactChange
from armd.compensation.estimate.noise.robust import (
    WINSOR_AT,
    compute_edge_stretch,
    compute_huber_loss,
)
from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import ArtefactCorrection
from armd.daemon.cli import main
from armd.simulator.plants.live import plant_in_arm
from armd.simulator.truth import nominal
from support.touched_surfaces import Surface, Workshop, distance, plane, sphere

CERTIFIED_MM = 0.0005


@dataclass(frozen=True)
class Kind:
    """A campaign: what is touched, and how often in each of six placements."""

    surfaces: Sequence[Surface]
    each: int
    lengths: Sequence[str] = ()
    tilted: float = 0.6

    def measure(self, workshop: Workshop, folder: Path) -> Path:
        return workshop.session(folder, self.surfaces, 6, self.each, self.lengths, self.tilted)


KINDS = {
    "plate": Kind([plane("plate")], 40),
    "ball": Kind([sphere("ball", 40.0, (40.0, CERTIFIED_MM))], 40),
    "block": Kind(
        [plane("foot", 0.0, -1.0, 60.0), plane("head", 50.0, 1.0, 60.0)],
        30, [distance("foot", "head", 50.0, CERTIFIED_MM)], 1.2,
    ),
}  # fmt: skip


def diagnosed(folder: Path, name: str, plant: Sequence[str], seed: int = 1) -> armd.Diagnosis:
    """A diagnosis under a calibration by the same kind of campaign, made before the *plant*."""
    workshop, kind = Workshop(seed), KINDS[name]
    arm = folder / "arm.toml"
    arm.write_text(nominal.make_arm_toml(), encoding="utf-8")
    before = armd.calibrate([kind.measure(workshop, folder / "before")], arm)
    workshop.arm = plant_in_arm(workshop.arm, plant, seed)
    return armd.diagnose([kind.measure(workshop, folder / "now")], arm, before)


@pytest.mark.slow
def test_a_bent_joint_is_found_on_a_plate(tmp_path: Path) -> None:
    found = diagnosed(tmp_path, "plate", ["geometry_shift@joint 2=60"])
    (finding,) = found.findings
    assert (finding.cause, finding.location) == ("geometry_shift", "joint 2")
    assert finding.probability > 0.95
    assert finding.gain.heldout_rms_um_before > 15.0
    assert finding.gain.heldout_rms_um_after < 10.0
    # 5 µm of seating and 2″ of six encoders, along the normal alone
    assert 5.0 < found.baseline.noise_floor_um < 11.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "plant"),
    [
        ("ball", "geometry_shift@joint 2=60"),
        ("block", "geometry_shift@joint 2=60"),
        ("block", "encoder_eccentricity@joint 3=4"),
    ],
)
def test_planted_causes_are_found(name: str, plant: str, tmp_path: Path) -> None:
    found = diagnosed(tmp_path, name, [plant])
    cause, location = plant.partition("=")[0].split("@")
    first = found.findings[0]
    assert (first.cause, first.location) == (cause, location)
    assert first.gain.heldout_rms_um_after < 0.7 * first.gain.heldout_rms_um_before


@pytest.mark.slow
@pytest.mark.timeout(600)
@pytest.mark.parametrize("name", list(KINDS))
def test_a_healthy_arm_stays_without_findings(name: str, tmp_path: Path) -> None:
    for seed in range(1, 9):
        folder = tmp_path / str(seed)
        folder.mkdir()
        found = diagnosed(folder, name, [], seed)
        assert found.findings == []
        ratio = found.baseline.rms_um / found.baseline.noise_floor_um
        assert 0.85 < ratio < 1.15


def test_columns_of_surfaces_are_what_the_residuals_do(tmp_path: Path) -> None:
    """A larger ball and a longer block, by the difference of two linearisations."""
    workshop = Workshop(2, reach_size=2000)
    workshop.session(
        tmp_path / "session",
        [*KINDS["block"].surfaces, *KINDS["ball"].surfaces], 2, 12, KINDS["block"].lengths, 1.2,
    )  # fmt: skip
    true = nominal.make_arm_toml(rows=workshop.arm.rows, tip=workshop.arm.tip_offset)
    (tmp_path / "arm.toml").write_text(true, encoding="utf-8")
    arm = load_arm(tmp_path / "arm.toml")
    rests = collect_rests(load_sessions([tmp_path / "session"], arm), arm)
    # 6 placements: of each of the blocks 3 unknowns, of the balls 3; and the block's length
    assert count_spare_rows(rests.observations) == 72 + 1 - 4 * 3 - 2
    linear, more = (
        linearise(rests, ModelState(arm.nominal(), (), 20.0, artefact), arm)
        for artefact in (ArtefactCorrection(), ArtefactCorrection(scale=1.0 + 1e-4))
    )
    n = 3 * rests.n
    column = linear.artefact_column(ArtefactChange("scale"))[:n]
    normal = linear.normal
    assert normal is not None
    of_rests = column.reshape(-1, 3)
    assert np.allclose(np.cross(of_rests, normal), 0.0, atol=1e-12)
    # Both are fitted with their placements: what these absorb is nobody's.
    absorbed = linear.nuisance.to_dense(slice(None))[:n]
    change = (more.residual - linear.residual)[:n] / 1e-4
    left = [v - absorbed @ np.linalg.lstsq(absorbed, v, rcond=1e-9)[0] for v in (column, change)]
    assert np.linalg.norm(left[0]) > 10.0
    assert np.allclose(left[0], left[1], atol=0.02 * np.abs(left[0]).max())


def test_a_surface_is_clipped_where_a_point_of_the_same_probability_is() -> None:
    """One in eighty of normal numbers lies beyond 2.5, of triples beyond 3.3."""
    rng = np.random.default_rng(1)
    one, three = (
        np.abs(rng.normal(size=100_000)),
        np.linalg.norm(rng.normal(size=(100_000, 3)), axis=1),
    )
    stretch = compute_edge_stretch(np.array([1, 3]))
    beyond = np.mean(one * stretch[0] > WINSOR_AT), np.mean(three * stretch[1] > WINSOR_AT)
    assert beyond[0] == pytest.approx(beyond[1], abs=0.0015)
    near = np.array([0.5])
    assert compute_huber_loss(near * stretch[0], stretch[0]) == pytest.approx(0.125)


def test_a_plate_touched_at_one_spot_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Workshop(2).session(tmp_path / "session", [plane("plate", half_mm=0.2)], 3, 20)
    arm, out = tmp_path / "arm.toml", tmp_path / "out.json"
    arm.write_text(nominal.make_arm_toml(), encoding="utf-8")
    code = main(["diagnose", str(tmp_path / "session"), "--arm", str(arm), "--json", str(out)])
    error = capsys.readouterr().err
    assert code == 2
    assert re.search(r"/session: surface plate, placement P\d: found a plane touched at one", error)
    assert not out.exists()
