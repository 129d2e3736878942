"""In one word and one sentence: can a person measure with this arm now?"""

from __future__ import annotations

from enum import StrEnum
from typing import NamedTuple

from armd import Flag

#: Without a sample for this long the arm is not ready.
SILENCE_S = 0.5
#: Points that come later than this are no live measurement.
LATE_S = 0.25

# Bits as plain integers: 20 times a second an operation of `Flag` is worth avoiding, at 2 µs.
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


class Seen(NamedTuple):
    """What the daemon saw of the arm during the last second."""

    silent_s: float | None  # since the last sample; None: none yet
    trouble: str = ""  # the driver's own explanation of a silence: unplugged, a foreign arm, …
    hindrance: str = ""  # what the arm says of itself that keeps a person from measuring
    points: int = 0
    flags: int = 0  # any of them, bits of `Flag`
    invalid: int = 0  # points
    lossy: bool = False
    invalid_joints: tuple[int, ...] = ()
    warning_joints: tuple[int, ...] = ()
    missing_sensors: tuple[str, ...] = ()
    outside_sensors: tuple[str, ...] = ()
    late_s: float = 0.0  # from latch to put, half the points
    changed: str = ""  # why interim checks say that the arm is no longer what it was
    due: str = ""  # why an interim check is due
    held: str = ""  # the period in which a term was identified that is held now, outside it
    drift: str = ""  # why the temperatures are not called steady; "" if they are


def assess(seen: Seen) -> tuple[State, str]:
    """The state and its reason; the worst reason wins."""
    if seen.silent_s is None or seen.silent_s > SILENCE_S:
        since = "no sample yet" if seen.silent_s is None else f"silent for {seen.silent_s:.1f} s"
        return State.NOT_READY, f"{since}: {seen.trouble}" if seen.trouble else since
    joints = ", ".join(f"joint {k}" for k in seen.invalid_joints)
    if seen.points and seen.invalid == seen.points:
        if seen.hindrance:
            return State.NOT_READY, f"no valid point: {seen.hindrance}"
        missing = " and ".join(seen.missing_sensors)
        return State.NOT_READY, f"no valid point: {joints or f'{missing} missing for too long'}"
    if seen.hindrance:
        return State.DEGRADED, seen.hindrance
    if seen.invalid:
        return State.DEGRADED, f"{seen.invalid} of {seen.points} points invalid: {joints}"
    if seen.missing_sensors:
        missing = ", ".join(seen.missing_sensors)
        return State.DEGRADED, f"temperature missing: {missing}; the last value is held"
    if seen.warning_joints:
        return State.DEGRADED, "warning of " + ", ".join(f"joint {k}" for k in seen.warning_joints)
    if seen.flags & CLOCK:
        return State.DEGRADED, "the device's clock is not mapped: stamps are arrival times"
    if seen.lossy:
        return State.DEGRADED, "samples are being lost before the daemon; armd status counts why"
    if seen.late_s > LATE_S:
        late = f"points come {seen.late_s:.1f} s late: more arrives than can be read"
        return State.DEGRADED, late
    if seen.changed:
        return State.INACCURATE, seen.changed
    if seen.outside_sensors:
        outside = ", ".join(seen.outside_sensors)
        return State.INACCURATE, f"outside the identified temperature range: {outside}"
    if seen.held:
        text = f"a term that follows time was identified {seen.held}; it is held at its end value"
        return State.INACCURATE, text
    if seen.due:
        return State.INACCURATE, seen.due
    if seen.flags & TEMPERATURE_RATE:
        return State.INACCURATE, f"temperature changes too fast for the model: {seen.drift}"
    if seen.drift:
        return State.WARMING, seen.drift
    if seen.flags & NOT_CALIBRATED:
        return State.READY, "nominal geometry: no calibration is loaded"
    return State.READY, "measuring"
