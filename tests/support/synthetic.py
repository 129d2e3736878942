"""Sessions made from the model itself, for what must come back exactly: rank, truth, covariance.

Not for accuracy: there the simulator's own physics are the truth.
"""

from __future__ import annotations

import datetime
from dataclasses import replace

import numpy as np

from armd.compensation.data.sessions.format import Artefact
from armd.compensation.data.sessions.session import Session
from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.kinematics import compute_joint_jacobian, compute_pose
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term
from support.readings import session_of, states_of

STARTED = datetime.datetime(2026, 3, 1, 9, tzinfo=datetime.UTC)


def arm(n_joints: int = 6) -> Arm:
    """A measuring arm with twisted axes; sensor k on joint k."""
    a = [0.0, 40.0, 0.0, 35.0, 0.0, 20.0, 0.0, 30.0, 10.0]
    d = [300.0, 0.0, 400.0, 0.0, 350.0, 0.0, 60.0, 0.0, 50.0]
    alpha = [90.0, -90.0, 90.0, -90.0, 90.0, -90.0, 90.0, -90.0, 90.0]
    joints = [
        {"d_mm": d[k], "a_mm": a[k], "alpha_deg": alpha[k], "temperature": f"t{k + 1}"}
        for k in range(n_joints)
    ]
    return Arm.model_validate(
        {
            "schema": "armd.arm/1",
            "serial_number": "SYN-1",
            "temperature_sensor": [{"name": f"t{k + 1}"} for k in range(n_joints)],
            "joint": joints,
            "tip": {"offset_mm": [10.0, 20.0, 120.0]},
        }
    )


def disturbed(arm: Arm, rng: np.random.Generator, size: float = 1.0) -> np.ndarray:
    """True constants: up to *size* mm and 0.5° · *size* from the drawing; no base, no β."""
    truth = arm.nominal()
    for i, name in enumerate(arm.layout.names):
        if not name.startswith(("base", "beta")):
            spread = size * (np.radians(0.5) if parameters.find_unit(name) == "rad" else 1.0)
            truth[i] += rng.uniform(-spread, spread)
    return truth


def session(
    arm: Arm,
    constants: np.ndarray,
    rng: np.random.Generator,
    *,
    terms: list[Term] | None = None,
    targets: int = 4,
    spread_mm: float = 150.0,
    known: bool = True,
    placements: int = 3,
    readings: int = 150,
    distances: list[tuple[int, int]] | None = None,
    temperature_c: float = 20.0,
    scatter_k: float = 0.3,
    encoder_rad: float = 0.0,
    noise_mm: float = 0.0,
    uncertainty_mm: float = 0.0,
    name: str = "synthetic",
) -> Session:
    """Readings whose artefact is put where the arm happens to be.

    Each placement's targets stay put: the poses at one target are found by turning the joints
    at random and correcting the first angles (Newton on the tip's position).
    """
    points = rng.uniform(-spread_mm, spread_mm, (targets, 3))
    points -= points.mean(axis=0)
    placement = np.arange(readings) % placements
    target = (np.arange(readings) // placements) % targets
    temperatures = np.full((readings, arm.n_joints), temperature_c)
    temperatures += rng.normal(0, scatter_k, temperatures.shape)
    reach = float(np.abs(arm.nominal()[1 : 5 * arm.n_joints : 5]).sum()) * 0.55
    centres = np.array(
        [
            [reach * np.cos(turn), reach * np.sin(turn), 150.0 * np.sin(3 * turn)]
            for turn in np.linspace(0, 2 * np.pi, placements, endpoint=False)
        ]
    )
    turns = np.linalg.qr(rng.normal(size=(placements, 3, 3)))[0]
    turns *= np.linalg.det(turns)[:, None, None]
    wanted = centres[placement] + np.einsum("nij,nj->ni", turns[placement], points[target])
    states = _reach(arm, constants, terms or [], wanted, temperatures, rng)
    certified = points + uncertainty_mm * rng.normal(size=points.shape)
    read = states.q + encoder_rad * rng.normal(size=states.q.shape)
    artefact = Artefact.model_validate(
        {
            "name": "points",
            "target": [
                {"name": f"B{k}"}
                | (
                    {
                        "position_mm": certified[k].tolist(),
                        "standard_uncertainty_mm": uncertainty_mm,
                    }
                    if known
                    else {}
                )
                for k in range(targets)
            ],
            "distance": [
                {
                    "between": [f"B{i}", f"B{j}"],
                    "length_mm": float(np.linalg.norm(points[i] - points[j])),
                    "standard_uncertainty_mm": 0.001,
                }
                for i, j in distances or []
            ],
        }
    )
    truth = np.full((readings, 3), np.nan)
    if noise_mm:  # repeatability at the tip: the same as a truth that moved by as much
        local = np.einsum("nji,nj->ni", turns[placement], noise_mm * rng.normal(size=(readings, 3)))
        if not known:
            raise ValueError("noise at the tip needs known targets")
        truth = certified[target] + local
    return session_of(
        name,
        arm.serial_number,
        artefact,
        replace(states, q=read),
        placement=placement,
        placement_names=[f"P{p}" for p in range(placements)],
        target=target,
        truth_mm=truth,
    )


def tracked(
    arm: Arm, constants: np.ndarray, rng: np.random.Generator, readings: int = 150
) -> Session:
    """Random poses seen by a tracker: one placement, truth row by row."""
    n = arm.n_joints
    states = states_of(
        rng.uniform(-2.5, 2.5, (readings, n)),
        temperature_c=np.full((readings, n), 20.0),
        time_s=STARTED.timestamp() + 5.0 * np.arange(readings),
    )
    position = compute_pose(states.q, constants)[0]
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    turn *= np.linalg.det(turn)
    return session_of(
        "tracked",
        arm.serial_number,
        Artefact.model_validate({"name": "tracker", "target": [{"name": "ball"}]}),
        states,
        placement_names=["tracker"],
        truth_mm=(position - [1000.0, -300.0, 200.0]) @ turn,
    )


def _reach(
    arm: Arm,
    constants: np.ndarray,
    terms: list[Term],
    wanted: np.ndarray,
    temperatures: np.ndarray,
    rng: np.random.Generator,
) -> States:
    n = len(wanted)
    q = rng.uniform(-2.2, 2.2, (n, arm.n_joints))
    time_s = STARTED.timestamp() + 5.0 * np.arange(n)

    def states() -> States:
        return states_of(q, temperature_c=temperatures, time_s=time_s)

    for step in range(400):
        basis = compute_basis_values(terms, states(), arm, arm.reference_temperature_c, constants)
        p = compute_parameter_rows(constants, terms, basis)
        error = wanted - compute_pose(q, p)[0]
        apart = np.linalg.norm(error, axis=1)
        if apart.max() < 1e-10:
            break
        if step % 40 == 39:  # begin anew where a pose got stuck
            stuck = apart > 1e-6
            q = np.where(stuck[:, None], rng.uniform(-2.2, 2.2, q.shape), q)
            continue
        columns = compute_joint_jacobian(q, p)
        damping = 1e-8 * np.eye(3) + columns @ columns.transpose(0, 2, 1)
        move = np.einsum("nij,ni->nj", columns, np.linalg.solve(damping, error[:, :, None])[..., 0])
        q = q + np.clip(move, -0.3, 0.3)
    assert apart.max() < 1e-9
    return states()
