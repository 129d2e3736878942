"""The aim of the next experiment, and how well a covariance of the unknowns meets it.

With several causes: the projected signal-to-noise of each with another in the model (T-optimal).
With nothing in doubt: the standard uncertainty of the least well known parameter (c-optimal).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import logsumexp

from armd.arrays import F64
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.report.advice import Doubt, is_alike
from armd.compensation.estimate.linear.linear_model import LinearModel
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_jacobian
from armd.compensation.model.state import States
from armd.errors import BadInput

#: The block of the columns of the causes to be distinguished.
ASKED = "asked"
#: A parameter is a gauge if less than this share of its column remains when all others are fitted
#: along, with the whole pool measured: the placement or the tip's offset has the same effect.
GAUGE_SHARE = 1e-5
#: A rival with this probability relative to the likeliest must also be distinguished from the
#: others.
LEADING = 0.1
#: From this separation in noise units, two causes are nearly always distinguished with 95 %.
APART = 6.0


@dataclass(frozen=True)
class CauseSeparation:
    """The aim to distinguish several causes, by their separation."""

    words: str
    signals: F64  # (e, l) the signal of each cause to be distinguished, by its unknowns
    rivals: tuple[slice, ...]  # r causes to compare with, each its part of the extra unknowns
    weight: F64  # (l, r) zero: a pair that need not be distinguished
    unit: str = "noise units"

    @property
    def quantity(self) -> str:
        several = ", the likeliest and nearest counting most" if self.weight.size > 1 else ""
        return f"projected signal-to-noise of one with the other in the model{several}"

    def merit(self, prior: LinearModel, rows: F64 | None = None) -> F64:
        """Compute the joint separation (n,) of all pairs, in noise units.

        *prior* is the information on k unknowns. Each of *rows* (n, 3, k) is one more reading;
        without them the result is (1,). The probability to take one of two causes for the other, d
        noise units away, is at most √(p₁p₂)·exp(−d²/8) (Bhattacharyya). These bounds are added.
        """
        separation_squared = self.separations(prior, rows) ** 2
        doubt = logsumexp(-separation_squared / 8.0, axis=(1, 2), b=self.weight / self.weight.sum())
        together: F64 = np.sqrt(np.maximum(-8.0 * doubt, 0.0))
        return together

    def separations(self, prior: LinearModel, rows: F64 | None = None) -> F64:
        """Compute the signal-to-noise (n, l, r) of each signal, projected off each rival."""
        c, e = prior.layout.find_other_columns([ASKED]), prior.layout.find_columns([ASKED])
        covariance = prior.only(c).covariance
        across = covariance @ prior.gram[np.ix_(c, e)]
        information = prior.compute_information(ASKED)
        gained: F64 = np.zeros((1, 3, len(e)))
        remainder = gained
        if rows is not None:
            remainder = rows[:, :, e] - rows[:, :, c] @ across
            spread = np.eye(3) + (rows[:, :, c] @ covariance) @ rows[:, :, c].transpose(0, 2, 1)
            gained = np.asarray(np.linalg.solve(spread, remainder), dtype=np.float64)

        def products(a: F64, b: F64) -> F64:
            """(n, ., .) of combinations of the extra unknowns' columns."""
            product: F64 = a.T @ information @ b + (remainder @ a).transpose(0, 2, 1) @ (gained @ b)
            return product

        signal_squared = np.einsum("nll->nl", products(self.signals, self.signals))
        separations_squared = []
        for rival in self.rivals:
            columns = np.eye(len(e))[:, rival]
            towards = products(columns, self.signals)
            solved = np.linalg.solve(products(columns, columns), towards)
            separations_squared.append(signal_squared - (towards * solved).sum(axis=1))
        separation: F64 = np.sqrt(np.maximum(np.stack(separations_squared, axis=2), 0.0))
        return separation

    def settled(self, merit: float) -> bool:
        """Return whether causes with this separation will be distinguished."""
        return merit >= APART

    def figure(self, merit: float) -> float:
        """Return a merit in `unit`."""
        return merit


@dataclass(frozen=True)
class WeakestParameter:
    """The aim to reduce the uncertainty of the least well known parameter."""

    words: str
    quantity: str
    direction: F64  # (k,) in the space of unknowns, in `unit`
    unit: str = "µm at the tip"

    def merit(self, prior: LinearModel, rows: F64 | None = None) -> F64:
        """Compute one over the standard uncertainty; arguments as in `CauseSeparation.merit`."""
        covariance = prior.covariance
        towards = covariance @ self.direction
        variance = np.array([self.direction @ towards])
        if rows is not None:
            moved = rows @ towards
            spread = np.eye(3) + (rows @ covariance) @ rows.transpose(0, 2, 1)
            solved = np.linalg.solve(spread, moved[:, :, None])[:, :, 0]
            variance = variance - (moved * solved).sum(axis=1)
        precision: F64 = 1.0 / np.sqrt(np.maximum(variance, 1e-300))
        return precision

    def settled(self, merit: float) -> bool:
        """Return True for a merit above 0: a few poses are enough.

        A parameter could always be known better.
        """
        return merit > 0.0

    def figure(self, merit: float) -> float:
        """Return a merit in `unit`."""
        return 1.0 / merit


Criterion = CauseSeparation | WeakestParameter


def compare_causes(
    doubt: Doubt, last: Fit, prior: LinearModel, richest: LinearModel
) -> CauseSeparation:
    """Make the criterion that distinguishes the finding and its rivals, by the *prior* information.

    Pairs that even the *richest* information cannot separate are left out, unless all are. The
    block `ASKED` has the finding's columns, then each rival's. The finding may be wrong, so a
    likely rival must also be distinguished from the others.
    """
    candidates = [doubt.finding.candidate, *doubt.rivals]
    share = np.array([doubt.finding.probability, *doubt.share])
    ends = np.cumsum([0, *(len(c.columns) for c in candidates)])
    blocks = tuple(slice(low, high) for low, high in itertools.pairwise(ends))
    information = prior.compute_information(ASKED)
    finding = np.zeros(len(information))
    finding[blocks[0]] = last.amplitudes[doubt.index]
    leads = [i for i in range(len(blocks)) if i == 0 or share[i] >= LEADING * share.max()]
    signals = [finding, *(_passing(information, finding, blocks[i]) for i in leads[1:])]
    separable = [[not is_alike(candidates[i], rival) for rival in candidates] for i in leads]
    weight = np.sqrt(share[leads][:, None] * share) * separable
    criterion = CauseSeparation(doubt.words, np.stack(signals, axis=1), blocks, weight)
    able = weight * (criterion.separations(richest)[0] >= APART)
    return replace(criterion, weight=able if able.any() else weight)


def _passing(information: F64, signal: F64, rival: slice) -> F64:
    """Return the amplitudes (e,) of a rival that imitate a *signal* (e,) best.

    *information* (e, e) is that of the readings.
    """
    signal_of_rival = np.zeros(len(information))
    signal_of_rival[rival] = np.linalg.lstsq(
        information[rival, rival], information[rival] @ signal, rcond=1e-9
    )[0]
    return signal_of_rival


def find_weakest(
    last: Fit, arm: Arm, prior: LinearModel, richest: LinearModel, poses: States
) -> WeakestParameter:
    """Find the least well known constant, in µm at the tip, of those that poses can determine at
    all.

    Raises `BadInput` for a calibration without a covariance of constants.
    """
    baseline = last.baseline
    if not baseline.parameters:
        raise BadInput("calibration", "covariance", "none", "that of the constants to tighten")
    names = arm.layout.names
    moves = compute_jacobian(poses.q, last.model.constants)[1]  # (n, 3, P) mm per unit
    lever_um = 1e3 * np.sqrt((moves**2).sum(axis=1).mean(axis=0))
    indices = list(baseline.parameters)
    directions = np.zeros((prior.layout.n, len(indices)))
    if baseline.is_given:
        directions[: baseline.root.shape[1]] = baseline.root[: len(indices)].T
        settled = np.ones(len(indices), dtype=bool)
    else:
        directions[: len(indices)] = np.eye(len(indices))
        diagonal = np.diag(richest.gram)[: len(indices)]
        settled = 1.0 / np.diag(richest.covariance)[: len(indices)] > GAUGE_SHARE * diagonal
    directions *= lever_um[indices]
    variance = np.einsum("ki,kl,li->i", directions, prior.covariance, directions)
    worst = int(np.argmax(np.where(settled, variance, -1.0)))
    name = names[indices[worst]]
    return WeakestParameter(
        f"tighten {name}, the least well known parameter",
        f"standard uncertainty of {name}",
        directions[:, worst],
    )
