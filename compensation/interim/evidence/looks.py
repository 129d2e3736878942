"""Checks after which no change was told, as far as watching goes on from them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: What the same checks say of a change known differs by roundings alone, far less than this share.
SAME = 1e-7


@dataclass(frozen=True)
class QuietRun:
    """What came of checks one after another, after none of which a change was told: all that
    watching the later ones needs of it."""

    statistic: tuple[float, ...] = ()  # after each of them
    bad: tuple[int, ...] = ()  # those of them and before that will not be doubted again


NOTHING_YET = QuietRun()


@dataclass(frozen=True)
class EpochLook:
    """One look at an epoch's checks, from *since* on: what was known then, and what came of it."""

    since: int
    left_out: tuple[int, ...]  # checks before that are bad
    known_changes: tuple[float, ...]  # the changes known, as numbers
    quiet: QuietRun

    @property
    def until(self) -> int:
        return self.since + len(self.quiet.statistic)

    @property
    def finite(self) -> bool:
        return all(math.isfinite(value) for value in (*self.known_changes, *self.quiet.statistic))

    def is_at(self, since: int, left_out: Sequence[int], known_changes: Sequence[float]) -> bool:
        return (
            (self.since, self.left_out) == (since, tuple(left_out))
            and len(self.known_changes) == len(known_changes)
            and bool(np.allclose(self.known_changes, known_changes, rtol=SAME, atol=0.0))
        )  # fmt: skip


@dataclass(frozen=True)
class EpochLooks:
    """All looks at an epoch's checks, in turn: with no change known, and after each one told."""

    looks: tuple[EpochLook, ...] = ()
    #: The statistic after each check that came after the first alarm, but the last, without these.
    after: tuple[float, ...] = ()
    left_out: tuple[int, ...] = ()

    def find_quiet_run(
        self, since: int, left_out: Sequence[int], known_changes: Sequence[float]
    ) -> QuietRun:
        """What is known of a look already."""
        matching = (look for look in self.looks if look.is_at(since, left_out, known_changes))
        return next((look.quiet for look in matching), NOTHING_YET)

    def after_alarm(self, alarm: int, check: int, left_out: Sequence[int]) -> float | None:
        """The statistic after a *check* that came after the first *alarm*, if it is known."""
        place = check - alarm - 1
        first = self.looks[0] if self.looks else None
        if first is None or first.until != alarm or not 0 <= place < len(self.after):
            return None
        same = [i for i in self.left_out if i <= check] == [i for i in left_out if i <= check]
        return self.after[place] if same else None


NEVER_YET = EpochLooks()
