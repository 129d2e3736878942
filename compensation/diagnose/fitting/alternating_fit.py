"""A fit of causes that act through other findings, by alternation.

The model has the product of two unknowns. With one of them fixed it is linear, and the other
changes the fixed one little. For example, a sensor's offset is one constant, which hardly changes
while the amplitude through which it acts settles.
"""

from __future__ import annotations

from collections.abc import Sequence

from armd.arrays import F64
from armd.compensation.diagnose.constants import MOST_TURNS
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.problem.acting_causes import find_acting, update_candidate
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline, ModelState, Rests
from armd.compensation.diagnose.problem.whitening import RestNoise
from armd.compensation.effects.effect import Candidate, SessionFacts
from armd.compensation.model.arm import Arm


def fit_by_turns(
    facts: SessionFacts,
    rests: Rests,
    arm: Arm,
    baseline: Baseline,
    model: ModelState,
    findings: Sequence[Candidate],
    amplitudes: Sequence[F64],
    *,
    noise_extra: Sequence[Candidate] = (),
    noise: RestNoise | None = None,
) -> Fit:
    """Fit findings, rebuilding those that act through others at the others' amplitudes."""
    for _ in range(MOST_TURNS):
        fitted = fit(rests, arm, baseline, model, findings, amplitudes, noise_extra, noise)
        active = find_acting(fitted)
        rebuilt = [update_candidate(candidate, facts, active) for candidate in fitted.findings]
        if all(new is old for new, old in zip(rebuilt, fitted.findings, strict=True)):
            break
        remaining = [
            (c, a) for c, a in zip(rebuilt, fitted.amplitudes, strict=True) if c is not None
        ]
        findings, amplitudes = [c for c, _ in remaining], [a for _, a in remaining]
        model, noise = fitted.model, fitted.noise
    return fitted
