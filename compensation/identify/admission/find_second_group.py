"""Search for rows that another tip, or another place of the artefact, explains.

One fit to readings of two tips spreads their distance over all constants, and what it leaves looks
like any bad arm. So rows with a tip of their own are searched for around that fit, and the best
group is fitted whole. It is named only where it explains nearly all, and nothing else that may
begin at one moment explains as much.
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
from armd.compensation.identify.admission.requirements import count_needed_readings
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

#: Whole fits are worth it where the linear search leaves no more of the squared residuals.
WORTH_FITTING = 0.5
#: A group is named where its whole fit leaves no more of the RMS: a quarter of the squares. Noise
#: that is parted in two leaves 0.79 of them in three dimensions.
MOST_REMAINING = 0.5
#: Rows taken one by one are chosen more freely than a stretch: no more than this may remain.
MOST_REMAINING_SINGLY = 0.25
#: Of a group's rows, no more than so many times what they leave when fitted without the other
#: group. More, and the groups differ by more than a tip: another arm.
MOST_NOISE = 1.5
#: A group is fitted without the other if it has so many times the readings its unknowns take.
TELLS_NOISE = 1.5
#: No more than so much of the RMS that the next best cause leaves; else nobody can say which it is.
CLEARLY = 0.7
#: No tip grows by more than this share of its distance from the last joint per K, and a little that
#: readings hardly know (mm). More is no growth: sessions of two temperatures and two tips look so.
MOST_GROWN_PER_K, LEAST_GROWN_MM = 30e-6, 0.05
#: Steps of parting rows in two by their residuals in the last frame.
MOST_PARTINGS = 20


def find_second_group(
    sessions: Sequence[Session], identification: Identification
) -> SecondGroup | None:
    """Return the rows that have another tip or place than the rest, if that explains
    *identification*.

    *identification* is a fit to all *sessions* as one group. At most a few whole fits more, and
    none where the readings are in order.
    """
    with threadpool_limits(limits=1, user_api="blas"):  # small matrices: threads only cost
        grown_mm = _limit_growth_mm(identification, identification.terms)
        group = None if grown_mm else _find_group(identification, 0.0)
        if group:  # part of the second tip may still be taken for growth
            grown_mm = _limit_growth_mm(group.identification, identification.terms)
        if grown_mm:
            identification = _fit_without_growth(identification)
            group = _find_group(identification, grown_mm)
        return _describe_group(sessions, identification, group, grown_mm) if group else None


def _limit_growth_mm(identification: Identification, growth: Sequence[Term]) -> float:
    """By how much the tip can have grown, where it grew by more in the fit; else 0. *growth* is as
    many of the first terms."""
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
    """The same fit without growth of the tip."""
    terms = [term for term in identification.terms if term.parameter not in TIP_PARAMETERS]
    arm = identification.observations.arm
    unknowns = list_unknowns(arm, terms)
    return fit(
        identification.observations, arm.nominal(), terms, unknowns, identification.reference_c
    )


def _find_group(identification: Identification, grown_mm: float) -> GroupFit | None:
    """The group that explains *identification*, in which the tip may have grown by *grown_mm*
    unfitted.

    Outliers count in the first search, as a small group may be among them, and not in the
    second, as single readings in the air hide any other group."""
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
        if best and _explains(identification, best, most_remaining, grown_mm):
            return best
    return None


def _choose_cause(
    identification: Identification, candidates: Sequence[tuple[GroupCause, GroupGain]]
) -> GroupFit | None:
    """The best of the causes that are named, if it clearly explains more than the best other."""
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
    )  # a wrong cause takes the whole group for outliers
    return first.rms_um(is_inlier) < CLEARLY * second.rms_um(is_inlier)


def _find_single_rows(identification: Identification, cleared: ClearedRows) -> GroupFit | None:
    """Rows here and there: two reflectors in turn."""
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
    rival = min(gains, key=lambda pair: pair[1].residual_share)  # play: a zero here, one there
    rival_fit = fit_whole(identification, *rival, singly=True)
    return None if rival_fit and not _is_clearly_better(best, rival_fit) else best


def _part_in_two(points: F64) -> Mask:
    """(n,) two groups of *points* (n, 3), each nearer to its own mean than to the other's."""
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
    identification: Identification, group_fit: GroupFit, most_remaining: float, grown_mm: float
) -> bool:
    """Whether it leaves at most the share *most_remaining* of the RMS, and of each group that is
    large enough to tell it no more than noise and the growth of *grown_mm*."""
    if group_fit.rms_um(group_fit.is_inlier) > most_remaining * compute_rms_um(
        identification.linearisation.residual_mm[group_fit.is_inlier]
    ):
        return False
    for group in (group_fit.group, ~group_fit.group):
        part = identification.observations.rows(group)
        if part.n < TELLS_NOISE * count_needed_readings(part):
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
        limit_um = np.hypot(MOST_NOISE * noise_um, 1e3 * grown_mm)
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
    grown_mm: float,
) -> SecondGroup:
    """The smaller group, or of two equal ones the later, and how it differs from the other; the tip
    may have grown by *grown_mm* between them."""
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
    covariance = to_mm @ group_fit.covariance @ to_mm.T + grown_mm**2 * np.eye(3)
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
    """(n,) readings of placements that have some within the *group* and some outside: the others
    have a pose of their own as it is."""
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
