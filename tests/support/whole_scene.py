"""Sessions that have everything a cause may ask for, as the diagnosis and as plain columns have it.

Poses are at random: residuals are absurd, and columns do not depend on them.
"""

from __future__ import annotations

import datetime
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.signal import lsim

from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.problem.linear import Baseline, Linear, ModelState
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.diagnose.problem.session_facts import collect_facts
from armd.compensation.effects.effect import SessionFacts, Use, Winding
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import ArtefactCorrection, Calibration
from armd.compensation.model.terms import Term
from support.plain_basis import Scene, value
from support.readings import session_of, states_of

STARTED = datetime.datetime(2026, 3, 2, 6, tzinfo=datetime.UTC)
STEP_S, READINGS = 600.0, 60  # of each of two sessions, ten hours long
SECOND_H = 14.0
REFERENCE_C = 20.0


def _arm() -> Arm:
    """Six joints, each link with a weight of its own; two share a sensor, the last has none."""
    d = [300.0, 30.0, 400.0, -20.0, 350.0, 60.0]
    a = [25.0, 40.0, 15.0, 35.0, 30.0, 20.0]
    alpha = [90.0, -85.0, 5.0, -90.0, 90.0, 0.0]
    temperature = ["t1", "t2", "t3", {"t3": 0.5, "t4": 0.5}, "t3", None]
    joints = [
        {
            "theta_deg": 3.0 * k,
            "d_mm": d[k],
            "a_mm": a[k],
            "alpha_deg": alpha[k],
            "beta_deg": 2.0 * (k == 2),
            "temperature": temperature[k],
            "mass_kg": 0.4 + 0.3 * k,
            "centre_of_mass_mm": [-10.0 * k, 5.0 + k, -60.0],
        }
        for k in range(6)
    ]
    return Arm.model_validate(
        {
            "schema": "armd.arm/1",
            "serial_number": "WHOLE",
            "temperature_sensor": [{"name": f"t{k}"} for k in (1, 2, 3, 4)],
            "joint": joints,
            "tip": {"offset_mm": [10.0, 20.0, 120.0]},
        }
    )


TERMS = [
    Term.model_validate(
        {"parameter": f"{name}_{joint}", "basis": [basis], "coefficient": coefficient}
    )
    for name, joint, basis, coefficient in (
        ("d", 1, {"kind": "temperature", "weights": {"t1": 1.0}}, 3e-3),
        ("a", 2, {"kind": "temperature", "weights": {"t2": 1.0}}, 4e-4),
        ("d", 3, {"kind": "temperature", "weights": {"t3": 1.0}}, 4e-3),
        ("a", 3, {"kind": "temperature", "weights": {"t3": 1.0}, "order": 2}, 2e-5),
        ("d", 4, {"kind": "temperature", "weights": {"t3": 0.5, "t4": 0.5}}, -3e-4),
        ("theta", 5, {"kind": "temperature", "weights": {"t3": 1.0}}, 2e-6),
    )
]


def _artefact(name: str, points: np.ndarray) -> Artefact:
    targets = [{"name": f"{name[0]}{i}", "position_mm": list(p)} for i, p in enumerate(points)]
    length = float(np.linalg.norm(points[0] - points[1]))
    between = {"between": [f"{name[0]}0", f"{name[0]}1"], "length_mm": length}
    return Artefact.model_validate({"name": name, "target": targets, "distance": [between]})


def _session(arm: Arm, number: int, artefact: Artefact, rng: np.random.Generator) -> Session:
    n = READINGS
    q = rng.uniform(-2.5, 2.5, (n, arm.n_joints))
    time_s = STARTED.timestamp() + 3600.0 * SECOND_H * number + STEP_S * np.arange(n)
    warming = 6.0 * (1.0 - np.exp(-STEP_S * np.arange(n) / 9000.0))
    temperature = 18.0 + np.outer(warming, [1.0, 0.8, 0.5, 0.3]) + rng.normal(0, 1, (n, 4))
    approach = rng.normal(size=(n, 3))
    states = states_of(
        q,
        rate=rng.normal(0, 0.3, q.shape),
        temperature_c=temperature,
        time_s=time_s,
        approach=approach / np.linalg.norm(approach, axis=1, keepdims=True),
    )
    return session_of(
        f"whole-{number}",
        arm.serial_number,
        artefact,
        states,
        placement=np.arange(n) * 3 // n,
        placement_names=["P0", "P1", "P2"],
        target=np.arange(n) % len(artefact.targets),
        artefact_c=REFERENCE_C + warming,
    )


@dataclass(frozen=True)
class Whole:
    """The same sessions three ways: what the catalogue is told, the columns around the model
    under test, and plain columns."""

    held: SessionFacts  # a calibration was given
    free: SessionFacts  # it was made of these sessions
    linear: Linear
    plain: Scene
    artefact_rise_k: np.ndarray  # (n,)

    @cached_property
    def parameters(self) -> np.ndarray:
        """(n, P) the model's at every reading."""
        return model_at(self.plain)


def model_at(scene: Scene) -> np.ndarray:
    """(n, P) parameters of the model under test, in a scene."""
    found = scene.parameters
    for term in TERMS:
        at = scene.arm.layout.names.index(term.parameter)
        found[:, at] += term.coefficient * value(term.basis[0], scene)
    return found


def warm(use: Use, scene: Scene) -> np.ndarray:
    """τ·dy/dt = work − y from 0 in each run, the work even between two readings."""
    found = np.zeros(len(scene.q))
    for run in np.unique(scene.series):
        rows = np.flatnonzero(scene.series == run)
        time_s = scene.time_s[rows]
        way = np.abs(np.diff(scene.q[rows, use.joint - 1])) / np.diff(time_s)
        work = np.abs(scene.rate[rows[1:], use.joint - 1]) if use.by_rate else way
        system = ([1.0], [use.time_constant_s, 1.0])
        found[rows] = lsim(system, [*work, 0.0], time_s - time_s[0], interp=False)[1]
    return found


def wound(winding: Winding, scene: Scene) -> np.ndarray:
    """A joint less what follows it with play: it stands still within, and is dragged at the end."""
    found, within = np.zeros(len(scene.q)), winding.within_rad
    for run in np.unique(scene.series):
        rows = np.flatnonzero(scene.series == run)
        q = scene.q[rows, winding.joint - 1]
        dragged = q[0]
        for row, turned in zip(rows, q, strict=True):
            dragged = max(turned - within, min(turned + within, dragged))
            found[row] = (turned - dragged) / within
    return found


def whole_scene() -> Whole:
    rng = np.random.default_rng(15)
    arm = _arm()
    beam = np.array([[0.0, 0, 0], [400, 0, 0], [200, 30, 0], [80, -30, 5], [300, 10, -5]])
    plate = np.array([[0.0, 0, 0], [200, 0, 0], [0, 150, 0], [200, 150, 10], [90, 60, 30]])
    sessions = [
        _session(arm, i, _artefact(name, points), rng)
        for i, (name, points) in enumerate((("beam", beam), ("plate", plate)))
    ]
    model = ModelState(arm.nominal(), tuple(TERMS), REFERENCE_C, ArtefactCorrection())
    rests = collect_rests(sessions, arm)
    assert rests.n == 2 * READINGS
    held, free = (
        collect_facts(rests, arm, Baseline(model, _unused(), held, (), (), np.zeros((0, 0))))
        for held in (True, False)
    )
    states = rests.observations.states
    plain = Scene(
        arm,
        arm.nominal(),
        REFERENCE_C,
        states.q,
        states.rate,
        states.temperature_c,
        states.time_s,
        states.approach,
        states.series,
    )
    rise = np.concatenate([session.artefact_c for session in sessions]) - REFERENCE_C
    return Whole(held, free, linearise(rests, model, arm), plain, rise)


def _unused() -> Calibration:
    return Calibration(
        arm="WHOLE",
        created="2026-03-01T00:00:00Z",
        reference_temperature_c=REFERENCE_C,
        constants={},
    )
