"""The slow factors of terms at one instant: what a temperature that arrives live costs.

The same functions as `basis` evaluates for many readings, translated once into flat arrays, so
that an instant is one compiled call; a test holds the two together.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import DAY_S, delay_name
from armd.compensation.model.state import advance, followed
from armd.compensation.model.terms import (
    SLOW_FACTORS,
    After,
    Daily,
    Period,
    Relaxation,
    SlowFactor,
    Temperature,
    TemperatureRate,
    Term,
    Time,
)
from armd.jit import jit

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]


POWER, ZONE, RATE, TIME, AFTER, RELAXATION, DAY = range(7)


class Program(NamedTuple):
    """The slow factors of T terms of an arm with S sensors."""

    weights: F64  # (D, S) of distinct mean temperatures, each delayed by a lag of its own
    lag_s: F64  # (D,)
    memory: F64  # (D, 3) how far each lag has come, as `model.state.advance` has it
    factors: I64  # (F, 3) distinct factors: kind, mean temperature or power, a second such
    numbers: F64  # (F, 3) what else a factor is made of
    factor_first: I64  # (T+1,) where a term's factors begin in `term_factors`
    term_factors: I64  # rows of `factors`
    means: F64  # (D,) scratch: values of the mean temperatures …
    values: F64  # (F,) … and of the factors


class SlowFactors:
    """Products of each term's slow factors, one instant after the other.

    A sensor without weight may be missing; a missing one with weight, or a missing time, gives NaN.
    """

    def __init__(self, terms: Sequence[Term], arm: Arm, reference_c: float) -> None:
        listed = [
            [factor for factor in term.basis if isinstance(factor, SLOW_FACTORS)] for term in terms
        ]
        distinct = {factor.model_dump_json(): factor for row in listed for factor in row}
        number = {key: f for f, key in enumerate(distinct)}
        means = {delay_name(*mean): mean for factor in distinct.values() for mean in _means(factor)}
        self._mean_of = {name: d for d, name in enumerate(means)}
        rows = [_code(factor, self._mean_of, reference_c) for factor in distinct.values()]
        self._n_terms, self._n_sensors = len(terms), len(arm.sensors)
        self._program = Program(
            weights=np.array(
                [[weights.get(name, 0.0) for name in arm.sensors] for weights, _ in means.values()]
            ).reshape(len(means), self._n_sensors),
            lag_s=np.array([lag_s for _, lag_s in means.values()], dtype=np.float64),
            memory=np.full((len(means), 3), np.nan),
            factors=np.array([row[:3] for row in rows], dtype=np.int64).reshape(-1, 3),
            numbers=np.array([row[3:] for row in rows], dtype=np.float64).reshape(-1, 3),
            factor_first=np.cumsum([0, *map(len, listed)]),
            term_factors=np.array(
                [number[factor.model_dump_json()] for row in listed for factor in row], np.int64
            ),
            means=np.zeros(len(means)),
            values=np.zeros(len(rows)),
        )

    def values(self, celsius: F64, unix_s: float, more_c: float = 0.0) -> tuple[F64, F64]:
        """Values (T,) at temperatures (S,) °C; lags are followed from call to call.

        And what they do, (S, T), if one sensor reads *more_c* more, as if every lag had settled;
        (0, T) for 0.
        """
        rows = np.empty((self._n_sensors + 2 if more_c else 1, self._n_terms))
        _evaluate(celsius, unix_s, more_c, self._program, rows)
        return rows[0], rows[2:]

    def forget(self) -> None:
        """The next temperatures start the lags, settled."""
        self._program.memory[:] = np.nan

    def delay(self, name: str, value: F64, time_s: F64, lag_s: float) -> F64:
        """Follows the same lags through many instants: a `Delay` for `basis_values`."""
        row = self._mean_of[name]
        memory = self._program.memory[row : row + 1]
        return followed(time_s, value[:, None], lag_s, memory)[:, 0]


def _means(factor: SlowFactor) -> list[tuple[dict[str, float], float]]:
    """Weights and lags of the mean temperatures that a factor is made of."""
    match factor:
        case Temperature():
            return [(factor.weights, factor.lag_s)]
        case TemperatureRate():
            return [(factor.weights, 0.0), (factor.weights, factor.smoothing_s)]
        case _:
            return []


def _code(
    factor: SlowFactor, mean_of: dict[str, int], reference_c: float
) -> tuple[int, int, int, float, float, float]:
    """A row of `Program.factors`, then one of `Program.numbers`."""
    means = [mean_of[delay_name(*mean)] for mean in _means(factor)]
    match factor:
        case Temperature(zone_c=None):
            reference_c = reference_c if factor.reference_c is None else factor.reference_c
            return POWER, means[0], factor.order, reference_c, 0.0, 0.0
        case Temperature(zone_c=(low, high)):
            return ZONE, means[0], factor.order, low, high, 0.0
        case TemperatureRate():
            return RATE, means[0], means[1], factor.smoothing_s, 0.0, 0.0
        case Time():
            return TIME, factor.power, 0, factor.since_unix_s, _until(factor), 0.0
        case Relaxation():
            period = factor.since_unix_s, _until(factor)
            return RELAXATION, 0, 0, *period, factor.time_constant_s
        case Daily():
            return DAY, int(factor.kind == "daily_sin"), 0, factor.since_unix_s, 0.0, 0.0
        case After():
            return AFTER, 0, 0, factor.instant_unix_s, 0.0, 0.0
    raise AssertionError(f"{factor.kind} is no slow factor")


def _until(factor: Period) -> float:
    return math.inf if factor.until_unix_s is None else factor.until_unix_s


@jit
def _evaluate(celsius: F64, unix_s: float, more_c: float, program: Program, rows: F64) -> None:
    """Row 0 as it is, row 1 with settled lags, row 2 + s what sensor s changes in that."""
    weights, lag_s, memory, factors, numbers, factor_first, term_factors, means, known = program
    for row in range(len(rows)):
        for d in range(len(lag_s)):
            mean = 0.0
            for s in range(len(celsius)):
                if weights[d, s] != 0.0:
                    mean += weights[d, s] * (celsius[s] + more_c if row == 2 + s else celsius[s])
            if lag_s[d] != 0.0:
                if row == 0:
                    mean = advance(mean, unix_s, lag_s[d], memory, d)
                elif math.isnan(unix_s):
                    mean = math.nan
            means[d] = mean
        _set_factors(unix_s, means, factors, numbers, known)
        for t in range(rows.shape[1]):
            value = 1.0
            for j in range(factor_first[t], factor_first[t + 1]):
                value *= known[term_factors[j]]
            rows[row, t] = value if row < 2 else value - rows[1, t]


@jit
def _set_factors(unix_s: float, means: F64, factors: I64, numbers: F64, values: F64) -> None:
    for f in range(len(factors)):
        kind, a, b = factors[f, 0], factors[f, 1], factors[f, 2]
        number, other = numbers[f, 0], numbers[f, 1]
        if kind == POWER:
            value = (means[a] - number) ** b
        elif kind == ZONE:
            value = means[a]
            if value < number:
                value = number
            if value > other:
                value = other
            value = (value - number) ** b
        elif kind == RATE:
            value = (means[a] - means[b]) / number
        elif kind in (TIME, RELAXATION):
            value = unix_s  # NaN stays
            if value < number:
                value = number
            if value > other:
                value = other
            if kind == TIME:
                value = ((value - number) / 3600) ** a
            else:
                value = -math.expm1(-(value - number) / numbers[f, 2])
        elif kind == DAY:
            turn = math.tau * (unix_s - number) / DAY_S
            value = math.sin(turn) if a == 1 else math.cos(turn)
        elif math.isfinite(unix_s):
            value = 1.0 if unix_s >= number else 0.0
        else:
            value = math.nan
        values[f] = value
