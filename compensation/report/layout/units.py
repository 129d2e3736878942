"""Units and digits by the arm's resolution: µm for a precise arm, mm for a hobby arm."""

from __future__ import annotations

import math
from dataclasses import dataclass

from armd.compensation.model.arm import Arm
from armd.compensation.wording import ARC_SECOND

#: Reports of an arm with a coarser resolution use mm and degrees.
COARSE_MM = 0.05
NOT_KNOWN = "–"


@dataclass(frozen=True)
class Unit:
    """A unit of a report, and the number of its significant decimals."""

    name: str
    per_base: float  # its number in one mm, or in one radian
    decimals: int

    def format_value(self, value: float, sign: str = "") -> str:
        """Format a value in mm or rad as a number of this unit; a dash if it is not known."""
        if not math.isfinite(value):
            return NOT_KNOWN
        return f"{value * self.per_base:{sign}.{self.decimals}f}"

    def scale_to(self, *values: float) -> Unit:
        """Return this unit, or mm if the largest of *values* (mm) is 1 mm or more.

        Only µm is replaced.
        """
        large = self.name == "µm" and max(map(abs, values)) >= 1.0
        return Unit("mm", 1.0, 3) if large else self

    def to_text(self, value: float, sign: str = "") -> str:
        """Format a value in mm or rad with three significant digits and the unit, for
        a sentence.
        """
        if not math.isfinite(value):
            return "an unknown amount"
        return f"{format_three_digits(value * self.per_base, sign)}\N{NO-BREAK SPACE}{self.name}"


SECONDS = Unit("″", 1.0 / ARC_SECOND, 2)
MICROMETRES = Unit("µm", 1e3, 2)


@dataclass(frozen=True)
class Units:
    """The units of lengths and angles of one report."""

    length: Unit
    angle: Unit


def compute_resolution_mm(arm: Arm) -> float:
    """Return the step of the tip by one count of the coarsest encoder, at half the arm's reach.

    It is 0 where arm.toml has no encoder.
    """
    counts = [joint.counts_per_turn for joint in arm.joint if joint.counts_per_turn]
    return math.tau / min(counts) * arm.reach_mm / 2.0 if counts else 0.0


def choose_units(arm: Arm) -> Units:
    """Return the units that suit *arm*."""
    resolved_mm = compute_resolution_mm(arm)
    if resolved_mm < COARSE_MM:
        decimals = 2 if resolved_mm < 0.002 else 1 if resolved_mm < 0.02 else 0
        return Units(Unit("µm", 1e3, decimals), SECONDS)
    decimals = 3 if resolved_mm < 0.1 else 2
    return Units(Unit("mm", 1.0, decimals), Unit("°", math.degrees(1.0), 3))


def format_three_digits(value: float, sign: str = "") -> str:
    """Format a number with three significant digits, large ones as integers, without
    an exponent.
    """
    if abs(value) < 1e-12:
        return "0"
    decimals = 2 - math.floor(math.log10(abs(value)))
    return f"{value:{sign}.{max(decimals, 0)}f}"
