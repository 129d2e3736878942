"""The score and the evidence of each candidate on the residual, given what absorbs.

All statistics come from sums of products over whitened rows. So thousands of candidates cost a few
matrix products, and any column can be taken out of the model without the rows.
"""

from __future__ import annotations

import operator
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce

import numpy as np
from scipy.special import chdtrc, logsumexp

from armd.arrays import F64, I64, Mask
from armd.compensation.diagnose.constants import (
    ABSORBED,
    LEAST_EXPLAINED_SHARE,
    MOST_COUNTED,
)
from armd.compensation.diagnose.problem.signatures import Signatures
from armd.compensation.diagnose.scoring.prior import compute_log_prior
from armd.compensation.effects.sizes import list_sizes
from armd.compensation.estimate.linear.linear_model import LinearModel


@dataclass(frozen=True)
class Sums:
    """Products over whitened rows of shared nuisance columns B, candidates' columns X, residual r.

    All but the squared lengths are clear of what absorbs in one placement only.
    """

    signatures: Signatures
    shared: LinearModel  # of B
    br: F64  # (b,)
    bx: F64  # (b, K)
    xr: F64  # (K,)
    squared_length: F64  # (K,) of X before clearing
    xx: dict[int, tuple[I64, F64]]  # columns per candidate → candidates, (c, m, m)

    def with_more(self, added: Sums) -> Sums:
        """Append the candidates *added*, summed with the same shared columns."""
        xx, before = dict(self.xx), len(self.signatures.candidates)
        for m, (members, products) in added.xx.items():
            numbers, before_products = xx.get(m, (members[:0], products[:0]))
            xx[m] = (
                np.append(numbers, before + members),
                np.concatenate([before_products, products]),
            )
        return replace(
            self,
            signatures=self.signatures.with_more(added.signatures),
            bx=np.hstack([self.bx, added.bx]),
            xr=np.append(self.xr, added.xr),
            squared_length=np.append(self.squared_length, added.squared_length),
            xx=xx,
        )


def add_sums(parts: Sequence[Sums]) -> Sums:
    """Add the sums over several parts of the rows, one after another because they are large."""
    first = parts[0]
    return Sums(
        first.signatures,
        reduce(operator.add, (part.shared for part in parts)),
        sum((part.br for part in parts[1:]), start=first.br),
        sum((part.bx for part in parts[1:]), start=first.bx),
        sum((part.xr for part in parts[1:]), start=first.xr),
        sum((part.squared_length for part in parts[1:]), start=first.squared_length),
        {
            m: (members, sum((part.xx[m][1] for part in parts[1:]), start=products))
            for m, (members, products) in first.xx.items()
        },
    )


@dataclass(frozen=True)
class Scores:
    """The score statistic, freedom and evidence of each candidate, given what absorbs."""

    signatures: Signatures
    statistic: F64  # (C,) χ² under no effect
    freedom: I64  # (C,) rank after projection; 0: absorbed
    log_p: F64  # (C,)
    log_evidence: F64  # (C,) log Bayes factor against nothing, prior not included
    typical_snr: F64  # (C,) noise units of the cleared signature at the catalogue's typical size

    @cached_property
    def log_prior(self) -> F64:
        """The log priors (C,) of the candidates; −inf for those absorbed."""
        expected = np.array([c.expected for c in self.signatures.candidates], dtype=bool)
        return compute_log_prior(self.signatures.kinds, self.freedom, expected)

    @cached_property
    def _log_weight(self) -> F64:
        """The log of evidence × prior, (C,)."""
        weighted: F64 = self.log_evidence + self.log_prior
        return weighted

    def drop_candidates(self, barred: Mask) -> Scores:
        """Return the scores with the candidates *barred* (C,) counted as absorbed."""
        return replace(
            self,
            freedom=np.where(barred, 0, self.freedom),
            log_p=np.where(barred, 0.0, self.log_p),
            log_evidence=np.where(barred, -np.inf, self.log_evidence),
        )

    def find_partial_explanations(self, statistic: float) -> Mask:
        """Return which candidates (C,) alone explain a good part of a *statistic*."""
        well: Mask = self.statistic >= LEAST_EXPLAINED_SHARE * statistic
        return well

    def silent(self, causes: Iterable[str]) -> tuple[str, ...]:
        """Return those of *causes* that have no candidate, or only candidates that are absorbed."""
        candidates = zip(self.signatures.candidates, self.freedom, strict=True)
        alive = {candidate.cause for candidate, freedom in candidates if freedom > 0}
        return tuple(sorted(set(causes) - alive))

    def shown_at_typical_size(self) -> dict[str, float]:
        """Return for each named cause the noise units of its typical size where these data show it
        best.
        """
        best: dict[str, float] = {}
        candidates = zip(self.signatures.candidates, self.typical_snr, strict=True)
        for candidate, snr in candidates:
            if candidate.cause != "unknown":
                best[candidate.cause] = max(best.get(candidate.cause, 0.0), float(snr))
        return best

    def log_posterior(self) -> F64:
        """Return log (evidence × prior) (C,), normalised over the candidates: which one, if one."""
        normalised: F64 = self._log_weight - self.log_total
        return normalised

    @cached_property
    def log_total(self) -> float:
        """The log of the sum of evidence × prior over the candidates."""
        return float(logsumexp(self._log_weight))

    def log_places(self) -> dict[tuple[str, str], float]:
        """Return the log posterior probability of every (cause, location)."""
        log, numbers = self.log_posterior(), dict[tuple[str, str], int]()
        place_of = [numbers.setdefault(c.place, len(numbers)) for c in self.signatures.candidates]
        largest = np.full(len(numbers), -np.inf)
        np.maximum.at(largest, place_of, log)
        largest[np.isneginf(largest)] = 0.0
        with np.errstate(divide="ignore"):  # log 0 where all candidates of a place are absorbed
            sums = largest + np.log(
                np.bincount(place_of, np.exp(log - largest[place_of]), len(numbers))
            )
        return dict(zip(numbers, map(float, sums), strict=True))


def score(sums: Sums, without: Iterable[int] = ()) -> Scores:
    """Score all candidates, with the shared columns *without* left out of the model."""
    columns = np.setdiff1d(np.arange(sums.shared.layout.n), list(without))
    t, u = _project_out(sums, sums.shared.only(columns), columns)
    n = len(sums.signatures.candidates)
    statistic, freedom, evidence = np.zeros(n), np.zeros(n, dtype=np.int64), np.zeros(n)
    typical_snr = np.zeros(n)
    for m, (members, raw) in sums.xx.items():
        numbers = sums.signatures.first[members][:, None] + np.arange(m)
        size = np.sqrt(
            np.maximum(sums.squared_length[numbers], 0.0)
        )  # rounding may make it negative
        size[size == 0.0] = 1.0
        tc = t[numbers] / size[:, :, None]  # (c, m, r)
        gram = raw / (size[:, :, None] * size[:, None, :]) - tc @ tc.transpose(0, 2, 1)
        values, vectors = np.linalg.eigh(gram)
        is_independent = values > ABSORBED
        turned = np.einsum("cij,ci->cj", vectors, u[numbers] / size)
        with_root = np.where(
            is_independent, 1.0 / np.sqrt(np.where(is_independent, values, 1.0)), 0.0
        )
        statistic[members] = ((turned * with_root) ** 2).sum(axis=1)
        freedom[members] = is_independent.sum(axis=1)
        prior_sd = sums.signatures.prior_sd[numbers] * size
        reach = sums.signatures.reach[numbers]
        mean_squares = (np.einsum("cii->ci", gram) * prior_sd**2).mean(axis=1)
        typical_snr[members] = np.where(
            is_independent.any(axis=1), np.sqrt(np.maximum(mean_squares, 0.0)), 0.0
        )
        evidence[members] = compute_log_bayes_factors(gram, u[numbers] / size, prior_sd, reach)
    log_p = np.where(freedom > 0, compute_log_tail(statistic, np.maximum(freedom, 1)), 0.0)
    evidence[freedom == 0] = -np.inf
    log_p = np.where(sums.signatures.count > MOST_COUNTED, np.minimum(log_p, -evidence), log_p)
    return Scores(sums.signatures, statistic, freedom, log_p, evidence, typical_snr)


def estimate_amplitudes(sums: Sums, without: Iterable[int] = ()) -> list[F64]:
    """Return the amplitudes of each candidate alone, given what absorbs.

    The shared columns *without* are left out of the model.
    """
    columns = np.setdiff1d(np.arange(sums.shared.layout.n), list(without))
    t, u = _project_out(sums, sums.shared.only(columns), columns)
    amplitudes: list[F64] = [np.empty(0)] * len(sums.signatures.candidates)
    for members, raw in sums.xx.values():
        for i, gram in zip(members, raw, strict=True):
            numbers = sums.signatures.columns_of(int(i))
            cleared = gram - t[numbers] @ t[numbers].T
            amplitudes[i] = -np.linalg.pinv(cleared, rcond=ABSORBED, hermitian=True) @ u[numbers]
    return amplitudes


def _project_out(sums: Sums, model: LinearModel, columns: I64) -> tuple[F64, F64]:
    """Project X and its products with the residual on a *model* of the shared *columns*.

    The first result holds the coordinates (K, b) of what the model takes of X, along an orthonormal
    basis of the columns. The second holds the products (K,) of the rest of X with the residual.
    """
    t = model.project(sums.bx[columns]).T
    return t, sums.xr - t @ model.project(sums.br[columns])


def compute_log_tail(statistic: F64, freedom: I64) -> F64:
    """Return the log probability that χ² with *freedom* degrees of freedom exceeds *statistic*."""
    with np.errstate(divide="ignore"):
        return np.asarray(np.log(chdtrc(freedom, statistic)), dtype=np.float64)


def compute_log_bayes_factors(gram: F64, side: F64, prior_sd: F64, reach: F64) -> F64:
    """Return the log Bayes factors (c,) of candidates against nothing.

    *gram* (c, m, m): products of their columns; *side* (c, m): products with the residual. The
    amplitudes are a priori normal about zero with the catalogue's size.
    """
    logs = []
    for log_share, prior in list_sizes(prior_sd, reach):
        g = gram * prior[:, :, None] * prior[:, None, :] + np.eye(gram.shape[1])
        b = side * prior
        solved = np.linalg.solve(g, b[:, :, None])[:, :, 0]
        fit = 0.5 * (b * solved).sum(axis=1)
        logs.append(log_share + fit - 0.5 * np.linalg.slogdet(g)[1])
    combined: F64 = logsumexp(np.array(logs), axis=0)
    return combined
