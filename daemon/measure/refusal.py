"""Decide whether a measurement is the requested reading, and describe why not."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from armd import Flag
from armd.daemon.files.session_folder import explain_unfit
from armd.daemon.measure.in_use import MeasuredWith
from armd.daemon.measure.plan.stations import Plan, Station
from armd.daemon.measure.so_far.progress import Progress
from armd.daemon.measure.so_far.whereabouts import Whereabouts

#: If all joints turned by less since the last reading, the button was pressed twice. A hand that
#: moves the tip away and back turns some joint by far more, unless the arm reaches a place in only
#: one posture.
UNMOVED_RAD = 1e-4
ONE_POSTURE = 3  # at most so many joints of such an arm


class Refusal(NamedTuple):
    #: "moving", "invalid", "temperature", "too_far", "unmoved", "twice", "changed", "complete"
    reason: str
    text: str


def judge(
    measurement: Mapping[str, Any],
    plan: Plan,
    progress: Progress,
    station: Station | None,
    whereabouts: Whereabouts | None,
    earlier: Mapping[str, Whereabouts],
) -> Refusal | None:
    """Return why a measurement is refused as a reading of *station*, or None.

    *whereabouts* is that of the station's placement. *earlier* are those of the placements before,
    as long as nothing was measured in this one.
    """
    if station is None or whereabouts is None:
        return Refusal("complete", "everything is measured; ask for one more, or finish")
    if reason := explain_unfit(measurement):
        return Refusal(*reason)
    _require_numbers(measurement)
    if plan.within_calibration and (reason := _refuse_climate(Flag(measurement["flags"]))):
        return reason
    return (
        _refuse_already_taken(measurement, plan, progress)
        or _refuse_not_moved(measurement, plan, earlier)
        or _refuse_elsewhere(measurement, plan, progress, station, whereabouts)
    )


def refuse_changed(
    measurement: Mapping[str, Any], plan: Plan, in_use: MeasuredWith
) -> Refusal | None:
    """Refuse a reading if calibration or tip changed, for kinds that judge the calibrated arm."""
    if not plan.within_calibration:
        return None
    for key, then in (("calibration", in_use.identity), ("tip", in_use.tip)):
        if measurement[key] != then:
            return Refusal("changed", f"the {key} in use has changed since the session began")
    offset_mm = measurement.get("tip_offset_mm")
    if offset_mm is not None and not np.array_equal(offset_mm, in_use.offset_mm):
        return Refusal("changed", "the tip was calibrated anew since the session began")
    return None


def _require_numbers(measurement: Mapping[str, Any]) -> None:
    """Check the numbers of a reading; raises `KeyError`, `TypeError` or `ValueError`."""
    for name, count in (("position_mm", 3), ("orientation", 4), ("angles_rad", None)):
        values = [float(value) for value in measurement[name]]
        if (count is not None and len(values) != count) or not all(map(math.isfinite, values)):
            raise ValueError(f"{name}: {values}")
    int(measurement["seq"]), int(measurement["stamp_ns"])
    if (deviation := measurement["standard_deviation_mm"]) is not None:
        math.hypot(*deviation)


def _refuse_climate(flags: Flag) -> Refusal | None:
    if Flag.TEMPERATURE_RANGE in flags:
        text = "a temperature is outside the range that the calibration was identified in"
        return Refusal("temperature", text)
    if Flag.TEMPERATURE_RATE in flags:
        return Refusal("temperature", "a temperature changes too fast for the calibration")
    return None


def _refuse_already_taken(
    measurement: Mapping[str, Any], plan: Plan, progress: Progress
) -> Refusal | None:
    if not progress.readings:
        return None
    identity = measurement["seq"], measurement["stamp_ns"]
    if any(
        (r.measurement["seq"], r.measurement["stamp_ns"]) == identity for r in progress.readings
    ):
        return Refusal("twice", "this measurement has been taken")
    last = progress.readings[-1].measurement
    if _measure_turned_rad(measurement, last) < UNMOVED_RAD and not _has_come_back(
        measurement, last, plan
    ):
        return Refusal("unmoved", "the arm has not moved since the last reading")
    return None


def _has_come_back(measurement: Mapping[str, Any], last: Mapping[str, Any], plan: Plan) -> bool:
    """Return whether the tip was moved and returned since the last reading.

    This applies to an arm with only one posture, and to visits in the first posture. Older daemons
    do not report it.
    """
    one_posture = len(measurement["angles_rad"]) <= ONE_POSTURE or plan.kind == "repeatability"
    if not one_posture or "still_s" not in measurement:
        return False
    since_s = (int(measurement["stamp_ns"]) - int(last["stamp_ns"])) * 1e-9
    return float(measurement["still_s"]) < since_s


def _refuse_not_moved(
    measurement: Mapping[str, Any], plan: Plan, earlier: Mapping[str, Whereabouts]
) -> Refusal | None:
    """Refuse a reading in a new placement if the artefact is still in an earlier one."""
    point = np.array(measurement["position_mm"], dtype=float)
    for placement, whereabouts in earlier.items():
        if target := whereabouts.find_target(point, plan.near_mm):
            text = f"this is {target} in {placement}: the artefact has not been moved"
            return Refusal("too_far", text)
    return None


def _refuse_elsewhere(
    measurement: Mapping[str, Any],
    plan: Plan,
    progress: Progress,
    station: Station,
    whereabouts: Whereabouts,
) -> Refusal | None:
    """Refuse a reading that is not at its target's position, as far as that is known.

    A distance cannot show which of two readings is wrong; a second press at the same place can.
    """
    point = np.array(measurement["position_mm"], dtype=float)
    target, near_mm = station.target, plan.near_mm
    expected = whereabouts.get_position(target)
    if expected is not None and math.dist(point, expected) <= near_mm:
        return None
    if other_target := whereabouts.find_target(point, near_mm, but=target):
        text = f"this is {other_target}, and {target} is asked for"
        if whereabouts.is_measured(other_target) and _is_pressed_twice(measurement, plan, progress):
            text += f"; pressed there twice now: if it is {target}, a press was not heard and this"
            text += f" place was taken for {other_target}: delete the reading of {other_target}"
        return Refusal("too_far", text)
    worst = whereabouts.contradiction_mm(target, point)
    if expected is not None:
        away_mm = math.dist(point, expected)
        text = f"{away_mm:.1f} mm from {target}, more than {near_mm:g} mm"
    elif worst is not None and abs(worst[1] - worst[2]) > near_mm:
        name, measured, certified = worst
        text = f"{measured:.1f} mm from {name}, where {target} is {certified:.1f} mm from it"
    else:
        return None
    if other_target := whereabouts.find_by_distances(point, near_mm):
        return Refusal("too_far", f"{text}; as far as {other_target} is")
    return Refusal(
        "too_far", text + _describe_whose_fault(measurement, plan, progress, target, whereabouts)
    )


def _describe_whose_fault(
    measurement: Mapping[str, Any],
    plan: Plan,
    progress: Progress,
    target: str,
    whereabouts: Whereabouts,
) -> str:
    """Describe the earlier reading that may be the wrong one, or is."""
    point = np.array(measurement["position_mm"], dtype=float)
    suspects = whereabouts.find_suspects(target, point, plan.near_mm)
    if not suspects and whereabouts.is_measured(target):
        suspects = [target]  # a seat, or a ball of earlier rounds
    if not suspects:
        return ""
    names = " or ".join(suspects)
    if _is_pressed_twice(measurement, plan, progress):
        return f"; pressed there twice now: the reading of {names} is the wrong one, delete it"
    return f"; this press, or the reading of {names}, is not where it should be"


def _is_pressed_twice(measurement: Mapping[str, Any], plan: Plan, progress: Progress) -> bool:
    """Return whether the press before was refused at this place, and the arm moved since."""
    last_too_far = progress.last_too_far
    return last_too_far is not None and (
        math.dist(measurement["position_mm"], last_too_far["position_mm"]) <= plan.near_mm
        and _measure_turned_rad(measurement, last_too_far) >= UNMOVED_RAD
    )


def _measure_turned_rad(first: Mapping[str, Any], second: Mapping[str, Any]) -> float:
    """Return the largest rotation of a joint between two measurements."""
    pairs = zip(first["angles_rad"], second["angles_rad"], strict=True)
    return max(abs(float(a) - float(b)) for a, b in pairs)
