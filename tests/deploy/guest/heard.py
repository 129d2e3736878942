"""What the subscriber heard of an arm, and what the arm truly did."""

from __future__ import annotations

import json
import math
import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

HEARD = Path("/run/heard")
TRUTH = Path("/run/arm/truth")

POINT = struct.Struct("<Qqq3d4d6f3fIQII")  # armd.point.v1
TRUE_TIP = struct.Struct("<Q3d")


@dataclass(frozen=True)
class Point:
    seq: int
    position_mm: tuple[float, ...]
    flags: int
    calibration: int


class Arm:
    """What was heard of one arm since the controller's start."""

    def __init__(self, serial: str) -> None:
        self.serial = serial
        self._points = HEARD / f"{serial}.point"
        self._messages = HEARD / f"{serial}.json"

    def count(self) -> int:
        """How many points have been heard."""
        return self._points.stat().st_size // POINT.size if self._points.exists() else 0

    def points(self, first: int) -> list[Point]:
        """The points from number *first* on."""
        with self._points.open("rb") as file:
            file.seek(first * POINT.size)
            data = file.read()
        whole = data[: len(data) // POINT.size * POINT.size]
        return [Point(f[0], f[3:6], f[19], f[20]) for f in POINT.iter_unpack(whole)]

    def last(self) -> Point:
        return self.points(self.count() - 1)[0]

    def events(self) -> list[dict[str, Any]]:
        return [message for message in self._json() if "kind" in message]

    def states(self) -> list[str]:
        """The state of each second's health."""
        return [message["state"] for message in self._json() if "state" in message]

    def is_alive(self) -> bool:
        """Whether the liveliness token is there."""
        return (HEARD / f"{self.serial}.alive").read_text() == "here"

    def _json(self) -> list[dict[str, Any]]:
        if not self._messages.exists():
            return []
        # The last line may still be on its way.
        lines = self._messages.read_text().split("\n")[:-1]
        return [json.loads(line) for line in lines]


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
