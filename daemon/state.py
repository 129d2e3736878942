"""The state of the arm and its reason: whether a person can measure with it now."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from armd import Flag

#: Without a sample for this long the arm is not ready.
SILENCE_S = 0.5
#: Points that come later than this do not count as live.
LATE_S = 0.25

# Bits as plain integers: an operation of `Flag` takes 2 µs, and this runs 20 times a second.
CLOCK = int(Flag.CLOCK)
TEMPERATURE_RATE = int(Flag.TEMPERATURE_RATE)
NOT_CALIBRATED = int(Flag.NOT_CALIBRATED)


class State(StrEnum):
    READY = "READY"
    WARMING = "WARMING"
    """It measures; its temperatures still drift, or are not known for long enough."""
    INACCURATE = "INACCURATE"
    """It measures beyond what its calibration was made for."""
    DEGRADED = "DEGRADED"
    """It measures, but something of it is missing."""
    NOT_READY = "NOT_READY"
    """It does not measure."""


@dataclass(frozen=True, kw_only=True)
class Observation:
    """The daemon's observation of the arm during the last second."""

    silent_s: float | None  # since the last sample; None: none yet
    trouble: str = ""  # the driver's own explanation of a silence: unplugged, a foreign arm, …
    hindrance: str = ""  # a fault of the arm that prevents measuring
    points: int = 0
    flags: int = 0  # any of them, bits of `Flag`
    invalid: int = 0  # points
    lossy: bool = False
    invalid_joints: tuple[int, ...] = ()
    warning_joints: tuple[int, ...] = ()
    missing_sensors: tuple[str, ...] = ()
    outside_sensors: tuple[str, ...] = ()
    late_s: float = 0.0  # from latch to put, the median of the points
    changed: str = ""  # why the arm counts as changed by interim checks
    interim_due: str = ""  # why an interim check is due
    held_period: str = ""  # the period of a term that is held now, outside it
    drift: str = ""  # why the temperatures are not steady; "" if they are


def judge_state(observation: Observation) -> tuple[State, str]:
    """Return the state and its reason; the worst reason wins."""
    if observation.silent_s is None or observation.silent_s > SILENCE_S:
        silent_s = observation.silent_s
        since = "no sample yet" if silent_s is None else f"silent for {silent_s:.1f} s"
        return State.NOT_READY, f"{since}: {observation.trouble}" if observation.trouble else since
    joints = ", ".join(f"joint {k}" for k in observation.invalid_joints)
    if observation.points and observation.invalid == observation.points:
        if observation.hindrance:
            return State.NOT_READY, f"no valid point: {observation.hindrance}"
        missing = " and ".join(observation.missing_sensors) or "a temperature"
        return State.NOT_READY, f"no valid point: {joints or f'{missing} missing for too long'}"
    if observation.hindrance:
        return State.DEGRADED, observation.hindrance
    if observation.invalid:
        text = f"{observation.invalid} of {observation.points} points invalid: {joints}"
        return State.DEGRADED, text
    if observation.missing_sensors:
        missing = ", ".join(observation.missing_sensors)
        return State.DEGRADED, f"temperature missing: {missing}; the last value is held"
    if observation.warning_joints:
        return State.DEGRADED, "warning of " + ", ".join(
            f"joint {k}" for k in observation.warning_joints
        )
    if observation.flags & CLOCK:
        return State.DEGRADED, "the device's clock is not mapped: stamps are arrival times"
    if observation.lossy:
        return State.DEGRADED, "samples are being lost before the daemon; armd status counts why"
    if observation.late_s > LATE_S:
        late = f"points come {observation.late_s:.1f} s late: more arrives than can be read"
        return State.DEGRADED, late
    if observation.changed:
        return State.INACCURATE, observation.changed
    if observation.outside_sensors:
        outside = ", ".join(observation.outside_sensors)
        return State.INACCURATE, f"outside the identified temperature range: {outside}"
    if observation.held_period:
        period = observation.held_period
        text = f"a term that follows time was identified {period}; it is held at its end value"
        return State.INACCURATE, text
    if observation.interim_due:
        return State.INACCURATE, observation.interim_due
    if observation.flags & TEMPERATURE_RATE:
        return State.INACCURATE, f"temperature changes too fast for the model: {observation.drift}"
    if observation.drift:
        return State.WARMING, observation.drift
    if observation.flags & NOT_CALIBRATED:
        return State.READY, "nominal geometry: no calibration is loaded"
    return State.READY, "measuring"
