"""How much must be measured: for an answer at all, and for a certificate."""

from __future__ import annotations

import math

#: One placement left out must leave two to tell where the arm is wrong and where the artefact lay.
LEAST_PLACEMENTS = 3
#: Readings, as a multiple of those without which the unknowns have no answer at all.
LEAST_TIMES = 3


def count_least_readings(n_joints: int, placements: int, seats: int) -> int:
    """Readings below which the unknowns have no one answer, whatever their poses.

    *seats*: targets whose position nobody has certified.
    """
    return count_readings_for(n_joints, 6 * placements + 3 * seats)


def count_readings_for(n_joints: int, free: int, equations_per_reading: float = 3.0) -> int:
    """The same of an artefact with so many *free* unknowns; a reading gives
    *equations_per_reading*."""
    return math.ceil((4 * n_joints - 3 + free) / equations_per_reading) + 1


def count_certificate_readings(n_joints: int, placements: int, seats: int) -> int:
    """Readings below which no certificate is granted."""
    return LEAST_TIMES * count_least_readings(n_joints, placements, seats)
