"""What errs with whole numbers of two neighbouring joints' angles, and has no name.

A wheel that both turn pushes one of them so many times a turn of each. The catalogue's gear runs
with the other joint, or with both alike; where the numbers are others, it stood for a part of them,
and a harmonic of the joint itself for the next.
"""

from __future__ import annotations

from collections.abc import Iterator

from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, SessionFacts, tie
from armd.compensation.model.pose_factors import Harmonic

#: Of each joint; the general basis of two angles has the first two.
ORDERS = range(1, 6)
COVERED = 2
TYPICAL_RAD = 10e-6


def candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for joint in facts.joints:
        for other in (joint - 1, joint + 1):
            if other not in facts.joints:
                continue
            for own in ORDERS:
                for others in ORDERS:
                    if max(own, others) > COVERED:
                        yield _rolled(joint, other, own, others)
                        yield _rolled(joint, other, own, -others)


def _rolled(joint: int, other: int, own: int, others: int) -> Candidate:
    """Sine and cosine of *own* × q of the joint + *others* × q of the other one."""
    sign = 1.0 if others > 0 else -1.0
    parameter = f"theta_{joint}"
    s, c = (Harmonic(kind=kind, joint=joint, order=own) for kind in ("sin", "cos"))
    so, co = (Harmonic(kind=kind, joint=other, order=abs(others)) for kind in ("sin", "cos"))
    sine = (*tie([(parameter, 1.0)], s, co), *tie([(parameter, sign)], c, so))
    cosine = (*tie([(parameter, 1.0)], c, co), *tie([(parameter, -sign)], s, so))
    rolled = f"{own}q{joint} {'+' if others > 0 else '-'} {abs(others)}q{other}"
    columns = tuple(
        Column(f"{parameter} × {kind}({rolled})", "rad", TYPICAL_RAD, terms)
        for kind, terms in (("sin", sine), ("cos", cosine))
    )
    variables = tuple(f"q{k}" for k in sorted((joint, other)))
    where = location.parameter(joint, f"{parameter}({', '.join(variables)})")
    return Candidate("unknown", where, columns, variables)
