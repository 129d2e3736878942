"""Several reflectors on the last link: the tip of each is unknown, or given."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from armd.arrays import F64
from armd.compensation.data.sessions.session import load_session, load_sessions
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.estimate.unknowns import describe_term
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.identify.reflectors import make_reflector_terms
from armd.compensation.identify.result import Result
from armd.compensation.model.arm import load_arm
from armd.compensation.model.kinematics import compute_pose
from armd.daemon.cli import main
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects.effect import Conditions
from support.reflector_nest import NEST, write_nest_session


def true_arm(seed: int) -> TrueArm:
    """An arm off its drawing, but for the last joint: no reading tells it from the nest."""
    arm = TrueArm.default(seed)
    rows = arm.rows.copy()
    rows[-1] = nominal.list_nominal_rows()[-1]
    return replace(arm, rows=rows)


def calibrated(folder: Path, seed: int, poses: int = 40, given: tuple[str, ...] = ()) -> Result:
    write_nest_session(folder / "T", true_arm(seed), np.random.default_rng(seed), poses, given)
    (folder / "arm.toml").write_text(nominal.make_arm_toml(), encoding="utf-8")
    arm = load_arm(folder / "arm.toml")
    return calibrate(load_sessions([folder / "T"], arm), arm, Options())


def errors_of(found: Result) -> F64:
    """(9,) offsets minus true ones, in units of their stated uncertainties."""
    assert [one.name for one in found.reflectors] == list(NEST)
    off = [one.offset_mm - NEST[one.name] for one in found.reflectors]
    uncertain = [one.standard_uncertainty_mm for one in found.reflectors]
    ratio: F64 = np.concatenate(off) / np.concatenate(uncertain)
    return ratio


def test_unknown_reflectors_are_found_and_the_arm_with_them(tmp_path: Path) -> None:
    found = calibrated(tmp_path, 1)
    assert found.fit.converged and found.certificate.granted
    assert np.abs(errors_of(found)).max() < 3.5
    assert max(one.standard_uncertainty_mm.max() for one in found.reflectors) < 0.02
    # All but θ₁ and d₁, which only place the arm.
    assert found.fit.solution.rank == len(found.fit.unknowns.names) - 2
    # The file has the arm alone: no term, the tip that arm.toml has.
    calibration = found.calibration
    assert calibration.terms == [] and calibration.constants["tip_z"] == nominal.TIP_MM[2]
    assert len(calibration.covariance) == len(calibration.covariance_of) == 20
    # Where the arm puts reflector B in postures not measured: the simulator's own truth.
    rng = np.random.default_rng(9)
    q = rng.uniform(*nominal.get_limits_rad(), (200, 6))
    true = replace(true_arm(1), tip_offset=NEST["B"]).tip(q, Conditions.at_rest(200, 6))
    constants = found.fit.constants.copy()
    constants[found.fit.observations.arm.layout.tip] = found.reflectors[1].offset_mm
    tips = compute_pose(q, np.tile(constants, (200, 1)))[0]
    one, other = (np.linalg.norm(np.diff(points, axis=0), axis=1) for points in (tips, true))
    assert np.sqrt(np.mean((one - other) ** 2)) < 0.01


@pytest.mark.slow
@pytest.mark.timeout(1800)  # forty calibrations
def test_offsets_lie_within_their_uncertainty_as_often_as_stated(tmp_path: Path) -> None:
    errors = []
    for seed in range(1, 41):
        folder = tmp_path / str(seed)
        folder.mkdir()
        errors.append(errors_of(calibrated(folder, seed)))
    squares = np.array(errors) ** 2
    # Nine offsets of one arm share its constants: a session counts as one of them, not as nine.
    assert abs(np.mean(squares < 1.96**2) - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / 120)
    assert abs(squares.mean() - 1.0) < 3.0 * np.sqrt(2.0 / 120)


def test_a_given_reflector_stays_where_it_is_given(tmp_path: Path) -> None:
    found = calibrated(tmp_path, 2, given=("A", "B", "C"))
    for one in found.reflectors:
        assert one.offset_mm.tolist() == pytest.approx(NEST[one.name].tolist(), abs=1e-9)
        assert one.standard_uncertainty_mm.tolist() == [0.0, 0.0, 0.0]
    # A nest of known size tells where the last joint has it, which unknown ones cannot.
    words = " ".join(found.unidentifiable)
    assert "alpha_6" not in words and "a_6" not in words
    assert found.fit.solution.rank == 24 - 2


def test_the_term_of_a_reflector_is_its_place() -> None:
    from support import synthetic

    arm = synthetic.arm()
    session = synthetic.session(arm, arm.nominal(), np.random.default_rng(1), readings=12)
    named = replace(
        session, reflector=np.arange(12) % 2, reflector_names=("A", "B"),
        offset_mm={"B": (1.0, 2.0, 3.0)},
    )  # fmt: skip
    tips = make_reflector_terms(collect_observations([named], arm), np.array([0.5, 0.5, 0.5]))
    assert [describe_term(term) for term in tips.terms[::3]] == [
        "tip_x of reflector A", "tip_x of reflector B",
    ]  # fmt: skip
    assert tips.free == [0, 1, 2] and tips.hides_tip
    assert [term.coefficient for term in tips.terms[3:]] == [0.5, 1.5, 2.5]
    plain = make_reflector_terms(collect_observations([session], arm), np.zeros(3))
    assert plain.terms == [] and not plain.hides_tip


def test_the_commands_tell_where_reflectors_sit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_nest_session(Path("T"), true_arm(1), np.random.default_rng(1), 30)
    Path("arm.toml").write_text(nominal.make_arm_toml(), encoding="utf-8")
    words = ["calibrate", "T", "--arm", "arm.toml", "-o", "cal.json", "--json", "r.json"]
    assert main(words) == 0
    assert "reflector B: (-6" in capsys.readouterr().out
    result = json.loads(Path("r.json").read_text(encoding="utf-8"))["reflectors"]
    assert list(result) == list(NEST)
    assert set(result["A"]) == {"offset_mm", "standard_uncertainty_mm"}
    # Evaluated, they are fitted again: nobody keeps a nest.
    more = ["--calibration", "cal.json", "--json", "e.json"]
    assert main(["evaluate", "T", "--arm", "arm.toml", *more]) == 0
    evaluated = json.loads(Path("e.json").read_text(encoding="utf-8"))
    assert evaluated["rms_um"] < 30.0
    for name, one in evaluated["reflectors"].items():
        assert one["offset_mm"] == pytest.approx(result[name]["offset_mm"], abs=0.005)
    assert main(["check", "T", "arm.toml"]) == 0
    capsys.readouterr()
    for command in (["verify"], ["design", "-o", "p.csv"]):
        assert main([command[0], "T", "--arm", "arm.toml", *command[1:]]) == 2
        error = capsys.readouterr().err
        assert f"`armd {command[0]}` does not use reflectors" in error


def test_bad_reflectors_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arm_file, rng = tmp_path / "arm.toml", np.random.default_rng(1)
    arm_file.write_text(nominal.make_arm_toml(), encoding="utf-8")

    def calibrate_of(*sessions: str) -> str:
        folders = [str(tmp_path / name) for name in sessions]
        out = tmp_path / "cal.json"
        assert main(["calibrate", *folders, "--arm", str(arm_file), "-o", str(out)]) == 2
        assert not out.exists()
        return capsys.readouterr().err

    again = '[[reflector]]\nname = "A"\noffset_mm = [1, 2, 3]\n'
    write_nest_session(tmp_path / "twice", true_arm(1), rng, 4, ("A",), extra=again)
    assert "reflectors' names that differ, not two 'A'" in calibrate_of("twice")
    write_nest_session(tmp_path / "one", true_arm(1), rng, 20)
    write_nest_session(tmp_path / "other", true_arm(1), rng, 20, ("A",))
    assert "session.toml: reflector A: found offset_mm [45.3" in calibrate_of("one", "other")
    table = tmp_path / "one" / "readings.csv"
    lines = table.read_text(encoding="utf-8").splitlines()
    lines[3] = lines[3].replace(",C,", ",,")
    table.write_text("\n".join(lines) + "\n", encoding="utf-8")
    error = calibrate_of("one")
    assert "row 3 (line 4), column reflector: found nothing" in error
    # A given place beside readings of the tip itself, which is unknown.
    write_nest_session(tmp_path / "given", true_arm(1), rng, 20, ("A", "B", "C"))
    plain = tmp_path / "plain"
    write_nest_session(plain, true_arm(1), rng, 20, nest={"A": NEST["A"]})
    text = (plain / "readings.csv").read_text(encoding="utf-8")
    text = text.replace("reflector", "remark", 1)
    (plain / "readings.csv").write_text(text, encoding="utf-8")
    assert load_session(plain, load_arm(arm_file)).reflector is None
    assert "readings without a reflector beside" in calibrate_of("given", "plain")
