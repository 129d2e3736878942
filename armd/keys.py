"""The Zenoh keys of one arm: `armd/<serial>/<what>` (docs/reference/subscriber.md lists them)."""

from __future__ import annotations

POINT = "point"
MEASUREMENT = "measurement"
EVENT = "event"
HEALTH = "health"
INFO = "info"
#: The calibration file, byte for byte: apart from the info, so that a small client can read that.
CALIBRATION = "info/calibration"
JOINTS = "joints"
COMMAND = "command"
ALIVE = "alive"
#: Bytes as they crossed the wire, for recorders. A chunk that starts with @ is not matched by
#: wildcards, so that a subscriber to `armd/<serial>/**` does not pay for it unasked.
RAW = "@raw"
#: By which the daemons of one serial number notice each other.
DAEMON = "@daemon"

#: Characters with a meaning in Zenoh keys; a serial number with one of them cannot be published.
FORBIDDEN = frozenset("/*$#?@")


def key(serial: str, what: str) -> str:
    """The key of one arm's stream, e.g. `key("SIM-0001", POINT)`; "*" as serial matches all."""
    return f"armd/{serial}/{what}"
