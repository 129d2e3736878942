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
from armd.compensation.data.session import Session
from armd.compensation.estimate.observations import Observations
from armd.compensation.identify.admission.group_fit import (
    GroupCause,
    GroupFit,
    causes_of,
    fit_whole,
    unknowns_of,
)
from armd.compensation.identify.admission.requirements import readings_needed
from armd.compensation.identify.admission.row_groups import (
    LEAST_ROWS,
    ClearedRows,
    GroupGain,
    acquisition_order,
    clear_rows,
)
from armd.compensation.identify.admission.second_group import (
    Differs,
    RowsOfSession,
    SecondGroup,
)
from armd.compensation.identify.fit import Identification, fit, rms_um
from armd.compensation.identify.thermal.terms import last_lever_mm
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


def find_second_group(sessions: Sequence[Session], found: Identification) -> SecondGroup | None:
    """Return the rows that have another tip or place than the rest, if that explains *found*.

    *found* is a fit to all *sessions* as one group. At most a few whole fits more, and none where
    the readings are in order.
    """
    with threadpool_limits(limits=1, user_api="blas"):  # small matrices: threads only cost
        grown_mm = _most_grown_mm(found, found.terms)
        group = None if grown_mm else _find(found, 0.0)
        if group:  # part of the second tip may still be taken for growth
            grown_mm = _most_grown_mm(group.found, found.terms)
        if grown_mm:
            found = _without_growth(found)
            group = _find(found, grown_mm)
        return _described(sessions, found, group, grown_mm) if group else None


def _most_grown_mm(found: Identification, growth: Sequence[Term]) -> float:
    """By how much the tip can have grown, where it grew by more in the fit; else 0. *growth* is as
    many of the first terms."""
    of_tip = [k for k, term in enumerate(growth) if term.parameter in TIP_PARAMETERS]
    if not of_tip:
        return 0.0
    span_k = np.ptp(found.at.basis[:, of_tip], axis=0)
    grown_mm = np.abs([found.terms[k].coefficient for k in of_tip]) * span_k
    most_mm = MOST_GROWN_PER_K * np.linalg.norm(last_lever_mm(found.observations.arm)) * span_k
    return float(most_mm.max()) if (grown_mm > most_mm + LEAST_GROWN_MM).any() else 0.0


def _without_growth(found: Identification) -> Identification:
    """The same fit without growth of the tip."""
    terms = [term for term in found.terms if term.parameter not in TIP_PARAMETERS]
    arm = found.observations.arm
    unknowns = unknowns_of(arm, terms)
    return fit(found.observations, arm.nominal(), terms, unknowns, found.reference_c)


def _find(found: Identification, grown_mm: float) -> GroupFit | None:
    """The group that explains *found*, in which the tip may have grown by *grown_mm* unfitted.

    Outliers count in the first search, as a small group may be among them, and not in the
    second, as single readings in the air hide any other group."""
    nobody = np.zeros(0, dtype=np.int64)
    for without in [nobody, found.outliers] if len(found.outliers) else [nobody]:
        cleared = clear_rows(found, without)
        if cleared is None or cleared.square == 0.0:
            return None
        gains = [
            (cause, gain)
            for cause in causes_of(found.observations.arm)
            if (gain := cleared.best_stretch(cause.columns(found))) is not None
        ]
        worth = [one for one in gains if one[1].residual_share < WORTH_FITTING]
        one, most = (
            (_compared(found, worth), MOST_REMAINING)
            if worth
            else (_singly(found, cleared), MOST_REMAINING_SINGLY)
        )
        if one and _explains(found, one, most, grown_mm):
            return one
    return None


def _compared(
    found: Identification, worth: Sequence[tuple[GroupCause, GroupGain]]
) -> GroupFit | None:
    """The best of the causes that are named, if it clearly explains more than the best other."""
    worth = sorted(worth, key=lambda one: one[1].residual_share)
    named = [one for one in worth if one[0].differs is not Differs.ARM]
    best = fit_whole(found, *named[0]) if named else None
    if best is None:
        return None
    rivals = [one for one in worth if one[0] is not best.cause]
    other = fit_whole(found, *rivals[0]) if rivals else None
    if other and not _clearly_better(best, other):
        if not _clearly_better(other, best):
            return None
        best = other
    return None if best.cause.differs is Differs.ARM else best


def _clearly_better(one: GroupFit, other: GroupFit) -> bool:
    kept = one.kept | other.kept  # a wrong cause takes the whole group for outliers
    return one.rms_um(kept) < CLEARLY * other.rms_um(kept)


def _singly(found: Identification, cleared: ClearedRows) -> GroupFit | None:
    """Rows here and there: two reflectors in turn."""
    tip = GroupCause(Differs.TIP, TIP_PARAMETERS)
    columns = tip.columns(found)
    group = _parted(np.einsum("nic,ni->nc", columns, found.at.residual_mm))
    if not LEAST_ROWS <= group.sum() <= len(group) - LEAST_ROWS:
        return None
    gain = cleared.gain(columns, group)
    if gain.residual_share > WORTH_FITTING:
        return None
    best = fit_whole(found, tip, gain, singly=True)
    if best is None:
        return None
    joints = [cause for cause in causes_of(found.observations.arm) if len(cause.parameters) == 1]
    gains = [(cause, cleared.gain(cause.columns(found), best.group)) for cause in joints]
    rival = min(gains, key=lambda one: one[1].residual_share)  # play: a zero here, one there
    other = fit_whole(found, *rival, singly=True)
    return None if other and not _clearly_better(best, other) else best


def _parted(points: F64) -> Mask:
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
        one, other = (np.median(off[mask], axis=0) for mask in (group, ~group))
        nearer = ((off - one) ** 2).sum(axis=1) < ((off - other) ** 2).sum(axis=1)
        if np.array_equal(nearer, group):
            break
        group = nearer
    return group


def _explains(found: Identification, one: GroupFit, most: float, grown_mm: float) -> bool:
    """Whether it leaves at most the share *most* of the RMS, and of each group that is large enough
    to tell it no more than noise and the growth of *grown_mm*."""
    if one.rms_um(one.kept) > most * rms_um(found.at.residual_mm[one.kept]):
        return False
    for group in (one.group, ~one.group):
        part = found.observations.rows(group)
        if part.n < TELLS_NOISE * readings_needed(part):
            continue
        alone = fit(
            part, part.arm.nominal(), found.terms, unknowns_of(part.arm, found.terms),
            found.reference_c,
        )  # fmt: skip
        equations = int(part.freedom.sum())
        freedom = equations - alone.alone.rank - alone.solution.effective_rank
        kept = one.kept[group]
        kept[alone.outliers] = False
        noise_um = rms_um(alone.at.residual_mm[kept]) * np.sqrt(equations / max(freedom, 1))
        limit_um = np.hypot(MOST_NOISE * noise_um, 1e3 * grown_mm)
        if rms_um(one.found.at.residual_mm[group][kept]) > limit_um:
            return False
    return True


def _described(
    sessions: Sequence[Session], found: Identification, one: GroupFit, grown_mm: float
) -> SecondGroup:
    """The smaller group, or of two equal ones the later, and how it differs from the other; the tip
    may have grown by *grown_mm* between them."""
    observations = found.observations
    place = np.empty(observations.n)
    place[acquisition_order(found)] = np.arange(observations.n)
    group, sign = one.group, 1.0
    if (~group).sum() < group.sum() or (
        (~group).sum() == group.sum() and place[group].mean() < place[~group].mean()
    ):
        group, sign = ~group, -1.0
    rest = ~group
    to_mm = np.eye(3)
    if one.cause.differs is Differs.PLACE:
        shared = _in_both(observations, group)
        group, rest = group & shared, rest & shared
        to_mm = one.cause.columns(one.found)[group].mean(axis=0)
    step = sign * to_mm @ one.step
    covariance = to_mm @ one.covariance @ to_mm.T + grown_mm**2 * np.eye(3)
    along = step / max(float(np.linalg.norm(step)), 1e-12)
    return SecondGroup(
        one.cause.differs,
        tuple(_of_sessions(sessions, observations, group)),
        int(rest.sum()),
        step,
        np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        float(np.sqrt(max(float(along @ covariance @ along), 0.0))),
        rms_um(found.at.residual_mm[one.kept]),
        one.rms_um(one.kept),
    )


def _in_both(observations: Observations, group: Mask) -> Mask:
    """(n,) readings of placements that have some within the *group* and some outside: the others
    have a pose of their own as it is."""
    both: I64 = np.intersect1d(observations.placement[group], observations.placement[~group])
    return np.isin(observations.placement, both)


def _of_sessions(
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
