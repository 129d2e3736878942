"""A link's length is not a linear function of its temperature."""

from collections.abc import Iterator

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    list_lengths,
    make_temperature,
    tie,
)
from armd.compensation.wording import format_plain

TYPICAL = {2: 8e-8, 3: 8e-9, 4: 8e-10}
#: One order, or all: a coefficient that rises from one value to another is no single power.
ORDERS = ((2,), (3,), (2, 3, 4))


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        weights, lengths_mm = facts.weights(k), list_lengths(facts, k)
        if not (weights and lengths_mm):
            continue
        for orders in ORDERS:
            columns = tuple(
                Column(
                    "per kelvin to the order",
                    f"1/K^{order}",
                    TYPICAL[order],
                    tie(lengths_mm, make_temperature(weights, order=order)),
                )
                for order in orders
            )
            setting = (("order", float(max(orders)), "1"),)
            place = location.link(k)
            yield Candidate("nonlinear_expansion", place, columns, tuple(weights), setting)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    orders = [int(column.unit.rpartition("^")[2]) for column in candidate.columns]
    off = sum(value * 5.0**order for value, order in zip(amplitudes, orders, strict=True))
    return (
        f"{candidate.location} at 5 K from the reference is "
        f"{format_plain(abs(off) * 1e6)} µm per metre off the straight line"
    )


EFFECT = Effect(
    "nonlinear_expansion",
    "composites, glue and preloaded joints expand in a curve",
    "a higher thermal order of the calibration, which absorbs it",
    "measure at the two ends and the middle of the temperature range",
    list_candidates,
    describe,
    "temperatures that vary over the readings, and the sensor of each joint in arm.toml",
    by_temperature=True,
)
