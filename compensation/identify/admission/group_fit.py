"""Fits in which a group of rows has separate parameters: another tip, another place, or a joint.

A sensor marks the group, so a parameter that differs in it is a term like any other.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64, Mask
from armd.compensation.estimate.gauge import list_free_constants
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.admission.row_groups import (
    LEAST_ROWS,
    GroupGain,
    order_by_acquisition,
)
from armd.compensation.identify.admission.second_group import Differs
from armd.compensation.identify.fit import Identification, compute_rms_um, fit
from armd.compensation.model.arm import Arm, TemperatureSensor
from armd.compensation.model.parameters import BASE_PARAMETERS, LEAST_LENGTH_MM, TIP_PARAMETERS
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term

#: The most full fits of one cause; the group's rows are chosen again after each.
MOST_FITS = 3
#: The group is a sensor of this name, 1 K above the reference in the group's rows and at the
#: reference elsewhere. A term of that sensor is a parameter that differs in the group.
INDICATOR = "second group"


@dataclass(frozen=True)
class GroupCause:
    """A difference that a group of rows may have, and the parameters that then differ."""

    differs: Differs
    parameters: Sequence[str]

    def columns(self, identification: Identification) -> F64:
        """Return the derivatives (n, 3, c) of the residuals by the parameters."""
        return identification.linearisation.make_constant_columns(self.parameters)


@dataclass(frozen=True)
class GroupFit:
    """A fit in which the rows of a group have separate parameters."""

    cause: GroupCause
    group: Mask  # (n,)
    identification: Identification

    @property
    def step(self) -> F64:
        """The differences (c,) of the parameters in the group."""
        return np.array(
            [t.coefficient for t in self.identification.terms[-len(self.cause.parameters) :]]
        )

    @property
    def covariance(self) -> F64:
        """The covariance (c, c) of the step."""
        c = len(self.cause.parameters)
        return self.identification.covariance[-c:, -c:]

    @property
    def is_inlier(self) -> Mask:
        """A mask (n,) of all rows that are not outliers."""
        is_inlier = np.ones(len(self.group), dtype=bool)
        is_inlier[self.identification.outliers] = False
        return is_inlier

    def rms_um(self, is_inlier: Mask) -> float:
        """Return the RMS of the readings *is_inlier* (n,)."""
        return compute_rms_um(self.identification.linearisation.residual_mm[is_inlier])


def list_causes(arm: Arm) -> list[GroupCause]:
    """List the differences that may begin at one moment.

    The last link's lengths place the same points as the tip, so they are not listed. The last
    joint's zero also does; where it explains as much, no tip is reported.
    """
    drawn, layout = arm.nominal(), arm.layout
    joints = range(2, arm.n_joints + 1)
    lengths = [f"{stem}_{k}" for k in joints[:-1] for stem in ("d", "a")]
    lengths = [name for name in lengths if abs(drawn[layout.index(name)]) > LEAST_LENGTH_MM]
    return [
        GroupCause(Differs.TIP, TIP_PARAMETERS),
        GroupCause(Differs.PLACE, BASE_PARAMETERS),
        *(GroupCause(Differs.ARM, [f"theta_{k}"]) for k in joints),
        *([GroupCause(Differs.ARM, lengths)] if lengths else []),
    ]


def fit_whole(
    identification: Identification, cause: GroupCause, gain: GroupGain, singly: bool = False
) -> GroupFit | None:
    """Fit all unknowns and the group's own parameters, and choose the group again after each fit.

    Return None where the group, or the rest, has fewer than `LEAST_ROWS` rows.
    """
    group, step, group_fit = gain.group, gain.step, None
    for _ in range(MOST_FITS):
        group_fit = GroupFit(cause, group, _fit_group(identification, cause, group, step))
        chosen = _choose_rows(group_fit, singly)
        if not LEAST_ROWS <= chosen.sum() <= len(chosen) - LEAST_ROWS:
            return None
        if np.array_equal(chosen, group):
            break
        group, step = chosen, group_fit.step
    return group_fit


def _fit_group(
    identification: Identification, cause: GroupCause, group: Mask, step: F64
) -> Identification:
    observations, arm = identification.observations, identification.observations.arm
    sensors = [*arm.temperature_sensor, TemperatureSensor(name=INDICATOR)]
    states = observations.states
    indicator = identification.reference_c + group.astype(np.float64)
    temperature_c = np.column_stack([states.temperature_c, indicator])
    grouped = replace(
        observations,
        arm=arm.model_copy(update={"temperature_sensor": sensors}),
        states=replace(states, temperature_c=temperature_c),
    )
    within = [Temperature(weights={INDICATOR: 1.0})]
    group_terms = [
        Term(parameter=name, basis=within, coefficient=float(by))
        for name, by in zip(cause.parameters, step, strict=True)
    ]
    terms = [*identification.terms, *group_terms]
    return fit(grouped, arm.nominal(), terms, list_unknowns(arm, terms), identification.reference_c)


def list_unknowns(arm: Arm, terms: Sequence[Term]) -> Unknowns:
    """Return all constants that a calibration identifies except the last joint's, and all *terms*.

    The tip's offset places every point that it places together with the last joint's constants. So
    the last frame stays nominal, and the fit does not drift along directions that no reading
    determines.
    """
    last = arm.layout.names[arm.layout.joint(arm.n_joints)]
    constants = [name for name in list_free_constants(arm) if name not in last]
    return Unknowns(constants, range(len(terms)))


def _choose_rows(group_fit: GroupFit, singly: bool) -> Mask:
    """Choose the rows that the group's parameters fit better: single rows, or one stretch."""
    moved = group_fit.cause.columns(group_fit.identification) @ group_fit.step
    residual = group_fit.identification.linearisation.residual_mm
    within = np.where(group_fit.group[:, None], residual, residual + moved)
    outside = within - moved
    limit = (moved**2).sum(axis=1)  # limits the weight of any row to that of a row that fits
    better = np.clip((outside**2).sum(axis=1) - (within**2).sum(axis=1), -limit, limit)
    if singly:
        suited: Mask = better > 0.0
        return suited
    order = order_by_acquisition(group_fit.identification)
    total = np.concatenate([[0.0], np.cumsum(better[order])])
    before = np.minimum.accumulate(total)
    end = int(np.argmax(total - before))
    first = int(np.argmin(total[: end + 1]))
    chosen = np.zeros(len(order), dtype=bool)
    chosen[order[first:end]] = True
    return chosen
