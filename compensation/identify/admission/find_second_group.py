"""Search for rows that another tip, or another place of the artefact, explains.

One fit to readings of two tips spreads their distance over all constants, and what it leaves looks
like any bad arm. So rows with a tip of their own are searched for around that fit, and the best
group is fitted whole. It is named only where it explains nearly all, and nothing else that may
begin at one moment explains as much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from armd.arrays import F64, I64, Mask
from armd.compensation.data.session import Session
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.admission.requirements import readings_needed
from armd.compensation.identify.admission.row_groups import (
    LEAST_ROWS,
    ClearedRows,
    Gain,
    acquisition_order,
    clear_rows,
)
from armd.compensation.identify.admission.second_group import (
    Differs,
    RowsOfSession,
    SecondGroup,
)
from armd.compensation.identify.fit import Identification, fit, rms_um
from armd.compensation.model.arm import Arm, TemperatureSensor
from armd.compensation.model.parameters import BASE_PARAMETERS, LEAST_LENGTH_MM, TIP_PARAMETERS
from armd.compensation.model.slow_factors import Temperature
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
#: Whole fits of one cause at most, its rows chosen anew after each.
MOST_FITS = 3
#: Steps of parting rows in two by their residuals in the last frame.
MOST_PARTINGS = 20
#: The group is one more sensor of this name, 1 K above the reference in its rows and at it in all
#: others: a term of it is a parameter that differs in the group.
INDICATOR = "second group"


@dataclass(frozen=True)
class Cause:
    """What may be other in a group of rows, and the parameters that then differ."""

    differs: Differs
    parameters: Sequence[str]

    def columns(self, found: Identification) -> F64:
        """(n, 3, c) d residual / d parameter."""
        return found.at.constant_columns(self.parameters)


@dataclass(frozen=True)
class GroupFit:
    """A fit in which the rows of a group have parameters of their own."""

    cause: Cause
    group: Mask  # (n,)
    found: Identification

    @property
    def step(self) -> F64:
        """(c,) by how much the parameters differ."""
        return np.array([t.coefficient for t in self.found.terms[-len(self.cause.parameters) :]])

    @property
    def covariance(self) -> F64:
        """(c, c) of the step."""
        c = len(self.cause.parameters)
        return self.found.covariance[-c:, -c:]

    @property
    def kept(self) -> Mask:
        """(n,) all rows but outliers."""
        kept = np.ones(len(self.group), dtype=bool)
        kept[self.found.outliers] = False
        return kept

    def rms_um(self, kept: Mask) -> float:
        """RMS of the readings *kept* (n,)."""
        return rms_um(self.found.at.residual_mm[kept])


def find_second_group(sessions: Sequence[Session], found: Identification) -> SecondGroup | None:
    """Return the rows that have another tip or place than the rest, if that explains *found*.

    *found* is a fit to all *sessions* as one group. At most a few whole fits more, and none where
    the readings are in order.
    """
    with threadpool_limits(limits=1, user_api="blas"):  # small matrices: threads only cost
        group = _find(found)
        return _described(sessions, found, group) if group else None


def _find(found: Identification) -> GroupFit | None:
    """Outliers count in the first search, as a small group may be among them, and not in the
    second, as single readings in the air hide any other group."""
    nobody = np.zeros(0, dtype=np.int64)
    for without in [nobody, found.outliers] if len(found.outliers) else [nobody]:
        cleared = clear_rows(found, without)
        if cleared is None or cleared.square == 0.0:
            return None
        gains = [
            (cause, gain)
            for cause in _causes(found.observations.arm)
            if (gain := cleared.best_stretch(cause.columns(found))) is not None
        ]
        worth = [one for one in gains if one[1].residual_share < WORTH_FITTING]
        one = _compared(found, worth) if worth else _singly(found, cleared)
        if one:
            return one
    return None


def _compared(found: Identification, worth: Sequence[tuple[Cause, Gain]]) -> GroupFit | None:
    """The best of the causes that are named, if it clearly explains more than the best other."""
    worth = sorted(worth, key=lambda one: one[1].residual_share)
    named = [one for one in worth if one[0].differs is not Differs.ARM]
    best = _fit_whole(found, *named[0]) if named else None
    if best is None:
        return None
    rivals = [one for one in worth if one[0] is not best.cause]
    other = _fit_whole(found, *rivals[0]) if rivals else None
    if other:
        kept = best.kept | other.kept  # a wrong cause takes the whole group for outliers
        if other.rms_um(kept) < best.rms_um(kept):
            best, other = other, best
        if best.rms_um(kept) > CLEARLY * other.rms_um(kept):
            return None
    if best.cause.differs is Differs.ARM:
        return None
    return best if _explains(found, best, MOST_REMAINING) else None


def _singly(found: Identification, cleared: ClearedRows) -> GroupFit | None:
    """Rows here and there: two reflectors in turn."""
    tip = Cause(Differs.TIP, TIP_PARAMETERS)
    columns = tip.columns(found)
    group = _parted(np.einsum("nic,ni->nc", columns, found.at.residual_mm))
    if not LEAST_ROWS <= group.sum() <= len(group) - LEAST_ROWS:
        return None
    gain = cleared.gain(columns, group)
    if gain.residual_share > WORTH_FITTING:
        return None
    best = _fit_whole(found, tip, gain, singly=True)
    return best if best and _explains(found, best, MOST_REMAINING_SINGLY) else None


def _causes(arm: Arm) -> list[Cause]:
    """What may begin at one moment. The last link's lengths place the same point as the tip; the
    last joint's zero does so, too, and where it explains as much, no tip is named."""
    drawn, layout = arm.nominal(), arm.layout
    joints = range(2, arm.n_joints + 1)
    lengths = [f"{stem}_{k}" for k in joints[:-1] for stem in ("d", "a")]
    lengths = [name for name in lengths if abs(drawn[layout.index(name)]) > LEAST_LENGTH_MM]
    return [
        Cause(Differs.TIP, TIP_PARAMETERS),
        Cause(Differs.PLACE, BASE_PARAMETERS),
        *(Cause(Differs.ARM, [f"theta_{k}"]) for k in joints),
        *([Cause(Differs.ARM, lengths)] if lengths else []),
    ]


def _fit_whole(
    found: Identification, cause: Cause, gain: Gain, singly: bool = False
) -> GroupFit | None:
    """Fit all unknowns and the group's own parameters, the group chosen anew after each fit; None
    where no group remains."""
    group, step, one = gain.group, gain.step, None
    for _ in range(MOST_FITS):
        one = GroupFit(cause, group, _fit_group(found, cause, group, step))
        chosen = _chosen(one, singly)
        if not LEAST_ROWS <= chosen.sum() <= len(chosen) - LEAST_ROWS:
            return None
        if np.array_equal(chosen, group):
            break
        group, step = chosen, one.step
    return one


def _fit_group(found: Identification, cause: Cause, group: Mask, step: F64) -> Identification:
    observations, arm = found.observations, found.observations.arm
    sensors = [*arm.temperature_sensor, TemperatureSensor(name=INDICATOR)]
    states = observations.states
    indicator = found.reference_c + group.astype(np.float64)
    temperature_c = np.column_stack([states.temperature_c, indicator])
    grouped = replace(
        observations,
        arm=arm.model_copy(update={"temperature_sensor": sensors}),
        states=replace(states, temperature_c=temperature_c),
    )
    within = [Temperature(weights={INDICATOR: 1.0})]
    own = [
        Term(parameter=name, basis=within, coefficient=float(by))
        for name, by in zip(cause.parameters, step, strict=True)
    ]
    terms = [*found.terms, *own]
    unknowns = Unknowns(found.unknowns.constants, range(len(terms)))
    begin = found.constants
    return fit(grouped, arm.nominal(), terms, unknowns, found.reference_c, begin=begin)


def _chosen(one: GroupFit, singly: bool) -> Mask:
    """The rows that the group's parameters suit better: each by itself, or in one stretch."""
    moved = one.cause.columns(one.found) @ one.step
    residual = one.found.at.residual_mm
    within = np.where(one.group[:, None], residual, residual + moved)
    outside = within - moved
    limit = (moved**2).sum(axis=1)  # no row has more voice than one that is right
    better = np.clip((outside**2).sum(axis=1) - (within**2).sum(axis=1), -limit, limit)
    if singly:
        suited: Mask = better > 0.0
        return suited
    order = acquisition_order(one.found)
    total = np.concatenate([[0.0], np.cumsum(better[order])])
    before = np.minimum.accumulate(total)
    end = int(np.argmax(total - before))
    first = int(np.argmin(total[: end + 1]))
    chosen = np.zeros(len(order), dtype=bool)
    chosen[order[first:end]] = True
    return chosen


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


def _explains(found: Identification, one: GroupFit, most: float) -> bool:
    """Whether it leaves at most the share *most* of the RMS, and no more than noise of each group
    that is large enough to tell it."""
    if one.rms_um(one.kept) > most * rms_um(found.at.residual_mm[one.kept]):
        return False
    for group in (one.group, ~one.group):
        part = found.observations.rows(group)
        if part.n < TELLS_NOISE * readings_needed(part):
            continue
        alone = fit(
            part, part.arm.nominal(), found.terms, found.unknowns, found.reference_c,
            begin=one.found.constants,
        )  # fmt: skip
        freedom = 3 * part.n - alone.alone.rank - alone.solution.told
        kept = one.kept[group]
        kept[alone.outliers] = False
        noise_um = rms_um(alone.at.residual_mm[kept]) * np.sqrt(3 * part.n / max(freedom, 1))
        if rms_um(one.found.at.residual_mm[group][kept]) > MOST_NOISE * noise_um:
            return False
    return True


def _described(sessions: Sequence[Session], found: Identification, one: GroupFit) -> SecondGroup:
    """The smaller group, or of two equal ones the later, and how it differs from the other."""
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
    covariance = to_mm @ one.covariance @ to_mm.T
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
            tuple(observations.row[group & own].tolist()),
            bool(group[own].all()),
        )
        for k in np.unique(observations.session[group]).tolist()
        if (own := observations.session == k).any()
    ]
