"""What a subscriber believes of what arrives: well-formed, and from the publisher it met first.

Whoever reaches the network, or a daemon configured to let others speak, can put anything on an
arm's keys. A payload of the wrong form is passed over and counted, never passed on. This is no
proof of origin; certificates are (docs/secure.md).
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass
from typing import Any

import zenoh

from armd import keys
from armd.point import POINT

#: Another publisher of the same arm is followed only after this silence: health comes each second.
KEPT_S = 1.5
MOST_JSON_BYTES = 1 << 20
#: The shortest: a raw frame's header, a message of joints without a joint.
LEAST_BYTES = {keys.RAW: 26, keys.JOINTS: 24}
#: Fields whose type everybody relies on, where they are there.
TYPES: dict[str, type | tuple[type, ...]] = {
    "kind": str,
    "text": str,
    "state": str,
    "reason": str,
    "temperatures": dict,
    "seq": int,
    "stamp_ns": int,
    "position_mm": (list, type(None)),
}


@dataclass
class Refused:
    """Samples passed over, by why."""

    malformed: int = 0
    foreign: int = 0
    """From another publisher than the one met first, while that one was there."""


class Gate:
    """Lets through what an arm's publisher can have sent; one for all streams of an `Arm`."""

    def __init__(self) -> None:
        self.refused = Refused()
        self._publisher: zenoh.TimestampId | None = None
        self._heard_s = 0.0

    def payload(self, what: str, sample: zenoh.Sample) -> bytes | None:
        """The payload of a sample on the key *what*, or None."""
        payload = sample.payload.to_bytes()
        if sample.kind != zenoh.SampleKind.PUT or not is_sound(what, payload):
            self.refused.malformed += 1
            return None
        # The daemon's session stamps all it publishes with its own identity.
        stamp = sample.timestamp
        publisher = None if stamp is None else stamp.get_id()
        now_s = time.monotonic()
        if publisher != self._publisher and now_s - self._heard_s < KEPT_S:
            self.refused.foreign += 1
            return None
        self._publisher, self._heard_s = publisher, now_s
        return payload


def is_sound(what: str, payload: bytes) -> bool:
    """Whether *payload* has the form of what armd publishes on the key *what*."""
    if what == keys.POINT:
        return len(payload) == POINT.itemsize
    if what in LEAST_BYTES:
        return len(payload) >= LEAST_BYTES[what]
    return json_object(payload) is not None


def json_object(payload: bytes) -> dict[str, Any] | None:
    """A message of armd's, parsed; None if it cannot be one."""
    if len(payload) > MOST_JSON_BYTES:
        return None
    try:
        content = json.loads(payload)
    except (ValueError, RecursionError):
        return None
    if not isinstance(content, dict):
        return None
    sound = all(
        isinstance(content[name], kind) and not isinstance(content[name], bool)
        for name, kind in TYPES.items()
        if name in content
    )
    return content if sound else None
