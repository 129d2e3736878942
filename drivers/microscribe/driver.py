"""The driver of the MicroScribe's port: finds the baud rate, keeps the session, polls or streams.

The decoder interprets the bytes.
"""

from __future__ import annotations

import termios
import time
from contextlib import suppress

import serial

from armd.drivers.config import MicroScribeConfig
from armd.drivers.identity import Expectation
from armd.drivers.microscribe import wire
from armd.drivers.microscribe.conversation import SESSION, Phase
from armd.drivers.microscribe.decoder import PUT_IT_TO_REST, UP, MicroScribeDecoder
from armd.drivers.microscribe.timer import TICK_NS
from armd.drivers.sample import Item
from armd.drivers.shell import SerialShell
from armd.drivers.waiting import has_bytes

AFTER_END_S = 0.015
SYNC_EVERY_NS = 30_000_000
PER_BAUD_NS = 900_000_000  # before the next rate is tried
REPLY_NS = 200_000_000  # for the reply to a question about the arm
#: A poll without answer is given up after this and the line's own time. The answer may still come,
#: so the driver waits once more before the next poll: else it would count as that one's answer.
POLL_NS = 25_000_000
HOME_EVERY_NS = 150_000_000
START_NS = 40_000_000  # for the acknowledgement, or the reply of an arm without CF
START_BYTES = 100
STOP_NS = 50_000_000  # the time that the maker's library waits
STUCK_NS = 100_000_000  # without a packet, plus five paces of the stream
#: Streaming pauses this often for a few requested readings: they compare the arm's timer with the
#: host's clock.
TIMING_NS = 5_000_000_000


class MicroScribeDriver(SerialShell[MicroScribeDecoder]):
    """The driver of a MicroScribe; see `armd.drivers.sample.Driver`."""

    def __init__(self, config: MicroScribeConfig, expectation: Expectation) -> None:
        decoder = MicroScribeDecoder(expectation, config.max_joint_rate_deg_s, config.stream)
        super().__init__(decoder, config.port)
        self._bauds: tuple[int, ...] = wire.BAUDS if config.baud is None else (config.baud,)
        self._fastest = self._bauds[0]
        #: An arm takes the rate of the first command that it receives. One that was switched on
        #: while a slow rate was tried answers at that rate: then the fastest is tried once more.
        self._trying_fastest = self._is_slow = False
        self._tried = 0  # baud rates tried since the last session
        self._give_up_ns = 0  # when to give this rate up
        self._send_ns = 0  # when the next request may leave
        self._sent_ns = 0  # when the last one left
        self._session_ns = 0  # when a session last began
        self._home_ns = 0  # when HOME may be sent again
        self._draining = False  # waiting once more after a poll without answer
        self._timing_ns = 0  # when streaming is to pause

    @property
    def hindrance(self) -> str:
        homing = self._decoder.homing
        if homing is None or homing.homed:
            return ""
        return f"not homed: {homing.doubt if homing.unconfirmed else PUT_IT_TO_REST}"

    def close(self) -> None:
        """End the session, and with it the stream: the next program finds the arm silent."""
        if self._port is not None and self._decoder.conversation.phase in SESSION:
            with suppress(OSError, termios.error):
                self._write(self._port, bytes([wire.END]))
                self._port.flush()
        super().close()

    def read(self, timeout_s: float) -> list[Item]:
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        items: list[Item] = []
        while not items:
            now_ns = time.monotonic_ns()
            if self._port is None:
                if now_ns >= self._line.open_due_ns:
                    items += self._try_open(now_ns)
            elif now_ns >= self._line.act_ns:
                items += self._silent(now_ns)
            if self._port is not None and now_ns >= self._send_ns:
                items += self._ask(self._port, now_ns)
            due_ns = self._line.open_due_ns if self._port is None else self._send_ns
            wait_s = max(0, min(deadline_ns, due_ns) - time.monotonic_ns()) / 1e9
            if self._port is None:
                time.sleep(wait_s)
            elif has_bytes(self._port.fileno(), wait_s):
                items += self._receive(self._port)
            if time.monotonic_ns() >= deadline_ns:
                break
        return items

    # --- what is to be asked ---------------------------------------------------------------

    def _ask(self, port: serial.Serial, now_ns: int) -> list[Item]:
        conversation, homing = self._decoder.conversation, self._decoder.homing
        if conversation.phase not in SESSION and now_ns >= self._give_up_ns:
            self._is_slow |= self._trying_fastest
            self._trying_fastest = False
            self._tried += 1
            self._hang_up()
            return self._try_open(now_ns)
        streaming = conversation.phase is Phase.STREAM and now_ns < self._timing_ns
        if streaming and has_bytes(port.fileno(), 0):
            return []  # this process was late, not the arm
        stopping = conversation.phase is Phase.STOPPING and conversation.stops
        if stopping or conversation.phase in (Phase.STREAM, Phase.STARTING):
            self._send_ns = now_ns + STOP_NS
            return self._send(port, wire.STOP)
        if (
            conversation.pending is not None
            and conversation.phase is Phase.POLL
            and not self._draining
        ):
            self._draining = True
            self._send_ns = now_ns + POLL_NS
            return []
        self._draining = False
        needs_home = homing is not None and not homing.homed and homing.is_due(now_ns)
        if needs_home and now_ns >= self._home_ns:
            self._home_ns = now_ns + HOME_EVERY_NS
            self._send_ns = now_ns + HOME_EVERY_NS // 3
            return self._send(port, bytes([wire.HOME]))
        request = conversation.request
        byte_ns = 10_000_000_000 // port.baudrate
        if conversation.phase is Phase.POLL and self._decoder.may_stream:
            if not conversation.stops:  # never start a stream that might not be stoppable
                self._send_ns = now_ns + STOP_NS
                return self._send(port, wire.STOP)
            delay = wire.compute_delay_ticks(request[0], port.baudrate)
            self._send_ns = now_ns + START_NS + START_BYTES * byte_ns
            self._timing_ns = now_ns + TIMING_NS
            return self._send(port, wire.start_streaming(request[0], delay))
        wait_ns = SYNC_EVERY_NS if conversation.phase is Phase.SYNC else REPLY_NS
        if conversation.phase in SESSION:
            wait_ns = POLL_NS + 20 * byte_ns
        self._send_ns = now_ns + wait_ns
        return self._send(port, request)

    def _answered(self, port: serial.Serial) -> None:
        """Set the time of the next request after an answer, at the line's own pace."""
        conversation = self._decoder.conversation
        if conversation.pending is not None:
            return
        if conversation.stream is not None:
            patience_ns = STUCK_NS + round(5 * conversation.stream.pace_ticks * TICK_NS)
            self._send_ns = min(self._timing_ns, time.monotonic_ns() + patience_ns)
            return
        self._send_ns = 0
        if conversation.phase is not Phase.POLL:
            self._session_ns = time.monotonic_ns()
            self._give_up_ns = self._session_ns + PER_BAUD_NS
        if conversation.phase is Phase.POLL:
            byte_ns = 10_000_000_000 // port.baudrate
            self._send_ns = self._sent_ns + (1 + conversation.reply_size) * byte_ns
            self._trying_fastest = port.baudrate < self._fastest and not self._is_slow
            if self._tried:  # this rate works: the next session begins with it
                good = self._tried % len(self._bauds)
                self._bauds, self._tried = self._bauds[good:] + self._bauds[:good], 0
            if self._trying_fastest:
                slower = (baud for baud in self._bauds if baud != self._fastest)
                self._bauds = (self._fastest, *slower)

    # --- the port --------------------------------------------------------------------------

    def _try_open(self, now_ns: int) -> list[Item]:
        baud = self._bauds[self._tried % len(self._bauds)]
        missing = self._open_port(baud, now_ns)
        if self._port is None:
            return missing
        if self._tried == 0:
            self._line.opened(now_ns)
        self._feed("link", UP + b"%d" % baud)
        # A session that another program left open accepts only END.
        items = self._send(self._port, bytes([wire.END]))
        time.sleep(AFTER_END_S)
        with suppress(OSError, termios.error):
            self._port.reset_input_buffer()
        self._give_up_ns = now_ns + PER_BAUD_NS
        self._send_ns = 0
        return items

    def _silent(self, now_ns: int) -> list[Item]:
        """Report the silence, and after a while reopen the line.

        The session ends then, and the arm is no longer known to be homed.
        """
        items = self._line.silent(now_ns)
        young = now_ns - self._session_ns < self.RENEW_NS
        if items or young or self._decoder.conversation.phase not in SESSION:
            return items
        self._hang_up()
        return self._try_open(now_ns)

    # --- bytes -----------------------------------------------------------------------------

    def _received(self, port: serial.Serial, data: bytes) -> list[Item]:
        items = self._feed("rx", data)
        self._answered(port)
        items = self._line.heard(self._decoder.last_sample_ns, items)
        if self._trying_fastest and self._decoder.conversation.phase in SESSION:
            self._hang_up()
            items += self._try_open(time.monotonic_ns())
        return items

    def _send(self, port: serial.Serial, data: bytes) -> list[Item]:
        frame = self._write(port, data)
        if frame is None:  # requested again when it is due
            return []
        self._sent_ns = frame.monotonic_ns
        return self._take(frame)
