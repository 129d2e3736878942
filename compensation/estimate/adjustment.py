"""Adjusted angles: the angles nearest to those read that put the tip where it was held.

The angles carry the noise, not the point touched. A column taken at the angles as read shares their
noise with the residual, and least squares takes the shared part for information. Shorter levers
scatter less, so the estimated arm shrinks (docs/decisions/0023). At adjusted angles, as Pope (1972)
requires for every adjustment of observations, columns and residuals share nothing.

The residual is r = J ε for angles q + ε, and a column as read is c(q + ε) = c(q) + ∂J ε. The normal
equation Σ cᵀ Σ⁻¹ r = 0 then contains E[Σ (∂J ε)ᵀ Σ⁻¹ J ε], which does not vanish at the true
constants: for all lengths in proportion ∂J = J, and it is 3 for each reading. The columns taken
here, at q + ε − J⁺ r, make it the gradient of the likelihood of the angles, Σ rᵀ (J C Jᵀ)⁻¹ r.
"""

from __future__ import annotations

from armd.arrays import F64
from armd.compensation.model.row_algebra import compute_least_turns, rotate_towards

#: A direction whose lever is shorter than this share of the reading's longest is hardly turned
#: towards: a fully stretched arm cannot reach farther. Any value from 0.01 to 0.1 does the same.
LEAST_LEVER = 0.03
#: A reading farther off than this is not noise; its angles are turned by no more.
MOST_TURN_RAD = 0.1
#: Newton steps: after the second the remainder is of third order in the noise.
TURNS = 2


def adjust_angles(q: F64, parameters: F64, placed_mm: F64) -> F64:
    """Return angles (n, N) nearest *q* with the tip at *placed_mm* (n, 3); parameters (n, P)."""
    return rotate_towards(q, parameters, placed_mm, TURNS, LEAST_LEVER, MOST_TURN_RAD)


def compute_backwards_map(joints: F64) -> F64:
    """Return the smallest turn (n, N, 3) rad/mm for each motion of the tip.

    *joints* (n, 3, N): d tip / d angle.
    """
    return compute_least_turns(joints, LEAST_LEVER)
