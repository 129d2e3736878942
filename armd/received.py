"""Checks received messages: well-formed, and from the publisher that was received first.

Everybody on the network, or a daemon configured to let others publish, can send anything on an
arm's keys. All messages pass through this module. A payload of the wrong form is dropped and
counted, so that no bridge and no client gets it. This is no proof of origin; certificates are
(docs/how-to/secure.md).
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import zenoh

from armd import keys
from armd.joints import joints_dtype
from armd.point import POINT

#: Another publisher of the same arm is accepted only after this silence: health comes each second.
KEPT_S = 1.5
MOST_JSON_BYTES = 1 << 20
#: The largest calibration file that a daemon reads.
MOST_CALIBRATION_BYTES = 8 << 20
#: A raw frame's header.
LEAST_RAW_BYTES = 26
MOST_JOINTS = 20
#: Limits of a position, which no arm exceeds …
MOST_MM = 1e6
#: … of components of a unit vector or quaternion, with rounding, and of a number's digits.
MOST_UNIT = 1.001
MOST_DIGITS = 20

FormCheck = Callable[[Any], bool]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_text(value: Any) -> bool:
    return isinstance(value, str)


def _is_integer(low: int, high: int) -> FormCheck:
    return lambda value: _is_number(value) and isinstance(value, int) and low <= value < high


def _is_vector(n: int, limit: float = math.inf) -> FormCheck:
    def check(value: Any) -> bool:
        return (
            isinstance(value, list)
            and len(value) == n
            and all(_is_number(x) and abs(x) <= limit for x in value)
        )

    return check


def _is_covariance(value: Any) -> bool:
    """Return whether it is xx xy xz yy yz zz without a negative variance."""
    return bool(_is_vector(6, MOST_MM**2)(value)) and min(value[0], value[3], value[5]) >= 0.0


def _is_deviation(value: Any) -> bool:
    return bool(_is_vector(3, MOST_MM)(value)) and min(value) >= 0.0


def _is_list(check: FormCheck) -> FormCheck:
    return lambda value: isinstance(value, list) and all(map(check, value))


def _is_table(check: FormCheck) -> FormCheck:
    """Return a check for an object whose values all have one form."""
    return lambda value: isinstance(value, dict) and all(map(check, value.values()))


def _is_optional(check: FormCheck) -> FormCheck:
    return lambda value: value is None or check(value)


def _has(
    required: Mapping[str, FormCheck], optional: Mapping[str, FormCheck] | None = None
) -> FormCheck:
    """Return a check for an object with these keys and any others."""

    def check(value: Any) -> bool:
        return (
            isinstance(value, dict)
            and all(name in value and is_valid(value[name]) for name, is_valid in required.items())
            and all(
                is_valid(value[name])
                for name, is_valid in (optional or {}).items()
                if name in value
            )
        )

    return check


_is_seq = _is_integer(0, 1 << 64)
_is_stamp = _is_integer(-(1 << 63), 1 << 63)
_is_bits = _is_integer(0, 1 << 32)
_is_count = _is_integer(0, 1 << 63)
_is_text_or_none = _is_optional(_is_text)
_is_place = _is_vector(3, MOST_MM)
_is_tip = _has({"offset_mm": _is_place}, {"radius_mm": _is_optional(_is_number)})
#: The names of an arm and its tips, in its `info` or in a recording.
names_arm_and_tips = _has(
    {
        "arm": _has(
            {
                "serial_number": _is_text,
                "tip": _has({"offset_mm": _is_place, "radius_mm": _is_number}),
            }
        ),
        "configuration": _has({"tips": _is_table(_is_tip)}),
    }
)

#: The form of each message, on which every program relies. Further keys are permitted.
FORMS: dict[str, FormCheck] = {
    keys.HEALTH: _has(
        {
            "state": _is_text,
            "reason": _is_text,
            "stamp_ns": _is_stamp,
            "uptime_s": _is_number,
            "rates": _has({"points_hz": _is_number}),
            "drops": _is_table(_is_number),
            "last_second": _has({"flagged": _is_table(_is_number)}),
            "temperatures": _is_table(_is_optional(_is_number)),
            "calibration": _is_text_or_none,
            "tip": _is_text_or_none,
        },
        {
            "points": _has({"published": _is_count, "flagged": _is_table(_is_number)}),
            "latency": _is_table(_is_number),
        },
    ),
    keys.EVENT: _has(
        {"kind": _is_text, "text": _is_text, "stamp_ns": _is_stamp},
        {
            "severity": _is_text,
            "detail": _is_optional(
                _has(
                    {},
                    {
                        "buttons": _is_list(_is_integer(0, 32)),
                        "seq": _is_seq,
                        "tip": _is_text_or_none,
                        "offset_mm": _is_optional(_is_place),
                        "radius_mm": _is_optional(_is_number),
                    },
                )
            ),
        },
    ),
    keys.MEASUREMENT: _has(
        {
            "seq": _is_seq,
            "stamp_ns": _is_stamp,
            "position_mm": _is_optional(_is_place),
            "orientation": _is_optional(_is_vector(4, MOST_UNIT)),
            "approach": _is_optional(_is_vector(3, MOST_UNIT)),
            "covariance_mm2": _is_optional(_is_covariance),
            "standard_deviation_mm": _is_optional(_is_deviation),
            "count": _is_count,
            "flags": _is_bits,
            "flag_names": _is_list(_is_text),
            "buttons": _is_bits,
            "calibration": _is_text_or_none,
            "tip": _is_text_or_none,
        },
        {
            "trigger": _is_text,
            "angles_rad": _is_optional(_is_list(_is_number)),
            "duration_s": _is_number,
            "tip_offset_mm": _is_optional(_is_place),
            "tip_radius_mm": _is_optional(_is_number),
            "temperatures_c": _is_table(_is_optional(_is_number)),
        },
    ),
    keys.INFO: _has(
        {
            "arm": _has(
                {
                    "serial_number": _is_text,
                    "joint": _is_list(_has({"a_mm": _is_number, "d_mm": _is_number})),
                    "tip": _has({"offset_mm": _is_place, "radius_mm": _is_number}),
                }
            ),
            "configuration": _has({"tips": _is_table(_is_tip)}),
            "tip": _is_text_or_none,
        }
    ),
    keys.CALIBRATION: _has({"constants": _is_table(_is_number)}),
}


@dataclass
class Refused:
    """The number of ignored samples, by reason."""

    malformed: int = 0
    foreign: int = 0
    """From another publisher than the one met first, while that one was there."""


class Gate:
    """Accepts messages that an arm's publisher can have sent; one for all streams of an `Arm`."""

    def __init__(self) -> None:
        self.refused = Refused()
        self._publisher: zenoh.TimestampId | None = None
        self._heard_s = 0.0

    def payload(self, topic_key: str, sample: zenoh.Sample) -> bytes | None:
        """Return the payload of a sample on the key *topic_key*, or None if it is refused."""
        payload = sample.payload.to_bytes()
        if sample.kind != zenoh.SampleKind.PUT or not is_sound(topic_key, payload):
            self.refused.malformed += 1
            return None
        # The daemon's session stamps every message with its own identity.
        stamp = sample.timestamp
        publisher = None if stamp is None else stamp.get_id()
        now_s = time.monotonic()
        if publisher != self._publisher and now_s - self._heard_s < KEPT_S:
            self.refused.foreign += 1
            return None
        self._publisher, self._heard_s = publisher, now_s
        return payload


def is_sound(topic_key: str, payload: bytes) -> bool:
    """Return whether *payload* has the form of armd's messages on the key *topic_key*."""
    if topic_key == keys.POINT:
        return len(payload) == POINT.itemsize
    if topic_key == keys.JOINTS:  # the stated number of joints, within that of any arm
        n = int.from_bytes(payload[16:20], "little")
        return 0 < n <= MOST_JOINTS and len(payload) == joints_dtype(n).itemsize
    if topic_key == keys.RAW:
        return len(payload) >= LEAST_RAW_BYTES
    return parse_object(topic_key, payload) is not None


def parse_object(topic_key: str, payload: bytes) -> dict[str, Any] | None:
    """Parse a message on the key *topic_key*; None if it is not one of armd's.

    A number that a double cannot hold, NaN, or a lone surrogate makes a message malformed, because
    programs could not write it again.
    """
    if len(payload) > (
        MOST_CALIBRATION_BYTES if topic_key == keys.CALIBRATION else MOST_JSON_BYTES
    ):
        return None
    try:
        text = payload.decode("utf-8-sig")
        content = json.loads(text, parse_float=_finite, parse_int=_short, parse_constant=_refuse)
        if "\\ud" in text or "\\uD" in text:  # may be a lone surrogate
            json.dumps(content, ensure_ascii=False).encode()
    except (ValueError, RecursionError):
        return None
    if not isinstance(content, dict):
        return None
    has_form = FORMS.get(topic_key)
    if has_form is None:
        return content
    sound = has_form(content)
    if sound and topic_key == keys.MEASUREMENT and content["position_mm"] is not None:
        sound = content["orientation"] is not None  # a position needs an orientation
    return content if sound else None


def _finite(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ValueError(text[:MOST_DIGITS])
    return value


def _short(text: str) -> int:
    if len(text) > MOST_DIGITS:
        raise ValueError(text[:MOST_DIGITS])
    return int(text)


def _refuse(name: str) -> float:
    raise ValueError(name)
