"""Unnamed errors that depend on whole multiples of two neighbouring joints' angles together.

A wheel that both joints turn pushes one of them a whole number of times per turn of each. The
catalogue's gear depends on the other joint, or on both with equal numbers. With other numbers it
was found as a part of the error, and a harmonic of the joint itself as the next part.
"""

from __future__ import annotations

from collections.abc import Iterator

from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, SessionFacts, tie
from armd.compensation.model.pose_factors import Harmonic

#: Orders of each joint; the general basis of two angles has those up to `COVERED`.
ORDERS = range(1, 6)
COVERED = 2
TYPICAL_RAD = 10e-6


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for joint in facts.joints:
        for neighbour in (joint - 1, joint + 1):
            if neighbour not in facts.joints:
                continue
            for order in ORDERS:
                for neighbour_order in ORDERS:
                    if max(order, neighbour_order) > COVERED:
                        yield _rolled(joint, neighbour, order, neighbour_order)
                        yield _rolled(joint, neighbour, order, -neighbour_order)


def _rolled(joint: int, neighbour: int, order: int, neighbour_order: int) -> Candidate:
    """Make sine and cosine of *order* × q of the joint + *neighbour_order* × q of the other one."""
    sign = 1.0 if neighbour_order > 0 else -1.0
    parameter = f"theta_{joint}"
    s, c = (Harmonic(kind=kind, joint=joint, order=order) for kind in ("sin", "cos"))
    so, co = (
        Harmonic(kind=kind, joint=neighbour, order=abs(neighbour_order)) for kind in ("sin", "cos")
    )
    sine = (*tie([(parameter, 1.0)], s, co), *tie([(parameter, sign)], c, so))
    cosine = (*tie([(parameter, 1.0)], c, co), *tie([(parameter, -sign)], s, so))
    rolled = (
        f"{order}q{joint} {'+' if neighbour_order > 0 else '-'} {abs(neighbour_order)}q{neighbour}"
    )
    columns = tuple(
        Column(f"{parameter} × {kind}({rolled})", "rad", TYPICAL_RAD, terms)
        for kind, terms in (("sin", sine), ("cos", cosine))
    )
    variables = tuple(f"q{k}" for k in sorted((joint, neighbour)))
    place = location.parameter(joint, f"{parameter}({', '.join(variables)})")
    return Candidate("unknown", place, columns, variables)
