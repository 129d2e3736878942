"""The posterior probability of a set of causes: one number by which sets are compared.

log p(S | r) = log B(S) + Σ log prior(cause, place, kind, value) + const. B is the evidence of all
amplitudes together against none, about one fit's point and in its noise. Each cause's amplitudes
have the likeliest of the scales, and all shapes may be a little off.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import SHAPE_PRIOR
from armd.compensation.diagnose.fitting.refit import solve_with_findings
from armd.compensation.diagnose.problem.amplitudes import is_sized
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.signatures import identify_kind
from armd.compensation.diagnose.scoring.evidence import Scores
from armd.compensation.diagnose.scoring.prior import find_log_prior
from armd.compensation.diagnose.scoring.projection import Projection, make_projection
from armd.compensation.diagnose.scoring.shape import is_shape, make_shapes
from armd.compensation.diagnose.scoring.time_discrepancy import make_slower
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.sizes import list_sizes
from armd.compensation.model.arm import Arm


def compute_log_odds(
    findings: Sequence[Candidate],
    instead_of: Sequence[Candidate],
    about: Fit,
    arm: Arm,
    scores: Scores,
) -> float:
    """Return by how many nats all *findings* together are likelier than those *instead_of*.

    Both are linearised about the point of the fit *about*; *scores* hold the catalogue's priors.
    """
    projection = make_projection(solve_with_findings(about, [], arm), arm)
    log_posterior, against = (weigh_set(c, projection, scores) for c in (findings, instead_of))
    return log_posterior - against


def weigh_set(findings: Sequence[Candidate], projection: Projection, scores: Scores) -> float:
    """Return the log posterior (nat, up to a constant) of all *findings* together.

    *projection*: that of a fit without findings. *scores* hold the catalogue's priors. The shape of
    a lag is how its sessions began; with that open, the lag may be slower.
    """
    straight, shaped = _with_shapes(findings, projection)
    for i, finding in enumerate(findings):
        for slower in make_slower(finding):
            slower_set = [*findings[:i], slower, *findings[i + 1 :]]
            shaped = max(shaped, _with_shapes(slower_set, projection)[1])
    kinds, log_prior = scores.signatures.kinds, scores.log_prior
    prior = sum(
        math.log(SHAPE_PRIOR)
        if is_shape(finding)
        else find_log_prior(identify_kind(finding), kinds, log_prior)
        for finding in findings
    )
    return float(np.logaddexp(straight, shaped + math.log(SHAPE_PRIOR))) + prior


def _with_shapes(findings: Sequence[Candidate], projection: Projection) -> tuple[float, float]:
    """Return log (evidence × prior) of the findings' amplitudes, without and with their shapes
    open.
    """
    nothing = projection.fit
    fitted = solve_with_findings(nothing, findings, projection.arm)
    columns_of_findings = [
        n for span in fitted.layout.findings for n in range(span.start, span.stop)
    ]
    shapes = make_shapes(fitted, projection.arm)
    columns = np.hstack(
        [fitted.nuisance.columns.to_dense(np.array(columns_of_findings, dtype=int)), shapes.matrix]
    )
    white, cleared = projection.clear_of_all(columns)
    gram, side = white.T @ cleared, cleared.T @ nothing.noise.whiten(nothing.residual)
    variance, log_prior = _amplitudes_a_priori(fitted)
    straight = _log_evidence(gram, side, variance)
    shaped = _log_evidence(gram, side, np.concatenate([variance, shapes.variance]))
    return straight + log_prior, shaped + log_prior


def _log_evidence(gram: F64, side: F64, variance: F64) -> float:
    """Return the log Bayes factor of the first m columns against none.

    Their amplitudes are normal with a *variance* (m,). The products *gram* (M, M) and *side* (M,)
    with the residual are clear of what absorbs.
    """
    m = len(variance)
    size = np.sqrt(variance)
    inner = gram[:m, :m] * np.outer(size, size) + np.eye(m)
    b = side[:m] * size
    return 0.5 * float(b @ np.linalg.solve(inner, b)) - 0.5 * float(np.linalg.slogdet(inner)[1])


def _amplitudes_a_priori(fitted: Fit) -> tuple[F64, float]:
    """Return the variances of all findings' amplitudes, and the log prior of the scales chosen."""
    variances, log_prior = [np.empty(0)], 0.0
    for candidate, values, span in zip(
        fitted.findings, fitted.amplitudes, fitted.layout.findings, strict=True
    ):
        if is_sized(candidate):  # the data determine their common size
            variances.append(fitted.nuisance.variance[span])
            continue
        prior_sd = np.array([column.prior_sd for column in candidate.columns])
        reach = np.array([column.reach for column in candidate.columns])
        log_share, size = max(
            list_sizes(prior_sd, reach),
            key=lambda able: (
                able[0] - 0.5 * ((values / able[1]) ** 2).sum() - np.log(able[1]).sum()
            ),
        )
        variances.append(size**2)
        log_prior += log_share
    return np.concatenate(variances), log_prior
