"""What surrounds each reading: link temperatures, motion, time, how the tip was brought there."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armd.arrays import F64


@dataclass(frozen=True)
class Conditions:
    """The surroundings of n readings."""

    link_c: F64  # (n, N) true mean temperature of each link, °C
    rate: F64  # (n, N) joint rates, rad/s
    time_s: F64  # (n,) seconds since the arm was mounted
    approach: F64  # (n, 3) unit vector of approach, base frame
    ambient_c: F64  # (n,) °C

    @classmethod
    def at_rest(
        cls, n: int, n_joints: int, link_c: float | F64 = 20.0, ambient_c: float = 20.0
    ) -> Conditions:
        """n readings at rest at time 0, approached from above; *link_c* broadcasts to (n, N)."""
        return cls(
            link_c=np.broadcast_to(np.asarray(link_c, float), (n, n_joints)).copy(),
            rate=np.zeros((n, n_joints)),
            time_s=np.zeros(n),
            approach=np.tile([0.0, 0.0, -1.0], (n, 1)),
            ambient_c=np.full(n, ambient_c),
        )
