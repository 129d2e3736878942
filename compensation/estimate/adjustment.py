"""Angles adjusted so that the tip stands where it was held: where columns are taken.

The angles carry the noise, not the point touched. A column taken at the angles as read shares
their noise with the residual, and least squares takes what the two share for knowledge: shorter
levers scatter less, so the arm shrinks (docs/decisions/0023). Taken at adjusted angles, as Pope
(1972) asks of every adjustment of observations, columns and residuals share nothing.

The residual is r = J ε for angles q + ε, and a column as read is c(q + ε) = c(q) + ∂J ε. The
normal equation Σ cᵀ Σ⁻¹ r = 0 then holds E[Σ (∂J ε)ᵀ Σ⁻¹ J ε], which does not vanish at the true
constants: for all lengths in proportion ∂J = J, and it is 3 a reading. The columns taken here, at
q + ε − J⁺ r, make it the gradient of the likelihood of the angles, Σ rᵀ (J C Jᵀ)⁻¹ r.
"""

from __future__ import annotations

from armd.arrays import F64
from armd.compensation.model.row_algebra import compute_least_turns, rotate_towards

#: A direction whose lever is shorter than this share of the reading's longest is hardly turned
#: towards: an arm stretched out cannot reach farther. Between 0.01 and 0.1 nothing changes.
LEAST_LEVER = 0.03
#: A reading farther off than this is not noise; its angles go no farther.
MOST_TURN_RAD = 0.1
#: Newton steps: after the second what is left is noise to the third power.
TURNS = 2


def adjust_angles(q: F64, parameters: F64, placed_mm: F64) -> F64:
    """Angles (n, N) nearest *q* that put the tip at *placed_mm* (n, 3); parameters (n, P)."""
    return rotate_towards(q, parameters, placed_mm, TURNS, LEAST_LEVER, MOST_TURN_RAD)


def compute_backwards_map(joints: F64) -> F64:
    """(n, N, 3) rad/mm: the smallest turn that moves the tip so, from d tip / d angle (n, 3, N)."""
    return compute_least_turns(joints, LEAST_LEVER)
