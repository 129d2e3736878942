"""The largest plausible size of a cause, by the unit of its amplitude and not by its name.

Causes with equal signatures differ by name only. If a graduation could be 5′ at most and a wheel
8′, a graduation of 6′ would be refused. A wheel with as many teeth would be found in its place,
with high probability. So the limit depends on the unit of an amplitude, and is that of the largest
cause with this unit.
"""

from __future__ import annotations

import math

from armd.compensation.effects.effect import Column
from armd.compensation.wording import ARC_SECOND

#: The largest error of an angle: a disc of 50 mm that is 0.1 mm off its axis, more than any
#: centring leaves.
ANGLE_RAD = 900 * ARC_SECOND
#: The limits of units of angles, as shares of that. "rad": a wave of an encoder or a gear, a tilt
#: of an axis, half of a joint's backlash. "rad/rad": a gain as steep as a disc's wave. "rad/K":
#: this error at six kelvin. "rad/K^2": a square that equals the linear limit at ten kelvin.
OF_AN_ANGLE = {"rad": 1.0, "rad/rad": 1.0, "rad/K": 1 / 6, "rad/K^2": 1 / 60}
#: The largest compliance of a joint or a link: 100 Nm would turn it by 7°.
COMPLIANCE_RAD_PER_NM = 1.2e-3
#: The largest expansion of a link, late or not, and of the artefact: ten times that of plastics.
GROWTH_PER_K = 2.25e-3


def find_largest(column: Column) -> float:
    """Return the largest plausible size of an amplitude, in its unit, on an arm as coarse as this
    one.

    It is inf if there is no limit for its unit, or if the column has a `reach` of its own.
    """
    if not math.isinf(column.reach):
        return math.inf
    of_unit = {unit: share * ANGLE_RAD for unit, share in OF_AN_ANGLE.items()} | {
        "rad/Nm": COMPLIANCE_RAD_PER_NM,
        "1/K": GROWTH_PER_K,
    }
    return of_unit.get(column.unit, math.inf) * column.coarseness
