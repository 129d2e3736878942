"""How strongly the residual wants each candidate, given what absorbs: score and evidence.

All statistics come from sums of products over whitened rows, so that candidates by the thousand
cost a few matrix products, and any column may be taken out of the model again without the rows.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from scipy.special import logsumexp
from scipy.stats import chi2

from armd.compensation.diagnose.noise import Absorbing, Noise
from armd.compensation.diagnose.problem import Linear
from armd.compensation.diagnose.signatures import Signatures

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

#: A candidate of which less than this share of its squared norm survives projection is absorbed.
ABSORBED = 1e-6
#: Amplitudes may be this many times their typical size, with these probabilities.
SCALES = {1.0: 0.6, 5.0: 0.3, 50.0: 0.1}
#: What the catalogue does not know gets this prior share.
UNKNOWN_PRIOR = 0.05
CHUNK = 512


@dataclass(frozen=True)
class Sums:
    """Products over whitened rows of absorbing columns B, candidates' columns X, residual r."""

    signatures: Signatures
    scale: F64  # (b,) by which the columns of B were divided
    ridge: F64  # (b,) for the scaled columns
    bb: F64  # (b, b)
    br: F64  # (b,)
    bx: F64  # (b, K)
    xr: F64  # (K,)
    xx: dict[int, tuple[I64, F64]]  # columns per candidate → candidates, (c, m, m)
    rr: float
    bd: F64  # (b, R) with simulated noise
    xd: F64  # (K, R)


def add_up(
    linear: Linear,
    noise: Noise,
    residual: F64,
    absorbing: Absorbing,
    signatures: Signatures,
    draws: F64 | None = None,
) -> Sums:
    """One pass over the rows. *draws* (N, R) is whitened simulated noise."""
    white_b = noise.whiten(absorbing.columns)
    scale = np.sqrt((white_b**2).sum(axis=0))
    scale[scale == 0.0] = 1.0
    white_b /= scale
    white_r = noise.whiten(residual)
    white_j = np.ascontiguousarray(noise.whiten(linear.jacobian.T).T)
    draws = np.zeros((len(residual), 0)) if draws is None else draws
    k = signatures.n_columns
    bx, xr, xd = np.empty((len(scale), k)), np.empty(k), np.empty((k, draws.shape[1]))
    xx = {
        int(m): (np.flatnonzero(signatures.count == m), np.empty(0))
        for m in np.unique(signatures.count)
    }
    blocks: dict[int, list[F64]] = {m: [] for m in xx}
    for low, high in _chunks(signatures):
        columns = range(
            signatures.first[low], signatures.first[high - 1] + signatures.count[high - 1]
        )
        x = signatures.block(linear, white_j, columns, noise)
        at = slice(columns.start, columns.stop)
        bx[:, at], xr[at], xd[at] = white_b.T @ x, white_r @ x, x.T @ draws
        for m, (members, _) in xx.items():
            inside = members[(members >= low) & (members < high)]
            which = signatures.first[inside][:, None] + np.arange(m) - columns.start
            own = x[:, which]  # (N, c, m)
            blocks[m].append(np.einsum("nci,ncj->cij", own, own, optimize=True))
    return Sums(
        signatures,
        scale,
        1.0 / (absorbing.variance * scale**2),
        white_b.T @ white_b,
        white_b.T @ white_r,
        bx,
        xr,
        {m: (members, np.concatenate(blocks[m])) for m, (members, _) in xx.items()},
        float(white_r @ white_r),
        white_b.T @ draws,
        xd,
    )


def _chunks(signatures: Signatures) -> Iterable[tuple[int, int]]:
    """Ranges of candidates of about CHUNK columns."""
    low = 0
    while low < len(signatures.candidates):
        high, width = low, 0
        while high < len(signatures.candidates) and (
            width == 0 or width + signatures.count[high] <= CHUNK
        ):
            width += int(signatures.count[high])
            high += 1
        yield low, high
        low = high


@dataclass(frozen=True)
class Scores:
    """Per candidate, given what absorbs: score statistic, its degrees of freedom, evidence."""

    signatures: Signatures
    statistic: F64  # (C,) χ² under no effect
    freedom: I64  # (C,) rank after projection; 0: absorbed
    log_p: F64  # (C,)
    log_evidence: F64  # (C,) log Bayes factor against nothing, prior not included
    least_log_p: F64  # (R,) of the simulated noise: smallest over all candidates

    def without(self, held: npt.NDArray[np.bool_]) -> Scores:
        """With the candidates *held* (C,) counted as absorbed."""
        return replace(
            self,
            freedom=np.where(held, 0, self.freedom),
            log_p=np.where(held, 0.0, self.log_p),
            log_evidence=np.where(held, -np.inf, self.log_evidence),
        )

    def silent(self, causes: Iterable[str]) -> tuple[str, ...]:
        """Those of *causes* that have no candidate, or only candidates that are absorbed."""
        candidates = zip(self.signatures.candidates, self.freedom, strict=True)
        alive = {candidate.cause for candidate, freedom in candidates if freedom > 0}
        return tuple(sorted(set(causes) - alive))

    def log_posterior(self) -> F64:
        """(C,) log of evidence × prior, normalised over the candidates: which one, if one."""
        weighted = self.log_evidence + _log_prior(self)
        normalised: F64 = weighted - logsumexp(weighted)
        return normalised

    def places(self) -> dict[tuple[str, str], float]:
        """Posterior probability of every (cause, location)."""
        found: dict[tuple[str, str], float] = {}
        for candidate, value in zip(
            self.signatures.candidates, np.exp(self.log_posterior()), strict=True
        ):
            found[candidate.place] = found.get(candidate.place, 0.0) + float(value)
        return found


def score(sums: Sums, without: Iterable[int] = ()) -> Scores:
    """Statistics of all candidates, the absorbing columns *without* left out of the model."""
    keep = np.setdiff1d(np.arange(len(sums.scale)), list(without))
    factor = inverse_factor(sums.bb[np.ix_(keep, keep)] + np.diag(sums.ridge[keep]))
    t = factor.T @ sums.bx[keep]  # (r, K)
    u = sums.xr - t.T @ (factor.T @ sums.br[keep])
    ud = sums.xd - t.T @ (factor.T @ sums.bd[keep])
    n = len(sums.signatures.candidates)
    statistic, freedom, evidence = np.zeros(n), np.zeros(n, dtype=np.int64), np.zeros(n)
    least = np.zeros(ud.shape[1])
    for m, (members, raw) in sums.xx.items():
        which = sums.signatures.first[members][:, None] + np.arange(m)
        size = np.sqrt(np.einsum("cii->ci", raw))
        size[size == 0.0] = 1.0
        tc = t[:, which] / size  # (r, c, m)
        gram = raw / (size[:, :, None] * size[:, None, :])
        gram = gram - np.einsum("rci,rcj->cij", tc, tc, optimize=True)
        values, vectors = np.linalg.eigh(gram)
        kept = values > ABSORBED
        turned = np.einsum("cij,ci->cj", vectors, u[which] / size)
        with_root = np.where(kept, 1.0 / np.sqrt(np.where(kept, values, 1.0)), 0.0)
        statistic[members] = ((turned * with_root) ** 2).sum(axis=1)
        freedom[members] = kept.sum(axis=1)
        evidence[members] = _evidence(gram, u[which] / size, sums.signatures.typical[which] * size)
        simulated = np.einsum("cij,cir->cjr", vectors, ud[which] / size[:, :, None])
        simulated = ((simulated * with_root[:, :, None]) ** 2).sum(axis=1)
        log_p = _log_tail(simulated, np.maximum(freedom[members], 1)[:, None])
        log_p[freedom[members] == 0] = 0.0
        least = np.minimum(least, log_p.min(axis=0, initial=0.0))
    log_p = np.where(freedom > 0, _log_tail(statistic, np.maximum(freedom, 1)), 0.0)
    evidence[freedom == 0] = -np.inf
    return Scores(sums.signatures, statistic, freedom, log_p, evidence, least)


def _log_tail(statistic: F64, freedom: I64) -> F64:
    """Log of the probability that χ² of so many degrees of freedom is larger."""
    return np.asarray(chi2.logsf(statistic, freedom), dtype=np.float64)


def inverse_factor(matrix: F64, least: float = 1e-10) -> F64:
    """F (b, r) with F Fᵀ the pseudo-inverse of a symmetric *matrix* of columns of unit length."""
    values, vectors = np.linalg.eigh(matrix)
    kept = values > least * max(float(values.max(initial=0.0)), 1e-300)
    factor: F64 = vectors[:, kept] / np.sqrt(values[kept])
    return factor


def _evidence(gram: F64, side: F64, typical: F64) -> F64:
    """(c,) log Bayes factors, amplitudes a priori normal about zero with the catalogue's size."""
    logs = []
    for scale, share in SCALES.items():
        prior = scale * typical
        g = gram * prior[:, :, None] * prior[:, None, :] + np.eye(gram.shape[1])
        b = side * prior
        solved = np.linalg.solve(g, b[:, :, None])[:, :, 0]
        fit = 0.5 * (b * solved).sum(axis=1)
        logs.append(np.log(share) + fit - 0.5 * np.linalg.slogdet(g)[1])
    combined: F64 = logsumexp(np.array(logs), axis=0)
    return combined


def _log_prior(scores: Scores) -> F64:
    """Uniform over causes, then places, then the grid; those absorbed do not take part."""
    candidates = scores.signatures.candidates
    alive = scores.freedom > 0
    grid: dict[tuple[str, str], int] = {}
    for candidate, lives in zip(candidates, alive, strict=True):
        if lives:
            grid[candidate.place] = grid.get(candidate.place, 0) + 1
    places: dict[str, int] = {}
    for cause, _ in grid:
        places[cause] = places.get(cause, 0) + 1
    named = max(len(places) - ("unknown" in places), 1)
    prior = np.full(len(candidates), -np.inf)
    for i, candidate in enumerate(candidates):
        if alive[i]:
            share = UNKNOWN_PRIOR if candidate.cause == "unknown" else (1 - UNKNOWN_PRIOR) / named
            prior[i] = np.log(share / (places[candidate.cause] * grid[candidate.place]))
    return prior
