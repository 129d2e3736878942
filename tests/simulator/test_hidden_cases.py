"""Cases that hide an effect: what is planted shows in the readings, and only there."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from armd.errors import BadInput
from armd.simulator.campaigns.hidden import DESIGNS, NOISE, Design, plan_campaigns
from armd.simulator.hidden import HiddenCase, generate_case
from armd.simulator.measured.measuring import Measured
from armd.simulator.measured.noise import Noise
from armd.simulator.measured.plan import Climate
from armd.simulator.plants.causes import CAUSES
from armd.simulator.plants.draw import FOREIGN, FOREIGN_SIZE, draw_plant
from armd.simulator.plants.plant import Plant, parse_plant
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects.effect import Conditions
from support.next_session import measure_next
from support.selection import parametrize_default
from support.simulated_sessions import numbers, read_plainly
from support.warmed_climate import warmed

SMALL = Design(sessions=3, articulations=2, holdout=1)
QUIET = Noise().scaled(0.0)
ANGLES = [f"q{k}" for k in range(1, 7)]
PLACES = {
    "joint": "joint 3",
    "link": "link 2",
    "sensor": "sensor t2",
    "sensors": "sensors t2, t4",
    "target": "target B7",
}
CATALOGUE = [
    Plant(cause, PLACES.get(kind.places, kind.places), kind.typical)
    for cause, kind in CAUSES.items()
    if cause != "unknown"
]
FOREIGNERS = [Plant("unknown", "-", FOREIGN_SIZE[kind], {"kind": kind}) for kind in FOREIGN]
VARIANTS = [
    Plant("encoder_periodic", "joint 2", 2.0, {"kind": "curve"}),
    Plant("encoder_periodic", "joint 2", 2.0, {"kind": "square wave"}),
    Plant("axis_wobble", "joint 2", 5.0, {"kind": "run-out"}),
    Plant("mount_drift", "base", 1.0, {"kind": "step"}),
    Plant("tip_offset", "tip", 7.0, {"kind": "once"}),
    Plant("joint_thermal", "joint 2", 0.06, {"order": 2}),
    Plant("artefact_length", "artefact", 20.0),
    *(
        Plant("geometry_shift", "joint 3", 20.0, {"parameter": name})
        for name in ("theta", "alpha", "d", "a")
    ),
]


def predicted_error(case: HiddenCase, measured: Measured, seed: int) -> np.ndarray:
    """What a model with the true geometry and linear expansion errs by, from the folder's data."""
    believed = measured.conditions
    told = np.array(measured.sensor_c)
    arm = TrueArm.default(seed)
    tip = arm.tip(measured.encoder, type(believed)(told, *list(vars(believed).values())[1:]))
    artefact = measured.artefact
    growth = 1 + artefact.expansion_per_k * (measured.artefact_c[:, None] - 20)
    certified = measured.to_base(artefact.certified_mm[measured.target] * growth)
    origins = np.array([where.origin_mm for where in measured.placements])
    return tip - certified - origins[measured.placement]


@parametrize_default(
    "plant",
    CATALOGUE + FOREIGNERS + VARIANTS,
    ids=lambda p: f"{p.cause}-{dict(p.detail)}",
    default=12,
)
def test_what_is_planted_is_what_the_readings_err_by(plant: Plant, tmp_path: Path) -> None:
    """Read back without noise, residuals of the healthy arm's model are the stated effect."""
    case = generate_case(tmp_path, 2, [plant], SMALL, QUIET)
    [effect] = case.effects
    for path in [*case.sessions, *case.holdout]:
        measured = case.measured[path.name]
        error = predicted_error(case, measured, 2) - case.noise_mm[path.name]
        stated = effect.error_mm[path.name]
        # Sensors trail their links by a few hundredths of a kelvin on the ramp, and a small turn
        # of an angle error is linear to a part in a thousand.
        assert np.abs(error - stated).max() < 6e-4 + 2e-3 * np.abs(stated).max()
    if plant.cause not in ("outliers", "thermal_lag"):
        assert 0.3 < effect.rms_um < 400
    if plant.cause == "outliers":
        assert any(measured.spoilt.any() for measured in case.measured.values())
    text = "".join(path.read_text() for path in tmp_path.rglob("*") if path.is_file())
    assert plant.cause not in text


def test_effects_scale_with_their_size_and_stand_side_by_side(tmp_path: Path) -> None:
    one = Plant("encoder_eccentricity", "joint 2", 0.7)
    other = Plant("joint_compliance", "joint 3", 5.0)
    alone = generate_case(tmp_path / "a", 3, [one], SMALL)
    twice = generate_case(tmp_path / "b", 3, [Plant(one.cause, one.location, 1.4)], SMALL)
    both = generate_case(tmp_path / "c", 3, [one, other], SMALL)
    assert twice.effects[0].rms_um == pytest.approx(2 * alone.effects[0].rms_um, rel=1e-3)
    assert both.effects[0].rms_um == pytest.approx(alone.effects[0].rms_um, rel=1e-3)
    assert [effect.plant for effect in both.effects] == [one, other]


def test_the_standard_design_is_that_of_the_facts_without_its_payload(tmp_path: Path) -> None:
    case = generate_case(tmp_path, 1)
    sessions = [case.measured[path.name] for path in case.sessions]
    assert [session.n for session in sessions] == [100] * 8
    assert len(case.holdout) == 2
    mean = np.array([session.conditions.ambient_c.mean() for session in sessions])
    assert mean.min() < 17
    assert mean.max() > 27
    ramps = [session.plan.climate.ramp_k_per_h for session in sessions]
    assert sorted(ramps) == [0.0] * 7 + [4.0]
    rates = [np.abs(session.conditions.rate).mean() for session in sessions]
    assert sorted(np.array(rates) > 0.1) == [False] * 7 + [True]
    # A payload that nothing tells the diagnosis of would be a second error in every case.
    assert not any(session.plan.payload_kg for session in sessions)
    loaded = plan_campaigns(1, DESIGNS["payload"])[1].sessions
    weights = [plan.payload_kg for plan, _ in loaded if not plan.held_out]
    assert sorted(weights) == [0.0] * 7 + [0.5]
    assert 4 < case.oracle_rms_um(case.sessions) < 10
    assert not case.effects


@pytest.mark.slow
def test_kinds_of_noise_are_what_they_say(tmp_path: Path) -> None:
    noises = {
        "plain": NOISE,
        "heavy": Noise(1.0, 0.7, 0.01, tails="heavy"),
        "wander": Noise(1.0, 0.7, 0.01, wander_um=3.0),
    }
    cases = {name: generate_case(tmp_path / name, 1, (), None, n) for name, n in noises.items()}

    def noise(name: str) -> np.ndarray:
        case = cases[name]
        return np.array([case.noise_mm[path.name] for path in case.sessions])

    def kurtosis(values: np.ndarray) -> float:
        return float(np.mean(values**4) / np.mean(values**2) ** 2)

    assert kurtosis(noise("heavy")) > kurtosis(noise("plain")) + 0.5
    added = np.mean(noise("wander") ** 2) - np.mean(noise("plain") ** 2)
    assert added == pytest.approx(0.003**2, rel=0.5)

    def neighbours(values: np.ndarray) -> float:
        return float(np.mean(values[:, 1:] * values[:, :-1]) / np.mean(values**2))

    assert neighbours(noise("wander")) > neighbours(noise("plain")) + 0.1


@parametrize_default("name", DESIGNS, default=2)
def test_every_design_can_be_measured(name: str, tmp_path: Path) -> None:
    design = DESIGNS[name]
    case = generate_case(tmp_path, 1, (), design)
    assert len(case.sessions) == design.sessions
    assert len(case.before) == design.before
    for joint, (low, high) in design.ranges_deg.items():
        for path in case.sessions:
            angle = np.degrees(case.measured[path.name].phi[:, joint - 1])
            assert (angle > low).all()
            assert (angle < high).all()
    certified = case.measured[case.sessions[0].name].artefact.certified_mm
    assert np.isfinite(certified).all() == design.certified


def test_the_stated_truth_is_the_true_arms(tmp_path: Path) -> None:
    case = generate_case(tmp_path, 5, (), SMALL)
    arm = TrueArm.default(5)
    assert case.constants["a_2"] == arm.rows[1, 2]
    assert case.constants["alpha_3"] == arm.rows[2, 3]
    growth = {name: per_k for name, _, per_k in case.expansion}
    assert growth["a_2"] == pytest.approx(520 * (130 * 23e-6 + 390 * 0.5e-6) / 520, rel=3e-3)
    assert {sensor for _, sensor, _ in case.expansion} == {"t1", "t2", "t3", "t4", "t6"}


def test_plants_are_drawn_where_they_can_show() -> None:
    rng = np.random.default_rng(0)
    drawn = [draw_plant(rng) for _ in range(600)]
    assert {plant.cause for plant in drawn} == set(CAUSES) - {"unknown"}
    for cause in set(CAUSES) - {"unknown"}:
        sizes = np.array([abs(plant.size) for plant in drawn if plant.cause == cause])
        assert 0.2 < np.median(sizes) / CAUSES[cause].typical < 3
    kinds = {draw_plant(rng, ["unknown"]).detail["kind"] for _ in range(60)}
    assert kinds == set(FOREIGN)


def test_plants_on_the_command_line() -> None:
    plant = parse_plant("sensor_swapped@sensors t2, t4=1")
    assert plant == Plant("sensor_swapped", "sensors t2, t4", 1.0)
    for text in ("eccentricity", "a@b", "a@b=much", "a=3"):
        with pytest.raises(BadInput, match="cause@location=size"):
            parse_plant(text)


def test_proposed_poses_can_be_measured_next(tmp_path: Path) -> None:
    plant = Plant("joint_compliance", "joint 2", 6.0)
    case = generate_case(tmp_path / "case", 4, [plant], SMALL)
    rng = np.random.default_rng(0)
    q = rng.uniform(-1.0, 0.0, (30, 6))
    climate = Climate(24.0)
    folder = measure_next(case, tmp_path / "next", q, climate, payload_kg=1.0)
    session, rows = read_plainly(folder)
    shown = numbers(rows, ANGLES)
    # Balls are set up with the arm unloaded and at the air's temperature.
    assert np.abs(shown - q).max() < 5e-3
    certified = {t["name"]: t["position_mm"] for t in session["artefact"]["target"]}
    assert [row["target"] for row in rows] == list(certified)
    last = max(case.measured[path.name].plan.started for path in case.sessions)
    assert session["started"] > last
    # Distances between the tips of a healthy arm differ from the certified ones by the compliance
    # and the payload it carries.
    arm = TrueArm.default(4)
    tip = arm.tip(shown, Conditions.at_rest(30, 6, 25.5))
    there = np.array(list(certified.values()))
    apart = [np.linalg.norm(x[:, None] - x[None], axis=2) for x in (tip, there)]
    assert 0.02 < np.abs(apart[0] - apart[1]).max() < 0.5


def test_what_is_proposed_is_done(tmp_path: Path) -> None:
    """Joints come from the sides given, a link is as warm as meant, the artefact is the same."""
    plant = Plant("artefact_expansion", "artefact", 100.0)
    case = generate_case(tmp_path / "case", 4, [plant], SMALL)
    rng = np.random.default_rng(0)
    q, sides = rng.uniform(-1.0, 0.0, (12, 6)), rng.choice([-1.0, 1.0], (12, 6))
    (session, usual), (_, warm) = (
        read_plainly(measure_next(case, tmp_path / name, q, climate, sides=sides))
        for name, climate in (("usual", Climate(30.0)), ("warm", warmed(Climate(30.0), 3, 4.0)))
    )
    rate = numbers(usual, [f"w{k}" for k in range(1, 7)])
    np.testing.assert_array_equal(np.sign(rate), sides)
    warmer_c = numbers(warm, ["t4"]).mean() - numbers(usual, ["t4"]).mean()
    assert warmer_c == pytest.approx(4.0, abs=0.05)
    # 100 ppm/K more than certified, 10 K over the reference, the arm's own growth besides.
    tip = TrueArm.default(4).tip(numbers(usual, ANGLES), Conditions.at_rest(12, 6, 31.5))
    there = np.array([t["position_mm"] for t in session["artefact"]["target"]])
    apart = [np.linalg.norm(x[:, None] - x[None], axis=2).sum() for x in (tip, there)]
    assert 0.9e-3 < apart[0] / apart[1] - 1 < 1.2e-3
