"""The findings' own shapes (form errors), so that these are not taken for further causes.

No disc, bearing or stylus errs exactly in the catalogue's form. A strong finding therefore leaves a
structure, a share of itself, that would be named as one cause after another. While the search goes
on, each finding may vary with the joints at its place: its own signature times 1 + ε, with ε a few
harmonics of these joints. A second cause at the same place is named if it is too large for that.
Otherwise the shape itself is the finding, as `unknown`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import SHAPE_OFF, SHAPE_ORDERS
from armd.compensation.diagnose.problem.amplitudes import is_sized
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.diagnose.scoring.time_discrepancy import (
    make_time_discrepancy_columns,
    may_have_time_discrepancy,
)
from armd.compensation.effects.effect import Candidate, Column
from armd.compensation.effects.location import TIP, Location, make_shape_location
from armd.compensation.model.arm import Arm
from armd.compensation.model.pose_factors import Harmonic

#: A shifted length or zero is one number at every angle: it has no shape.
ONE_NUMBER = frozenset({"geometry_shift"})


def is_shape(candidate: Candidate) -> bool:
    """Whether a candidate is the shape of another one."""
    return candidate.location.kind == "shape"


def locate_shape(candidate: Candidate) -> Location:
    """Return the location of a candidate's shape."""
    return make_shape_location(candidate.cause, candidate.location)


@dataclass(frozen=True)
class Shapes:
    """The findings' shapes, which also absorb while the search goes on."""

    matrix: F64  # (N, b) their columns
    variance: F64  # (b,)
    candidates: tuple[Candidate | None, ...]  # per finding, its shape where it may be off
    columns: tuple[range, ...]  # of each finding's shape, numbered after the fit's nuisance columns

    def list_columns(self, current: Fit, index: int) -> list[int]:
        """Return the nuisance columns of a finding and its shape, even if that is a finding."""
        shaped = current.findings[index]
        return [
            *self.columns[index],
            *(
                column
                for finding, span in zip(current.findings, current.layout.findings, strict=True)
                if finding is shaped or finding.location == locate_shape(shaped)
                for column in range(span.start, span.stop)
            ),
        ]


def make_shapes(current: Fit, arm: Arm) -> Shapes:
    """Make the shapes of all findings that have none in the model yet."""
    locations = {c.location for c in current.findings}
    candidates = tuple(
        None if locate_shape(c) in locations else make_shape(c, values, arm.n_joints)
        for c, values in zip(current.findings, current.amplitudes, strict=True)
    )
    shape_columns = iter(
        make_finding_columns(current.linear, [c for c in candidates if c is not None], arm)
    )
    blocks = [
        make_time_discrepancy_columns(current.linear, current.noise, c, values, arm) / SHAPE_OFF
        if shape is None
        else next(shape_columns)
        for shape, c, values in zip(candidates, current.findings, current.amplitudes, strict=True)
    ]
    first, columns = current.nuisance.columns.size, []
    for block in blocks:
        columns.append(range(first, first + block.shape[1]))
        first += block.shape[1]
    nothing = np.empty((len(current.residual), 0))
    joined = np.hstack([nothing, *blocks])
    return Shapes(joined, np.full(joined.shape[1], SHAPE_OFF**2), candidates, tuple(columns))


def make_shape(candidate: Candidate, amplitudes: F64, n_joints: int) -> Candidate | None:
    """Make a finding's own signature times harmonics of the joints at its place; None if it has
    none.
    """
    joints = _joints(candidate, n_joints)
    if (
        not joints or is_sized(candidate) or may_have_time_discrepancy(candidate)
    ):  # or can take any shape
        return None
    terms = [
        term
        for column, value in zip(candidate.columns, amplitudes, strict=True)
        for term in column.make_terms(np.sqrt(2.0) * float(value))
    ]
    waves = [
        Harmonic(kind=kind, joint=joint, order=order)
        for joint in joints
        for order in SHAPE_ORDERS
        for kind in ("sin", "cos")
    ]
    columns = tuple(
        Column(
            f"share × {wave.kind} {wave.order}q{wave.joint}",
            "1",
            SHAPE_OFF,
            tuple(term.model_copy(update={"basis": [*term.basis, wave]}) for term in terms),
        )
        for wave in waves
    )
    return Candidate(
        "unknown", locate_shape(candidate), columns, tuple(f"q{joint}" for joint in joints)
    )


def _joints(candidate: Candidate, n_joints: int) -> list[int]:
    """Return the joints (1…N) at a finding's place; for the tip those of the wrist that turn it."""
    if is_shape(candidate) or candidate.cause in ONE_NUMBER:
        return []
    if candidate.location == TIP:
        return [n_joints - 1, n_joints]
    if candidate.cause == "unknown":
        return [int(name[1:]) for name in candidate.depends_on if re.fullmatch(r"q\d+", name)]
    joint = candidate.location.joint
    return [] if joint is None else [joint]


def select_with_causes(findings: Sequence[Candidate]) -> list[Candidate]:
    """Drop shapes without the finding whose shape they are."""
    named = {locate_shape(c) for c in findings}
    return [c for c in findings if not is_shape(c) or c.location in named]
