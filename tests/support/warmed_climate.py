"""A climate in which one link is warmed by itself."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armd.simulator.measured.plan import Climate
from armd.simulator.truth.heat import HeatField


def warmed(climate: Climate, link: int, kelvin: float) -> Climate:
    """*climate* with so much more power in one link (from 0) that it ends up *kelvin* warmer."""
    one_watt = np.zeros_like(climate.power_w)
    one_watt[link] = 1.0
    rise_k = HeatField().steady_c(0.0, one_watt)[link]
    return replace(climate, power_w=climate.power_w + kelvin / rise_k * one_watt)
