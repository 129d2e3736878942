"""The artefact moved during a placement: a step of one placement, which is not the arm's."""

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import ArtefactChange, Candidate, Column, Effect, SessionFacts
from armd.compensation.wording import format_plain

#: A hand moves an artefact by tenths of a millimetre; a mount steps by some µm.
SHIFT_MM, TURN_RAD = 0.1, 0.3e-3


def make_candidate(placement: int, after: int) -> Candidate:
    """Make the candidate for the placement of this number, moved after so many rests in
    time order.
    """
    columns = tuple(
        Column(
            f"{'shift' if axis < 3 else 'turn'} {'xyz'[axis % 3]}",
            "mm" if axis < 3 else "rad",
            SHIFT_MM if axis < 3 else TURN_RAD,
            artefact=ArtefactChange("moved", axis=axis, index=placement, after=after),
        )
        for axis in range(6)
    )
    return Candidate("artefact_moved", location.ARTEFACT, columns, ("placement", "time_s"))


def list_candidates(_: SessionFacts) -> Iterator[Candidate]:
    """Return no candidate: `diagnose.search.moved_artefact` tests for it and splits
    the placement.
    """
    return iter(())


def describe(_: Candidate, amplitudes: F64) -> str:
    shift, turn = (float(np.linalg.norm(part)) * 1e3 for part in (amplitudes[:3], amplitudes[3:]))
    size = f"moved by {format_plain(shift)} µm and turned by {format_plain(turn)} mrad"
    return f"the artefact was {size}"


EFFECT = Effect(
    "artefact_moved",
    "somebody leaned on it, a magnet slid, a clamp let go",
    "a step of the base, a slip of joint 1",
    "measure three of its targets at the start and the end of every placement",
    list_candidates,
    describe,
)
