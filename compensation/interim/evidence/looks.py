"""Results of watching checks without an alarm, from which the watch can continue."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

#: Numbers of a known change that come from the same checks differ by rounding only, far less than
#: this share.
SAME = 1e-7


@dataclass(frozen=True)
class QuietRun:
    """The result of consecutive checks without an alarm: all that is needed to watch later ones."""

    statistic: tuple[float, ...] = ()  # after each of them
    bad: tuple[int, ...] = ()  # bad ones of them and of earlier checks; final


NOTHING_YET = QuietRun()


@dataclass(frozen=True)
class EpochLook:
    """One look at an epoch's checks, from *since* on: what was known then, and the result."""

    since: int
    left_out: tuple[int, ...]  # earlier checks that are bad
    known_changes: tuple[float, ...]  # the known changes, as numbers
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
    """All looks at an epoch's checks, in turn: without a known change, and after each
    reported one.
    """

    looks: tuple[EpochLook, ...] = ()
    #: The statistic after each check between the first alarm and the last check, without the checks
    #: *left_out*.
    after: tuple[float, ...] = ()
    left_out: tuple[int, ...] = ()

    def find_quiet_run(
        self, since: int, left_out: Sequence[int], known_changes: Sequence[float]
    ) -> QuietRun:
        """Return the result of a look that was made before, or an empty one."""
        matching = (look for look in self.looks if look.is_at(since, left_out, known_changes))
        return next((look.quiet for look in matching), NOTHING_YET)

    def after_alarm(self, alarm: int, check: int, left_out: Sequence[int]) -> float | None:
        """Return the statistic after a *check* that came after the first *alarm*, or None if it is
        unknown.
        """
        place = check - alarm - 1
        first = self.looks[0] if self.looks else None
        if first is None or first.until != alarm or not 0 <= place < len(self.after):
            return None
        same = [i for i in self.left_out if i <= check] == [i for i in left_out if i <= check]
        return self.after[place] if same else None


NEVER_YET = EpochLooks()
