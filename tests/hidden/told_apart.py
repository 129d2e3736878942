"""Which of several effects planted together can be told apart at all.

An effect of many noise units may be just what two others do, at other sizes and phases than theirs:
over 40° of a joint a gain, an eccentricity and an ellipticity span nearly two shapes. No reader can
name all three there, and a set in which one of them is missing fits as well. What an effect has
clear of the others' *free* amplitudes says so, without what was found.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from cases import at_rests, clear_of

from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.problem.signatures import make_finding_columns


def told_apart(
    diagnosis: Diagnosis, errors_mm: Sequence[np.ndarray], places: Sequence[tuple[str, str]]
) -> tuple[float, ...]:
    """Noise units of each effect, clear of what absorbs and of whatever the causes at the other
    *places* can do; *errors_mm* (readings, 3) of each, *places* as the catalogue names them.

    What a cause can do are its own exact error and the catalogue's columns of it, of several
    settings those that come nearest to the error for their number (Akaike's criterion).
    """
    first, noise = diagnosis.search.first, diagnosis.search.last.noise
    exact = [noise.whiten(at_rests(first, error)) for error in errors_mm]
    catalogue = diagnosis.search.signatures.candidates
    able = []
    for error, place in zip(exact, places, strict=True):
        own = [c for c in catalogue if c.place == place]
        some = [noise.whiten(c) for c in make_finding_columns(first.linear, own, diagnosis.arm)]
        lost = [_left(error, columns) + 2 * columns.shape[1] for columns in some]
        nearest = [some[int(np.argmin(lost))]] if some else []
        able.append(np.column_stack([error, *nearest]))
    return tuple(
        clear_of(first, error, noise, np.hstack([*able[:i], *able[i + 1 :]]))
        for i, error in enumerate(exact)
    )


def _left(error: np.ndarray, columns: np.ndarray) -> float:
    """Squared noise units of an error that its nearest sum of columns misses."""
    missed = error - columns @ np.linalg.lstsq(columns, error, rcond=None)[0]
    return float(missed @ missed)
