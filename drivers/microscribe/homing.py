"""Determines whether the arm is homed: encoders count from power-up, and no bit shows homing.

A pedal pressed while the arm has been at rest means: the stylus is in its rest. Only then is HOME
sent, and until it is acknowledged no angle has a meaning.

After a homing was lost (a pulled plug, a long silence), a user who has not noticed may press a
pedal to go on measuring. So a press is accepted at once only if the arm's timer has kept running,
so that its counts are still valid, and the counts are those of its rest. Otherwise the user must
lift the stylus and put it back. If five joints come back to within half a degree, the rest holds
the stylus, and not a hand. Why: docs/decisions/0011.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, asdict, dataclass
from typing import Any, NamedTuple, Self

from armd.drivers.microscribe.timer import TICK_NS
from armd.drivers.microscribe.wire import TICKS

REST_NS = 500_000_000
REST_DEG = 0.25  # by which a joint may differ within a rest
PATIENCE_NS = 500_000_000  # after the press; later the place of the stylus is unknown
BACK_DEG = 0.5  # by which a joint may miss its rest
LIFTED_DEG = 5.0  # at least one joint differs by this when the stylus is out of its rest
#: Of a timer that kept running: the largest error of an instant, and of a crystal's rate. After a
#: longer time too many multiples of its period of 18 s would fit.
TIMER_NS, TIMER_RATE = 5_000_000, 1e-4
LONGEST_NS = 100_000_000_000
LIFT_IT = "lift the stylus, put it back into its rest and press a pedal once more"


class Before(NamedTuple):
    """The state of an arm before its homing was lost."""

    home: Sequence[int]  # counts in its rest
    at_ns: int  # its last reading, host monotonic
    ticks: int | None  # the timer of that reading


@dataclass
class Homing:
    """The homing of one session. *counts_per_turn* (N,); *before*: None where no homing was lost.

    Recordings store its fields by these names (`state`).
    """

    counts_per_turn: Sequence[int]
    before: Before | None = None
    _: KW_ONLY
    homed: bool = False
    unconfirmed: bool = False  # HOME was acknowledged, but needs a second press
    _home: Sequence[int] | None = None  # counts in the rest, or in the presumed rest
    _last: tuple[int, int | None] | None = None  # instant and timer of the last reading when homed
    _rest: Sequence[int] = ()
    _rest_since_ns: int = 0
    _buttons: int | None = None  # buttons of the last reading
    _pressed_ns: int | None = None  # time of a press that requests HOME
    _asked: bool = False  # HOME was sent: counts are no longer comparable
    _doubt: str = ""  # why the press that requests HOME needs a second one
    _lifted: bool = False  # lifted since HOME
    _quickest_ns: int | None = None  # the quickest reply of this session: it bounds the timer best
    _ran_on: bool = False  # the timer kept running since the homing was lost

    @property
    def doubt(self) -> str:
        """The reason why the stylus may not be in its rest, and what to do about it."""
        return f"{self._doubt}: {LIFT_IT}"

    def lost(self) -> Before | None:
        """Return the state for the next session."""
        if not self.homed or self._home is None or self._last is None:
            return self.before
        return Before(self._home, *self._last)

    def state(self) -> dict[str, Any]:
        """Return the state for `restored`, as JSON."""
        return asdict(self)

    @classmethod
    def restored(cls, state: dict[str, Any]) -> Self:
        before = state["before"]
        return cls(**state | {"before": before and Before(*before)})

    def is_due(self, now_ns: int) -> bool:
        """Return whether HOME should be sent, again if necessary."""
        return self._pressed_ns is not None and now_ns - self._pressed_ns < PATIENCE_NS

    def note_sent(self) -> None:
        """Record that HOME is sent."""
        self._asked = True

    def acknowledged(self) -> bool:
        """Record that HOME was acknowledged; return whether the arm counts as homed."""
        self.homed, self.unconfirmed = not self._doubt, bool(self._doubt)
        self._pressed_ns = self._home = None
        self._lifted = False
        return self.homed

    def follow(self, counts: Sequence[int], at_ns: int, ticks: int | None) -> None:
        """Record a reading of the homed arm."""
        if self._home is None:
            self._home = tuple(counts)
        self._last = at_ns, ticks

    def watch(
        self,
        counts: Sequence[int],
        buttons: int,
        at_ns: int,
        ticks: int | None = None,
        took_ns: int = 0,
    ) -> str:
        """Take a reading of the arm that is not homed; return why a press was refused, if one was.

        *took_ns*: from the reading's request to its reply.
        """
        self._look_at_timer(at_ns, ticks, took_ns)
        moved = not self._rest or self._largest_difference(counts, self._rest)[0] > REST_DEG
        if moved:
            self._rest, self._rest_since_ns = tuple(counts), at_ns
        if self.unconfirmed:
            self._home = tuple(counts) if self._home is None else self._home
            self._lifted |= self._largest_difference(counts, self._home)[0] > LIFTED_DEG
        risen = 0 if self._buttons is None else buttons & ~self._buttons
        self._buttons = buttons
        if self._pressed_ns is not None and (moved or not self.is_due(at_ns)):
            self._pressed_ns = None
            return "it moved" if moved else "it did not acknowledge HOME"
        if not risen:
            return ""
        if at_ns - self._rest_since_ns < REST_NS:
            return f"it had not been at rest for {REST_NS / 1e9:g} s"
        if (
            self.unconfirmed
            and self._home
            and self._largest_difference(counts, self._home)[0] <= BACK_DEG
        ):
            if not self._lifted:
                return "the stylus was not lifted out of its rest since the last press"
            self.homed, self.unconfirmed = True, False
            return ""
        self._pressed_ns, self._doubt = at_ns, self._doubt_of(counts)
        return ""

    def _doubt_of(self, counts: Sequence[int]) -> str:
        """Return why *counts* may not be those of the stylus in its rest; empty if they are."""
        if self.before is None:
            return ""
        if self._asked or not self._ran_on:
            return "nothing tells whether the stylus is in its rest, as the arm may have been off"
        degrees, joint = self._largest_difference(counts, self.before.home)
        if degrees <= BACK_DEG:
            return ""
        return f"joint {joint} is {degrees:.1f}° from where it was in its rest"

    def _look_at_timer(self, at_ns: int, ticks: int | None, took_ns: int) -> None:
        if self.before is None or ticks is None or self.before.ticks is None:
            return
        if self._quickest_ns is not None and took_ns >= self._quickest_ns:
            return
        self._quickest_ns = took_ns
        since_ns = at_ns - self.before.at_ns
        off = ticks - self.before.ticks - since_ns / TICK_NS
        off_ns = ((off + TICKS / 2) % TICKS - TICKS / 2) * TICK_NS
        fits = abs(off_ns) <= TIMER_NS + TIMER_RATE * since_ns
        self._ran_on = fits and since_ns <= LONGEST_NS

    def _largest_difference(
        self, counts: Sequence[int], counts_before: Sequence[int]
    ) -> tuple[float, int]:
        """Return the largest difference in degrees, and its joint (from 1)."""
        return max(
            (abs((count - count_before + turn // 2) % turn - turn // 2) * 360 / turn, joint)
            for joint, (count, count_before, turn) in enumerate(
                zip(counts, counts_before, self.counts_per_turn, strict=True), 1
            )
        )
