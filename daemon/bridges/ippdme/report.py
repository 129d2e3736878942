"""Reports of a hit, of a motion or of an error: their content and their timing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from armd.arrays import F64
from armd.daemon.bridges.ippdme.errors import DmeError
from armd.daemon.bridges.ippdme.grammar import Arg, Property, format_decimal, format_quoted

ReportedFields = Mapping[str, tuple[float, ...]]

MOTION = ("X", "Y", "Z")
HIT = (*MOTION, "IJK", "ER", "Q")
#: IJKAct is 0 for a measured IJK, else it is nominal or the tool's direction.
HIT_2_5 = (*HIT, "IJKAct")
SCAN = (*HIT, "R")
#: At most ten reports a second.
SHORTEST_S = 0.1
_PLACES = {"IJK": 6, "Q": 0, "IJKAct": 0}


def format_error(error: DmeError, method: str) -> str:
    """Return an error as `Error(3, 0501, "GoTo", "Unsupported command")`."""
    method, text = format_quoted(method), format_quoted(error.text)
    return f"Error({error.severity}, {error.number:04d}, {method}, {text})"


def format_fields(names: Sequence[str], fields: ReportedFields) -> dict[str, str]:
    """Return the requested fields as text, in the order of *names*."""
    return {
        name: ", ".join(format_decimal(value, _PLACES.get(name, 5)) for value in fields[name])
        for name in names
    }


def parse_names(args: Sequence[Arg], allowed: Sequence[str]) -> tuple[str, ...]:
    """Return the names of `X(), Y(), …`; raises `DmeError` for an unknown or repeated one."""
    if not args:
        raise DmeError(502)
    names = []
    for arg in args:
        if not isinstance(arg, Property):
            raise DmeError(509)
        if arg.name == "R" and "R" not in allowed:
            raise DmeError(1002)  # no rotary table
        if arg.name not in allowed or arg.name in names or arg.values:
            raise DmeError(510)
        names.append(arg.name)
    return tuple(names)


@dataclass
class MoveReport:
    """A daemon that reports after *time_s*, or when the tip moved more than *distance_mm*."""

    tag: str
    fields: tuple[str, ...]
    time_s: float | None
    distance_mm: float | None
    _last_s: float = -math.inf
    _last_mm: F64 | None = None

    def hurry(self) -> None:
        """Make the next report due as soon as the shortest interval is over."""
        self._last_mm = None

    def is_due(self, now_s: float, position_mm: F64) -> bool:
        since_s = now_s - self._last_s
        if since_s < SHORTEST_S:
            return False
        if (
            self._last_mm is None
            or (self.time_s is not None and since_s >= self.time_s)
            or (
                self.distance_mm is not None
                and math.dist(position_mm, self._last_mm) > self.distance_mm
            )
        ):
            self._last_s, self._last_mm = now_s, position_mm
            return True
        return False


def make_move_report(tag: str, args: Sequence[Arg], both_needed: bool) -> MoveReport:
    """Make the daemon of `OnMoveReportE(Time(1), Dis(20), X(), …)`; raises `DmeError`."""
    limits: dict[str, float] = {}
    fields = []
    for arg in args:
        if isinstance(arg, Property) and arg.name in ("Time", "Dis"):
            if len(arg.values) != 1 or not isinstance(arg.values[0], float):
                raise DmeError(510)
            lowest = SHORTEST_S if arg.name == "Time" else 0.0
            if arg.name in limits or arg.values[0] < lowest:
                raise DmeError(510)
            limits[arg.name] = arg.values[0]
        else:
            fields.append(arg)
    if not limits or (both_needed and len(limits) < 2):
        raise DmeError(502)
    return MoveReport(tag, parse_names(fields, MOTION), limits.get("Time"), limits.get("Dis"))
