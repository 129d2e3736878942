"""Is the arm homed? Its encoders count from where it woke up, and its wire has no bit for it.

A pedal pressed while the arm has been at rest says: the stylus is in its rest. Only then is HOME
sent, and until it is acknowledged no angle means anything.

After a homing was lost (a pulled plug, a long silence) a press may as well be that of somebody who
has not noticed and goes on measuring. Then it is believed at once only if the arm's timer has run
on, so that its counts still mean what they did, and they are those of its rest. Otherwise the
stylus is to be lifted and put back: what it comes back to within half a degree in five joints is
what holds it, and no hand. Why: docs/decisions/0012.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, asdict, dataclass
from typing import Any, NamedTuple, Self

from armd.drivers.microscribe.timer import TICK_NS
from armd.drivers.microscribe.wire import TICKS

REST_NS = 500_000_000
REST_DEG = 0.25  # by which a joint may differ within a rest
PATIENCE_NS = 500_000_000  # from the press on; later nobody knows where the stylus is
BACK_DEG = 0.5  # by which a joint may miss its rest
LIFTED_DEG = 5.0  # one joint at the least, when the stylus is out of its rest
#: Of a timer that ran on: what an instant is off at the worst, and a crystal. After a longer time
#: too many of its 18 s would fit.
TIMER_NS, TIMER_RATE = 5_000_000, 1e-4
LONGEST_NS = 100_000_000_000
LIFT_IT = "lift the stylus, put it back into its rest and press a pedal once more"


class Before(NamedTuple):
    """What is known of an arm whose homing was lost."""

    home: Sequence[int]  # counts in its rest
    at_ns: int  # its last reading, host monotonic
    ticks: int | None  # of that one's timer


@dataclass
class Homing:
    """Of one session. *counts_per_turn* (N,); *before*: None where no homing was lost.

    Recordings have its fields by these names (`state`).
    """

    counts_per_turn: Sequence[int]
    before: Before | None = None
    _: KW_ONLY
    homed: bool = False
    unconfirmed: bool = False  # HOME was acknowledged, and is not believed yet
    _home: Sequence[int] | None = None  # counts in the rest, or in what may be it
    _last: tuple[int, int | None] | None = None  # instant and timer of the last reading when homed
    _rest: Sequence[int] = ()
    _rest_since_ns: int = 0
    _buttons: int | None = None  # of the last reading
    _pressed_ns: int | None = None  # a press that asks for HOME
    _asked: bool = False  # HOME was sent in this session: the counts are no more those of before
    _doubt: str = ""  # why the press that asks for HOME needs another one
    _lifted: bool = False  # since HOME
    _quickest_ns: int | None = None  # reply of this session, which tells most of the timer
    _ran_on: bool = False  # the timer, since before

    @property
    def doubt(self) -> str:
        """Why it is not believed that the stylus is in its rest, and what to do about it."""
        return f"{self._doubt}: {LIFT_IT}"

    def lost(self) -> Before | None:
        """What the next session should know of this one."""
        if not self.homed or self._home is None or self._last is None:
            return self.before
        return Before(self._home, *self._last)

    def state(self) -> dict[str, Any]:
        """For `restored`, as JSON."""
        return asdict(self)

    @classmethod
    def restored(cls, state: dict[str, Any]) -> Self:
        before = state["before"]
        return cls(**state | {"before": before and Before(*before)})

    def is_due(self, now_ns: int) -> bool:
        """HOME is to be sent, again if need be."""
        return self._pressed_ns is not None and now_ns - self._pressed_ns < PATIENCE_NS

    def note_sent(self) -> None:
        """HOME goes out."""
        self._asked = True

    def acknowledged(self) -> bool:
        """HOME was; whether the arm counts as homed."""
        self.homed, self.unconfirmed = not self._doubt, bool(self._doubt)
        self._pressed_ns = self._home = None
        self._lifted = False
        return self.homed

    def follow(self, counts: Sequence[int], at_ns: int, ticks: int | None) -> None:
        """A reading of the arm that is homed."""
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
        """A reading of the arm that is not homed, *took_ns* from its request to its reply; why a
        press was refused, if one was."""
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
        """Why *counts* may not be those of the stylus in its rest; empty if they are."""
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
        """By how many degrees they differ at the most, and which joint (from 1) does."""
        return max(
            (abs((count - count_before + turn // 2) % turn - turn // 2) * 360 / turn, joint)
            for joint, (count, count_before, turn) in enumerate(
                zip(counts, counts_before, self.counts_per_turn, strict=True), 1
            )
        )
