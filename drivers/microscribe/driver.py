"""The MicroScribe's port: finds the baud rate, holds the session, asks for one reading after the
other. Everything that the bytes mean is in the decoder."""

from __future__ import annotations

import os
import select
import termios
import time
from collections import deque
from contextlib import suppress

import serial

from armd.drivers.config import MicroScribeConfig
from armd.drivers.host_time import HostTime
from armd.drivers.identity import Expectation
from armd.drivers.line_health import SILENCE_NS, STALE_NS, LineHealth
from armd.drivers.microscribe import wire
from armd.drivers.microscribe.decoder import PUT_IT_TO_REST, UP, MicroScribeDecoder
from armd.drivers.microscribe.session import Step
from armd.drivers.sample import RAW_FRAMES_KEPT, Direction, Item, RawFrame

AFTER_END_S = 0.015
RENEW_NS = 1_000_000_000
SYNC_EVERY_NS = 30_000_000
PER_BAUD_NS = 900_000_000  # before the next rate is tried
REPLY_NS = 200_000_000  # to a question about the arm
#: An unanswered poll is given up after this and the line's own time; the answer may yet come, so
#: it is waited for once more before the next poll, lest it be taken for that one's.
POLL_NS = 25_000_000
HOME_EVERY_NS = 150_000_000


class MicroScribeDriver:
    """See `armd.drivers.sample.Driver`."""

    def __init__(self, config: MicroScribeConfig, expectation: Expectation) -> None:
        self._config = config
        self._decoder = MicroScribeDecoder(expectation, config.max_joint_rate_deg_s)
        self._time = HostTime()
        self._line = LineHealth(config.port, RENEW_NS)
        self._serial: serial.Serial | None = None
        self._raw: deque[RawFrame] = deque(maxlen=RAW_FRAMES_KEPT)
        self._bauds: tuple[int, ...] = wire.BAUDS if config.baud is None else (config.baud,)
        self._tried = 0  # baud rates, since the last session
        self._give_up_ns = 0  # on this rate
        self._send_ns = 0  # when the next request may leave
        self._sent_ns = 0  # when the last one left
        self._session_ns = 0  # when the session was last being begun
        self._home_ns = 0  # when HOME may be sent again
        self._draining = False  # a poll was not answered

    @property
    def connected(self) -> bool:
        return self._decoder.accepted and self._line.quiet_ns < SILENCE_NS

    @property
    def stale(self) -> bool:
        return not self._decoder.accepted or self._line.quiet_ns > STALE_NS

    @property
    def hindrance(self) -> str:
        homing = self._decoder.homing
        return f"not homed: {PUT_IT_TO_REST}" if homing is not None and not homing.homed else ""

    @property
    def counters(self) -> dict[str, int]:
        return {**self._decoder.counters, "reconnects": self._line.reconnects}

    def open(self) -> None:
        """Get ready; the port itself is opened by the first `read`, which goes on trying."""
        self._decoder.warm_up()

    def close(self) -> None:
        if self._serial is not None:
            with suppress(OSError):
                self._serial.close()
            self._serial = None

    def take_raw(self) -> list[RawFrame]:
        raw = list(self._raw)
        self._raw.clear()
        return raw

    def preamble(self) -> list[RawFrame]:
        return self._decoder.preamble()

    def read(self, timeout_s: float) -> list[Item]:
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        items: list[Item] = []
        while not items:
            now_ns = time.monotonic_ns()
            if self._serial is None:
                if now_ns >= self._line.open_due_ns:
                    items += self._try_open(now_ns)
            elif now_ns >= self._line.act_ns:
                items += self._silent(now_ns)
            if self._serial is not None and now_ns >= self._send_ns:
                items += self._ask(self._serial, now_ns)
            due_ns = self._line.open_due_ns if self._serial is None else self._send_ns
            wait_s = max(0, min(deadline_ns, due_ns) - time.monotonic_ns()) / 1e9
            if self._serial is None:
                time.sleep(wait_s)
            elif select.select([self._serial.fileno()], [], [], wait_s)[0]:
                items += self._receive(self._serial)
            if time.monotonic_ns() >= deadline_ns:
                break
        return items

    # --- what is to be asked ---------------------------------------------------------------

    def _ask(self, port: serial.Serial, now_ns: int) -> list[Item]:
        session, homing = self._decoder.session, self._decoder.homing
        if session.step is not Step.POLL and now_ns >= self._give_up_ns:
            self._tried += 1
            self._hang_up()
            return self._try_open(now_ns)
        if session.pending is not None and session.step is Step.POLL and not self._draining:
            self._draining = True
            self._send_ns = now_ns + POLL_NS
            return []
        self._draining = False
        wanted = homing is not None and not homing.homed and homing.wanted(now_ns)
        if wanted and now_ns >= self._home_ns:
            self._home_ns = now_ns + HOME_EVERY_NS
            self._send_ns = now_ns + HOME_EVERY_NS // 3
            return self._send(port, bytes([wire.HOME]))
        request = session.request
        byte_ns = 10_000_000_000 // port.baudrate
        waits = {Step.SYNC: SYNC_EVERY_NS, Step.POLL: POLL_NS + 20 * byte_ns}
        self._send_ns = now_ns + waits.get(session.step, REPLY_NS)
        return self._send(port, request)

    def _answered(self, port: serial.Serial) -> None:
        """The request was answered: the next one may leave, at the line's own pace."""
        session = self._decoder.session
        if session.pending is not None:
            return
        self._send_ns = 0
        if session.step is not Step.POLL:
            self._session_ns = time.monotonic_ns()
            self._give_up_ns = self._session_ns + PER_BAUD_NS
        if session.step is Step.POLL:
            byte_ns = 10_000_000_000 // port.baudrate
            self._send_ns = self._sent_ns + (1 + session.reply_size) * byte_ns
            if self._tried:  # this rate works: the next session begins with it
                good = self._tried % len(self._bauds)
                self._bauds, self._tried = self._bauds[good:] + self._bauds[:good], 0

    # --- the port --------------------------------------------------------------------------

    def _try_open(self, now_ns: int) -> list[Item]:
        baud = self._bauds[self._tried % len(self._bauds)]
        try:
            self._serial = serial.Serial(self._config.port, baud, timeout=0, exclusive=True)
        except (OSError, ValueError, termios.error) as error:
            return self._line.lost("port_missing", str(error), now_ns)
        with suppress(OSError, ValueError):  # a pty has no such mode
            self._serial.set_low_latency_mode(True)
        if self._tried == 0:
            self._line.opened(now_ns)
        self._feed("link", UP + b"%d" % baud)
        # A session that another program left open hears nothing but its end.
        items = self._send(self._serial, bytes([wire.END]))
        time.sleep(AFTER_END_S)
        with suppress(OSError, termios.error):
            self._serial.reset_input_buffer()
        self._give_up_ns = now_ns + PER_BAUD_NS
        self._send_ns = 0
        return items

    def _silent(self, now_ns: int) -> list[Item]:
        """Told at first; after a while the line is opened afresh, and with the session goes the
        knowledge that the arm is homed."""
        items = self._line.silent(now_ns)
        young = now_ns - self._session_ns < RENEW_NS
        if items or young or self._decoder.session.step is not Step.POLL:
            return items
        self._hang_up()
        return self._try_open(now_ns)

    def _unplugged(self, reason: str) -> list[Item]:
        self._hang_up()
        text = f"the line to {self._config.port} broke: {reason}"
        return self._line.lost("unplugged", text, time.monotonic_ns())

    def _hang_up(self) -> None:
        self.close()
        self._feed("link", b"down")

    # --- bytes -----------------------------------------------------------------------------

    def _receive(self, port: serial.Serial) -> list[Item]:
        try:
            data = os.read(port.fileno(), 4096)
        except BlockingIOError:
            return []
        except OSError as error:
            return self._unplugged(str(error))
        if not data:
            return self._unplugged("end of file")
        items = self._feed("rx", data)
        self._answered(port)
        return self._line.heard(self._decoder.last_reply_ns, items)

    def _send(self, port: serial.Serial, data: bytes) -> list[Item]:
        items = self._feed("tx", data)
        self._sent_ns = time.monotonic_ns()
        with suppress(OSError):  # a full or broken line shows itself when reading
            os.write(port.fileno(), data)
        return items

    def _feed(self, direction: Direction, data: bytes) -> list[Item]:
        monotonic_ns, unix_ns = self._time.now()
        frame = RawFrame(monotonic_ns, unix_ns, direction, data)
        self._raw.append(frame)
        return self._decoder.feed(frame)
