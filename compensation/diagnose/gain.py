"""How much better the extended model is, on readings that had no part in it.

With sessions held out, models fitted to the others are evaluated on them. Without, whole
placements are left out in turn: amplitudes and constants, and whether a finding is significant
at all, come from the other placements only; a finding that is not, counts as not found there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.stats import binom, chi2

from armd.compensation.diagnose.evidence import inverse_factor
from armd.compensation.diagnose.fit import Fit
from armd.compensation.diagnose.threshold import family_wise
from armd.compensation.identify.observations import Observations

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]
Mask = npt.NDArray[np.bool_]

MOST_FOLDS = 8
BLOCKS = 5  # of readings, where there is one placement only
#: Readings with truth of their own share nothing but their time: they are resampled in blocks.
TRUTH_BLOCKS = 40
RESAMPLES = 1000
SIGN_P = 0.01


@dataclass(frozen=True)
class Gain:
    """3-D RMS on held-out readings before and after a finding, and 95 % of their difference."""

    before_um: float
    after_um: float
    interval_um: tuple[float, float]
    shown: bool  # held-out readings improve beyond doubt


def gains(squares: Sequence[F64], groups: I64, kept: Mask, seed: int = 1) -> list[Gain]:
    """Gains from step to step of squared residuals (n,) mm², resampled by *groups* (n,).

    *kept* (n,): rows of the last figure; the others are what an outlier finding names.
    """
    found = []
    rng = np.random.default_rng(seed)
    names, index = np.unique(groups, return_inverse=True)
    draws = rng.integers(len(names), size=(RESAMPLES, len(names)))
    last = len(squares) - 1
    for j in range(1, len(squares)):
        use = kept if j == last else np.ones(len(groups), dtype=bool)
        before, after = squares[j - 1], squares[j]
        sums = [
            np.bincount(index, values, len(names))
            for values in (before, np.ones(len(groups)), after * use, use.astype(float))
        ]
        drawn = [total[draws].sum(axis=1) for total in sums]
        change = np.sqrt(drawn[0] / drawn[1]) - np.sqrt(drawn[2] / np.maximum(drawn[3], 1.0))
        low, high = np.quantile(1e3 * change, [0.025, 0.975])
        rms = _rms(before), _rms(after[use])
        shown = low > 0 or (rms[1] < rms[0] and _most_improve(index, before, after))
        found.append(Gain(*rms, (float(low), float(high)), bool(shown)))
    return found


def _most_improve(index: I64, before: F64, after: F64) -> bool:
    """Whether most groups improve, by the sign test: a few readings that the model was never
    shown anything like may spoil a mean that is right for all the others."""
    change = np.bincount(index, before) - np.bincount(index, after)
    better, worse = int((change > 0).sum()), int((change < 0).sum())
    return bool(binom.sf(better - 1, better + worse, 0.5) < SIGN_P) if better else False


def _rms(squares: F64) -> float:
    return 1e3 * float(np.sqrt(squares.mean())) if squares.size else 0.0


@dataclass(frozen=True)
class CrossValidated:
    """Squared held-out residuals (n,) mm² of each rest, without findings and after each."""

    squares: list[F64]
    groups: I64


def cross_validate(last: Fit, tests: float, alpha: float) -> CrossValidated:
    """Leave placements out in turn, on the linearised problem of the last fit."""
    n = last.linear.rests.n
    folds = _folds(last)
    noise, absorbing = last.noise, last.absorbing
    white = noise.whiten(absorbing.columns)
    scale = np.sqrt((white**2).sum(axis=0))
    scale[scale == 0.0] = 1.0
    white /= scale
    white_r = noise.whiten(last.residual)
    ridge = 1.0 / (absorbing.variance * scale**2)
    squares = [np.zeros(n) for _ in range(len(last.findings) + 1)]
    total, total_r = white.T @ white, white.T @ white_r
    nuisance = last.linear.nuisance
    findings = [np.arange(at.start, at.stop) for at in last.layout.findings]
    others = np.setdiff1d(np.arange(len(scale)), np.concatenate([*findings, []]).astype(int))
    for fold in np.unique(folds):
        rows = np.repeat(folds == fold, 3)
        rows = np.concatenate([rows, np.zeros(len(white) - len(rows), dtype=bool)])
        gram = total - white[rows].T @ white[rows]
        side = total_r - white[rows].T @ white_r[rows]
        chosen = others
        for step in range(len(findings) + 1):
            if step:
                wanted = np.concatenate([chosen, findings[step - 1]])
                if _wanted(gram, side, ridge, chosen, findings[step - 1], tests, alpha):
                    chosen = wanted
            factor = inverse_factor(gram[np.ix_(chosen, chosen)] + np.diag(ridge[chosen]))
            solution = factor @ (factor.T @ side[chosen]) / scale[chosen]
            # Poses, seats, targets and drift are fitted to the readings left out themselves.
            arm = np.isin(chosen, _of_the_arm(last))
            left = last.raw_residual[rows]
            left = left - absorbing.columns[np.ix_(rows, chosen[arm])] @ solution[arm]
            own = nuisance[rows]
            own = own[:, np.abs(own).max(axis=0) > 0]
            left = left - own @ np.linalg.lstsq(own, left, rcond=1e-9)[0]
            squares[step][folds == fold] = (left.reshape(-1, 3) ** 2).sum(axis=1)
    return CrossValidated(squares, groups_of(last.linear.rests.observations))


def groups_of(observations: Observations) -> I64:
    """(n,) what readings are resampled by: placement and target, or blocks of time."""
    groups = observations.placement * len(observations.target_names) + observations.target
    truth = observations.has_truth
    if truth.any():
        order = _ranks(observations.states.time_s[truth])
        groups[truth] = groups.max() + 1 + order * TRUTH_BLOCKS // len(order)
    return groups


def _of_the_arm(last: Fit) -> I64:
    """Columns whose solution carries over to other placements: the arm's, and the findings'."""
    at = last.layout
    mount = at.findings[-1].stop if at.findings else at.identified.stop
    return np.concatenate(
        [
            np.arange(at.identified.start, at.identified.stop),
            *(np.arange(f.start, f.stop) for f in at.findings),
            np.arange(mount, at.shared),
        ]
    )


def _wanted(
    gram: F64, side: F64, ridge: F64, given: I64, more: I64, tests: float, alpha: float
) -> bool:
    """Whether the rows left say that the columns *more* are needed beside those *given*."""
    factor = inverse_factor(gram[np.ix_(given, given)] + np.diag(ridge[given]))
    across = factor.T @ gram[np.ix_(given, more)]
    own = gram[np.ix_(more, more)] - across.T @ across
    u = side[more] - across.T @ (factor.T @ side[given])
    values, vectors = np.linalg.eigh(own)
    kept = values > 1e-9
    if not kept.any():
        return False
    statistic = float((((vectors.T @ u)[kept]) ** 2 / values[kept]).sum())
    return family_wise(float(chi2.logsf(statistic, kept.sum())), tests) < alpha


def _folds(last: Fit) -> I64:
    """Fold of each rest: whole placements, dealt in turn; blocks of time for a single one."""
    observations = last.linear.rests.observations
    names, placement = np.unique(observations.placement, return_inverse=True)
    if len(names) > 1:
        return placement % min(len(names), MOST_FOLDS)
    order = _ranks(observations.states.time_s)
    blocks: I64 = order * BLOCKS // max(len(order), 1)
    return blocks


def _ranks(time_s: F64) -> I64:
    """(n,) the place of each reading in the order of time."""
    ranks: I64 = np.argsort(np.argsort(time_s, kind="stable"), kind="stable")
    return ranks
