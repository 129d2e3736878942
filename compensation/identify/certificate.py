"""Whether a calibration deserves to be vouched for, judged by readings that took no part."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from armd.compensation.identify.fit import Fit
from armd.compensation.identify.gauge import PLAUSIBLE
from armd.compensation.identify.lengths import MOST_OFF, Length
from armd.compensation.identify.solution import LEAST_KNOWN

#: Readings left out must lose at least half of the error they have under the drawing.
MOST_LEFT = 0.5
#: Readings left out that miss by more than this are as unsure as a direction counted not known.
MOST_HELDOUT_MM = PLAUSIBLE["mm"] / LEAST_KNOWN
#: Least rank, as a share of what ideal readings would give, to vouch for other postures.
LEAST_RANK = 0.75


@dataclass(frozen=True)
class Certificate:
    """A verdict and why, in words."""

    granted: bool
    reason: str


def judge(
    found: Fit,
    drawn_rms_um: float,
    heldout_rms_um: float,
    heldout_by: str,
    lengths: Sequence[Length],
) -> Certificate:
    """Judge by 3-D RMS errors: under the drawing, and of a fit that left the readings out.

    *found* tells what is known: all constants, and the lengths' linear growth where thermal.
    """
    drawn_mm, heldout_mm = drawn_rms_um / 1e3, heldout_rms_um / 1e3
    share = heldout_rms_um / drawn_rms_um
    left = (
        f"each {heldout_by} left out misses by {heldout_mm:.4g} mm RMS,"
        f" {100 * share:.2g}% of the {drawn_mm:.4g} mm under the drawing"
    )
    faults = []
    if share > MOST_LEFT:
        faults.append(f"more than the {MOST_LEFT:.0%} that shows a calibration to help")
    if heldout_mm > MOST_HELDOUT_MM:
        faults.append(
            f"more than {MOST_HELDOUT_MM:g} mm: no set of constants describes this arm"
            " (play in a joint, a loose artefact, readings mixed up?)"
        )
    ideal = 4 * found.observations.arm.n_joints - 3 + len(found.unknowns.terms)
    rank = found.solution.rank
    if rank < LEAST_RANK * ideal:
        faults.append(f"only {rank} of {ideal} combinations of the unknowns are known beside it")
    faults += [
        f"a certified length contradicts the arm: {length.in_words()}"
        for length in lengths
        if abs(length.off) > MOST_OFF
    ]
    return Certificate(not faults, "; ".join([left, *faults]))
