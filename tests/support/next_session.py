"""The session that a hidden case's arm measures next, in proposed poses."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from armd.arrays import F64
from armd.simulator.hidden import HiddenCase
from armd.simulator.measured.artefact import Artefact
from armd.simulator.measured.measuring import take_readings, write_session
from armd.simulator.measured.placement import Placement
from armd.simulator.measured.plan import Climate, SessionPlan
from armd.simulator.truth.effects.effect import Conditions


def measure_next(
    case: HiddenCase,
    folder: Path,
    q_rad: F64,
    climate: Climate | None = None,
    *,
    sides: F64 | None = None,
    rate_rad_s: float = 0.05,
    payload_kg: float = 0.0,
    seed: int = 0,
) -> Path:
    """Measure the proposed poses *q_rad* (n, N) with the arm of *case*, a day after its sessions.

    A ball is set up where the tip stands in each pose and certified like the case's own; joints
    come to rest from *sides* (n, N: a sign) if given. Writes the session *folder* and returns it.
    """
    rng = np.random.default_rng([seed, 0x0E87])
    rig = case.present.rig
    plan = SessionPlan(
        folder.name,
        case.present.span_s()[-1][1] / 3600 + 24.0,
        climate or Climate(),
        interval_s=20.0,
        rate_rad_s=rate_rad_s,
        payload_kg=payload_kg,
    )
    n = len(q_rad)
    tip = rig.arm.tip(q_rad, Conditions.at_rest(n, rig.arm.n_joints, plan.climate.ambient_c))
    pose = Placement("P1", _random_rotation(rng), rng.uniform(-500.0, 500.0, 3))
    balls = {
        f"N{i + 1}": tuple(ball) for i, ball in enumerate((tip - pose.origin_mm) @ pose.rotation)
    }
    artefact = Artefact.certified(
        "balls at the proposed poses",
        balls,
        rng,
        manufacturing_mm=0.0,
        standard_uncertainty_mm=rig.artefact.standard_uncertainty_mm,
        expansion_per_k=rig.artefact.expansion_per_k,
    )
    artefact = replace(artefact, true_expansion_per_k=rig.artefact.true_expansion_per_k)
    rows = np.arange(n)
    measured = take_readings(
        replace(rig, artefact=artefact), plan, [pose], np.zeros(n, int), rows, q_rad, rng, sides
    )
    write_session(folder, measured)
    return folder


def _random_rotation(rng: np.random.Generator) -> F64:
    """A rotation (3, 3) uniform over all."""
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    rotation: F64 = q if np.linalg.det(q) > 0 else -q
    return rotation
