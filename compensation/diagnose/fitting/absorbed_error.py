"""Error that a calibration absorbed from causes older than the calibration.

Nobody knows when an encoder's disc became eccentric. If it was eccentric when the calibration was
made, the constants absorbed part of that error, often many times their own uncertainty. Under this
calibration the disc alone leaves that part as residual, which looks like a joint that was knocked.

So two kinds of findings may occur together: some that a change of the identified values explains,
and some that it does not. Then the calibration's covariance gets one more direction for each
finding of the second kind: by how much a calibration from readings like these would have absorbed
it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.diagnose.constants import (
    LEAST_ABSORBED,
    LEFT_OUT_PARTS,
    OF_THEIR_OWN,
    WEAKEST,
)
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.layout import PLACEMENTS
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.diagnose.problem.rests import assign_folds
from armd.compensation.effects.by_session import is_by_session
from armd.compensation.effects.courses import is_drift
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.gauge import PLAUSIBLE
from armd.compensation.estimate.unknowns import PLAUSIBLE_TERM
from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm


def allow_absorbed_error(last: Fit, arm: Arm) -> Baseline | None:
    """Return the model under test, uncertain also by what it absorbed of the findings of *last*.

    Returns None where absorbed error could explain none of the findings.
    """
    if not last.baseline.is_given or len(last.findings) < 2:
        return None
    shares = _Shares.from_fit(last, arm)
    if not shares.older or not shares.own_change.any():
        return None
    return shares.taken_up_by(last.baseline)


def allow_only_absorbed_error(baseline: Baseline, last: Fit, arm: Arm) -> Baseline:
    """Return *baseline* uncertain also by what it would have absorbed of the findings of *last*.

    *baseline* is the calibration as given; the baseline of *last* may have further uncertainty.
    """
    shares = _Shares.from_fit(last, arm)
    return shares.taken_up_by(baseline) if shares.older else baseline


@dataclass(frozen=True)
class _Shares:
    """The parts of a fit's k findings that constants and terms under test could explain."""

    rests: Rests
    plausible: F64  # (identified,) plausible departure of each from its nominal value
    columns: F64  # (N, identified) columns for that departure, whitened, cleared of the poses
    white: F64  # (N, k) residuals that the findings explain, whitened and cleared likewise
    own_change: Mask  # (k,) which findings are a change of the identified values
    older: list[int]  # other findings that may be older than the calibration

    @classmethod
    def from_fit(cls, last: Fit, arm: Arm) -> _Shares:
        plausible = _plausible(last.baseline, arm)
        poses = last.noise.whiten(last.nuisance.columns.to_dense(last.layout.blocks[PLACEMENTS]))
        columns = last.baseline.columns(last.linear, arm) * plausible
        cleared = _clear_of(poses, last.noise.whiten(columns))
        moves = [
            last.nuisance.columns.to_dense(block) @ amplitudes
            for block, amplitudes in zip(last.layout.findings, last.amplitudes, strict=True)
        ]
        white = _clear_of(poses, last.noise.whiten(np.array(moves).T))
        residual_norm: F64 = np.linalg.norm(white - cleared @ _absorbed_by(cleared, white), axis=0)
        own_change = residual_norm < OF_THEIR_OWN * np.linalg.norm(white, axis=0)
        older = [i for i, c in enumerate(last.findings) if not own_change[i] and _may_be_older(c)]
        return cls(last.linear.rests, plausible, cleared, white, own_change, older)

    def taken_up_by(self, baseline: Baseline) -> Baseline:
        """Return a calibration uncertain also by what it absorbed of the older findings."""
        columns, white, plausible = self.columns, self.white[:, self.older], self.plausible
        directions = [plausible[:, None] * _absorbed_by(columns, white)]
        # The calibration was made of other readings, at other temperatures and in other poses.
        # Parts of these readings show how much that matters: placements, and rests of all.
        for folds in (assign_folds(self.rests), self.rests.posture % LEFT_OUT_PARTS):
            directions += [
                plausible[:, None] * direction for direction in _differs(columns, white, folds)
            ]
        return replace(baseline, root=_as_few(np.hstack([baseline.root, *directions]), plausible))


def _as_few(root: F64, plausible: F64) -> F64:
    """Return a root (identified, r) with the same R Rᵀ, r at most the number of rows."""
    if root.shape[1] <= len(root):
        return root
    directions, sizes, _ = np.linalg.svd(root / plausible[:, None], full_matrices=False)
    few: F64 = plausible[:, None] * directions * sizes
    return few


def _clear_of(absorbing: F64, columns: F64) -> F64:
    """Project *columns* (N, m) off the columns *absorbing* (N, b)."""
    cleared: F64 = columns - absorbing @ np.linalg.lstsq(absorbing, columns, rcond=WEAKEST)[0]
    return cleared


def _differs(columns: F64, white: F64, folds: I64) -> Iterator[F64]:
    """Yield how the absorbed amounts (identified, m) change without each part of the readings.

    They are scaled as a jackknife with twice its variance: the calibration was made of other
    readings.
    """
    parts, absorbed = int(folds.max()) + 1, _absorbed_by(columns, white)
    for part in range(parts) if parts > 1 else ():
        selected = np.ones(len(white), dtype=bool)
        selected[: 3 * len(folds)] = np.repeat(folds != part, 3)
        without = _absorbed_by(columns[selected], white[selected])
        yield np.sqrt(2.0 * (parts - 1) / parts) * (without - absorbed)


def _absorbed_by(columns: F64, white: F64) -> F64:
    """Return how far (identified, m) each of *white* (N, m) moved the identified values."""
    strongest = float(np.linalg.svd(columns, compute_uv=False)[0])
    cutoff = LEAST_ABSORBED / max(strongest, LEAST_ABSORBED)
    absorbed: F64 = np.asarray(np.linalg.lstsq(columns, white, rcond=cutoff)[0], dtype=np.float64)
    return absorbed


def _may_be_older(candidate: Candidate) -> bool:
    """Return whether a finding may be older than these sessions.

    It may not, if it stepped or drifted during the sessions or differs between them.
    """
    while_measured = is_drift(candidate) or is_by_session(candidate)
    return candidate.instant_unix_s is None and not while_measured


def _plausible(baseline: Baseline, arm: Arm) -> F64:
    """Return the plausible departure (identified,) of each constant or coefficient."""
    names = arm.layout.names
    constants = [PLAUSIBLE[parameters.find_unit(names[i])] for i in baseline.parameters]
    term_parameters = [baseline.model.terms[i].parameter for i in baseline.terms]
    slopes = [PLAUSIBLE_TERM * PLAUSIBLE[parameters.find_unit(name)] for name in term_parameters]
    return np.array([*constants, *slopes])
