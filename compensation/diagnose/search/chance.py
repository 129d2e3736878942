"""How sure a finding can be where the noise lasts from rest to rest.

The evidence takes rests as independent. Where what is left of them remembers, the score varies more
than that, and a probability among causes says nothing of the chance that there is none.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.compensation.diagnose.constants import EVEN_CHANCE
from armd.compensation.diagnose.diagnosis import Finding
from armd.compensation.diagnose.fitting.refit import solve_again
from armd.compensation.diagnose.scoring.candidates import ScoredCandidates
from armd.compensation.diagnose.scoring.projection import Projection, make_projection
from armd.compensation.diagnose.scoring.scatter import compute_log_p_by_scatter
from armd.compensation.diagnose.scoring.shape import locate_shape
from armd.compensation.diagnose.scoring.threshold import compute_family_wise_p


def limit_by_lasting_noise(
    findings: Sequence[Finding], scored: ScoredCandidates, tests: int
) -> tuple[Finding, ...]:
    """The findings of a fit, no surer than their p values by the scatter of the rests allow, where
    the noise lasts."""
    projection = scored.projection
    if not findings or not _lasts(projection):
        return tuple(findings)
    limited = []
    for finding, candidate in zip(findings, scored.fit.findings, strict=True):
        fit = scored.fit
        remaining = [
            c for c in fit.findings if c is not candidate and c.location != locate_shape(candidate)
        ]
        without = make_projection(solve_again(fit, remaining, projection.arm), projection.arm)
        p = float(compute_family_wise_p(compute_log_p_by_scatter(candidate, without), tests))
        limited.append(replace(finding, probability=finding.probability * limit_probability(p)))
    return tuple(limited)


def limit_probability(p_value: float) -> float:
    """The highest probability that something is there which a p value allows, as likely as not
    before: the Bayes factor of nothing is at least −e p ln p (Sellke, Bayarri and Berger, American
    Statistician 55, 2001)."""
    if p_value >= np.exp(-1.0):
        return EVEN_CHANCE
    return 1.0 / (1.0 - np.e * p_value * np.log(p_value)) if p_value > 0.0 else 1.0


def _lasts(projection: Projection) -> bool:
    n = projection.fit.linear.rests.n
    _, cleared = projection.clear_of_all(projection.fit.residual[:, None])
    return projection.lasting.memory(cleared[: 3 * n].reshape(n, 3)) is not None
