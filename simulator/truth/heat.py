"""The arm's temperature field: heat that flows between links, into the air, from the electronics.

Each link is one thermal mass; its ends conduct to its neighbours and its skin loses heat to the
air. A sensor in each link follows it with its own lag. The equations are linear, so a step of any
length is solved exactly.
"""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.simulator.truth.nominal import list_parts

#: Heat capacity of each link, J/K: mass × 900 J/(kg K), as for aluminium and carbon.
CAPACITY = 900.0 * np.array([2.4, 1.7, 0.9, 1.1, 0.5, 0.4])
#: Heat given to still air by each link's skin, W/K: about 8 W/(m² K) on its surface.
TO_AIR = np.array([0.85, 0.70, 0.40, 0.50, 0.25, 0.22])
#: Conduction from each link to the next through bearing and housing, W/K.
TO_NEXT = np.array([0.10, 0.12, 0.10, 0.06, 0.05])
#: Time constant with which a sensor follows the link it is embedded in, s.
SENSOR_LAG_S = np.array([25.0, 20.0, 20.0, 20.0, 15.0, 15.0])


class HeatField:
    """Temperatures of the links and their sensors, one each, advanced by `step`.

    *core_lag_s* (N,): the time constant of the body of a link behind its shell. The body's
    temperature sets the link's length; the sensor is in the shell. 0: the link is one body.
    """

    def __init__(
        self, start_c: float | F64 = 20.0, core_lag_s: F64 | None = None, joints: int = 6
    ) -> None:
        n, which = joints, list_parts(joints)
        lag = np.zeros(n) if core_lag_s is None else np.asarray(core_lag_s, float)
        self._to_air: F64 = TO_AIR[which]
        flow = np.diag(-self._to_air)
        for k, conduction in enumerate(TO_NEXT[which[:-1]]):
            flow[k, k] -= conduction
            flow[k + 1, k + 1] -= conduction
            flow[k, k + 1] += conduction
            flow[k + 1, k] += conduction
        # Shells, then sensors, then cores; a link of one body has an unused core.
        follow = np.concatenate([SENSOR_LAG_S[which], np.where(lag > 0, lag, 1.0)])
        matrix = np.zeros((3 * n, 3 * n))
        matrix[:n, :n] = flow / CAPACITY[which, None]
        matrix[n:, :n] = np.tile(np.eye(n), (2, 1)) / follow[:, None]
        matrix[n:, n:] = np.diag(-1 / follow)
        self._flow = flow
        self._layered = lag > 0
        # dT/dt = M·(T − steady): decays by the modes of M. They are real, because conduction is
        # symmetric and sensors and cores have no effect on shells.
        decay, modes = np.linalg.eig(matrix)
        self._decay: F64 = np.real(decay).astype(np.float64)
        self._modes: F64 = np.real(modes).astype(np.float64)
        self._state: F64 = np.empty(3 * n)
        self._state.reshape(3, n)[:] = start_c

    def step(self, dt_s: float, ambient_c: float, self_heating_w: float | F64) -> None:
        """Advance by *dt_s* with constant air temperature and power (N,) or one for all, W."""
        steady = np.tile(self.steady_c(ambient_c, self_heating_w), 3)
        away = np.linalg.solve(self._modes, self._state - steady)
        self._state = steady + self._modes @ (np.exp(self._decay * dt_s) * away)

    def steady_c(self, ambient_c: float, self_heating_w: float | F64) -> F64:
        """Return the final link temperatures (N,) under these conditions, °C."""
        power = np.broadcast_to(np.asarray(self_heating_w, float), self._to_air.shape)
        source = power + self._to_air * ambient_c
        return np.linalg.solve(self._flow, -source).astype(np.float64)

    def settle(self, ambient_c: float, self_heating_w: float | F64) -> None:
        """Set links and sensors to their final temperatures."""
        self._state = np.tile(self.steady_c(ambient_c, self_heating_w), 3)

    @property
    def link_c(self) -> F64:
        """The true mean temperatures of the links (N,), °C."""
        shell, _, core = self._state.reshape(3, -1)
        body: F64 = np.where(self._layered, core, shell)
        return body

    @property
    def sensor_c(self) -> F64:
        """The temperatures of the sensors (S,), °C, before noise and quantisation."""
        _, sensor, _ = self._state.reshape(3, -1)
        return np.array(sensor, dtype=np.float64)
