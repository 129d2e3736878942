"""The geometry of a calibrated arm at one temperature, and the effects that it omits.

Terms of temperature and time alone are constant at one temperature, so the geometry contains them.
If terms depend on the pose, the geometry is the one whose tip is nearest to the corrected tip, in
the mean square over postures within the limits. The base keeps its place.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.estimate.gauge import list_free_constants
from armd.compensation.geometry.postures import draw_postures, make_states
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import compute_jacobian, compute_pose
from armd.compensation.model.terms import Term

#: Postures of the fit, and further postures that test it.
FITTED, JUDGED = 4000, 10_000
#: Departures of about equal effect at the tip: the fit's columns are scaled by them.
SCALE = {True: 1.0, False: 1e-3}  # mm; rad
#: A direction with a smaller singular value, relative to the largest, moves no tip and is kept.
RANK = 1e-9
MOST_STEPS = 20


@dataclass(frozen=True)
class Difference:
    """The difference of two models at the tip, over postures within the limits."""

    rms_mm: float
    max_mm: float


@dataclass(frozen=True)
class Geometry:
    """Parameters without terms, and the difference that the omitted terms make."""

    parameters: F64  # (P,)
    celsius: float  # all sensors
    left_out: Difference  # at this temperature
    terms: list[Term]  # the omitted terms
    #: the tip's motion from here to the limits of the calibration's temperatures; None: not thermal
    by_temperature: Difference | None = None
    range_c: tuple[float, float] | None = None


def compute_geometry(arm: Arm, calibration: Calibration | None, celsius: float | None) -> Geometry:
    """Compute the best geometry with all sensors at *celsius*, or at the reference temperature."""
    none = Difference(0.0, 0.0)
    if calibration is None:
        reference_c = arm.reference_temperature_c
        return Geometry(arm.nominal(), celsius if celsius is not None else reference_c, none, [])
    at_c = calibration.reference_temperature_c if celsius is None else celsius
    slow = [term for term in calibration.terms if term.slow]
    pose = [term for term in calibration.terms if not term.slow]
    parameters = fold_terms(arm, calibration, slow, at_c)
    if pose:
        parameters = _fit(arm, calibration, parameters, at_c)
        none = _difference(arm, calibration, parameters, at_c)
    ends = [end for pair in calibration.temperature_range_c.values() for end in pair]
    if not (ends and any(term.slow and _is_thermal(term) for term in calibration.terms)):
        return Geometry(parameters, at_c, none, pose)
    low, high = min(ends), max(ends)
    middle = fold_terms(arm, calibration, slow, at_c)
    q = draw_postures(arm, JUDGED, 3)
    tip = compute_pose(q, middle)[0]
    tip_changes = [
        compute_pose(q, fold_terms(arm, calibration, slow, end))[0] - tip for end in (low, high)
    ]
    return Geometry(parameters, at_c, none, pose, _summary(np.vstack(tip_changes)), (low, high))


def fold_terms(arm: Arm, calibration: Calibration, slow: list[Term], celsius: float) -> F64:
    """Return parameters (P,): constants plus *slow* terms with all sensors at one temperature."""
    constants = calibration.vector(arm.n_joints)
    state = make_states(np.zeros((1, arm.n_joints)), arm, celsius, calibration, 0)
    values = compute_basis_values(slow, state, arm, calibration.reference_temperature_c, constants)
    folded: F64 = compute_parameter_rows(constants, slow, values)[0]
    return folded


def _is_thermal(term: Term) -> bool:
    return any(getattr(factor, "means", []) for factor in term.basis)


def _fit(arm: Arm, calibration: Calibration, start: F64, celsius: float) -> F64:
    """Fit the geometry by Gauss–Newton from *start*; directions that move no tip are kept."""
    layout = arm.layout
    free = layout.indices(list_free_constants(arm))
    scale = np.array([SCALE[bool(layout.are_lengths[i])] for i in free])
    q, target_mm = _corrected(arm, calibration, celsius, FITTED, 1)
    parameters = start.copy()
    for _ in range(MOST_STEPS):
        tip, columns = compute_jacobian(q, parameters)
        a = columns[:, :, free].reshape(-1, len(free)) * scale
        step = np.linalg.lstsq(a, (target_mm - tip).ravel(), rcond=RANK)[0]
        parameters[free] += scale * step
        if np.abs(step).max() < 1e-9:
            break
    return parameters


def _difference(arm: Arm, calibration: Calibration, parameters: F64, celsius: float) -> Difference:
    q, target_mm = _corrected(arm, calibration, celsius, JUDGED, 2)
    return _summary(compute_pose(q, parameters)[0] - target_mm)


def _corrected(
    arm: Arm, calibration: Calibration, celsius: float, n: int, seed: int
) -> tuple[F64, F64]:
    """Return postures (n, N) and the tips (n, 3) of the whole calibration in them."""
    q = draw_postures(arm, n, seed)
    states = make_states(q, arm, celsius, calibration, seed)
    constants, reference_c = calibration.vector(arm.n_joints), calibration.reference_temperature_c
    values = compute_basis_values(calibration.terms, states, arm, reference_c, constants)
    return q, compute_pose(q, compute_parameter_rows(constants, calibration.terms, values))[0]


def _summary(difference_mm: F64) -> Difference:
    squared_mm2 = (difference_mm**2).sum(axis=1)
    return Difference(float(np.sqrt(squared_mm2.mean())), float(np.sqrt(squared_mm2.max())))
