"""Count the readings and placements needed for a solution, and for a certificate."""

from __future__ import annotations

import math

#: With one placement held out, two must remain to separate errors of the arm from the artefact's
#: pose.
LEAST_PLACEMENTS = 3
#: The readings needed for a certificate, as a multiple of those needed for any solution.
CERTIFICATE_TIMES = 3


def count_least_readings_for_plan(n_joints: int, placements: int, seats: int) -> int:
    """Return the number of readings below which no poses determine all unknowns.

    *seats* is the number of targets without a certified position.
    """
    return count_least_readings(n_joints, 6 * placements + 3 * seats)


def count_least_readings(
    n_joints: int, artefact_unknowns: int, equations_per_reading: float = 3.0
) -> int:
    """Return the number of readings below which no poses determine all unknowns.

    *artefact_unknowns* is the number of unknowns of poses and seats, and a reading gives
    *equations_per_reading* equations.
    """
    return math.ceil((4 * n_joints - 3 + artefact_unknowns) / equations_per_reading) + 1


def count_certificate_readings(n_joints: int, placements: int, seats: int) -> int:
    """Return the number of readings below which no certificate is granted."""
    return CERTIFICATE_TIMES * count_least_readings_for_plan(n_joints, placements, seats)
