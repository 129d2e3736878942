"""Which findings the extended calibration gets: those that readings held out bear out.

A finding is significant on the readings it was made of; whether the model is better with it, only
others can tell. Findings join one after another, in the order in which they were found, where the
held-out error falls beyond doubt; one that helps only beside a later one gets its turn again.

What this costs and saves: a finding that is worth nothing passes once in forty (the interval has
2.5 % below zero), and then by what chance made of it; a true one of five noise units passes mostly.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from armd.compensation.data.session import Session
from armd.compensation.diagnose.extend import extended
from armd.compensation.diagnose.fitting.baseline import Baseline
from armd.compensation.diagnose.fitting.fit import Fit, Refits
from armd.compensation.diagnose.fitting.neighbourhood import scale_kept
from armd.compensation.diagnose.gain import (
    Gain,
    folds_of,
    gain,
    groups_of,
    left_out,
    without_gross,
)
from armd.compensation.diagnose.scoring.shape import is_shape, shape_place
from armd.compensation.diagnose.search import Result
from armd.compensation.estimate.observations import Observations
from armd.compensation.identify.evaluate import evaluate
from armd.compensation.model.arm import Arm

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

#: Where placements are left out, the finding was chosen with them too. That hardly flatters one so
#: sure that a search without any of them finds it as well; a weaker one must not have done harm
#: when the search was repeated without them, and a sure one none beyond `MOST_WORSE`.
SURE_P = 1e-6
TARGET_FOLDS = 4
#: A finding that shows so much in placements left out together cannot be learnt from the others.
IN_ONE = 0.75
#: Gross errors have no voice in the decision, and they move the error over all readings by chance,
#: of noise-sized findings by far less than this share: beyond it a finding does harm somewhere.
MOST_WORSE = 1.02


@dataclass(frozen=True)
class BorneOut:
    """The findings written, by number, and squared residuals held out (n,) mm² without any and
    with these."""

    some: tuple[int, ...]
    before: F64
    after: F64
    further: dict[int, Gain]  # of those that a further look bears out


@dataclass(frozen=True)
class Look:
    """One way to hold readings out: squared residuals (n,) mm² by the findings in the model, and
    what readings are resampled by (n,)."""

    squares: Callable[[Sequence[int]], F64]
    groups: I64


def choose(
    result: Result, looks: Sequence[Look], able: Sequence[bool], deaf: Sequence[bool] = ()
) -> BorneOut:
    """Those of the findings *able* to be written that held-out readings bear out.

    The first look decides. What shows in one placement only, nobody can learn from the others:
    where the first look does not speak against a finding, or is *deaf* to it, a further one may
    bear it out.
    """
    known: dict[tuple[int, ...], list[F64]] = {}

    def errors(some: tuple[int, ...]) -> list[F64]:
        if some not in known:
            known[some] = [look.squares(some) for look in looks]
        return known[some]

    def shown_by(before: tuple[int, ...], after: tuple[int, ...]) -> tuple[int, Gain] | None:
        """The first look that bears out what is new, and its gain."""
        pairs = [
            (old, new, look.groups)
            for old, new, look in zip(errors(before), errors(after), looks, strict=True)
        ]
        decided = [gain(*without_gross(old, new), groups) for old, new, groups in pairs]
        heard = not deaf or not all(deaf[i] for i in after if i not in before)
        if heard and decided[0].interval_um[1] < 0.0:
            return None
        for k, found in enumerate(decided):
            of_all = gain(*pairs[k])
            if found.shown and of_all.after_um <= MOST_WORSE * of_all.before_um:
                return k, replace(of_all, shown=True)
        return None

    chosen: tuple[int, ...] = ()
    further: dict[int, Gain] = {}
    every = tuple(i for i, ok in enumerate(able) if ok)
    more = True
    while more:
        more = False
        for i in every:
            if i in chosen or not _has_its_cause(result.last, i, chosen):
                continue
            some = tuple(sorted((*chosen, i)))
            if (shown := shown_by(chosen, some)) is not None:
                chosen, more = some, True
                if shown[0] > 0:
                    further[i] = shown[1]
    if len(every) > len(chosen) + 1 and shown_by(chosen, every) is not None:
        chosen = every  # some help only together
    decides = -1 if further else 0
    return BorneOut(chosen, errors(())[decides], errors(chosen)[decides], further)


def by_placement(result: Result, arm: Arm, stepwise: Sequence[Gain]) -> BorneOut:
    """By whole placements left out in turn, then by targets within them; *stepwise*: gains of a
    search repeated without the placements."""
    observations = result.last.linear.rests.observations
    groups = groups_of(observations)
    looks = [
        Look(_left_out_in_turn(result.last, arm, folds), groups)
        for folds in (folds_of(result.last), _by_target(observations))
    ]
    able = [
        own.after_um <= (MOST_WORSE if found.p_value < SURE_P else 1.0) * own.before_um
        for found, own in zip(result.found, stepwise, strict=True)
    ]
    deaf = [_in_one_fold(result.last, i) for i in range(len(result.found))]
    return choose(result, looks, able, deaf)


def _in_one_fold(last: Fit, index: int) -> bool:
    """Whether nearly all that shows a finding stands in placements left out together."""
    moves = last.net_signature(index)
    white = np.einsum("nij,nj->ni", last.noise.whitener, moves)
    told = np.bincount(folds_of(last), (white**2).sum(axis=1))
    return bool(told.max() > IN_ONE * max(float(told.sum()), 1e-300))


def _left_out_in_turn(last: Fit, arm: Arm, folds: I64) -> Callable[[Sequence[int]], F64]:
    refits = []
    for part in np.unique(folds):
        out = folds == part
        whitener = np.where(out[:, None, None], 0.0, last.noise.whitener)
        refits.append((out, Refits(last, replace(last.noise, whitener=whitener))))

    def squares(some: Sequence[int]) -> F64:
        found = np.zeros(len(folds))
        for out, refit in refits:
            fit = refit.with_some(some)
            as_given = last.baseline.held and not some
            found[out] = left_out(fit, out, as_given) * scale_kept(fit, arm) ** 2
        return found

    return squares


def _by_target(observations: Observations) -> I64:
    """Fold of each rest: its target's within the placement; of readings with truth their turn."""
    turn = np.where(observations.has_truth, np.arange(observations.n), observations.target)
    folds: I64 = turn % TARGET_FOLDS
    return folds


def by_session(
    result: Result,
    baseline: Baseline,
    arm: Arm,
    sessions: Sequence[Session],
    holdout: Sequence[Session],
) -> BorneOut:
    """By sessions that had no part in anything."""
    last = result.last
    refit = Refits(last, last.noise)
    observations = evaluate(holdout, arm, baseline.calibration).observations

    def squares(some: Sequence[int]) -> F64:
        fit = refit.with_some(some)
        model = extended(baseline, fit, arm, sessions) if some else baseline.calibration
        residual = evaluate(holdout, arm, model).residual_mm
        square: F64 = (residual**2).sum(axis=1) * scale_kept(fit, arm) ** 2
        return square

    look = Look(squares, groups_of(observations))
    return choose(result, [look], [True] * len(result.found))


def _has_its_cause(last: Fit, index: int, chosen: Sequence[int]) -> bool:
    """A shape is written with the finding whose shape it is, or not at all."""
    finding = last.findings[index]
    if not is_shape(finding):
        return True
    return any(shape_place(last.findings[i]) == finding.location for i in chosen)
