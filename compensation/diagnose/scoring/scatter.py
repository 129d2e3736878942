"""A test of a score against the scatter of the rests that decide on it.

Few rests decide on a step or a single target. Where the noise has heavy tails, some of them that
err alike reach a score that noise of one variance never would. Their own residuals show it: the
score's variance from these residuals (White's sandwich, HC3) is compared with that of the noise.
The ratio is known only as well as so few rests allow. Where their residuals have a memory, the
score varies more.
"""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import (
    ABSORBED,
    AXES,
    LEAST_P,
    LEAST_POSITIVE,
    MOST_COUNTED,
    MOST_LEVERAGE,
)
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.diagnose.scoring.evidence import compute_log_bayes_factors
from armd.compensation.diagnose.scoring.noise_correlation import compute_variance_of_sums
from armd.compensation.diagnose.scoring.projection import Projection
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.linear.bordered import compute_root_along_known


def compute_log_p_by_scatter(candidate: Candidate, projection: Projection) -> float:
    """Return the log p value of a candidate's score, its variance from the rests' residuals."""
    white, cleared, residual, size = _cleared(candidate, projection)
    gram = white.T @ cleared
    root = compute_root_along_known(gram, ABSORBED)
    if not root.shape[1]:
        return 0.0
    score = root.T @ (white.T @ residual)
    m, n = len(score), 3 * projection.fit.linear.rests.n
    weights = cleared @ root
    rests = weights[:n].reshape(-1, 3, m)
    residual_rests = (residual - weights @ score)[:n].reshape(-1, 3)
    posture = projection.fit.linear.rests.posture  # copies of one posture count as one
    leverage = np.bincount(posture, (rests**2).sum(axis=(1, 2)))
    pulls = sum_by_posture(np.einsum("nia,ni->na", rests, residual_rests), posture)
    pulls /= 1.0 - np.minimum(leverage, MOST_LEVERAGE)[:, None]
    # Errors that rests share (a certified target, drift) keep their stated variance.
    scatter = float((pulls**2).sum() + m - leverage.sum()) / m  # 1: the variance of the noise
    estimator = projection.correlation_estimator
    if memory := estimator.estimate(residual_rests):
        larger = compute_variance_of_sums(
            rests, estimator.sources, memory.tau_s, estimator.sequence
        )
        scatter *= max(memory.variance * larger, 1.0)
    # The effective number of rests that decide.
    speaking = leverage.sum() ** 2 / max(float((leverage**2).sum()), LEAST_POSITIVE)
    axes = _axes(rests, projection)
    freedom = max((speaking - 1.0) * min(m, axes), 1.0)
    tail = float(fdtrc(m, freedom, float(score @ score) / (m * scatter)))
    log_p = float(np.log(max(tail, LEAST_P)))
    if m > MOST_COUNTED:  # many columns: the evidence, with noise as large as the scatter, counts
        side = white.T @ residual / np.sqrt(max(scatter, 1.0))
        prior_sd, reach = np.array([(c.prior_sd, c.reach) for c in candidate.columns]).T
        evidence = compute_log_bayes_factors(
            gram[None], side[None], (prior_sd * size)[None], reach[None]
        )
        log_p = min(log_p, -float(evidence[0]))
    return log_p


def _axes(rests: F64, projection: Projection) -> float:
    """Return the mean number of equations that a rest gives, by the weights *rests* (n, 3, m)."""
    noise = projection.fit.noise
    if noise.normal is None:
        return float(AXES)
    decides = (rests**2).sum(axis=(1, 2))
    return float(decides @ noise.freedom) / max(float(decides.sum()), LEAST_POSITIVE)


def sum_by_posture(values: F64, posture: I64) -> F64:
    """Return sums (p, m) of values (n, m) over the copies of each posture."""
    sums: F64 = np.stack([np.bincount(posture, column) for column in values.T], axis=1)
    return sums


def _cleared(candidate: Candidate, projection: Projection) -> tuple[F64, F64, F64, F64]:
    """Return a candidate's whitened unit columns (N, m), and again clear of what absorbs.

    The findings' shapes are among what absorbs. The cleared residual (N,) and the columns' lengths
    (m,) before scaling are returned, too.
    """
    columns = make_finding_columns(projection.fit.linear, [candidate], projection.arm)[0]
    white, cleared = projection.clear_of_all(np.hstack([columns, projection.fit.residual[:, None]]))
    size = np.sqrt((white[:, :-1] ** 2).sum(axis=0))
    size = np.where(size > 0.0, size, 1.0)
    return white[:, :-1] / size, cleared[:, :-1] / size, cleared[:, -1], size
