"""The slow factors of terms at one instant, evaluated when a live temperature arrives.

The functions are those that `basis` evaluates for many readings. They are translated once into flat
arrays, so that an instant is one compiled call; a test compares the two.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.model.arm import Arm
from armd.compensation.model.instants import name_delay
from armd.compensation.model.slow_factors import DAY_S, SlowFactor
from armd.compensation.model.state import follow_lag, update_lag
from armd.compensation.model.terms import Term
from armd.compiled.jit import jit

KINDS = ("power", "zone", "rate", "time", "after", "relaxation", "day")
POWER, ZONE, RATE, TIME, AFTER, RELAXATION, DAY = range(7)


class SlowProgram(NamedTuple):
    """The slow factors of T terms of an arm with S sensors."""

    weights: F64  # (D, S) of distinct mean temperatures, each delayed by a lag of its own
    lag_s: F64  # (D,)
    memory: F64  # (D, 3) the state of each lag, as in `model.state.update_lag`
    factors: I64  # (F, 3) distinct factors: kind, mean temperature or power, a second such
    numbers: F64  # (F, 3) the other numbers of a factor
    factor_first: I64  # (T+1,) where a term's factors begin in `term_factors`
    term_factors: I64  # rows of `factors`
    means: F64  # (D,) scratch: values of the mean temperatures …
    values: F64  # (F,) … and of the factors


class SlowFactors:
    """The product of each term's slow factors, one instant after the other.

    A sensor without weight may be missing; a missing one with weight, or a missing time, gives NaN.
    """

    def __init__(self, terms: Sequence[Term], arm: Arm, reference_c: float) -> None:
        listed = [
            [factor for factor in term.basis if isinstance(factor, SlowFactor)] for term in terms
        ]
        distinct = {factor.model_dump_json(): factor for row in listed for factor in row}
        number = {key: f for f, key in enumerate(distinct)}
        means = {name_delay(*mean): mean for factor in distinct.values() for mean in factor.means}
        self._mean_of = {name: d for d, name in enumerate(means)}
        rows = [_row(factor, self._mean_of, reference_c) for factor in distinct.values()]
        self._n_terms, self._n_sensors = len(terms), len(arm.sensors)
        self._program = SlowProgram(
            weights=np.array(
                [[weights.get(name, 0.0) for name in arm.sensors] for weights, _ in means.values()]
            ).reshape(len(means), self._n_sensors),
            lag_s=np.array([lag_s for _, lag_s in means.values()], dtype=np.float64),
            memory=np.full((len(means), 3), np.nan),
            factors=np.array([integers for integers, _ in rows], dtype=np.int64).reshape(-1, 3),
            numbers=np.array([floats for _, floats in rows], dtype=np.float64).reshape(-1, 3),
            factor_first=np.cumsum([0, *map(len, listed)]),
            term_factors=np.array(
                [number[factor.model_dump_json()] for row in listed for factor in row], np.int64
            ),
            means=np.zeros(len(means)),
            values=np.zeros(len(rows)),
        )

    def values(self, celsius: F64, unix_s: float, more_c: float = 0.0) -> tuple[F64, F64]:
        """Compute values (T,) at temperatures (S,) °C; lags are followed from call to call.

        Also return their changes (S, T) if one sensor reads *more_c* more, as if every lag had
        settled; (0, T) for 0.
        """
        rows = np.empty((self._n_sensors + 2 if more_c else 1, self._n_terms))
        evaluate(celsius, unix_s, more_c, self._program, rows)
        return rows[0], rows[2:]

    def copy_program(self) -> SlowProgram:
        """Return a copy with separate lags and scratch, for `evaluate` in any thread."""
        program = self._program
        return program._replace(
            memory=np.full_like(program.memory, np.nan),
            means=program.means.copy(),
            values=program.values.copy(),
        )

    def forget(self) -> None:
        """Restart the lags, settled at the next temperatures."""
        self._program.memory[:] = np.nan

    def delay(self, name: str, value: F64, time_s: F64, lag_s: float) -> F64:
        """Follow the same lags through many instants: a `Delay` for `compute_basis_values`."""
        row = self._mean_of[name]
        memory = self._program.memory[row : row + 1]
        return follow_lag(time_s, value[:, None], lag_s, memory)[:, 0]


def _row(factor: SlowFactor, mean_of: dict[str, int], reference_c: float) -> tuple[list[int], F64]:
    """Return rows of `SlowProgram.factors` and `SlowProgram.numbers`."""
    means = [mean_of[name_delay(*mean)] for mean in factor.means]
    kind, first, second, numbers = factor.slow_code(means, reference_c)
    return [KINDS.index(kind), first, second], np.pad(numbers, (0, 3 - len(numbers)))


@jit
def evaluate(celsius: F64, unix_s: float, more_c: float, program: SlowProgram, rows: F64) -> None:
    """Evaluate all terms: row 0 with lags, row 1 with settled lags, row 2 + s the change by sensor
    s.
    """
    weights, lag_s, memory, factors, numbers, factor_first, term_factors, means, values = program
    for row in range(len(rows)):
        for d in range(len(lag_s)):
            mean = 0.0
            for s in range(len(celsius)):
                if weights[d, s] != 0.0:
                    mean += weights[d, s] * (celsius[s] + more_c if row == 2 + s else celsius[s])
            if lag_s[d] != 0.0:
                if row == 0:
                    mean = update_lag(mean, unix_s, lag_s[d], memory, d)
                elif math.isnan(unix_s):
                    mean = math.nan
            means[d] = mean
        _set_factors(unix_s, means, factors, numbers, values)
        for t in range(rows.shape[1]):
            value = 1.0
            for j in range(factor_first[t], factor_first[t + 1]):
                value *= values[term_factors[j]]
            rows[row, t] = value if row < 2 else value - rows[1, t]


@jit
def _set_factors(unix_s: float, means: F64, factors: I64, numbers: F64, values: F64) -> None:
    for f in range(len(factors)):
        kind, a, b = factors[f, 0], factors[f, 1], factors[f, 2]
        number, limit = numbers[f, 0], numbers[f, 1]
        if kind == POWER:
            value = (means[a] - number) ** b
        elif kind == ZONE:
            value = means[a]
            if value < number:
                value = number
            if value > limit:
                value = limit
            value = (value - number) ** b
        elif kind == RATE:
            value = (means[a] - means[b]) / number
        elif kind in (TIME, RELAXATION, DAY):
            value = unix_s  # NaN stays NaN
            if value < number:
                value = number
            if value > limit:
                value = limit
            value -= number
            if kind == TIME:
                value = (value / 3600) ** a
            elif kind == RELAXATION:
                value = -math.expm1(-value / numbers[f, 2])
            else:
                turn = math.tau * value / DAY_S
                value = math.sin(turn) if a == 1 else math.cos(turn)
        elif math.isfinite(unix_s):
            value = 1.0 if unix_s >= number else 0.0
        else:
            value = math.nan
        values[f] = value
