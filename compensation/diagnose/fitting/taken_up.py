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
from armd.compensation.diagnose.problem.rests import folds_of
from armd.compensation.effects.by_session import is_by_session
from armd.compensation.effects.courses import is_drift
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.gauge import PLAUSIBLE
from armd.compensation.estimate.unknowns import PLAUSIBLE_TERM
from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm


def beside_what_it_took_up(last: Fit, arm: Arm) -> Baseline | None:
    """The model under test, wrong also by what it took up of the findings of *last*; None where
    they tell nothing that this could explain."""
    if not last.baseline.held or len(last.findings) < 2:
        return None
    shares = _Shares.of(last, arm)
    if not shares.older or not shares.own_change.any():
        return None
    return shares.taken_up_by(last.baseline)


def wrong_only_by(given: Baseline, last: Fit, arm: Arm) -> Baseline:
    """The calibration as it was *given*, wrong also by what it would have taken up of the findings
    of *last*, under whose own baseline it may be wrong by more."""
    shares = _Shares.of(last, arm)
    return shares.taken_up_by(given) if shares.older else given


@dataclass(frozen=True)
class _Shares:
    """What constants and terms under test could explain of a fit's k findings."""

    rests: Rests
    plausible: F64  # (identified,) how far each may be from the drawing
    own: F64  # (N, identified) their columns at that, whitened, clear of the poses
    white: F64  # (N, k) what the findings do, so too
    own_change: Mask  # (k,) which findings are a change of theirs
    older: list[int]  # the findings that are none and may be older than the calibration

    @classmethod
    def of(cls, last: Fit, arm: Arm) -> _Shares:
        plausible = _plausible(last.baseline, arm)
        poses = last.noise.whiten(last.nuisance.columns.dense(last.layout.blocks[PLACEMENTS]))
        columns = last.baseline.columns(last.linear, arm) * plausible
        own = _clear_of(poses, last.noise.whiten(columns))
        moves = [
            last.nuisance.columns.dense(block) @ amplitudes
            for block, amplitudes in zip(last.layout.findings, last.amplitudes, strict=True)
        ]
        white = _clear_of(poses, last.noise.whiten(np.array(moves).T))
        left: F64 = np.linalg.norm(white - own @ _taken_by(own, white), axis=0)
        own_change = left < OF_THEIR_OWN * np.linalg.norm(white, axis=0)
        older = [i for i, c in enumerate(last.findings) if not own_change[i] and _may_be_older(c)]
        return cls(last.linear.rests, plausible, own, white, own_change, older)

    def taken_up_by(self, given: Baseline) -> Baseline:
        """A calibration wrong also by what it took up of the older findings."""
        own, white, plausible = self.own, self.white[:, self.older], self.plausible
        ways = [plausible[:, None] * _taken_by(own, white)]
        # It was made of other readings, at other temperatures and in other poses. How much that
        # changes, these readings in parts tell: placements, and rests of all of them.
        for folds in (folds_of(self.rests), self.rests.posture % LEFT_OUT_PARTS):
            ways += [plausible[:, None] * way for way in _differs(own, white, folds)]
        return replace(given, root=_as_few(np.hstack([given.root, *ways]), plausible))


def _as_few(root: F64, plausible: F64) -> F64:
    """(identified, r) with the same R Rᵀ, r no more than what was identified."""
    if root.shape[1] <= len(root):
        return root
    directions, sizes, _ = np.linalg.svd(root / plausible[:, None], full_matrices=False)
    few: F64 = plausible[:, None] * directions * sizes
    return few


def _clear_of(absorbing: F64, columns: F64) -> F64:
    """What is left of *columns* (N, m) beside others (N, b)."""
    clear: F64 = columns - absorbing @ np.linalg.lstsq(absorbing, columns, rcond=WEAKEST)[0]
    return clear


def _differs(own: F64, white: F64, folds: I64) -> Iterator[F64]:
    """(identified, m) for each part: how far what was taken up differs with the readings, of which
    the calibration was made of others (jackknife, twice its variance)."""
    parts, taken = int(folds.max()) + 1, _taken_by(own, white)
    for part in range(parts) if parts > 1 else ():
        kept = np.ones(len(white), dtype=bool)
        kept[: 3 * len(folds)] = np.repeat(folds != part, 3)
        without = _taken_by(own[kept], white[kept])
        yield np.sqrt(2.0 * (parts - 1) / parts) * (without - taken)


def _taken_by(own: F64, white: F64) -> F64:
    """(identified, m) how far what was identified would have gone for each of *white* (N, m)."""
    strongest = float(np.linalg.svd(own, compute_uv=False)[0])
    least = LEAST_TAKEN_UP / max(strongest, LEAST_TAKEN_UP)
    taken: F64 = np.asarray(np.linalg.lstsq(own, white, rcond=least)[0], dtype=np.float64)
    return taken


def _may_be_older(candidate: Candidate) -> bool:
    """Not what stepped, drifted or was another in each while these sessions were measured."""
    while_measured = is_drift(candidate) or is_by_session(candidate)
    return candidate.instant_unix_s is None and not while_measured


def _plausible(baseline: Baseline, arm: Arm) -> F64:
    """(identified,) how far each constant or coefficient may plausibly be from the drawing."""
    names = arm.layout.names
    constants = [PLAUSIBLE[parameters.unit(names[i])] for i in baseline.parameters]
    own = [baseline.model.terms[i].parameter for i in baseline.terms]
    slopes = [PLAUSIBLE_TERM * PLAUSIBLE[parameters.unit(name)] for name in own]
    return np.array([*constants, *slopes])
