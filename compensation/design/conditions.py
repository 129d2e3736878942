"""Conditions of the next session: poses and a climate, and their whitened rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64
from armd.compensation.design.clearance import (
    compute_column_distance_mm,
    compute_height_mm,
    make_resting_states,
)
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.whitening import RestNoise
from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.estimate.noise.reading import ReadingNoise, make_whitening
from armd.compensation.estimate.placements.poses import make_rigid_columns
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import (
    compute_basis_values,
    compute_parameter_rows,
    compute_tip_motion,
)
from armd.compensation.model.kinematics import compute_jacobian, compute_joint_jacobian
from armd.compensation.model.slow_factors import DAY_S
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term
from armd.errors import BadInput

POOL = 300
#: The least height of the arm over the base, and the least distance of the tip from the column.
LOWEST_MM, CLEAR_MM = 0.0, 150.0
#: Air temperatures to choose from, relative to the reference.
AIR_K = (0.0, -5.0, 5.0)
HEATED_K = 4.0  # of one sensor's link, by hand or by its own motor


@dataclass(frozen=True)
class Climate:
    """Temperatures that an operator can keep through one session."""

    air_c: float
    heated: str = ""  # sensor whose link is warmed by HEATED_K

    @property
    def words(self) -> str:
        link = f", the link of {self.heated} warmed by {HEATED_K:.0f} K" if self.heated else ""
        return f"air and artefact at {self.air_c:.0f} °C{link}"


def list_climates(diagnosis: Diagnosis) -> list[Climate]:
    """List the climates to choose from, the easiest first; only that one without temperatures."""
    last = diagnosis.search.last
    reference = last.model.reference_c
    has_temperature = np.isfinite(last.linear.rests.observations.states.temperature_c)
    sensors = [name for i, name in enumerate(diagnosis.arm.sensors) if has_temperature[:, i].any()]
    if not sensors:
        return [Climate(reference)]
    return [Climate(reference + k, heated) for heated in ("", *sensors) for k in AIR_K]


def draw_poses(diagnosis: Diagnosis, seed: int) -> States:
    """Draw poses within the limits, or where arm.toml has none within the measured ranges.

    Each joint comes to rest from either side, at the reference temperature. No part of the arm is
    lower than its base or, if one was, than the lowest of the sessions. Raises `BadInput` where no
    pose meets this.
    """
    arm, last = diagnosis.arm, diagnosis.search.last
    rng = np.random.default_rng(seed)
    measured_rad = last.linear.rests.observations.states.q
    low, high = _ranges(arm, measured_rad)
    q = rng.uniform(low, high, (12 * POOL, arm.n_joints))
    lowest = min(LOWEST_MM, float(compute_height_mm(measured_rad, last.model.constants, arm).min()))
    away = compute_column_distance_mm(q, last.model.constants) > min(
        CLEAR_MM, float(compute_column_distance_mm(measured_rad, last.model.constants).min())
    )
    q = q[away & (compute_height_mm(q, last.model.constants, arm) >= lowest)][:POOL]
    if not len(q):
        raise BadInput(
            "arm.toml", "joint limits", "no pose above the base", "ranges that have some"
        )
    next_day_s = float(last.linear.rests.observations.states.time_s.max()) + DAY_S
    return make_resting_states(q, rng, arm, last.model.reference_c, next_day_s)


def _ranges(arm: Arm, measured_rad: F64) -> tuple[F64, F64]:
    """Return the lowest and highest angles (N,) that a joint is known to reach, rad."""
    low, high = arm.limits_rad
    low = np.where(np.isfinite(low), low, measured_rad.min(axis=0))
    high = np.where(np.isfinite(high), high, measured_rad.max(axis=0))
    return low, high


def set_climate(poses: States, climate: Climate, diagnosis: Diagnosis) -> States:
    """Return the poses at the climate's temperatures, with the links' own warming of the sessions.

    The artefact's temperature in the sessions is taken for that of the air.
    """
    rests, arm = diagnosis.search.last.linear.rests, diagnosis.arm
    temperature_c = rests.observations.states.temperature_c
    over = (
        temperature_c - (diagnosis.search.last.model.reference_c + rests.artefact_rise_c)[:, None]
    )
    has_rise = np.isfinite(over).all(axis=0) & np.any(rests.artefact_rise_c != 0.0)
    own_k = np.where(has_rise, np.median(np.nan_to_num(over), axis=0), 0.0)
    temperature = np.tile(climate.air_c + own_k, (poses.n, 1))
    if climate.heated:
        temperature[:, arm.sensors.index(climate.heated)] += HEATED_K
    return replace(poses, temperature_c=temperature)


def whiten_rows(
    states: States, climate: Climate, last: Fit, candidates: Sequence[Candidate], arm: Arm
) -> tuple[F64, F64]:
    """Compute whitened rows (n, 3, k) and tips (n, 3) mm of readings in one new placement.

    Unknowns: the identified constants and terms (given: the directions of their covariance), the
    candidates' columns, the six of the placement.
    """
    model, baseline = last.linear.model, last.baseline
    values = compute_basis_values(model.terms, states, arm, model.reference_c, model.constants)
    p = compute_parameter_rows(model.constants, model.terms, np.nan_to_num(values))
    position, jac = compute_jacobian(states.q, p)

    def moves(terms: Sequence[Term]) -> F64:
        return compute_tip_motion(terms, states, arm, model.reference_c, model.constants, jac)

    probes = [
        baseline.model.terms[i].model_copy(update={"coefficient": 1.0}) for i in baseline.terms
    ]
    slopes = [moves([probe]) for probe in probes]
    identified = jac[:, :, np.array(baseline.parameters, dtype=np.int64)]  # none: exact
    identified_columns = np.concatenate(
        [identified, *(slope[:, :, None] for slope in slopes)], axis=2
    )
    if baseline.is_given:
        identified_columns = identified_columns @ baseline.root
    columns = [column for candidate in candidates for column in candidate.columns]
    extra = [moves(c.terms) + _artefact(c, position, climate, last) for c in columns]
    placement = make_rigid_columns(position - position.mean(axis=0))
    stacked = [identified_columns, *(block[:, :, None] for block in extra), placement]
    whitener = _whitener(compute_joint_jacobian(states.q, p), last.noise, _target_mm(last))
    rows: F64 = whitener @ np.concatenate(stacked, axis=2)
    return rows, position


def _artefact(column: Column, position: F64, climate: Climate, last: Fit) -> F64:
    """Compute the targets' motion (n, 3), mm per unit; the new targets are not those that moved."""
    if column.artefact is None or column.artefact.kind in ("target", "distance", "sag"):
        return np.zeros_like(position)
    warm = column.artefact.kind in ("expansion", "warmth")
    rise = climate.air_c - last.model.reference_c if warm else 1.0
    moves: F64 = -rise * (position - position.mean(axis=0))
    return moves


def _target_mm(last: Fit) -> float:
    """Return the uncertainty of a new target's position, as those of the existing sessions."""
    observations = last.linear.rests.observations
    uncertainty = observations.uncertainty_mm[~observations.unknown]
    return float(np.sqrt(np.mean(uncertainty**2))) if len(uncertainty) else 0.0


def _whitener(joints: F64, noise: RestNoise, target_mm: float) -> F64:
    """Return the whitening (n, 3, 3) by the sessions' noise, for poses of Jacobian (n, 3, joints).

    Each pose is at a target of its own.
    """
    of_point = math.hypot(noise.repeat_mm, target_mm)
    covariance = ReadingNoise(noise.encoder_rad, of_point).covariance(joints)
    return make_whitening(covariance, np.ones(len(joints)))
