"""Compute residuals of sessions under a model: only placements and unknown seats are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from armd.arrays import F64, I64, Mask
from armd.compensation.data.correction.overflow import find_overflows, refuse_overflow
from armd.compensation.data.sessions.session import Session
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.placements.poses import Poses
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.admission.touched_surfaces import require_surfaces
from armd.compensation.identify.evaluation import tally
from armd.compensation.identify.evaluation.lengths import Length, measure_certified_lengths
from armd.compensation.identify.fit import Identification, fit
from armd.compensation.identify.reflectors import (
    FoundReflector,
    ReflectorTerms,
    locate_reflectors,
    make_reflector_terms,
)
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.calibration import Calibration, list_sensors
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.terms import Term
from armd.compensation.progress import TellStep
from armd.errors import BadInput

#: The rows whose parameters are in memory at once.
CHUNK = 1 << 16


@dataclass(frozen=True)
class Evaluation:
    """The residuals of the readings that could be evaluated."""

    observations: Observations  # of those readings
    poses: Poses
    position_mm: F64  # (n, 3) base frame
    residual_mm: F64  # (n, 3) tip minus target, base frame
    n_unused: int  # readings that lack a temperature the model needs
    reflectors: list[FoundReflector] = field(default_factory=list)  # fitted positions

    @property
    def distance_um(self) -> F64:
        """The 3-D distances (n,) of the tip from its target."""
        distance: F64 = 1e3 * np.linalg.norm(self.residual_mm, axis=1)
        return distance

    @property
    def rms_um(self) -> float:
        """The 3-D RMS of all readings that could be evaluated."""
        return float(np.sqrt(np.mean(self.distance_um**2)))

    def as_json(self) -> dict[str, Any]:
        """Return the object that `armd evaluate --json` writes."""
        distance, observations = self.distance_um, self.observations
        names = observations.session_names
        return {
            **_compute_statistics(distance),
            "n_unused": self.n_unused,
            "by_session": {
                name: _compute_statistics(distance[observations.session == i])
                for i, name in enumerate(names)
            },
            "distances": [length.as_json() for length in self.lengths],
            "reflectors": {reflector.name: reflector.as_json() for reflector in self.reflectors},
        }

    @property
    def lengths(self) -> list[Length]:
        """The certified lengths, each with the length between the fitted seats."""
        return measure_certified_lengths(self.observations, self.poses, self.residual_mm)


def evaluate(
    sessions: Sequence[Session],
    arm: Arm,
    calibration: Calibration | None,
    progress: TellStep | None = None,
) -> Evaluation:
    """Compute residuals under a calibration, or without one under the nominal model of arm.toml."""
    with threadpool_limits(limits=1, user_api="blas"):  # small matrices: threads only cost
        return _evaluate(sessions, arm, calibration, progress)


def _evaluate(
    sessions: Sequence[Session],
    arm: Arm,
    calibration: Calibration | None,
    progress: TellStep | None,
) -> Evaluation:
    observations = collect_observations(
        sessions, arm, calibration.artefact if calibration else None
    )
    constants = calibration.vector(arm.n_joints) if calibration else arm.nominal()
    terms = calibration.terms if calibration else []
    reference_c = (calibration or arm).reference_temperature_c
    tips = make_reflector_terms(observations, constants[arm.layout.tip])
    reflectors: list[FoundReflector] = []
    if tips.terms:
        observations = tips.observations
        names, covariance, terms = list[str](), np.zeros((0, 0)), [*tips.terms, *terms]
        if tips.free:
            fitted = _fit_reflectors(tips, constants, terms, reference_c)
            terms, names, covariance = fitted.terms, fitted.unknowns.names, fitted.covariance
        reflectors = locate_reflectors(observations, constants, terms, names, covariance)
    evaluation = evaluate_model(observations, constants, terms, reference_c, progress)
    require_surfaces(sessions, evaluation.observations, evaluation.poses, evaluation.position_mm)
    return replace(evaluation, reflectors=reflectors)


def _fit_reflectors(
    tips: ReflectorTerms, constants: F64, terms: Sequence[Term], reference_c: float
) -> Identification:
    """Fit the positions of unknown reflectors, with constants (P,) and other terms fixed.

    *terms* are all terms, those of *tips* included. Readings without a temperature that a term
    needs are skipped.
    """
    arm = tips.observations.arm
    basis = compute_basis_values(terms, tips.observations.states, arm, reference_c, constants)
    usable: Mask = np.all(np.isfinite(basis), axis=1)
    observations = tips.observations.rows(usable) if usable.any() else tips.observations
    return fit(observations, constants, terms, Unknowns((), tips.free), reference_c)


def evaluate_model(
    observations: Observations,
    constants: F64,
    terms: Sequence[Term],
    reference_c: float,
    progress: TellStep | None = None,
) -> Evaluation:
    """Compute residuals under constants (P,) and terms.

    Memory stays bounded for millions of readings. Raises `BadInput` where no reading has the
    temperatures that the terms need.
    """
    states, arm = observations.states, observations.arm
    basis = compute_basis_values(terms, states, arm, reference_c, constants)
    position = np.empty((observations.n, 3))
    for first in range(0, observations.n, CHUNK):
        chunk = slice(first, first + CHUNK)
        position[chunk] = compute_tips(states.q[chunk], constants, terms, basis[chunk])
        if progress:
            progress(f"{min(first + CHUNK, observations.n)} of {observations.n} readings")
    refuse_overflows(observations, position, basis)
    usable = np.isfinite(position[:, 0])
    if not usable.any():
        missing = np.isnan(states.temperature_c).sum(axis=0)
        raise make_temperature_fault(observations, terms, observations.n, missing)
    if not usable.all():
        observations, position = observations.rows(usable), position[usable]
    poses = fit_poses(observations, position)
    residual = poses.residual(observations, position)
    return Evaluation(observations, poses, position, residual, int((~usable).sum()))


def compute_tips(q: F64, constants: F64, terms: Sequence[Term], basis: F64) -> F64:
    """Return tip positions (n, 3) mm; `refuse_overflows` refuses those that overflow."""
    with np.errstate(over="ignore", invalid="ignore"):
        return compute_pose(q, compute_parameter_rows(constants, terms, basis))[0]


def refuse_overflows(observations: Observations, position: F64, basis: F64) -> None:
    """Raise `BadInput` for positions (n, 3) that overflow though all basis values (n, T) are known.

    It names the first session that has such rows.
    """
    overflow = find_overflows(position)
    if not overflow.any():
        return
    overflow &= np.isfinite(basis).all(axis=1)
    for session in np.unique(observations.session[overflow]):
        rows = observations.session == session
        name = observations.session_names[session]
        refuse_overflow(name, observations.row[rows], overflow[rows])


def make_temperature_fault(
    observations: Observations, terms: Sequence[Term], n: int, missing: I64
) -> BadInput:
    """Return a fault that names the sensor that most of *n* readings lack.

    *missing* (S,) counts for each sensor the readings that lack it.
    """
    sensors = observations.arm.sensors
    needed = sorted(list_sensors(terms), key=sensors.index)
    worst = max(needed, key=lambda name: int(missing[sensors.index(name)]))
    count = int(missing[sensors.index(worst)])
    return BadInput(
        ", ".join(observations.session_names),
        f"column {worst}",
        f"a temperature in {n - count} of {n} readings",
        f"readings with every temperature the calibration needs ({', '.join(needed)})",
    )


def _compute_statistics(distance_um: F64) -> dict[str, Any]:
    if not len(distance_um):
        return dict(tally.NONE)
    return {
        "rms_um": float(np.sqrt(np.mean(distance_um**2))),
        "max_um": float(distance_um.max()),
        "mean_um": float(np.mean(distance_um)),
        "median_um": float(np.median(distance_um)),
        "n": len(distance_um),
    }
