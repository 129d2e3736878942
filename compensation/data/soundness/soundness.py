"""Detects and corrects faults of recorded readings that are independent of the arm.

Duplicate rows count once. A stuck or silent temperature channel is filled from the others, and its
name is kept so that no cause is searched in it. A clock that was set back is corrected. Faults that
cannot be corrected are reported.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session
from armd.compensation.data.soundness.artefact_temperature import report_artefact_temperature
from armd.compensation.model.arm import Arm

#: A channel with more than this share of a session's rows missing is not used there.
MOST_MISSING = 0.1
#: A channel is stuck if it is constant for this many rows and this share of a session, while the
#: others change by this much (24 steps of the coarsest sensors, 0.0625 K).
LEAST_STILL, STILL_SHARE, OTHERS_MOVED_K = 12, 0.25, 1.5
#: A channel is stuck, too, if two sessions have one identical value throughout, while the others
#: changed by this much between them.
OTHERS_APART_K = 0.75
#: A channel that is constant to the last digit and this far from all others is stuck, too.
FAR_K = 15.0
STILL = "stands still while the others change"
SOME_ROWS = "has values in some rows only"
#: A clock that steps back by more than this was set back.
BACK_S = 1.0
MOST_SET_BACK = 2


@dataclass(frozen=True)
class Sound:
    """Corrected sessions, the arm to use with them, and the corrections in sentences."""

    sessions: tuple[Session, ...]
    arm: Arm
    remarks: tuple[str, ...]


def make_sound(sessions: Sequence[Session], arm: Arm) -> Sound:
    """Correct the faults of *sessions* that can be corrected, and report all of them.

    The arm changes only if a channel is stuck or silent in all sessions: its links then follow the
    mean of the other sensors.
    """
    remarks = [remark for session in sessions for remark in session.remarks]
    corrected = [_clock_on(_once(session, remarks), remarks) for session in sessions]
    surfaces = any(session.artefact.surfaces for session in sessions)
    if surfaces and any(session.turn is not None for session in sessions):
        remarks.append("Orientations take no part beside surfaces.")
    remarks += _clocks(corrected)
    remarks += report_artefact_temperature(corrected, arm)
    corrected, arm = _without_dead_channels(corrected, arm, remarks)
    return Sound(tuple(corrected), arm, tuple(remarks))


def fit_to_identify(sessions: Sequence[Session], arm: Arm) -> Sound:
    """Prepare sessions for an identification, without replacing temperatures by estimates.

    Duplicate rows count once. If a channel is stuck or silent in some sessions, its values there
    are missing; if it is so in all, its links follow the mean of the others.
    """
    columns = {name: arm.sensors.index(name) for name in arm.used_sensors}
    why = {
        name: ["" if reason == SOME_ROWS else reason for reason in _dead(sessions, columns, name)]
        for name in columns
    }
    live = [name for name in columns if not any(why[name])]
    remarks = [remark for session in sessions for remark in session.remarks]
    corrected = [_once(session, remarks) for session in sessions]
    remarks += report_artefact_temperature(corrected, arm)
    for name in columns if live else ():
        reasons = " and ".join(dict.fromkeys(filter(None, why[name])))
        if reasons and all(why[name]):
            arm = _following(arm, name, live)
            remarks.append(
                f"sensor {name} {reasons}, in all sessions: its links follow the mean of the others"
            )
        still = [i for i, reason in enumerate(why[name]) if reason and not all(why[name])]
        for i in still:
            celsius = corrected[i].states.temperature_c.copy()
            celsius[:, columns[name]] = np.nan
            corrected[i] = replace(
                corrected[i], states=replace(corrected[i].states, temperature_c=celsius)
            )
        if still:
            names = ", ".join(sessions[i].name for i in still)
            remarks.append(f"sensor {name} {reasons} ({names}): no temperature there")
    return Sound(tuple(corrected), arm, tuple(remarks))


def find_still_and_far(session: Session, arm: Arm) -> list[tuple[str, float]]:
    """Return temperature channels with one value in all rows, far from all other values, and the
    value.

    The unit is °C; the artefact's channel is included. Either that channel or all others are stuck.
    """
    names = [*arm.used_sensors, "artefact_c"]
    sensors_c = session.states.temperature_c[:, arm.used_columns]
    celsius = np.column_stack([sensors_c, session.artefact_c])
    still = (celsius == celsius[:1]).all(axis=0)  # NaN is unequal to everything
    channels = []
    for k in np.flatnonzero(still) if session.n >= LEAST_STILL else ():
        at_c = float(celsius[0, k])
        moving = celsius[:, ~(still & (celsius[0] == at_c))]
        finite = moving[np.isfinite(moving)]
        if finite.size and (np.abs(finite - at_c) > FAR_K).all():
            channels.append((names[k], at_c))
    return channels


def _once(session: Session, remarks: list[str]) -> Session:
    """Drop duplicate rows, which agree in all digits."""
    states = session.states
    columns = [
        states.q, states.rate, states.temperature_c, states.time_s[:, None], states.approach,
        session.truth_mm, session.artefact_c[:, None], session.placement[:, None],
        session.target[:, None],
    ]  # fmt: skip
    if session.reflector is not None:
        columns.append(session.reflector[:, None])
    if session.turn is not None:
        columns.append(session.turn.reshape(session.n, 9))
    table = np.nan_to_num(np.hstack(columns), nan=np.inf)
    first = np.sort(np.unique(table, axis=0, return_index=True)[1])
    if len(first) == session.n:
        return session
    again = np.setdiff1d(np.arange(session.n), first)
    remarks.append(
        f"{session.name}: {len(again)} of {session.n} rows stand there twice (the first is row "
        f"{session.row[again[0]] + 1}); they count once."
    )
    return session.rows(first)


def _clock_on(session: Session, remarks: list[str]) -> Session:
    """Continue with the usual interval where the clock was set back during a placement."""
    time_s = session.states.time_s
    steps = np.diff(time_s)
    back = np.flatnonzero(steps < -BACK_S)
    same = session.placement[back] == session.placement[back + 1]
    if not len(back) or len(back) > MOST_SET_BACK or not same.all():
        return session  # rows may be in any order
    usual = float(np.median(steps))
    time_s = time_s.copy()
    for step in back:
        gone = time_s[step] + usual - time_s[step + 1]
        time_s[step + 1 :] += gone
        remarks.append(
            f"{session.name}: at row {session.row[step + 1] + 1} the clock runs back by "
            f"{_duration(gone - usual)}; it is taken to have been set back there."
        )
    return replace(session, states=replace(session.states, time_s=time_s))


def _clocks(sessions: Sequence[Session]) -> list[str]:
    """Return remarks on sessions that one arm cannot have measured at the stated times."""
    timed = [s for s in sessions if np.isfinite(s.states.time_s).all()]
    order = sorted(timed, key=lambda s: float(s.states.time_s.min()))
    remarks = []
    for i, later in enumerate(order):
        for earlier in order[:i]:
            over = float(earlier.states.time_s.max() - later.states.time_s.min())
            if over > BACK_S:
                remarks.append(
                    f"{later.name} begins {_duration(over)} before {earlier.name} ends: one arm "
                    "cannot do that, and the clock of one is wrong. The instants, and "
                    "the drift between sessions, depend on these clocks."
                )
    counted = [(n, s) for s in timed if (n := _number(s)) is not None]
    numbered = sorted(counted, key=lambda pair: pair[0])
    stems = {re.sub(r"\d+$", "", s.name) for _, s in numbered}
    if len(stems) == 1:
        for (_, current), (_, next_) in itertools.pairwise(numbered):
            if next_.states.time_s.min() < current.states.time_s.min():
                remarks.append(
                    f"By their clocks {next_.name} was measured before {current.name}: if that is "
                    "wrong, the instants and the drift in the result are wrong, too."
                )
    return remarks


def _number(session: Session) -> int | None:
    match = re.search(r"(\d+)$", session.name)
    return int(match[1]) if match else None


def _duration(seconds: float) -> str:
    minutes = seconds / 60.0
    if minutes < 1.0:
        return f"{seconds:.0f} s"
    return f"{minutes:.0f} min" if minutes < 120.0 else f"{minutes / 60.0:.1f} h"


def _without_dead_channels(
    sessions: list[Session], arm: Arm, remarks: list[str]
) -> tuple[list[Session], Arm]:
    """Fill stuck or silent channels with the mean of the others, where these have values."""
    used = arm.used_sensors
    columns = {name: arm.sensors.index(name) for name in used}
    if not any(np.isfinite(s.states.temperature_c).any() for s in sessions):
        return sessions, arm  # no temperatures at all, which is reported elsewhere
    why = {name: _dead(sessions, columns, name) for name in used}
    live = [name for name in used if not any(why[name])]
    lost = [name for name in used if any(why[name])]
    if not lost or not live:
        return sessions, arm
    live_columns = [columns[name] for name in live]
    for name in lost:
        links = [k for k, joint in enumerate(arm.joint, 1) if joint.weights.get(name)]
        column = columns[name]
        alive = [s for s, reason in zip(sessions, why[name], strict=True) if not reason]
        apart_k = [s.states.temperature_c[:, column] - _mean(s, live_columns) for s in alive]
        offset_k = float(np.nanmedian(np.concatenate(apart_k))) if alive else 0.0
        corrected = []
        for session, reason in zip(sessions, why[name], strict=True):
            if reason:
                celsius = session.states.temperature_c.copy()
                celsius[:, column] = _mean(session, live_columns) + offset_k
                session = replace(
                    session,
                    states=replace(session.states, temperature_c=celsius),
                    lost=(*session.lost, name),
                    lost_links=tuple(sorted({*session.lost_links, *links})),
                )
            corrected.append(session)
        sessions = corrected
        remarks.append(_of_the_channel(sessions, why[name], name, links))
        if not alive:
            arm = _following(arm, name, live)
    return sessions, arm


def _mean(session: Session, columns: Sequence[int]) -> F64:
    """Return the mean (n,) of the channels that have a value."""
    celsius = session.states.temperature_c[:, list(columns)]
    finite = np.isfinite(celsius)
    mean: F64 = np.where(finite, celsius, 0.0).sum(axis=1) / np.maximum(finite.sum(axis=1), 1)
    return np.where(finite.any(axis=1), mean, np.nan)


def _of_the_channel(
    sessions: Sequence[Session], why: Sequence[str], name: str, links: Sequence[int]
) -> str:
    names = [s.name for s, reason in zip(sessions, why, strict=True) if reason]
    reasons = list(dict.fromkeys(reason for reason in why if reason))
    sessions_text = "all sessions" if len(names) == len(sessions) else ", ".join(names)
    links_text = ", ".join(f"link {k}" for k in links)
    return (
        f"Sensor {name} {' and '.join(reasons)} ({sessions_text}) and is dropped: {links_text} is "
        f"taken to follow the other sensors, its length free in each of these sessions. Not looked "
        f"for: what depends on {name}, that is expansion, its curve, lag and gradient of "
        f"{links_text}, heat at joint "
        f"{', '.join(map(str, links))}, and the sensor's own offset or exchange."
    )


def _middle(values: F64) -> float:
    """Return the median of the known values; NaN if there are none."""
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else np.nan


def _dead(sessions: Sequence[Session], columns: dict[str, int], name: str) -> list[str]:
    """Return for each session why the channel is stuck or silent; "" if it is neither."""
    readings_c = [s.states.temperature_c[:, columns[name]] for s in sessions]
    other_columns = [column for column_name, column in columns.items() if column_name != name]
    usual = [_middle(_mean(s, other_columns)) if other_columns else np.nan for s in sessions]
    one_value = [bool(np.all(values == values[0])) for values in readings_c]
    still_at = [  # NaN, unequal to everything, if there are several values
        float(values[0]) if constant and len(values) >= LEAST_STILL else np.nan
        for constant, values in zip(one_value, readings_c, strict=True)
    ]
    reasons = []
    for i, (session, values) in enumerate(zip(sessions, readings_c, strict=True)):
        missing = float(np.isnan(values).mean())
        still = any(
            at_c == still_at[i] and abs(usual[k] - usual[i]) > OTHERS_APART_K
            for k, at_c in enumerate(still_at)
        )
        if missing > MOST_MISSING:
            reasons.append("has no value" if missing == 1.0 else SOME_ROWS)
        elif still or _far_and_still(values, session, other_columns):
            reasons.append(f"shows {values[0]:g} °C whatever the others do")
        elif _stands_still(values, session, other_columns):
            reasons.append(STILL)
        else:
            reasons.append("")
    stuck = {
        float(v[-1]) for v, reason in zip(readings_c, reasons, strict=True) if reason and len(v)
    }
    return [  # a session with only the value at which the channel stuck
        reason or (STILL if constant and float(values[0]) in stuck else "")
        for values, constant, reason in zip(readings_c, one_value, reasons, strict=True)
    ]


def _far_and_still(values: F64, session: Session, columns: Sequence[int]) -> bool:
    if len(values) < LEAST_STILL or not columns or not np.all(values == values[0]):
        return False
    others_c = session.states.temperature_c[:, list(columns)]
    finite = others_c[:, np.isfinite(others_c).all(axis=0)]
    return bool(finite.size and (np.abs(finite - values[0]) > FAR_K).all())


def _stands_still(values: F64, session: Session, columns: Sequence[int]) -> bool:
    """Return whether the longest run of one value lasts while most other channels change."""
    changes = np.flatnonzero(np.diff(values) != 0)
    edges = np.concatenate([[0], changes + 1, [len(values)]])
    longest = int(np.argmax(np.diff(edges)))
    run = slice(int(edges[longest]), int(edges[longest + 1]))
    if run.stop - run.start < max(LEAST_STILL, STILL_SHARE * len(values)) or not columns:
        return False
    others_c = session.states.temperature_c[run][:, list(columns)]
    span = np.ptp(others_c, axis=0)[np.isfinite(others_c).all(axis=0)]
    return bool(span.size and np.median(span) > OTHERS_MOVED_K)


def _following(arm: Arm, name: str, live: Sequence[str]) -> Arm:
    """Return the arm with the links of one sensor on the mean of those that are *live*."""
    joints = []
    for joint in arm.joint:
        if share := joint.weights.get(name, 0.0):
            weights = {k: v for k, v in joint.weights.items() if k != name}
            for live_name in live:
                weights[live_name] = weights.get(live_name, 0.0) + share / len(live)
            joint = joint.model_copy(update={"temperature": weights})
        joints.append(joint)
    return arm.model_copy(update={"joint": joints})
