"""Rows with another tip, or another place of the artefact, than the rest: distance and words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.errors import BadInput
from armd.terminal.counted import format_count

#: The most stretches of rows that are named for a session; otherwise the rows are counted.
MOST_STRETCHES = 4


class Differs(Enum):
    """The kind of difference between a group of rows and the rest."""

    TIP = "tip"
    PLACE = "place"
    ARM = "arm"  # a joint's zero, or the links' lengths: only for comparison


@dataclass(frozen=True)
class RowsOfSession:
    """The rows of one session that are in a group."""

    path: Path
    rows: tuple[int, ...]  # of its table, from 0
    is_whole: bool  # all readings of the session

    def in_words(self) -> str:
        """`session T20`, or its rows counted from 1: `rows 81 to 160 of session T20`."""
        session = f"session {self.path.name}"
        if self.is_whole:
            return session
        numbers = _find_stretches(self.rows)
        words = [f"{a}" if a == b else f"{a} to {b}" for a, b in numbers[:MOST_STRETCHES]]
        row = "row" if len(self.rows) == 1 else "rows"
        remainder = "" if len(numbers) <= MOST_STRETCHES else f", … ({len(self.rows)} of them)"
        return f"{row} {', '.join(words)}{remainder} of {session}"


@dataclass(frozen=True)
class SecondGroup:
    """Rows with another tip, or another place of the artefact, than the rest."""

    differs: Differs
    sessions: tuple[RowsOfSession, ...]
    n_rest: int
    step_mm: F64  # (3,) the tip's in the last frame; a place's in the base frame
    uncertainty_mm: F64  # (3,) standard
    length_uncertainty_mm: float
    before_um: float  # RMS of all readings but outliers, as one group
    after_um: float

    @property
    def length_mm(self) -> float:
        """The distance of the second tip or place from the first."""
        return float(np.linalg.norm(self.step_mm))

    @property
    def is_whole(self) -> bool:
        """Whether the group consists of whole sessions."""
        return all(session.is_whole for session in self.sessions)

    @property
    def folders(self) -> tuple[str, ...]:
        """The sessions' folders."""
        return tuple(str(session.path) for session in self.sessions)

    def name_rows(self) -> str:
        """Return the group's sessions or rows, in words."""
        return " and ".join(session.in_words() for session in self.sessions)

    def reason(self) -> str:
        """Return which rows differ from the rest, in what, and by how much."""
        distance = format_uncertainty(self.length_mm, self.length_uncertainty_mm)
        remainder = format_count(self.n_rest, "other reading")
        if self.differs is Differs.PLACE:
            return (
                f"in {self.name_rows()} the artefact, the tracker or the arm's base stood"
                f" {distance} mm from where it stood in the {remainder} of the same placement"
            )
        steps = zip(self.step_mm.tolist(), self.uncertainty_mm.tolist(), strict=True)
        return (
            f"{self.name_rows()}: measured with another tip than the {remainder} (reflector, ball"
            f" or stylus exchanged or seated otherwise), {distance} mm from it:"
            f" ({', '.join(format_uncertainty(mm, u) for mm, u in steps)}) mm in the last frame"
        )

    def in_words(self) -> str:
        """Return the reason, and how much it explains."""
        cause = "two tips" if self.differs is Differs.TIP else "a placement of their own"
        return (
            f"{self.reason()}; with {cause} the readings miss by {self.after_um:.4g} instead"
            f" of {self.before_um:.4g} µm RMS"
        )

    def faults(self) -> list[BadInput]:
        """Return a fault for each session that holds both groups, as no session may."""
        return [self._fault(session) for session in self.sessions if not session.is_whole]

    def refusal(self) -> BadInput:
        """Return the fault for sessions that cannot be identified together."""
        partly = [session for session in self.sessions if not session.is_whole]
        return self._fault((partly or list(self.sessions))[0])

    def _fault(self, session: RowsOfSession) -> BadInput:
        if self.differs is Differs.PLACE:
            expected = "another name in column placement from where the artefact or base moved"
        elif session.is_whole:
            expected = "one tip in all sessions: calibrate each tip's sessions alone"
        else:
            expected = "one tip in a session: delete these rows, or make a session of them"
        return BadInput(session.path, "the session", self.in_words(), expected)

    def as_json(self) -> dict[str, Any]:
        """Return the object that `armd calibrate --json` writes; rows are counted from 1."""
        return {
            "differs": self.differs.value,
            "sessions": [
                {"session": str(session.path), "rows": [row + 1 for row in session.rows]}
                for session in self.sessions
            ],
            "step_mm": self.step_mm.tolist(),
            "standard_uncertainty_mm": self.uncertainty_mm.tolist(),
            "rms_um": self.before_um,
            "rms_with_two_um": self.after_um,
        }


def format_uncertainty(value_mm: float, uncertainty_mm: float) -> str:
    """Format as `5.662 ± 0.004`: two digits of the uncertainty at most, and µm at best."""
    digits = int(np.clip(np.ceil(-np.log10(max(uncertainty_mm, 1e-12))), 0, 3))
    return f"{value_mm:.{digits}f} ± {max(uncertainty_mm, 10.0**-digits):.{digits}f}"


def _find_stretches(rows: tuple[int, ...]) -> list[tuple[int, int]]:
    """Return the first and last row, counted from 1, of each run of rows without a gap."""

    def runs() -> Iterator[list[int]]:
        for _, run in groupby(enumerate(sorted(rows)), lambda pair: pair[1] - pair[0]):
            yield [row for _, row in run]

    return [(run[0] + 1, run[-1] + 1) for run in runs()]
