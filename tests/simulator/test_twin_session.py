"""Sessions of a twin: exact under their calibration, else as measured, with the noise asked for."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import armd
from armd.compensation.data.sessions.session import load_session
from armd.compensation.data.sessions.writing import write_session
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, load_calibration, save_calibration
from armd.compensation.model.kinematics import compute_joint_jacobian
from armd.files.toml_text import format_toml
from armd.simulator.__main__ import main
from armd.simulator.twin.files import to_arm_data, to_calibration_data
from armd.simulator.twin.model import TwinModel
from armd.simulator.twin.noise import FoundNoise, read_noise
from armd.simulator.twin.session import copy_session
from armd.simulator.twin.session_files import read_session
from support import synthetic
from support.drawn import drawn
from support.synthetic import STARTED

COUNTS = 1 << 20
ROUNDS = 4
TERMS: list[dict[str, Any]] = [
    {"parameter": "theta_3", "basis": [{"kind": "sin", "joint": 3}], "coefficient": 4e-5},
    {"parameter": "theta_2", "basis": [{"kind": "side", "joint": 2}], "coefficient": 2e-5},
    {"parameter": "d_3", "coefficient": 4e-3,
     "basis": [{"kind": "temperature", "weights": {"t3": 1.0}, "lag_s": 90.0}]},
    {"parameter": "tip_y", "basis": [{"kind": "approach", "axis": "z"}], "coefficient": 0.02},
    {"parameter": "base_x", "coefficient": 0.01,
     "basis": [{"kind": "time", "since_unix_s": STARTED.timestamp()}]},
    {"parameter": "theta_2", "basis": [{"kind": "gravity_torque", "joint": 2}],
     "coefficient": 1e-6},
]  # fmt: skip


def an_arm() -> Arm:
    """The synthetic one with encoders, stops and a ball; every other joint counts backwards."""
    arm = synthetic.arm()
    encoder = {"counts_per_turn": COUNTS, "min_deg": -175.0, "max_deg": 175.0}
    joints = [
        joint.model_copy(update=encoder | {"direction": 1 if k % 2 else -1})
        for k, joint in enumerate(arm.joint, 1)
    ]
    tip = arm.tip.model_copy(update={"radius_mm": 3.0})
    return arm.model_copy(update={"serial_number": "TWIN-2", "joint": joints, "tip": tip})


def a_calibration(arm: Arm, rng: np.random.Generator) -> Calibration:
    constants = arm.nominal() + 1e-4 * rng.normal(size=arm.layout.count)
    constants[arm.layout.base] = 0.0
    artefact = {"artefacts": ["mixed"], "expansion_per_k": 12e-6,
                "target_offset_mm": {"B2": [0.1, 0.0, -0.2]}, "scale": 1.0001}  # fmt: skip
    created = "2027-03-02T00:00:00+00:00"
    return drawn(arm, values=constants, created=created, terms=TERMS, artefact=artefact)


class Measured:
    """A folder with arm.toml, cal.json and a session that somebody measured, not very well."""

    def __init__(self, folder: Path, unit: str = "rad") -> None:
        rng = np.random.default_rng(11)
        self.folder, self.arm = folder, an_arm()
        self.arm_path, self.cal_path = folder / "arm.toml", folder / "cal.json"
        content = self.arm.model_dump(mode="json", by_alias=True, exclude_none=True)
        self.arm_path.write_text(format_toml(content))
        save_calibration(self.cal_path, a_calibration(self.arm, rng))
        self.session = folder / "session"
        self._write(rng, unit)

    def _write(self, rng: np.random.Generator, unit: str) -> None:
        """Balls on a plate, a bar of two unknown seats, and a tracker's own truth."""
        balls = {"B1": [0.0, 0.0, 0.0], "B2": [150.0, 0.0, 30.0], "B3": [60.0, 180.0, 0.0],
                 "B4": [-80.0, 90.0, 120.0]}  # fmt: skip
        names = [*balls, "S1", "S2"]
        true = {**balls, "S1": [20.0, -50.0, 80.0], "S2": [20.0, -50.0, 280.0]}
        rows, q = [], []
        for p, middle in enumerate(([450.0, 100.0, 300.0], [-100.0, 500.0, 400.0])):
            turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
            turn *= np.linalg.det(turn)
            for _ in range(ROUNDS):
                for name in names:
                    goal = turn @ true[name] + middle + rng.normal(0, 0.05, 3)
                    q.append(_reach(self.arm, goal, rng))
                    rows.append((f"P{p + 1}", name, turn @ true[name]))
        n = len(rows)
        scale = {"rad": np.ones(6), "deg": np.full(6, math.degrees(1.0))}.get(unit)
        if scale is None:
            scale = np.array([j.direction * COUNTS / math.tau for j in self.arm.joint])
        angles = np.array(q) * scale
        truth = np.full((n, 3), np.nan)
        truth[:: 2 * ROUNDS] = [true[rows[i][1]] for i in range(0, n, 2 * ROUNDS)]
        celsius = 22.0 + 2.0 * np.sin(np.arange(n)[:, None] / 9.0 + np.arange(6))
        celsius[5, 2] = np.nan
        columns: dict[str, Any] = {
            "time_s": (7.0 * np.arange(n)).tolist(),
            "placement": [row[0] for row in rows],
            "target": [row[1] for row in rows],
            **{f"q{k + 1}": angles[:, k] if unit != "count" else np.rint(angles[:, k]).astype(int)
               for k in range(6)},
            **{f"w{k + 1}": rng.normal(0, 0.05, n).round(6) for k in range(6)},
            **{f"t{k + 1}": celsius[:, k].round(2) for k in range(6)},
            "artefact_c": [23.5 if i % 4 else None for i in range(n)],
            "note": [f"row {i}, by hand" for i in range(n)],
            **{name: truth[:, i] for i, name in enumerate(("x_mm", "y_mm", "z_mm"))},
        }  # fmt: skip
        file = {
            "schema": "armd.session/1",
            "arm": "TWIN-2",
            "started": STARTED,
            "angle_unit": unit,
            "artefact": {
                "name": "mixed",
                "expansion_per_k": 8e-6,
                "target": [{"name": name, "position_mm": p} for name, p in balls.items()]
                + [{"name": "S1"}, {"name": "S2"}],
                "distance": [{"between": ["S1", "S2"], "length_mm": 200.04}],
            },
        }
        write_session(self.session, file, columns)

    def copy(self, noise: FoundNoise | None = None, seed: int = 1) -> Path:
        """As the command does it, in this process."""
        calibration = load_calibration(self.cal_path).content.content()
        arm = to_arm_data(self.arm.model_dump(mode="json", by_alias=True, exclude_none=True))
        twin = TwinModel(arm, to_calibration_data(calibration, 6))
        source = read_session(self.session, arm)
        copied = copy_session(twin, source, noise, seed)
        out = self.folder / "copy"
        out.mkdir(exist_ok=True)
        (out / "readings.csv").write_bytes(copied.table)
        (out / "session.toml").write_bytes((self.session / "session.toml").read_bytes())
        return out

    def command(self, name: str, *options: str) -> Path:
        out = self.folder / name
        command = ["--twin", str(self.cal_path), "--arm", str(self.arm_path)]
        command += ["--session-like", str(self.session), "-o", str(out), *options]
        assert main(command) == 0
        return out

    def residual_mm(self, folder: Path) -> np.ndarray:
        calibration = load_calibration(self.cal_path, self.arm).content
        return evaluate([load_session(folder, self.arm)], self.arm, calibration).residual_mm


def _reach(arm: Arm, goal: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    from armd.compensation.model.kinematics import compute_pose

    p = arm.nominal()
    for _ in range(200):
        q = rng.uniform(-2.0, 2.0, (1, 6))
        for _ in range(40):
            way = goal - compute_pose(q, p)[0][0]
            if np.abs(way).max() < 1e-3:
                if np.abs(q).max() < 3.0:
                    return q[0]
                break
            q = q + np.clip(np.linalg.pinv(compute_joint_jacobian(q, p)[0]) @ way, -0.4, 0.4)
    raise AssertionError(goal)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Measured]:
    made: dict[str, Measured] = {}

    def of(unit: str) -> Measured:
        if unit not in made:
            made[unit] = Measured(tmp_path_factory.mktemp(unit), unit)
        return made[unit]

    return of


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_a_session_of_the_twin_is_exact_under_its_calibration(
    folder: Callable[[str], Measured], unit: str
) -> None:
    measured = folder(unit)
    before = measured.residual_mm(measured.session)
    assert np.abs(before).max() > 0.02
    after = measured.residual_mm(measured.copy())
    assert len(after) == len(before) and np.abs(after).max() < 1e-6


def test_counts_are_whole_and_err_by_half_of_one_at_most(
    folder: Callable[[str], Measured],
) -> None:
    measured = folder("count")
    copy = measured.copy()
    copied = load_session(copy, measured.arm)
    half_mm = np.abs(compute_joint_jacobian(copied.states.q, measured.arm.nominal()))
    bound = (half_mm * (math.pi / COUNTS)).sum(axis=2).max()
    assert np.abs(measured.residual_mm(copy)).max() < 1.01 * bound


def test_certified_lengths_between_seats_are_kept(folder: Callable[[str], Measured]) -> None:
    measured = folder("rad")
    calibration = load_calibration(measured.cal_path, measured.arm).content
    session = load_session(measured.copy(), measured.arm)
    (length,) = evaluate([session], measured.arm, calibration).lengths
    assert abs(length.as_json()["error_um"]) < 1e-3


@pytest.mark.slow
def test_every_other_cell_stays_and_postures_are_next_to_the_measured(
    folder: Callable[[str], Measured],
) -> None:
    measured = folder("rad")
    copy = measured.command("cells")
    old, new = (
        list(csv.DictReader((place / "readings.csv").read_text().splitlines()))
        for place in (measured.session, copy)
    )
    for before, after in zip(old, new, strict=True):
        for name, cell in before.items():
            if name[0] == "q":
                assert abs(float(cell) - float(after[name])) < 2e-3
            else:
                assert after[name] == cell
    # What lacks a temperature that the calibration needs is as it was measured.
    assert [float(new[5][f"q{k}"]) for k in range(1, 7)] == [
        float(old[5][f"q{k}"]) for k in range(1, 7)
    ]
    text = (copy / "session.toml").read_text()
    assert text.startswith("# Simulated") and text.endswith(
        (measured.session / "session.toml").read_text()
    )


@pytest.mark.slow
def test_noise_is_what_a_diagnosis_found_and_a_seed_repeats_it(
    folder: Callable[[str], Measured], tmp_path: Path
) -> None:
    measured = folder("rad")
    found = tmp_path / "d.json"
    parts = {"encoder_rad": 4e-6, "repeat_mm": 0.003, "drift_mm": 0.0}
    found.write_text(json.dumps({"schema": "armd.diagnosis/1", "noise": parts}))
    noise = read_noise(found)
    squares = [
        (measured.residual_mm(measured.copy(noise, seed)) ** 2).sum(axis=1).mean()
        for seed in range(12)
    ]
    session = load_session(measured.session, measured.arm)
    jacobian = compute_joint_jacobian(session.states.q, measured.arm.nominal())
    expected = (4e-6**2 * (jacobian**2).sum(axis=(1, 2))).mean() + 3 * 0.003**2
    assert np.mean(squares) == pytest.approx(expected, rel=0.1)
    options = ["--noise-from", str(found), "--seed"]
    tables = [
        (measured.command(name, *options, seed) / "readings.csv").read_bytes()
        for name, seed in (("one", "3"), ("again", "3"), ("other", "4"))
    ]
    assert tables[0] == tables[1] != tables[2]


def test_a_diagnosis_without_the_parts_gives_its_floor_to_the_repeat(tmp_path: Path) -> None:
    path = tmp_path / "d.json"
    path.write_text('{"schema": "armd.diagnosis/1", "baseline": {"noise_floor_um": 3.0}}')
    assert read_noise(path) == FoundNoise(repeat_mm=0.003 / math.sqrt(3))


WRONG = [
    (["--session-like", "S", "-o", "new"], "--twin: found nothing"),
    (["--twin", "cal.json", "--session-like", "S", "-o", "new"], "--arm: found nothing"),
    (["--twin", "cal.json", "--arm", "arm.toml", "--session-like", "S"], "-o: found nothing"),
    (["--twin", "cal.json", "--arm", "arm.toml", "--serial", "-o", "new"], "--session-like: found"),
    (["--twin", "cal.json", "--arm", "arm.toml", "--serial", "--joints", "4"], "--joints: found"),
    (["--serial", "--noise-from", "cal.json"], "--twin: found nothing"),
]


@pytest.mark.parametrize("words", WRONG)
def test_options_that_do_not_fit_are_refused(
    words: tuple[list[str], str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words[0]) == 2
    assert words[1] in capsys.readouterr().err


@pytest.mark.slow
def test_files_that_are_wrong_are_named_and_nothing_is_written(
    folder: Callable[[str], Measured], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    measured = folder("rad")
    out = tmp_path / "out"

    def refused(expected: str, **files: Path) -> None:
        paths = {"twin": measured.cal_path, "arm": measured.arm_path, "like": measured.session}
        paths |= files
        command = ["--twin", str(paths["twin"]), "--arm", str(paths["arm"]), "-o", str(out)]
        command += ["--session-like", str(paths["like"])]
        if noise := files.get("noise"):
            command += ["--noise-from", str(noise)]
        assert main(command) == 2
        assert expected in capsys.readouterr().err and not out.exists()

    damaged = tmp_path / "damaged.json"
    damaged.write_text(measured.cal_path.read_text().replace("4e-05", "5e-05"))
    refused("content_sha256", twin=damaged)
    other = tmp_path / "other.toml"
    other.write_text(measured.arm_path.read_text().replace("TWIN-2", "TWIN-3"))
    refused("cal.json: arm: found 'TWIN-2', expected 'TWIN-3'", arm=other)
    refused("nowhere", like=tmp_path / "nowhere")
    noise = tmp_path / "noise.json"
    noise.write_text('{"schema": "armd.diagnosis/1", "noise": {"encoder_rad": -1}}')
    refused("noise.encoder_rad: found -1", noise=noise)


@pytest.mark.slow
def test_a_measured_session_is_not_written_over(
    folder: Callable[[str], Measured], capsys: pytest.CaptureFixture[str]
) -> None:
    measured = folder("rad")
    before = (measured.session / "readings.csv").read_bytes()
    command = ["--twin", str(measured.cal_path), "--arm", str(measured.arm_path), "--force"]
    command += ["--session-like", str(measured.session), "-o", str(measured.session)]
    assert main(command) == 2
    assert (measured.session / "readings.csv").read_bytes() == before
    assert "session" in capsys.readouterr().err


#: Causes of four kinds: in an encoder, in a joint, by weight, by temperature.
PLANTS = (
    ("encoder_eccentricity@joint 3=1.5", "encoder_eccentricity", "joint 3"),
    ("joint_backlash@joint 2=4", "joint_backlash", "joint 2"),
    ("joint_compliance@joint 2=8", "joint_compliance", "joint 2"),
    ("joint_thermal@joint 4=3", "joint_thermal", "joint 4"),
)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize(("plant", "cause", "location"), PLANTS)
def test_the_twin_of_an_extended_calibration_gives_the_same_findings(
    plant: str, cause: str, location: str, tmp_path: Path
) -> None:
    healthy, sick, twin = tmp_path / "healthy", tmp_path / "sick", tmp_path / "twin"
    assert main(["--session", "diagnosis", "-o", str(healthy), "--seed", "7"]) == 0
    assert main(["--session", "diagnosis", "-o", str(sick), "--seed", "7", "--plant", plant]) == 0
    arm = str(sick / "arm.toml")
    old = armd.calibrate([str(f) for f in sorted(healthy.glob("session-*"))], arm)
    old.save(str(tmp_path / "old.json"))
    sessions = sorted(sick.glob("session-*"))
    real = armd.diagnose([str(f) for f in sessions], arm, str(tmp_path / "old.json"))
    found = [(f.cause, f.location) for f in real.findings]
    assert (cause, location) in found
    assert real.extended is not None
    real.extended.save(str(tmp_path / "extended.json"))

    (tmp_path / "d.json").write_text(json.dumps(real.to_dict()))
    for session in sessions:
        options = ["--twin", str(tmp_path / "extended.json"), "--arm", arm]
        options += ["--noise-from", str(tmp_path / "d.json"), "--seed", "2"]
        options += ["--session-like", str(session), "-o", str(twin / session.name)]
        assert main(options) == 0
    copies = [str(twin / session.name) for session in sessions]
    exact = armd.evaluate(copies, arm, str(tmp_path / "extended.json"))
    assert exact.rms_um == pytest.approx(real.baseline.noise_floor_um, rel=0.1)
    again = armd.diagnose(copies, arm, str(tmp_path / "old.json"))
    assert [(f.cause, f.location) for f in again.findings] == found
    sizes = [{p.name: p for p in d.findings[found.index((cause, location))].parameters}
             for d in (real, again)]  # fmt: skip
    for name, size in sizes[0].items():
        other = sizes[1][name]
        off = abs(size.value - other.value)
        assert off <= 5.0 * max(size.standard_uncertainty, other.standard_uncertainty), name
