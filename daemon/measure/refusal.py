"""Whether a measurement is the reading that was asked for; if not, why, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from armd import Flag
from armd.daemon.measure.progress import Progress
from armd.daemon.measure.stations import Plan, Station
from armd.daemon.measure.whereabouts import Whereabouts
from armd.daemon.session_folder import unfit

#: A joint that turned by less since the last reading was not moved: the button was pressed twice.
#: A hand that takes the tip away and back moves some joint by far more.
UNMOVED_RAD = 1e-4


class Refusal(NamedTuple):
    reason: str  # "moving", "invalid", "temperature", "too_far", "unmoved", "twice", "complete"
    text: str


def judge(
    measurement: Mapping[str, Any],
    plan: Plan,
    progress: Progress,
    station: Station | None,
    whereabouts: Whereabouts | None,
    earlier: Mapping[str, Whereabouts],
) -> Refusal | None:
    """None: it is a reading of *station*. *whereabouts* is of the station's placement, *earlier* of
    those before it, as long as nothing was measured in this one."""
    if station is None or whereabouts is None:
        return Refusal("complete", "everything is measured; ask for one more, or finish")
    if reason := unfit(measurement):
        return Refusal(*reason)
    _require_numbers(measurement)
    if plan.within_calibration and (reason := _climate(Flag(measurement["flags"]))):
        return reason
    return (
        _already_taken(measurement, progress)
        or _not_moved(measurement, plan, earlier)
        or _elsewhere(measurement, plan, station, whereabouts)
    )


def _require_numbers(measurement: Mapping[str, Any]) -> None:
    """What a reading is made of; raises `KeyError`, `TypeError` or `ValueError`."""
    for name, count in (("position_mm", 3), ("orientation", 4), ("angles_rad", None)):
        values = [float(value) for value in measurement[name]]
        if (count is not None and len(values) != count) or not all(map(math.isfinite, values)):
            raise ValueError(f"{name}: {values}")
    int(measurement["seq"]), int(measurement["stamp_ns"])
    if (deviation := measurement["standard_deviation_mm"]) is not None:
        math.hypot(*deviation)


def _climate(flags: Flag) -> Refusal | None:
    if Flag.TEMPERATURE_RANGE in flags:
        text = "a temperature is outside the range that the calibration was identified in"
        return Refusal("temperature", text)
    if Flag.TEMPERATURE_RATE in flags:
        return Refusal("temperature", "a temperature changes too fast for the calibration")
    return None


def _already_taken(measurement: Mapping[str, Any], progress: Progress) -> Refusal | None:
    if not progress.readings:
        return None
    own = measurement["seq"], measurement["stamp_ns"]
    if any((r.measurement["seq"], r.measurement["stamp_ns"]) == own for r in progress.readings):
        return Refusal("twice", "this measurement has been taken")
    before = progress.readings[-1].measurement["angles_rad"]
    turned = max(abs(a - b) for a, b in zip(measurement["angles_rad"], before, strict=True))
    if turned < UNMOVED_RAD:
        return Refusal("unmoved", "the arm has not moved since the last reading")
    return None


def _not_moved(
    measurement: Mapping[str, Any], plan: Plan, earlier: Mapping[str, Whereabouts]
) -> Refusal | None:
    """In a new placement: the artefact must not stand where it stood."""
    point = np.array(measurement["position_mm"], dtype=float)
    for placement, whereabouts in earlier.items():
        if target := whereabouts.at(point, plan.near_mm):
            text = f"this is {target} in {placement}: the artefact has not been moved"
            return Refusal("too_far", text)
    return None


def _elsewhere(
    measurement: Mapping[str, Any], plan: Plan, station: Station, whereabouts: Whereabouts
) -> Refusal | None:
    point = np.array(measurement["position_mm"], dtype=float)
    expected = whereabouts.of(station.target)
    if expected is not None:
        away_mm = math.dist(point, expected)
        if away_mm <= plan.near_mm:
            return None
        text = f"{away_mm:.1f} mm from {station.target}, more than {plan.near_mm:g} mm; "
        other = whereabouts.at(point, plan.near_mm, but=station.target)
        text += f"this is {other}" if other else "or an earlier reading is wrong: delete it"
        return Refusal("too_far", text)
    if other := whereabouts.at(point, plan.near_mm, but=station.target):
        return Refusal("too_far", f"this is {other}, and {station.target} is asked for")
    worst = whereabouts.contradiction_mm(station.target, point)
    if worst is not None and abs(worst[1] - worst[2]) > plan.near_mm:
        name, measured, certified = worst
        text = f"{measured:.1f} mm from {name}, where {station.target} is {certified:.1f} mm"
        return Refusal("too_far", f"{text} from it; one of the two readings is not where it should")
    return None
