"""The Zenoh keys of one arm: `armd/<serial>/<what>` (docs/reference/subscriber.md lists them)."""

from __future__ import annotations

POINT = "point"
MEASUREMENT = "measurement"
EVENT = "event"
HEALTH = "health"
INFO = "info"
#: The calibration file, byte for byte; not in the info, so that small clients can read the info.
CALIBRATION = "info/calibration"
JOINTS = "joints"
COMMAND = "command"
ALIVE = "alive"
#: Bytes on the wire, for recorders. Wildcards do not match a chunk that starts with @, so a
#: subscriber to `armd/<serial>/**` does not receive them.
RAW = "@raw"
#: By this key, the daemons of one serial number detect each other.
DAEMON = "@daemon"

#: Characters with a meaning in Zenoh keys; a serial number with one of them cannot be published.
FORBIDDEN = frozenset("/*$#?@")


def key(serial: str, what: str) -> str:
    """Return the key of one arm's stream, e.g. `key("SIM-0001", POINT)`; serial "*" matches all."""
    return f"armd/{serial}/{what}"
