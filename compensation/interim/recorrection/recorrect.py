"""Re-correction of measurements from their stored angles and temperatures, by another calibration.

A measurement's angles are means over its points, like its position; over such a short path the
model is linear. Lags follow the temperatures from one measurement to the next.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from armd import Flag
from armd.arrays import F64
from armd.compensation.data.soundness.heat_flow import SensorHeat
from armd.compensation.data.soundness.turns import fold_turns
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration, list_used_sensors
from armd.compensation.model.state import States


@dataclass(frozen=True)
class Recorrected:
    """The positions of n measurements under a calibration."""

    position_mm: F64  # (n, 3) tip, base frame; NaN where an angle or a temperature is missing
    uncertainty_mm: F64  # (n, 3) standard; NaN where the calibration states none
    flags: npt.NDArray[np.uint32]  # (n,) INVALID, TEMPERATURE_RANGE, TEMPERATURE_STALE


def correct_again(arm: Arm, calibration: LoadedCalibration, states: States) -> Recorrected:
    """Compute the positions of *states* under *calibration*, with uncertainties and flags."""
    content = calibration.content
    model = Model(arm, calibration)
    possible_c = states.temperature_c.astype(np.float64)
    for column in possible_c.T:
        heat = SensorHeat(arm.reference_temperature_c)
        column[heat.impossible(column, states.time_s)] = np.nan
    states = replace(states, q=fold_turns(states.q, arm)[0], temperature_c=possible_c)
    slow = model.slow_values(states)
    position, _ = model.correct_rows(states, slow)
    uncertainty = model.uncertainty_rows(states, slow)
    invalid = ~np.isfinite(position).all(axis=1)
    if model.states_uncertainty:
        invalid |= ~np.isfinite(uncertainty).all(axis=1)
    position[invalid] = uncertainty[invalid] = np.nan
    used = list_used_sensors(arm, content)
    columns = [s for s, name in enumerate(arm.sensors) if name in used]
    ranges = [content.temperature_range_c.get(arm.sensors[s], (-np.inf, np.inf)) for s in columns]
    low, high = np.array(ranges).reshape(-1, 2).T
    celsius = states.temperature_c[:, columns]
    outside = ((celsius < low) | (celsius > high)).any(axis=1)
    for since, until in model.periods_unix_s:  # outside them terms are constant
        outside |= (states.time_s < since) | (states.time_s > until)
    flags = np.zeros(states.n, np.uint32)
    flags[invalid] |= int(Flag.INVALID)
    flags[outside] |= int(Flag.TEMPERATURE_RANGE)
    flags[np.isnan(celsius).any(axis=1)] |= int(Flag.TEMPERATURE_STALE)
    return Recorrected(position, uncertainty, flags)
