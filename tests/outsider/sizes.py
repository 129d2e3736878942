"""How large a fault is made, and which other names its readings have for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from outsider.chain import F64, Alteration
from outsider.scene import Fault, Scene
from outsider.seen import Seen

#: A rival that leaves less than this of a fault, in noise units, is the same to any reader of these
#: readings.
TOLD_APART = 3.0
#: Times a shape of size one: where everything is linear.
SMALL = 1e-6


def sized(
    variants: Sequence[Fault],
    seen: Seen,
    known: F64,
    wanted: float,
    beside: Sequence[Alteration] = (),
) -> Fault:
    """The variant nearest to the noise units wanted, clear of *beside*; one whose size is free is
    brought there, the first that is then no larger than a real one, or the least too large.

    *known*: (n,) bool, the rows that *seen* and *beside* have."""
    found = []
    for one in variants:
        units, excess = seen.noise_units(rows_of(one.alter, known), beside), 1.0
        if one.free and units > 0:
            small = one.alter.times(SMALL)
            size = SMALL * wanted / seen.noise_units(rows_of(small, known), beside)
            one = replace(one, alter=one.alter.times(size), words=f"{one.words} × {size:.3g}")
            units, excess = wanted, max(size / one.largest, 1.0)
        found.append((abs(np.log(max(units, 1e-9) / wanted)), excess, one))
    return min(found, key=lambda each: each[:2])[2]


def with_its_like(
    fault: Fault, seen: Seen, scene: Scene, known: F64, beside: Sequence[Alteration] = ()
) -> Fault:
    """With the rivals that leave next to nothing of it, clear of *beside*, as names of the same
    signal."""
    alter = rows_of(fault.alter, known)
    left = {
        (cause, fault.location): seen.noise_units(
            alter, [*(rows_of(one, known) for one in shapes), *beside]
        )
        for cause, shapes in fault.rivals
    }
    if fault.cause == "sensor_offset":  # beside a sensor that hardly matters, an exchange mends it
        for one, other in combinations(range(scene.machine.joints), 2):
            mended = rows_of(read_exchanged(scene, fault.alter, one, other), known)
            name = ("sensor_swapped", f"sensors t{one + 1}, t{other + 1}")
            left[name] = seen.noise_units(mended, beside)
    like = tuple(name for name, units in left.items() if units < TOLD_APART)
    words = [fault.words, *(f"{' '.join(name)} leaves {left[name]:.1f}" for name in like)]
    return replace(
        fault, words=", ".join(words), same_signal=(*fault.same_signal, *like)
    )  # fmt: skip


def read_exchanged(scene: Scene, alter: Alteration, one: int, other: int) -> Alteration:
    """What is left wrong if somebody takes two sensors, from 0, as altered, for exchanged."""
    sensor, shown = alter.sensor.copy(), scene.readings.warm + alter.sensor
    for own, from_ in ((one, other), (other, one)):
        sensor[scene.on, own] = (shown[:, from_] - scene.readings.warm[:, own])[scene.on]
    return replace(alter, sensor=sensor)


def rows_of(alter: Alteration, rows: F64) -> Alteration:
    return Alteration(*(part[rows] for part in vars(alter).values()))
