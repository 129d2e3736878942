"""Search for rows that another tip, or another place of the artefact, explains.

One fit to readings of two tips spreads the distance between the tips over all constants, and its
residuals look like those of any bad arm. So the search looks for rows with a tip of their own
around that fit, and fits the best group in full. The group is reported only if it explains nearly
all of the residuals, and no other cause that can begin at one moment explains as much.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from threadpoolctl import threadpool_limits

from armd.arrays import F64, I64, Mask
from armd.compensation.data.sessions.session import Session
from armd.compensation.estimate.observations import Observations
from armd.compensation.identify.admission.group_fit import (
    GroupCause,
    GroupFit,
    fit_whole,
    list_causes,
    list_unknowns,
)
from armd.compensation.identify.admission.requirements import count_least_readings_for_observations
from armd.compensation.identify.admission.row_groups import (
    LEAST_ROWS,
    ClearedRows,
    GroupGain,
    clear_rows,
    order_by_acquisition,
)
from armd.compensation.identify.admission.second_group import (
    Differs,
    RowsOfSession,
    SecondGroup,
)
from armd.compensation.identify.fit import Identification, compute_rms_um, fit
from armd.compensation.identify.thermal.terms import get_last_lever_mm
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.compensation.model.terms import Term

#: A full fit is made only if the linear search leaves at most this share of the squared residuals.
WORTH_FITTING = 0.5
#: A group is reported only if its full fit leaves at most this share of the RMS, a quarter of the
#: squares. Noise that is split in two leaves 0.79 of the squares in three dimensions.
MOST_REMAINING = 0.5
#: Single rows are chosen more freely than a stretch of rows, so their fit may leave only this
#: share.
MOST_REMAINING_SINGLY = 0.25
#: The RMS of a group's rows may be this many times their RMS in a fit without the other group. If
#: it is larger, the groups differ by more than a tip: another arm.
MOST_NOISE = 1.5
#: A group is fitted without the other one if it has this many times the readings it needs.
ENOUGH_READINGS = 1.5
#: The RMS must be below this share of the next best cause's; otherwise the cause is undecided.
MOST_OF_RIVAL_RMS = 0.7
#: A tip expands per K by at most this share of its distance from the last joint, plus an allowance
#: (mm) for what the readings hardly determine. A larger fitted expansion is none: sessions at two
#: temperatures with two tips look like that.
MOST_GROWN_PER_K, LEAST_GROWN_MM = 30e-6, 0.05
#: The most iterations that split rows in two by their residuals in the last frame.
MOST_PARTINGS = 20


def find_second_group(
    sessions: Sequence[Session], identification: Identification
) -> SecondGroup | None:
    """Return the rows that have another tip or place than the rest, if that explains
    *identification*.

    *identification* is a fit to all *sessions* as one group. The search makes a few more full fits
    at most, and none if the readings are consistent.
    """
    with threadpool_limits(limits=1, user_api="blas"):  # small matrices: threads only cost
        allowed_growth_mm = _get_exceeded_growth_limit_mm(identification, identification.terms)
        group = None if allowed_growth_mm else _find_group(identification, 0.0)
        if group:  # the fit may still take part of the second tip for expansion
            allowed_growth_mm = _get_exceeded_growth_limit_mm(
                group.identification, identification.terms
            )
        if allowed_growth_mm:
            identification = _fit_without_growth(identification)
            group = _find_group(identification, allowed_growth_mm)
        return (
            _describe_group(sessions, identification, group, allowed_growth_mm) if group else None
        )


def _get_exceeded_growth_limit_mm(identification: Identification, growth: Sequence[Term]) -> float:
    """Return the limit of the tip's expansion, mm, if the fit exceeds it; else 0.

    *growth* holds the expansion terms, which come first among the terms of *identification*.
    """
    of_tip = [k for k, term in enumerate(growth) if term.parameter in TIP_PARAMETERS]
    if not of_tip:
        return 0.0
    span_k = np.ptp(identification.linearisation.basis[:, of_tip], axis=0)
    grown_mm = np.abs([identification.terms[k].coefficient for k in of_tip]) * span_k
    most_mm = (
        MOST_GROWN_PER_K
        * np.linalg.norm(get_last_lever_mm(identification.observations.arm))
        * span_k
    )
    return float(most_mm.max()) if (grown_mm > most_mm + LEAST_GROWN_MM).any() else 0.0


def _fit_without_growth(identification: Identification) -> Identification:
    """Fit the readings again without expansion of the tip."""
    terms = [term for term in identification.terms if term.parameter not in TIP_PARAMETERS]
    arm = identification.observations.arm
    unknowns = list_unknowns(arm, terms)
    return fit(
        identification.observations, arm.nominal(), terms, unknowns, identification.reference_c
    )


def _find_group(identification: Identification, allowed_growth_mm: float) -> GroupFit | None:
    """Find the group that explains *identification*.

    The tip may expand by *allowed_growth_mm* without a fitted term.

    The first search counts outliers, because a small group may be among them. The second search
    does not, because single readings in the air hide any other group.
    """
    nobody = np.zeros(0, dtype=np.int64)
    for without in [nobody, identification.outliers] if len(identification.outliers) else [nobody]:
        cleared = clear_rows(identification, without)
        if cleared is None or cleared.squared_sum == 0.0:
            return None
        gains = [
            (cause, gain)
            for cause in list_causes(identification.observations.arm)
            if (gain := cleared.best_stretch(cause.columns(identification))) is not None
        ]
        candidates = [pair for pair in gains if pair[1].residual_share < WORTH_FITTING]
        best, most_remaining = (
            (_choose_cause(identification, candidates), MOST_REMAINING)
            if candidates
            else (_find_single_rows(identification, cleared), MOST_REMAINING_SINGLY)
        )
        if best and _explains(identification, best, most_remaining, allowed_growth_mm):
            return best
    return None


def _choose_cause(
    identification: Identification, candidates: Sequence[tuple[GroupCause, GroupGain]]
) -> GroupFit | None:
    """Choose the best cause that can be reported, if it is clearly better than its best rival."""
    candidates = sorted(candidates, key=lambda pair: pair[1].residual_share)
    named = [pair for pair in candidates if pair[0].differs is not Differs.ARM]
    best = fit_whole(identification, *named[0]) if named else None
    if best is None:
        return None
    rivals = [pair for pair in candidates if pair[0] is not best.cause]
    rival_fit = fit_whole(identification, *rivals[0]) if rivals else None
    if rival_fit and not _is_clearly_better(best, rival_fit):
        if not _is_clearly_better(rival_fit, best):
            return None
        best = rival_fit
    return None if best.cause.differs is Differs.ARM else best


def _is_clearly_better(first: GroupFit, second: GroupFit) -> bool:
    is_inlier = (
        first.is_inlier | second.is_inlier
    )  # with a wrong cause, the whole group counts as outliers
    return first.rms_um(is_inlier) < MOST_OF_RIVAL_RMS * second.rms_um(is_inlier)


def _find_single_rows(identification: Identification, cleared: ClearedRows) -> GroupFit | None:
    """Find a group of single rows anywhere in the data, as of two reflectors used in turn."""
    tip = GroupCause(Differs.TIP, TIP_PARAMETERS)
    columns = tip.columns(identification)
    group = _part_in_two(np.einsum("nic,ni->nc", columns, identification.linearisation.residual_mm))
    if not LEAST_ROWS <= group.sum() <= len(group) - LEAST_ROWS:
        return None
    gain = cleared.gain(columns, group)
    if gain.residual_share > WORTH_FITTING:
        return None
    best = fit_whole(identification, tip, gain, singly=True)
    if best is None:
        return None
    joints = [
        cause
        for cause in list_causes(identification.observations.arm)
        if len(cause.parameters) == 1
    ]
    gains = [(cause, cleared.gain(cause.columns(identification), best.group)) for cause in joints]
    rival = min(gains, key=lambda pair: pair[1].residual_share)  # backlash: two zeros
    rival_fit = fit_whole(identification, *rival, singly=True)
    return None if rival_fit and not _is_clearly_better(best, rival_fit) else best


def _part_in_two(points: F64) -> Mask:
    """Split *points* (n, 3) in two groups, each nearer to its own median; return a mask (n,)."""
    off = points - np.median(points, axis=0)
    size = np.linalg.norm(off, axis=1, keepdims=True)
    usual = max(float(np.median(size)), 1e-12)
    off = off * np.minimum(1.0, 3.0 * usual / np.maximum(size, 1e-12))  # as `row_groups.EDGE`
    along = np.linalg.eigh(off.T @ off)[1][:, -1]
    group: Mask = off @ along > 0.0
    for _ in range(MOST_PARTINGS):
        if group.all() or not group.any():
            break
        group_median, rest_median = (np.median(off[mask], axis=0) for mask in (group, ~group))
        nearer = ((off - group_median) ** 2).sum(axis=1) < ((off - rest_median) ** 2).sum(axis=1)
        if np.array_equal(nearer, group):
            break
        group = nearer
    return group


def _explains(
    identification: Identification,
    group_fit: GroupFit,
    most_remaining: float,
    allowed_growth_mm: float,
) -> bool:
    """Return whether the fit with a second group explains the residuals.

    Its RMS must be at most the share *most_remaining* of the RMS of *identification*. In each group
    with enough readings for a separate fit, it may exceed the noise of that fit only by the factor
    `MOST_NOISE` and the expansion *allowed_growth_mm*.
    """
    if group_fit.rms_um(group_fit.is_inlier) > most_remaining * compute_rms_um(
        identification.linearisation.residual_mm[group_fit.is_inlier]
    ):
        return False
    for group in (group_fit.group, ~group_fit.group):
        part = identification.observations.rows(group)
        if part.n < ENOUGH_READINGS * count_least_readings_for_observations(part):
            continue
        unknowns = list_unknowns(part.arm, identification.terms)
        own_fit = fit(
            part, part.arm.nominal(), identification.terms, unknowns, identification.reference_c
        )
        equations = int(part.freedom.sum())
        freedom = equations - own_fit.arm_problem.rank - own_fit.solution.effective_rank
        is_inlier = group_fit.is_inlier[group]
        is_inlier[own_fit.outliers] = False
        noise_um = compute_rms_um(own_fit.linearisation.residual_mm[is_inlier]) * np.sqrt(
            equations / max(freedom, 1)
        )
        limit_um = np.hypot(MOST_NOISE * noise_um, 1e3 * allowed_growth_mm)
        if (
            compute_rms_um(group_fit.identification.linearisation.residual_mm[group][is_inlier])
            > limit_um
        ):
            return False
    return True


def _describe_group(
    sessions: Sequence[Session],
    identification: Identification,
    group_fit: GroupFit,
    allowed_growth_mm: float,
) -> SecondGroup:
    """Describe the smaller group, the later of two equal ones, and how it differs from the rest.

    The tip may have expanded by *allowed_growth_mm* between the groups.
    """
    observations = identification.observations
    place = np.empty(observations.n)
    place[order_by_acquisition(identification)] = np.arange(observations.n)
    group, sign = group_fit.group, 1.0
    if (~group).sum() < group.sum() or (
        (~group).sum() == group.sum() and place[group].mean() < place[~group].mean()
    ):
        group, sign = ~group, -1.0
    others_mask = ~group
    to_mm = np.eye(3)
    if group_fit.cause.differs is Differs.PLACE:
        shared = _find_shared_rows(observations, group)
        group, others_mask = group & shared, others_mask & shared
        to_mm = group_fit.cause.columns(group_fit.identification)[group].mean(axis=0)
    step = sign * to_mm @ group_fit.step
    covariance = to_mm @ group_fit.covariance @ to_mm.T + allowed_growth_mm**2 * np.eye(3)
    along = step / max(float(np.linalg.norm(step)), 1e-12)
    return SecondGroup(
        group_fit.cause.differs,
        tuple(_list_rows(sessions, observations, group)),
        int(others_mask.sum()),
        step,
        np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        float(np.sqrt(max(float(along @ covariance @ along), 0.0))),
        compute_rms_um(identification.linearisation.residual_mm[group_fit.is_inlier]),
        group_fit.rms_um(group_fit.is_inlier),
    )


def _find_shared_rows(observations: Observations, group: Mask) -> Mask:
    """Mark the readings (n,) of placements that have rows both in *group* and outside.

    Other placements have a fitted pose of their own, which absorbs any difference of place.
    """
    shared_placements: I64 = np.intersect1d(
        observations.placement[group], observations.placement[~group]
    )
    return np.isin(observations.placement, shared_placements)


def _list_rows(
    sessions: Sequence[Session], observations: Observations, group: Mask
) -> list[RowsOfSession]:
    return [
        RowsOfSession(
            sessions[k].path,
            tuple(observations.row[group & rows].tolist()),
            bool(group[rows].all()),
        )
        for k in np.unique(observations.session[group]).tolist()
        if (rows := observations.session == k).any()
    ]
