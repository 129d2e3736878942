"""What a fault is, and what it happens to: the words and rows of one case."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from outsider.chain import F64, Alteration
from outsider.measured import Machine, Readings, Thing

#: Of which a posture is a linear function.
SMALL_RAD = 1e-6
Shapes = tuple[Alteration, ...]
Rivals = tuple[tuple[str, Shapes], ...]


@dataclass(frozen=True)
class Fault:
    """One that may be planted, and how a diagnosis may call it (the words of the contract)."""

    cause: str
    location: str
    depends_on: tuple[str, ...]  # the variables of it, for what is named otherwise
    alter: Alteration
    words: str
    free: bool = True  # its size can be chosen
    largest: float = np.inf  # no real one is larger
    beside: tuple[tuple[str, str], ...] = ()  # names that are true of it as well
    same_signal: tuple[tuple[str, str], ...] = ()  # names that no readings tell from it
    needs: str = ""  # a variable without which the name is not the fault's
    #: other causes at its place, each with the shapes of it, of any size
    rivals: Rivals = ()
    #: what a reader who knows its cause leaves free, as large as `alter`; (): only its size
    shapes: Shapes = ()


@dataclass(frozen=True)
class Scene:
    """What the faults of one case happen to. *on*: rows from the fault's beginning on."""

    machine: Machine
    readings: Readings
    on: F64  # (n,) bool
    thing: Thing
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)  # gravity, base frame
    joint: int | None = None  # the only one, from 0, at which anything may be wrong; None: any

    @property
    def since_s(self) -> F64:
        """Since the first session in which the arm is not healthy."""
        time_s: F64 = self.readings.time_s - self.readings.time_s[self.on][0]
        return time_s

    @property
    def span_s(self) -> float:
        """Of the sessions that are diagnosed."""
        last = self.readings.session.max()
        return float(self.since_s[self.readings.session < last][-1])

    def none(self) -> Alteration:
        return Alteration.none(*self.readings.q.shape)

    def rivals_at(self, k: int, shapes: dict[str, tuple[F64, ...]]) -> Rivals:
        """By what each lets the encoder of joint k (from 0) show."""
        return tuple(
            (cause, tuple(self.at_joint(k, SMALL_RAD * by) for by in each))
            for cause, each in shapes.items()
        )

    def each_session(self) -> tuple[F64, ...]:
        """(n,) 1 in one session after the other, from the beginning on: a zero of its own each."""
        numbers = self.readings.session
        return tuple(1.0 * (numbers == number) for number in np.unique(numbers[self.on]))

    def waves_at(self, k: int, angles: Sequence[F64], share: F64 | float = 1.0) -> Shapes:
        """Sine and cosine of each angle (n,), times *share*, in the encoder of joint k (from 0)."""
        return tuple(
            self.at_joint(k, share * wave(angle)) for angle in angles for wave in (np.sin, np.cos)
        )

    def at_joint(self, k: int, by: F64) -> Alteration:
        """The encoder of joint k (from 0) shows *by* more, from the beginning on."""
        encoder = np.zeros_like(self.readings.q)
        encoder[:, k] = by * self.on
        return replace(self.none(), encoder=encoder)
