"""The PINGs that were sent, their PONGs, and the clock mapping that both determine."""

from __future__ import annotations

from collections import deque

from armd.drivers.sample import RawFrame
from armd.drivers.serial import wire
from armd.drivers.serial.clock import PROMISED_NS, WINDOW, ClockMapping
from armd.drivers.serial.sequence import SequenceExtender

PINGS_REMEMBERED = 64


class Exchanges:
    """Updates a `ClockMapping`, unless a PONG contradicts the samples or the clock itself."""

    def __init__(self, clock: ClockMapping) -> None:
        self._clock = clock
        self._pings: dict[int, RawFrame] = {}  # by nonce: sent, not answered yet
        self._answered: deque[tuple[RawFrame, RawFrame]] = deque(maxlen=WINDOW)

    def forget(self) -> None:
        """Forget all exchanges and the clock: the device's clock may start from zero again."""
        self._clock.reset()
        self._pings.clear()
        self._answered.clear()

    def frames(self) -> list[RawFrame]:
        """Return the frames that determine the clock again."""
        return [frame for exchange in self._answered for frame in exchange]

    def sent(self, frame: RawFrame) -> None:
        """Record the PINGs in *frame*."""
        for packet in frame.data.split(b"\0"):
            data = wire.unpack(packet) if packet else None
            nonce = wire.decode_ping(data) if data and data[0] == wire.Type.PING else None
            if nonce is not None:
                self._pings[nonce] = frame
        while len(self._pings) > PINGS_REMEMBERED:
            del self._pings[next(iter(self._pings))]

    def take(self, nonce: int) -> RawFrame | None:
        """Take out and return the PING with this nonce."""
        return self._pings.pop(nonce, None)

    def answered(
        self, ping: RawFrame, pong: wire.Pong, frame: RawFrame, samples: SequenceExtender
    ) -> bool:
        """Add an exchange; return whether its PONG agrees with the last *samples* and the clock."""
        if not self._is_samples_clock(ping, pong, frame, samples):
            self.forget()
            return False
        agrees = self._clock.add(ping.monotonic_ns, frame.monotonic_ns, pong.t_us * 1000)
        if not agrees:
            self._answered.clear()  # like the clock
        bare_pong = frame._replace(data=wire.encode_pong(pong.nonce, pong.t_us))
        self._answered.append((ping, bare_pong))
        return agrees

    def _is_samples_clock(
        self, ping: RawFrame, pong: wire.Pong, frame: RawFrame, samples: SequenceExtender
    ) -> bool:
        """Return whether a PONG's time fits that of the last sample before it.

        The sample cannot have been under way for longer than the PONG itself plus the time since.
        Only a sample that came after the last exchange shows the present clock.
        """
        last_sample = samples.memory[0]
        last_ns = self._answered[-1][1].monotonic_ns if self._answered else frame.monotonic_ns
        if last_sample["seq"] < 0 or last_sample["arrival_ns"] <= last_ns:
            return True
        ahead_ns = 1000 * (pong.t_us - int(last_sample["t_us"]))
        since_ns = frame.monotonic_ns - int(last_sample["arrival_ns"])
        under_way_ns = frame.monotonic_ns - ping.monotonic_ns
        return -PROMISED_NS <= ahead_ns <= since_ns + under_way_ns + PROMISED_NS
