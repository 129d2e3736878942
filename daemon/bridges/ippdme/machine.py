"""The arm as a measuring machine: its position, its measurements, and its active tool."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from armd import Flag
from armd.arrays import F64
from armd.daemon.bridges.ippdme.csy import CoordinateSystems
from armd.daemon.bridges.ippdme.errors import DmeError
from armd.daemon.bridges.ippdme.tools import Toolbox
from armd.daemon.bridges.tips import Tips, compute_shaft

#: Without a point for this long, the arm counts as disconnected.
SILENT_S = 1.0

SelectTip = Callable[[str, Callable[[bool], None]], None]
"""Ask the daemon for a tip by name ("": its own); it calls back with whether it was done."""


class Machine:
    """The measuring machine, one for all clients, without network and dialogue."""

    def __init__(
        self,
        tips: Tips,
        toolbox: Toolbox,
        systems: CoordinateSystems,
        select_tip: SelectTip,
        reach_mm: float = math.inf,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Create the machine; no tip is further than *reach_mm* from the base frame's origin."""
        self.tips = tips
        self.toolbox = toolbox
        self.systems = systems
        self.select_tip = select_tip
        self.reach_mm = reach_mm
        self.in_session: object | None = None
        """The one client that is."""
        self.temperatures_c: dict[str, float | None] = {}
        self.part = {"Temperature": 20.0, "XpanCoefficient": 0.0}
        self._clock = clock
        self._point: tuple[F64, Any] | None = None  # position and orientation; None: invalid
        self._heard_s = -math.inf
        self._lost = True

    def note_point(self, point: np.void) -> None:
        """Store the latest point, a record of `POINT`."""
        self._heard_s = self._clock()
        if int(point["flags"]) & Flag.INVALID:
            self._point = None
        else:
            self._point = point["position_mm"].copy(), point["orientation"].tolist()

    @property
    def in_reach(self) -> bool:
        """Whether points arrive."""
        return self._clock() - self._heard_s < SILENT_S

    @property
    def homed(self) -> bool:
        """Whether the joints are known: points arrive, and are valid."""
        return self.in_reach and self._point is not None

    def take_loss(self) -> bool:
        """Return True once each time that points stop arriving."""
        before, self._lost = self._lost, not self.in_reach
        return self._lost and not before

    def position(self) -> F64:
        """Return the ball's centre now, in the selected coordinate system; raises `DmeError`."""
        return self.systems.position(self._valid_point()[0])

    def alignment(self) -> F64:
        """Return the shaft's unit vector from tip to wrist, in the selected coordinate system.

        Raises `DmeError`.
        """
        orientation = self._valid_point()[1]
        tip = self.toolbox.current.tip or self.tips.get(None)
        return self.systems.direction(np.array(compute_shaft(orientation, tip)))

    def _valid_point(self) -> tuple[F64, Any]:
        if not self.in_reach:
            raise DmeError(503)
        if self._point is None:
            raise DmeError(1000)
        return self._point

    def check_reach(self, nominal: Mapping[str, float]) -> None:
        """Check that a tip can be at *nominal* (coordinates by axis); raises `DmeError`."""
        x, y, z = self.systems.position(np.zeros(3)).tolist()
        base = {"X": x, "Y": y, "Z": z}
        if math.hypot(*(value - base[axis] for axis, value in nominal.items())) > self.reach_mm:
            raise DmeError(1008)

    def hit(self, measurement: Mapping[str, Any]) -> dict[str, tuple[float, ...]]:
        """Return a measurement's fields as OnPtMeasReport names them; it must have a position."""
        position = self.systems.position(np.array(measurement["position_mm"]))
        out = self.systems.direction(np.array(self.tips.out_of_material(measurement)))
        x, y, z = position.tolist()
        return {
            "X": (x,),
            "Y": (y,),
            "Z": (z,),
            "IJK": tuple(out.tolist()),
            "ER": (self.tips.used_in(measurement).radius_mm,),
            "Q": (max((flag.quality for flag in Flag(measurement["flags"])), default=0),),
            "IJKAct": (0,),
        }
