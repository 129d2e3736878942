"""Is the arm homed? Its encoders count from where it woke up, and its wire has no bit for it.

A pedal pressed while the arm has been at rest says: the stylus is in its rest. Only then is HOME
sent, and until it is acknowledged no angle means anything.
"""

from __future__ import annotations

from collections.abc import Sequence

REST_NS = 500_000_000
REST_DEG = 0.25  # by which a joint may differ within a rest
PATIENCE_NS = 500_000_000  # from the press on; later nobody knows where the stylus is


class Homing:
    def __init__(self, counts_per_turn: Sequence[int]) -> None:
        self.homed = False
        self._turns = tuple(counts_per_turn)
        self._rest: tuple[int, ...] = ()
        self._rest_since_ns = 0
        self._buttons: int | None = None  # of the last reading
        self._pressed_ns: int | None = None  # a press that asks for HOME

    def wanted(self, now_ns: int) -> bool:
        """HOME is to be sent, again if need be."""
        return self._pressed_ns is not None and now_ns - self._pressed_ns < PATIENCE_NS

    def acknowledged(self) -> None:
        self.homed, self._pressed_ns = True, None

    def watch(self, counts: Sequence[int], buttons: int, at_ns: int) -> str:
        """A reading of the arm that is not homed; why a press was refused, if one was."""
        moved = not self._rest or any(
            abs((count - rest + turn // 2) % turn - turn // 2) > turn * REST_DEG / 360
            for count, rest, turn in zip(counts, self._rest, self._turns, strict=True)
        )
        if moved:
            self._rest, self._rest_since_ns = tuple(counts), at_ns
        risen = 0 if self._buttons is None else buttons & ~self._buttons
        self._buttons = buttons
        if self._pressed_ns is not None and (moved or not self.wanted(at_ns)):
            self._pressed_ns = None
            return "it moved" if moved else "it did not acknowledge HOME"
        if not risen:
            return ""
        if at_ns - self._rest_since_ns < REST_NS:
            return f"it had not been at rest for {REST_NS / 1e9:g} s"
        self._pressed_ns = at_ns
        return ""
