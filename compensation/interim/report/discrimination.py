"""Predicts how well a future check would determine the cause of a change.

Each scenario predicts the check's numbers from all checks so far: a mean, and a covariance of the
remaining uncertainty, in units of the estimated noise. Poses are chosen by the likeliest scenario
of each cause. Two of them overlap by Bhattacharyya's coefficient exp(−B). Its sum over all pairs is
never below the probability that the likeliest of these scenarios is wrong afterwards:

    Σ √(pᵢ·pⱼ)·exp(−Bᵢⱼ),   B = Δᵀ S⁻¹ Δ / 8 + ½ ln(|S| / √(|Sᵢ|·|Sⱼ|)),   S = (Sᵢ + Sⱼ) / 2

(T. Kailath, IEEE Trans. Commun. Technol. 15, 1967). This is the criterion of a diagnosis' design
(`design/criterion.py`), extended to unequal covariances. The probability that is reported is over
all scenarios, not over these alone: a cause that began on another day, or at another size, is still
the same cause.
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

#: The prior standard deviation of a new seat's position, mm: larger than any change.
SEAT_MM = 1.0
#: Causes less likely than this are ignored, and so are all but this many.
LEAST_SHARE, MOST = 0.01, 6
#: Random checks for the probability of a wrong cause: of all scenarios together, and the least of
#: each.
DRAWS, LEAST_DRAWS = 4000, 10


@dataclass(frozen=True)
class PredictedCheck:
    """The predictions of one check's r numbers by H scenarios."""

    mean: F64  # (H, r)
    covariance: F64  # (H, r, r)

    def rows(self, chosen: I64) -> PredictedCheck:
        """Select some of the numbers (…, s): mean (…, H, s) and covariance (…, H, s, s)."""
        mean = np.moveaxis(self.mean[:, chosen], 0, -2)
        block = self.covariance[:, chosen[..., :, None], chosen[..., None, :]]
        return PredictedCheck(mean, np.moveaxis(block, 0, -3))


def group_by_place(
    scenarios: Sequence[ChangeScenario], causes: Sequence[Cause], index: int
) -> tuple[F64, list[tuple[Change, ...]]]:
    """Group the scenarios by the cause and place of change number *index*.

    Returns the share (H,) of each cause at its place, and its likeliest scenario.
    """
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
    """List every scenario: its share (W,), its cause and place (W,) of change *index*, its changes.

    Only the likeliest scenarios were kept, of a doubtful change perhaps half. So those of each
    cause share the probability of *probability_of*. The remainder to 1 belongs to causes without a
    scenario.
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
    """Predict each check *ahead* under each of *scenarios*, from the checks *measured*."""
    means: list[list[F64]] = [[] for _ in ahead]
    covariances: list[list[F64]] = [[] for _ in ahead]
    sums = ExtendedSums(stacked, measured)
    for changes in scenarios:
        extra = list_change_columns(stacked, changes)
        estimate = estimate_known_errors(sums.sum_with(extra))
        for number, check in enumerate(ahead):
            columns = np.concatenate([stacked.error_columns[check], extra[check]], axis=1)
            seat = SEAT_MM * stacked.targets[check]
            spread = np.eye(len(columns)) + columns @ estimate.covariance @ columns.T
            means[number].append(columns @ estimate.mean)
            covariances[number].append(estimate.scale * spread + seat @ seat.T)
    pairs = zip(means, covariances, strict=True)
    return [PredictedCheck(np.array(mean), np.array(covariance)) for mean, covariance in pairs]


def compute_overlap(share: F64, predicted: PredictedCheck) -> F64:
    """Compute the sum over pairs (…) that bounds the probability of a wrong cause from above.

    See the formula of the module.
    """
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
    """Estimate the probability that the likeliest cause is wrong after a check, from random checks.

    The scenarios have the shares *share* (W,) and the causes numbered by *of_scenario* (W,). The
    remainder of the shares to 1 counts as wrong.
    """
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
    """Choose *count* poses, three numbers each, one after another so that the overlap falls most.

    They come from each of *pools* in turn. Returns the poses and the overlap.
    """
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
    """List the numbers (…, 3 s) of poses (…, s)."""
    rows: I64 = (3 * poses[..., None] + np.arange(3)).reshape(*poses.shape[:-1], -1)
    return rows
