"""The results of a verification: figures of the standards, each with its deviations."""

from __future__ import annotations

from dataclasses import dataclass, field

from armd.arrays import F64


@dataclass(frozen=True)
class Deviation:
    """One result: a signed error or a spread, with the test's own standard uncertainty."""

    label: str
    value_mm: float
    standard_uncertainty_mm: float
    length_mm: float = 0.0
    placement: str = ""
    offsets_mm: F64 | None = field(default=None, compare=False, repr=False)
    """(n, 3) of the points behind it, from the sphere's centre or from the seat's mean."""


@dataclass(frozen=True)
class Figure:
    """One figure of a standard; each of its deviations has to lie within the limit."""

    key: str  # as in mpe.toml, without _mm
    name: str  # as the standard calls it
    standard: str
    deviations: tuple[Deviation, ...]

    @property
    def worst(self) -> Deviation:
        return max(self.deviations, key=lambda deviation: abs(deviation.value_mm))


@dataclass(frozen=True)
class Verification:
    figures: tuple[Figure, ...]
    left_out: dict[str, str]  # figure key → reason
    remarks: tuple[str, ...]
    far_off: tuple[str, ...] = ()  # readings far off, in words; they are used
