"""What a calibration took up of causes that are older than itself.

Nobody knows when a disc left its axis. If it was off it when the calibration was made, constants
are wrong by what they could take up of that, many times their own uncertainty. Found under this
calibration, the disc alone leaves just that part over, which looks like a joint that was knocked.
So where something is found that only a change of what was identified explains, beside causes that
it does not, the calibration counts as wrong in one more way for each of these: by what it would
have taken up of it, had it been made of readings like these.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.diagnose.constants import (
    LEAST_TAKEN_UP,
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
    """The model under test, wrong also by what it took up of the findings of *last*; None where
    they tell nothing that this could explain."""
    if not last.baseline.is_given or len(last.findings) < 2:
        return None
    shares = _Shares.from_fit(last, arm)
    if not shares.older or not shares.own_change.any():
        return None
    return shares.taken_up_by(last.baseline)


def allow_only_absorbed_error(baseline: Baseline, last: Fit, arm: Arm) -> Baseline:
    """The calibration as it was given (*baseline*), wrong also by what it would have taken up of
    the findings of *last*, under whose own baseline it may be wrong by more."""
    shares = _Shares.from_fit(last, arm)
    return shares.taken_up_by(baseline) if shares.older else baseline


@dataclass(frozen=True)
class _Shares:
    """What constants and terms under test could explain of a fit's k findings."""

    rests: Rests
    plausible: F64  # (identified,) how far each may be from the drawing
    columns: F64  # (N, identified) their columns at that, whitened, clear of the poses
    white: F64  # (N, k) what the findings do, so too
    own_change: Mask  # (k,) which findings are a change of theirs
    older: list[int]  # the findings that are none and may be older than the calibration

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
        """A calibration wrong also by what it took up of the older findings."""
        columns, white, plausible = self.columns, self.white[:, self.older], self.plausible
        directions = [plausible[:, None] * _absorbed_by(columns, white)]
        # It was made of other readings, at other temperatures and in other poses. How much that
        # changes, these readings in parts tell: placements, and rests of all of them.
        for folds in (assign_folds(self.rests), self.rests.posture % LEFT_OUT_PARTS):
            directions += [
                plausible[:, None] * direction for direction in _differs(columns, white, folds)
            ]
        return replace(baseline, root=_as_few(np.hstack([baseline.root, *directions]), plausible))


def _as_few(root: F64, plausible: F64) -> F64:
    """(identified, r) with the same R Rᵀ, r no more than what was identified."""
    if root.shape[1] <= len(root):
        return root
    directions, sizes, _ = np.linalg.svd(root / plausible[:, None], full_matrices=False)
    few: F64 = plausible[:, None] * directions * sizes
    return few


def _clear_of(absorbing: F64, columns: F64) -> F64:
    """What is left of *columns* (N, m) beside others (N, b)."""
    cleared: F64 = columns - absorbing @ np.linalg.lstsq(absorbing, columns, rcond=WEAKEST)[0]
    return cleared


def _differs(columns: F64, white: F64, folds: I64) -> Iterator[F64]:
    """(identified, m) for each part: how far what was taken up differs with the readings, of which
    the calibration was made of others (jackknife, twice its variance)."""
    parts, absorbed = int(folds.max()) + 1, _absorbed_by(columns, white)
    for part in range(parts) if parts > 1 else ():
        selected = np.ones(len(white), dtype=bool)
        selected[: 3 * len(folds)] = np.repeat(folds != part, 3)
        without = _absorbed_by(columns[selected], white[selected])
        yield np.sqrt(2.0 * (parts - 1) / parts) * (without - absorbed)


def _absorbed_by(columns: F64, white: F64) -> F64:
    """(identified, m) how far what was identified would have gone for each of *white* (N, m)."""
    strongest = float(np.linalg.svd(columns, compute_uv=False)[0])
    cutoff = LEAST_TAKEN_UP / max(strongest, LEAST_TAKEN_UP)
    absorbed: F64 = np.asarray(np.linalg.lstsq(columns, white, rcond=cutoff)[0], dtype=np.float64)
    return absorbed


def _may_be_older(candidate: Candidate) -> bool:
    """Not what stepped, drifted or was another in each while these sessions were measured."""
    while_measured = is_drift(candidate) or is_by_session(candidate)
    return candidate.instant_unix_s is None and not while_measured


def _plausible(baseline: Baseline, arm: Arm) -> F64:
    """(identified,) how far each constant or coefficient may plausibly be from the drawing."""
    names = arm.layout.names
    constants = [PLAUSIBLE[parameters.find_unit(names[i])] for i in baseline.parameters]
    term_parameters = [baseline.model.terms[i].parameter for i in baseline.terms]
    slopes = [PLAUSIBLE_TERM * PLAUSIBLE[parameters.find_unit(name)] for name in term_parameters]
    return np.array([*constants, *slopes])
