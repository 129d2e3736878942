"""The correction of readings to points, piece by piece.

A piece holds some ten thousand rows. `take` carries the state between rows (last temperatures,
lags) from piece to piece. `correct` computes all else, of any piece and from any thread.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from armd import Flag
from armd.arrays import F64, I64, Mask
from armd.compensation.data.sessions.columns import (
    APPROACH,
    LikeRadians,
    list_number_columns,
    read_angles,
    read_approaches,
    read_rates,
)
from armd.compensation.data.sessions.format import AngleUnit
from armd.compensation.data.soundness.temperature_columns import TemperatureColumns
from armd.compensation.data.soundness.turns import (
    AngleRange,
    are_decided,
    are_within_limits,
    describe_turns,
    fold_turns,
    report_open_turns,
)
from armd.compensation.data.tables.readings import (
    Readings,
)
from armd.compensation.data.tables.recorded import (
    RECORDED_TYPES,
    is_recorded,
    read_flags,
    read_instants_s,
)
from armd.compensation.data.tables.within import is_within
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration, list_used_sensors
from armd.compensation.model.pose_factors import Approach
from armd.compensation.model.slow_factors import Dated, SlowFactor
from armd.compensation.model.state import States
from armd.errors import BadInput

END_STOP_RAD = np.radians(0.5)


@dataclass(frozen=True)
class Taken:
    """Some readings, with all that depends on earlier ones."""

    states: States  # missing temperatures have the last value
    slow: F64  # (n, L+T) values of the model's slow factors
    stale: Mask  # (n,) a temperature in use is missing
    published: npt.NDArray[np.uint32] | None  # (n,) flags of the samples, of points recorded live


class Corrector:
    """Corrects one file's readings: `take` in their order, `correct` in any order, from
    any thread.
    """

    def __init__(
        self,
        arm: Arm,
        calibration: LoadedCalibration | None,
        unit: AngleUnit,
        started_unix_s: float | None,
    ) -> None:
        self._arm = arm
        self.columns = list_number_columns(arm)
        #: the calibration's identity, as points contain it
        self.identity = 0 if calibration is None else calibration.identity
        self._unit = unit
        self._like_radians = LikeRadians(arm, unit)
        self._started_unix_s = started_unix_s
        self._model = Model(arm, calibration)
        content = calibration.content if calibration else None
        self._always = Flag(0) if calibration else Flag.NOT_CALIBRATED
        factors = [factor for term in (content.terms if content else []) for factor in term.basis]
        self._needs_date = any(isinstance(factor, Dated) for factor in factors)
        self._needs_approach = any(isinstance(factor, Approach) for factor in factors)
        self._needs_time = self._needs_date or any(
            lag_s > 0
            for factor in factors
            if isinstance(factor, SlowFactor)
            for _, lag_s in factor.means
        )
        used = list_used_sensors(arm, content)
        self._used = [s for s, name in enumerate(arm.sensors) if name in used]
        ranges = content.temperature_range_c if content else {}
        low_high = [ranges.get(name, (-np.inf, np.inf)) for name in arm.sensors]
        self._range_c = np.array(low_high).reshape(-1, 2).T
        self._low, self._high = arm.limits_rad
        reference_c = content.reference_temperature_c if content else arm.reference_temperature_c
        self._held_c = np.full(len(arm.sensors), reference_c)
        self._temperature_columns = TemperatureColumns(arm, "F")
        self._open_joints = np.flatnonzero(~are_decided(arm))
        self._lowest, self._highest = np.full((2, arm.n_joints), np.nan)
        self._sames: dict[str, npt.NDArray[Any]] = {}
        #: sentences: values that were read and are not used as they are
        self.remarks: list[str] = []

    def select_columns(self, header: Collection[str]) -> dict[str, pa.DataType]:
        """Select the columns to read from a table with this *header*, with their types."""
        types: dict[str, pa.DataType] = {
            name: pa.float64() for name in self.columns if name in header
        }
        return types | (RECORDED_TYPES if is_recorded(header) else {})

    def take(self, readings: Readings) -> Taken:
        """Check and return the next readings of the file."""
        arm = self._arm
        # Operations on whole columns are several times faster in this memory order.
        q = read_angles(readings, arm, self._unit, missing_allowed=True, order="F")
        self._like_radians.take(readings, q)
        if not are_within_limits(q, arm):
            q, turns = fold_turns(q, arm)
            self.remarks += describe_turns(str(readings.path), turns)
        rate = self._rates(readings)
        recorded = is_recorded(readings.header)
        if recorded:
            time_s = read_instants_s(readings)
        else:
            timed = readings.has("time_s")
            time_s = readings.number("time_s") if timed else self._same(readings.n, np.nan)
        measured_c, _, remarks = self._temperature_columns.take(readings, time_s, "")
        self.remarks += remarks
        for k in self._open_joints:
            self._lowest[k] = np.fmin(self._lowest[k], np.fmin.reduce(q[:, k]))
            self._highest[k] = np.fmax(self._highest[k], np.fmax.reduce(q[:, k]))
        states = States(
            q=q,
            rate=rate,
            temperature_c=self._hold(measured_c),
            time_s=time_s if recorded else self._time_s(readings),
            approach=self._approaches(readings, q, rate),
            series=self._same(readings.n, 0),
        )
        slow = self._slow_values(states)
        stale: Mask = np.zeros(readings.n, bool)
        if states.temperature_c is not measured_c:  # some temperatures are missing
            stale = np.logical_or.reduce(np.isnan(measured_c[:, self._used]), axis=1)
        return Taken(states, slow, stale, read_flags(readings) if recorded else None)

    def ended(self, source: Path) -> None:
        """Finish *source*, which has no more readings; raises `BadInput` if their unit cannot be
        right.
        """
        self._like_radians.judge()
        middle = (self._lowest + self._highest) / 2
        turned = AngleRange(str(source), self._lowest, self._highest, middle)
        self.remarks += report_open_turns([turned], self._arm)[0]

    def correct(
        self, batch: Taken, *, uncertainty: bool = True
    ) -> tuple[F64, npt.NDArray[np.uint32]]:
        """Return positions and standard uncertainties (n, 6) mm, or positions (n, 3); and flags
        (n,).

        A row is NaN where an angle is missing or a number overflows. Uncertainties are also NaN
        where the calibration states none.
        """
        states = batch.states
        # Convert once to the order of the compiled functions, or each of them would do so.
        ordered = replace(states, q=np.ascontiguousarray(states.q))
        figures = np.empty((states.n, 6 if uncertainty else 3), order="F")  # by columns
        figures[:, :3] = judged = self._model.position_rows(ordered, batch.slow)
        if uncertainty:
            figures[:, 3:] = self._model.uncertainty_rows(ordered, batch.slow)
            if self._model.states_uncertainty:
                judged = figures
        if math.isfinite(judged.sum()):  # a missing angle makes NaN
            invalid = np.zeros(states.n, bool)
        else:
            invalid = np.logical_or.reduce(~np.isfinite(judged), axis=1)
        if batch.published is not None:  # a point that was withheld stays withheld
            invalid |= (batch.published & np.uint32(Flag.INVALID)) != 0
        if invalid.any():
            figures[invalid] = np.nan

        low_c, high_c = self._range_c
        outside = _beyond(states.temperature_c, low_c, high_c, self._used)
        for since, until in self._model.periods_unix_s:  # outside them terms are constant
            outside |= (states.time_s < since) | (states.time_s > until)
        low, high = self._low + END_STOP_RAD, self._high - END_STOP_RAD
        near_end = _beyond(states.q, low, high, range(len(low)))
        flags = np.full(states.n, int(self._always), np.uint32)
        if batch.published is not None:
            flags |= batch.published
        for flag, rows in (
            (Flag.INVALID, invalid),
            (Flag.TEMPERATURE_RANGE, outside),
            (Flag.TEMPERATURE_STALE, batch.stale),
            (Flag.END_STOP, near_end),
        ):
            if rows.any():
                flags |= np.where(rows, np.uint32(flag), np.uint32(0))
        return figures, flags

    def _slow_values(self, states: States) -> F64:
        """Return the values (n, L+T) of the slow factors.

        If they depend on temperatures only, repeated rows are computed once.
        """
        if self._needs_time:
            return np.ascontiguousarray(self._model.slow_values(states, onwards=True))
        first = _firsts(states.temperature_c)
        values = np.ascontiguousarray(self._model.slow_values(states.rows(first), onwards=True))
        return np.repeat(values, np.diff(first, append=states.n), axis=0)

    def _approaches(self, readings: Readings, q: F64, rate: F64) -> F64:
        if not self._needs_approach and not any(map(readings.has, APPROACH)):
            return self._same(readings.n, np.nan, 3)
        return read_approaches(readings, self._arm, q, rate, from_motion=self._needs_approach)

    def _rates(self, readings: Readings) -> F64:
        """Return joint rates (n, N), NaN in tables without them."""
        n_joints = self._arm.n_joints
        if any(readings.has(f"w{k}") for k in range(1, n_joints + 1)):
            return read_rates(readings, n_joints)
        return self._same(readings.n, np.nan, n_joints)

    def _same(self, n: int, value: float, *width: int) -> npt.NDArray[Any]:
        """Return an array (n, …) of this value, shared by all pieces; do not change it.

        A table without a column needs many of them, and filling new ones takes long.
        """
        name = f"{value!r} {width}"
        if name not in self._sames or n > len(self._sames[name]):
            self._sames[name] = np.full((n, *width), value)
        return self._sames[name][:n]

    def _hold(self, measured_c: F64) -> F64:
        """Return temperatures (n, S) with missing ones replaced by the last value, at first the
        reference.
        """
        if len(measured_c) and not np.isnan(measured_c.min(initial=0.0)):
            self._held_c = measured_c[-1].copy()
            return measured_c
        filled_c = np.vstack([self._held_c, measured_c])
        for column in filled_c.T:
            last = np.maximum.accumulate(np.where(np.isnan(column), 0, np.arange(len(column))))
            column[:] = column[last]
        self._held_c = filled_c[-1].copy()
        return filled_c[1:]

    def _time_s(self, readings: Readings) -> F64:
        if not self._needs_time:
            return self._same(readings.n, 0.0)
        if self._needs_date and self._started_unix_s is None:
            actual = "nothing"
            expected = "an instant: the calibration has terms that depend on the date"
            raise BadInput(readings.path, "--started", actual, expected)
        return readings.required("time_s") + (self._started_unix_s or 0.0)


def _beyond(values: F64, low: F64, high: F64, columns: Iterable[int]) -> Mask:
    """Return the rows (n,) of *values* (n, K) below *low* (K,) or above *high* in one
    of *columns*.
    """
    beyond = np.zeros(len(values), bool)
    for k in columns:
        if not is_within(values[:, k], low[k], high[k]):
            beyond |= (values[:, k] < low[k]) | (values[:, k] > high[k])
    return beyond


def _firsts(values: F64) -> I64:
    """Return the rows of *values* (n, K) that differ from the row before, and the first row."""
    differs = np.zeros(len(values), bool)
    differs[:1] = True
    for column in values.T:
        differs[1:] |= column[1:] != column[:-1]
    return np.flatnonzero(differs)
