"""The twin against the kernel: two programs for one calibration file, written apart, agree."""

from __future__ import annotations

import typing
from typing import Any

import numpy as np
import pytest

from armd.compensation.effects.catalogue import list_all_candidates
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration, LoadedCalibration
from armd.compensation.model.pose_factors import AnyPoseFactor
from armd.compensation.model.slow_factors import AnySlowFactor
from armd.compensation.model.state import States
from armd.simulator.twin.factors import POSE, SLOW
from armd.simulator.twin.files import to_arm_data, to_calibration_data
from armd.simulator.twin.model import TwinModel, count_whole_turns
from support.drawn import drawn
from support.drawn_arm import draw_arm
from support.selection import parametrize_default
from support.whole_scene import whole_scene

ROWS = 300
BEGIN_S = 1.77e9
#: One of each kind, with what is not its default.
FACTORS: list[dict[str, Any]] = [
    {"kind": "temperature", "weights": {"t1": 0.4, "t2": 0.6}, "order": 2},
    {"kind": "temperature", "weights": {"t2": 1.0}, "lag_s": 400.0, "reference_c": 22.0},
    {"kind": "temperature", "weights": {"t1": 1.0}, "zone_c": [18.0, 23.0]},
    {"kind": "temperature_rate", "weights": {"t2": 1.0}, "smoothing_s": 300.0},
    {"kind": "time", "since_unix_s": BEGIN_S - 100, "power": 2},
    {"kind": "relaxation", "since_unix_s": BEGIN_S + 500, "time_constant_s": 900.0},
    {"kind": "daily_sin", "since_unix_s": BEGIN_S},
    {"kind": "daily_cos", "since_unix_s": BEGIN_S, "until_unix_s": BEGIN_S + 5000},
    {"kind": "after", "instant_unix_s": BEGIN_S + 9000},
    {"kind": "sin", "joint": 2},
    {"kind": "cos", "joint": 3, "order": 5},
    {"kind": "angle", "joint": 1, "power": 3},
    {"kind": "curve", "joint": 3, "values": [0.0, 1.0, 0.5, -2.0, 0.25, 3.0, -1.0]},
    {"kind": "gravity_torque", "joint": 2},
    {"kind": "gravity_direction", "link": 3, "axis": "y"},
    {"kind": "gravity_moment", "link": 1, "axis": "z"},
    {"kind": "side", "joint": 1},
    {"kind": "rate", "joint": 3},
    {"kind": "approach", "axis": "x"},
    {"kind": "approach", "axis": "z", "frame": "tip"},
]


def kinds_of(union: Any) -> set[str]:
    found = set[str]()
    for factor in typing.get_args(union):
        found |= set(typing.get_args(factor.model_fields["kind"].annotation))
    return found


def test_the_twin_has_every_factor_that_a_calibration_may() -> None:
    assert set(SLOW) == kinds_of(AnySlowFactor)
    assert set(POSE) == kinds_of(AnyPoseFactor)
    assert {factor["kind"] for factor in FACTORS} == set(SLOW) | set(POSE)


def an_arm(n_joints: int, rng: np.random.Generator) -> Arm:
    def mass(k: int) -> dict[str, Any]:
        return {"mass_kg": 1.2} if k % 2 else {"centre_of_mass_mm": [3.0, -20.0, 7.0]}

    return draw_arm(n_joints, rng, "TWIN-1", mass)


def drawn_terms(arm: Arm, rng: np.random.Generator) -> list[dict[str, Any]]:
    """Each factor on some parameter, and products of two."""
    terms = []
    for factor in FACTORS:
        basis = [factor, *([FACTORS[rng.integers(9)]] if rng.uniform() < 0.4 else [])]
        parameter = str(rng.choice(arm.layout.names))
        size = 1e-2 if not parameter.startswith(("theta", "alpha", "beta", "base_r")) else 1e-5
        terms.append({"parameter": parameter, "basis": basis, "coefficient": size * rng.normal()})
    return terms


def calibrated(arm: Arm, terms: list[dict[str, Any]], rng: np.random.Generator) -> Calibration:
    constants = arm.nominal() + rng.normal(0, 1e-3, arm.layout.count)
    more = {"created": "2026-09-01T00:00:00+00:00", "reference_temperature_c": 20.5}
    return drawn(arm, values=constants, terms=terms, **more)


def states_of(arm: Arm, rng: np.random.Generator, n: int = ROWS) -> States:
    approach = rng.normal(size=(n, 3))
    approach /= np.linalg.norm(approach, axis=1, keepdims=True)
    rate = rng.normal(0, 0.5, (n, arm.n_joints))
    approach[::7], rate[::5] = np.nan, np.nan
    time_s = BEGIN_S + 60.0 * rng.permutation(n)  # not in their order
    slow = np.sin((time_s[:, None] - BEGIN_S) / 3000.0 + np.arange(len(arm.sensors)))
    return States(
        q=rng.uniform(-2.5, 2.5, (n, arm.n_joints)),
        rate=rate,
        temperature_c=20.0 + 5.0 * slow + rng.normal(0, 0.1, slow.shape),
        time_s=np.asarray(time_s, dtype=np.float64),
        approach=approach,
        series=np.zeros(n, dtype=np.int64),
    )


def twin_of(arm: Arm, calibration: Calibration) -> TwinModel:
    """By the files' content alone, as a program that reads them has it."""
    data = to_arm_data(arm.model_dump(mode="json", by_alias=True, exclude_none=True))
    return TwinModel(data, to_calibration_data(calibration.content(), arm.n_joints))


def agree_within_mm(arm: Arm, calibration: Calibration, states: States) -> float:
    loaded = LoadedCalibration(calibration, "00" * 32, None)  # type: ignore[arg-type]
    expected, _ = Model(arm, loaded).correct_states(states)
    twin = twin_of(arm, calibration)
    amounts = twin.row_slow(states.temperature_c, states.time_s)
    found = twin.stand(states.q, states.rate, states.approach, amounts).tip
    assert np.isfinite(expected).all()
    return float(np.abs(found - expected).max())


@pytest.mark.parametrize("seed", range(12))
def test_every_factor_moves_the_tip_as_the_kernel_says(seed: int) -> None:
    rng = np.random.default_rng([seed, 0x7417])
    arm = an_arm((6, 3, 9, 4)[seed % 4], rng)
    calibration = calibrated(arm, drawn_terms(arm, rng), rng)
    assert agree_within_mm(arm, calibration, states_of(arm, rng)) < 1e-9


@parametrize_default("seed", range(8), default=1)
def test_calibrations_that_a_diagnosis_extended_agree(seed: int) -> None:
    """Their terms are those of five causes drawn from the catalogue, large ones."""
    scene = whole_scene()
    rng = np.random.default_rng([seed, 0xE47])
    arm = scene.linear.rests.observations.arm
    of_the_arm = [
        candidate
        for candidate in list_all_candidates(scene.free)
        if all(column.terms for column in candidate.columns)
    ]
    causes = sorted({candidate.cause for candidate in of_the_arm})
    terms: list[dict[str, Any]] = []
    for cause in rng.choice(causes, 5, replace=False):
        own = [candidate for candidate in of_the_arm if candidate.cause == cause]
        chosen = own[rng.integers(len(own))]
        for column in chosen.columns:
            written = column.make_terms(20.0 * column.prior_sd * rng.normal())
            terms += [term.model_dump(mode="json") for term in written]
    calibration = calibrated(arm, terms, rng)
    assert agree_within_mm(arm, calibration, states_of(arm, rng)) < 1e-9


def test_a_missing_temperature_leaves_no_position() -> None:
    rng = np.random.default_rng(5)
    arm = an_arm(3, rng)
    calibration = calibrated(arm, drawn_terms(arm, rng), rng)
    states = states_of(arm, rng, 4)
    states.temperature_c[2, 0] = np.nan
    twin = twin_of(arm, calibration)
    amounts = twin.row_slow(states.temperature_c, states.time_s)
    tip = twin.stand(states.q, states.rate, states.approach, amounts).tip
    assert np.isnan(tip[2]).all() and np.isfinite(tip[[0, 1, 3]]).all()


def test_turns_are_taken_off_as_where_sessions_are_read() -> None:
    from armd.compensation.data.soundness.turns import find_whole_turns as expected

    rng = np.random.default_rng(3)
    limits = [(-180.0, 180.0), (-60.0, 130.0), (-155.0, 5.0), (-270.0, 270.0), (None, None)]
    joints = [
        {key: v for key, v in (("min_deg", low), ("max_deg", high)) if v is not None}
        for low, high in limits
    ]
    arm = Arm.model_validate({"schema": "armd.arm/1", "serial_number": "T", "joint": joints})
    data = to_arm_data(arm.model_dump(mode="json", by_alias=True, exclude_none=True))
    q = rng.uniform(-12.0, 12.0, (500, 5))
    assert np.array_equal(count_whole_turns(q, data.limits_rad), expected(q, arm))
