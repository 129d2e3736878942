"""How large a cause can be at most: what it does to the arm says so, whatever its name.

What errs along the same shape is told apart by its shape alone. If a graduation could be 5′ at most
and a wheel 8′, a graduation of 6′ would be refused, and a wheel that has the same teeth would stand
in for it, surely. So the limit goes by what an amplitude is of, its unit, and is that of the
largest cause of this kind.
"""

from __future__ import annotations

import math

from armd.compensation.effects.effect import Column
from armd.compensation.wording import ARC_SECOND

#: What an angle errs by: a disc of 50 mm that sits 0.1 mm off its axis, which no centring leaves.
ANGLE_RAD = 900 * ARC_SECOND
#: What is of an angle's error, as shares of that: a wave of an encoder or a gear, a tilt of an
#: axis, half of a joint's play; a gain as steep as a disc's wave; what six kelvin bring there, and
#: a square that comes to as much at ten kelvin as what grows evenly.
OF_AN_ANGLE = {"rad": 1.0, "rad/rad": 1.0, "rad/K": 1 / 6, "rad/K^2": 1 / 60}
#: Of a joint or a link: by 100 Nm it would turn by 7°.
COMPLIANCE_RAD_PER_NM = 1.2e-3
#: Of a link, late or not, and of the artefact: ten times what plastics grow by.
GROWTH_PER_K = 2.25e-3


def find_largest(column: Column) -> float:
    """The largest size that an amplitude can have, in its unit, on an arm as coarse as this one;
    inf where nothing is said of its unit, or the column itself says what is plausible."""
    if not math.isinf(column.reach):
        return math.inf
    of_unit = {unit: share * ANGLE_RAD for unit, share in OF_AN_ANGLE.items()} | {
        "rad/Nm": COMPLIANCE_RAD_PER_NM,
        "1/K": GROWTH_PER_K,
    }
    return of_unit.get(column.unit, math.inf) * column.coarseness
