"""How well a check that is not made yet would tell what a change was.

Each scenario predicts the check's numbers, by all checks so far: a mean, and a covariance of what
they leave open, in units of the noise as they found it. Poses are chosen by the likeliest scenario
of each cause: two of them overlap by Bhattacharyya's coefficient exp(−B), and the sum of it over
all pairs is never below the chance that the likeliest of these scenarios is wrong afterwards:

    Σ √(pᵢ·pⱼ)·exp(−Bᵢⱼ),   B = Δᵀ S⁻¹ Δ / 8 + ½ ln(|S| / √(|Sᵢ|·|Sⱼ|)),   S = (Sᵢ + Sⱼ) / 2

(T. Kailath, IEEE Trans. Commun. Technol. 15, 1967), the criterion of a diagnosis' design
(`design/criterion.py`) where the covariances differ, too. The chance that is reported is of all
scenarios, not of these alone: a cause that began on another day, at another size, is still that
cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.special import logsumexp

from armd.arrays import F64, I64
from armd.compensation.interim.changes.change import Change, ChangeScenario, list_change_columns
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence.extended_sums import ExtendedSums
from armd.compensation.interim.evidence.likelihood import estimate_known_errors
from armd.compensation.interim.evidence.stack import Stack

#: Where a new seat stands is not known, mm: farther off than any change moves it.
SEAT_MM = 1.0
#: Causes less likely than this play no part, nor do any but so many.
LEAST_SHARE, MOST = 0.01, 6
#: Checks drawn for the chance to be wrong: of all scenarios together, and of each at least.
DRAWS, LEAST_DRAWS = 4000, 10


@dataclass(frozen=True)
class PredictedCheck:
    """What H scenarios predict of one check's r numbers."""

    mean: F64  # (H, r)
    covariance: F64  # (H, r, r)

    def rows(self, chosen: I64) -> PredictedCheck:
        """Of some of the numbers (…, s): (…, H, s) and (…, H, s, s)."""
        mean = np.moveaxis(self.mean[:, chosen], 0, -2)
        block = self.covariance[:, chosen[..., :, None], chosen[..., None, :]]
        return PredictedCheck(mean, np.moveaxis(block, 0, -3))


def group_by_place(
    scenarios: Sequence[ChangeScenario], causes: Sequence[Cause], index: int
) -> tuple[F64, list[tuple[Change, ...]]]:
    """What change number *index* may have been: the share (H,) of each cause at its place, and the
    likeliest scenario of it."""
    share: dict[tuple[str, str], float] = {}
    likeliest: dict[tuple[str, str], ChangeScenario] = {}
    for scenario in scenarios:
        cause = scenario[1][index].cause
        assert cause is not None
        place = causes[cause].place
        share[place] = share.get(place, 0.0) + scenario[0]
        if place not in likeliest or scenario[0] > likeliest[place][0]:
            likeliest[place] = scenario
    order = sorted((p for p in share if share[p] >= LEAST_SHARE), key=lambda p: -share[p])[:MOST]
    shares = np.array([share[place] for place in order])
    return shares / shares.sum(), [likeliest[place][1] for place in order]


def list_all_scenarios(
    scenarios: Sequence[ChangeScenario],
    causes: Sequence[Cause],
    index: int,
    probability_of: Mapping[tuple[str, str], float],
) -> tuple[F64, I64, list[tuple[Change, ...]]]:
    """Every scenario: its share (W,), which cause and place of change number *index* it has (W,),
    and its changes.

    Only the likeliest scenarios are kept, of a doubtful change perhaps half. So those of each cause
    share the probability of *probability_of*; what they leave of 1 is of causes without any.
    """
    places = list(probability_of)
    listed_share: dict[tuple[str, str], float] = {}
    listed = []
    for share, changes in scenarios:
        cause = changes[index].cause
        assert cause is not None
        place = causes[cause].place
        if place in probability_of:
            listed_share[place] = listed_share.get(place, 0.0) + share
            listed.append((share, place, changes))
    return (
        np.array(
            [share / listed_share[place] * probability_of[place] for share, place, _ in listed]
        ),
        np.array([places.index(place) for _, place, _ in listed]),
        [changes for _, _, changes in listed],
    )


def predict_checks(
    stacked: Stack,
    scenarios: Sequence[tuple[Change, ...]],
    measured: Sequence[int],
    ahead: Sequence[int],
) -> list[PredictedCheck]:
    """What each of *scenarios* predicts of each check *ahead*, by those *measured*."""
    means: list[list[F64]] = [[] for _ in ahead]
    covariances: list[list[F64]] = [[] for _ in ahead]
    told_by = ExtendedSums(stacked, measured)
    for changes in scenarios:
        extra = list_change_columns(stacked, changes)
        estimate = estimate_known_errors(told_by.sum_with(extra))
        for number, check in enumerate(ahead):
            columns = np.concatenate([stacked.error_columns[check], extra[check]], axis=1)
            seat = SEAT_MM * stacked.targets[check]
            spread = np.eye(len(columns)) + columns @ estimate.covariance @ columns.T
            means[number].append(columns @ estimate.mean)
            covariances[number].append(estimate.scale * spread + seat @ seat.T)
    pairs = zip(means, covariances, strict=True)
    return [PredictedCheck(np.array(mean), np.array(covariance)) for mean, covariance in pairs]


def compute_overlap(share: F64, predicted: PredictedCheck) -> F64:
    """The sum (…) over pairs of the lines at the top: never below the chance to be wrong."""
    spread = np.linalg.slogdet(predicted.covariance)[1]
    total = np.zeros(predicted.mean.shape[:-2])
    for i, j in combinations(range(len(share)), 2):
        mean_covariance = (
            predicted.covariance[..., i, :, :] + predicted.covariance[..., j, :, :]
        ) / 2
        difference = predicted.mean[..., i, :] - predicted.mean[..., j, :]
        quad = (difference * np.linalg.solve(mean_covariance, difference[..., None])[..., 0]).sum(
            axis=-1
        )
        wider = np.linalg.slogdet(mean_covariance)[1] - (spread[..., i] + spread[..., j]) / 2
        total += np.sqrt(share[i] * share[j]) * np.exp(-quad / 8 - wider / 2)
    return total


def estimate_chance_wrong(share: F64, of_scenario: I64, predicted: PredictedCheck) -> float:
    """The chance that the likeliest cause is the wrong one after a check, from checks drawn:
    scenarios of *share* (W,), each of the cause that *of_scenario* (W,) numbers. Where the shares
    leave some of 1, the likeliest of them is wrong."""
    rng = np.random.default_rng(0)
    factors = np.linalg.cholesky(predicted.covariance)
    spread = np.log(np.diagonal(factors, axis1=1, axis2=2)).sum(axis=1)
    numbers = np.unique(of_scenario)
    members = [of_scenario == number for number in numbers]
    wrong = max(1.0 - float(share.sum()), 0.0)
    for true, probability in enumerate(share):
        draws = LEAST_DRAWS + round(DRAWS * float(probability))
        drawn = factors[true] @ rng.normal(size=(predicted.mean.shape[1], draws))
        off = predicted.mean[true][:, None] + drawn - predicted.mean[:, :, None]  # (W, r, draws)
        quad = (np.linalg.solve(factors, off) ** 2).sum(axis=1)
        likelihood = np.log(share)[:, None] - spread[:, None] - quad / 2
        by_cause = np.array([logsumexp(likelihood[its], axis=0) for its in members])
        wrong += probability * float((numbers[by_cause.argmax(axis=0)] != of_scenario[true]).mean())
    return wrong


def choose_best_poses(
    share: F64, predicted: PredictedCheck, pools: Sequence[I64], count: int
) -> tuple[list[int], float]:
    """*count* poses, three numbers each, from each of *pools* in turn, chosen one after another so
    that the overlap falls most; and that overlap."""
    chosen: list[int] = []
    lowest = np.inf
    for number in range(count):
        remaining = [pose for pose in pools[number % len(pools)] if pose not in chosen]
        sets = np.array([[*chosen, pose] for pose in remaining])
        overlaps = compute_overlap(share, predicted.rows(list_numbers(sets)))
        best = int(np.argmin(overlaps))
        chosen.append(int(remaining[best]))
        lowest = float(overlaps[best])
    return chosen, lowest


def list_numbers(poses: I64) -> I64:
    """(…, 3 s) the numbers of poses (…, s)."""
    rows: I64 = (3 * poses[..., None] + np.arange(3)).reshape(*poses.shape[:-1], -1)
    return rows
