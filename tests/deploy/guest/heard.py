"""What the subscriber heard of the arm, and what the arm truly did."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

POINTS = Path("/run/heard/point")
MESSAGES = Path("/run/heard/json")
ALIVE = Path("/run/heard/alive")
TRUTH = Path("/run/arm/truth")

POINT = struct.Struct("<Qqq3d4d6f3fIQII")  # armd.point.v1
TRUE_TIP = struct.Struct("<Q3d")


@dataclass(frozen=True)
class Point:
    seq: int
    monotonic_ns: int
    position_mm: tuple[float, ...]
    correction_mm: tuple[float, ...]
    flags: int
    calibration: int


def count() -> int:
    """How many points have been heard so far."""
    return POINTS.stat().st_size // POINT.size if POINTS.exists() else 0


def points(first: int) -> list[Point]:
    """The points from number *first* on."""
    with POINTS.open("rb") as file:
        file.seek(first * POINT.size)
        data = file.read()
    whole = data[: len(data) // POINT.size * POINT.size]
    return [Point(f[0], f[2], f[3:6], f[16:19], f[19], f[20]) for f in POINT.iter_unpack(whole)]


def messages() -> list[dict[str, Any]]:
    """Events, health and measurements, oldest first."""
    if not MESSAGES.exists():
        return []
    return [json.loads(line) for line in MESSAGES.read_text().splitlines() if line]


def events() -> list[dict[str, Any]]:
    return [message for message in messages() if "kind" in message]


def states() -> list[str]:
    """The state of each second's health."""
    return [message["state"] for message in messages() if "state" in message]


def length_errors_mm(heard: list[Point]) -> list[float]:
    """How wrong the distance between two points is, each paired with one half a stream away.

    Distances, as no measurement of an artefact tells where the base stands; smallest first.
    """
    data = TRUTH.read_bytes()
    whole = data[: len(data) // TRUE_TIP.size * TRUE_TIP.size]
    truth = {seq & 0xFFFFFFFF: tip for seq, *tip in TRUE_TIP.iter_unpack(whole)}
    pairs = [
        (point.position_mm, truth[point.seq & 0xFFFFFFFF])
        for point in heard
        if point.seq & 0xFFFFFFFF in truth and not point.flags & 1
    ]
    half = len(pairs) // 2
    return sorted(
        abs(math.dist(here, there) - math.dist(true_here, true_there))
        for (here, true_here), (there, true_there) in zip(pairs[:half], pairs[half:], strict=False)
    )
