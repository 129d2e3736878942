"""Several faults of different causes at once, each so large that what is due can be told.

A fault is *due* by what is left of it where nobody knows how large the others are, nor the phase
of a wave: clear of constants, poses and all that a reader who knows the others' causes leaves free.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from outsider.angles import ANGLES
from outsider.around import AROUND
from outsider.chain import F64, Alteration
from outsider.faults import FAULTS, UNDER_A_CALIBRATION
from outsider.measured import Rng
from outsider.scene import Fault, Scene
from outsider.seen import Seen
from outsider.sizes import SMALL, rows_of, sized, with_its_like

KNOWN = FAULTS | ANGLES | AROUND
#: Kinds of one cause, of which a crowd has at most one: those that may sit at one joint, and all.
AT_ONE_JOINT = (
    ("disc",), ("dahl", "stribeck", "play"), ("relax",), ("slip",), ("mesh",), ("gain",),
    ("wave",), ("warmed",),
)  # fmt: skip
ANYWHERE = (
    ("disc",), ("dahl", "stribeck", "play"), ("relax",), ("slip", "replaced"), ("mesh",),
    ("gain",), ("wave",), ("warmed",), ("sag",), ("lag",), ("offset",), ("exchanged",),
    ("settling",), ("touched",), ("alloy",), ("certificate",),
)  # fmt: skip
#: Noise units of each; what has the size that it has may have more.
LEAST, MOST, MOST_AS_IT_IS = 8.0, 25.0, 40.0
#: Of a fault's size alone, what the others leave of it: with less, the two are nearly one signal.
APART = 0.3
#: Changes of one fault for another before a crowd begins anew elsewhere.
CHANGES = 60


@dataclass(frozen=True)
class One:
    """A fault of a crowd."""

    fault: Fault
    clear_units: float  # noise units clear of constants, poses and all that the others leave free
    plain_units: float  # clear of constants, poses and the others as they are, of any size


def crowd(rng: Rng, scene: Scene, seen: Seen, known: F64) -> list[One]:
    """Four or five, anywhere. *known*: (n,) bool, the rows that *seen* has."""
    held = not scene.on.all()
    causes = [names for names in ANYWHERE if held or names[0] not in UNDER_A_CALIBRATION]
    them = None
    while them is None:
        them = _drawn(rng, scene, seen, known, causes, int(rng.integers(4, 6)))
    return them


def one_joint(rng: Rng, scene: Scene, seen: Seen, known: F64) -> list[One]:
    """Three to five, all at one joint."""
    them = None
    while them is None:
        there = replace(scene, joint=int(rng.integers(1, scene.machine.joints - 1)))
        them = _drawn(rng, there, seen, known, AT_ONE_JOINT, int(rng.integers(3, 6)))
    return them


CROWDS: dict[str, Callable[[Rng, Scene, Seen, F64], list[One]]] = {
    "crowd": crowd, "one_joint": one_joint,
}  # fmt: skip


def free_shapes(fault: Fault) -> tuple[Alteration, ...]:
    """All that a reader leaves free who knows the fault's cause, where everything is linear."""
    own = fault.alter.times(SMALL / _size(fault.alter))
    return (own, *(shape.times(SMALL / _size(shape)) for shape in fault.shapes))


def _size(alter: Alteration) -> float:
    """The largest of all its figures; 1 if there is none."""
    return max(float(np.abs(part).max()) for part in vars(alter).values()) or 1.0


def _drawn(
    rng: Rng, scene: Scene, seen: Seen, known: F64, causes: Sequence[tuple[str, ...]], count: int
) -> list[One] | None:
    """Whatever is too small, too large or too like the others is changed for another; `None` if
    that comes to no end."""
    chosen: dict[int, Fault] = {}
    for _ in range(CHANGES):
        while len(chosen) < count:
            number = int(rng.choice([i for i in range(len(causes)) if i not in chosen]))
            variants = KNOWN[str(rng.choice(causes[number]))](rng, scene)
            chosen[number] = variants[int(rng.integers(len(variants)))]
        bad, them = _sized_together(rng, list(chosen.values()), scene, seen, known)
        if not bad:
            return them
        del chosen[list(chosen)[int(rng.choice(bad))]]
    return None


def _sized_together(
    rng: Rng, faults: list[Fault], scene: Scene, seen: Seen, known: F64
) -> tuple[list[int], list[One]]:
    """The numbers of those that do not do among these; and all, sized."""
    shapes = [[rows_of(shape, known) for shape in free_shapes(fault)] for fault in faults]
    bad, them = [], []
    for i, fault in enumerate(faults):
        beside = [shape for j, each in enumerate(shapes) if j != i for shape in each]
        left = seen.noise_units(shapes[i][0], beside) / seen.noise_units(shapes[i][0])
        units, wanted = 0.0, float(np.exp(rng.uniform(np.log(LEAST), np.log(MOST))))
        size = SMALL / _size(fault.alter) * wanted / seen.noise_units(shapes[i][0], beside)
        if left > APART and (not fault.free or size <= fault.largest):
            fault = sized([fault], seen, known, wanted, beside)
            units = seen.noise_units(rows_of(fault.alter, known), beside)
        if not LEAST - 0.1 <= units <= MOST_AS_IT_IS:
            bad.append(i)
        them.append((with_its_like(fault, seen, scene, known, beside), units))
    alters = [rows_of(fault.alter, known) for fault, _ in them]
    return bad, [
        One(fault, units, seen.noise_units(alters[i], alters[:i] + alters[i + 1 :]))
        for i, (fault, units) in enumerate(them)
    ]
