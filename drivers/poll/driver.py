"""The servo driver: opens and reads a port that may vanish, with one request at a time on it.

One loop within `read` follows the table of `states.py`. The next request is sent before the answers
to the last one are decoded.
"""

from __future__ import annotations

import time

import serial

from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.poll.answers import Answers
from armd.drivers.poll.decoder import CHANNEL, OVER, ServoDecoder, encode_note
from armd.drivers.poll.exchange import Exchange
from armd.drivers.poll.plan import RequestPlan
from armd.drivers.poll.protocol.packet import ReadRequest
from armd.drivers.poll.servos.acquaintance import Acquaintance
from armd.drivers.poll.states import TRANSITIONS, LineEvent, LineState
from armd.drivers.ports import is_pseudo
from armd.drivers.sample import Item, RawFrame
from armd.drivers.shell import SerialShell
from armd.drivers.waiting import has_bytes

WRITE_NS = 10_000_000  # the time that a servo needs to store a register and to answer
#: A pause after a request on a pseudo-terminal: a kernel thread of low priority carries it, and
#: would otherwise wait until the earlier answers are decoded.
CARRIED_S = 30e-6


class ServoDriver(SerialShell[ServoDecoder]):
    """The driver of servo arms; see `armd.drivers.sample.Driver`."""

    DOWN = encode_note(note="down")

    def __init__(self, config: ServoConfig, expectation: Expectation) -> None:
        super().__init__(ServoDecoder(config, expectation), config.port, CHANNEL)
        self._baud = config.baud
        self._state = LineState.CLOSED
        period_ns = 0 if config.rate_hz is None else round(1e9 / config.rate_hz)
        self._plan = RequestPlan(self._decoder, period_ns)
        self._acquaintance = Acquaintance(
            config, self._decoder, self._plan, expectation.serial_number
        )
        self._answers = Answers(self._decoder)
        self._packets: dict[ReadRequest, bytes] = {}  # the packets of requests
        self._blocked_until_ns = 0
        self._next: ReadRequest | None = None  # the next cycle's request, chosen ahead
        self._ahead = b""  # its packet
        self._pause_s = 0.0  # after it
        self._answered_ns: int | None = None  # when a servo last answered
        self._strange_bytes = 0  # bytes since then that are no answers
        self._echoes = 0  # echoes until then

    @property
    def hindrance(self) -> str:
        if self._port is None:
            return ""
        decoder = self._decoder
        return decoder.stuck.hindrance or decoder.roster.hindrance(time.monotonic_ns())

    @property
    def _of_silence(self) -> str:
        actual = "nothing"
        if self._strange_bytes:
            actual = f"{self._strange_bytes} bytes that are no answer (another device, or rate?)"
        if self._decoder.counted["echoes"] > self._echoes:
            actual = "what was asked, which the adapter hears (are the servos switched on?)"
        ids = ", ".join(map(str, self._decoder.everyone))
        kind = self._decoder.family.name
        return f" at {self._baud} baud: found {actual}, expected answers of {kind} servos {ids}"

    def read(self, timeout_s: float) -> list[Item]:
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        items: list[Item] = []
        while not items:
            if self._port is None:
                items += self._wait_for_port(deadline_ns)
            else:
                items += self._turn(self._port, deadline_ns)
            if time.monotonic_ns() >= deadline_ns:
                break
        return items

    def _follow(self, event: LineEvent) -> None:
        self._state = TRANSITIONS[self._state, event]

    @property
    def _exchange(self) -> Exchange:
        """The open exchange; there is one while answers are awaited, and when they are complete."""
        assert self._decoder.exchange is not None
        return self._decoder.exchange

    # --- one turn of the loop ----------------------------------------------------------------

    def _turn(self, port: serial.Serial, deadline_ns: int) -> list[Item]:
        """Wait until bytes come or an action is due, and do it."""
        now_ns = time.monotonic_ns()
        if self._state is LineState.BLOCKED and now_ns >= self._blocked_until_ns:
            self._follow(LineEvent.RELEASED)
        if self._state is LineState.IDLE and (items := self._send_due(port, now_ns)):
            return items
        if self._state is LineState.ASKED:
            self._look_ahead(now_ns)
            look_ns = min(self._answers.look_ns(self._exchange), deadline_ns)
            if look_ns > now_ns:
                time.sleep((look_ns - now_ns) / 1e9)
        is_waiting = self._state in (LineState.ASKED, LineState.ANSWERING)
        if is_waiting:
            end_ns = self._answers.end_ns(self._exchange)
        else:
            end_ns = max(self._plan.due_ns, self._blocked_until_ns)
        wait_ns = min(end_ns, deadline_ns) - time.monotonic_ns()
        try:
            ready = has_bytes(port.fileno(), max(0.0, wait_ns / 1e9))
        except OSError as error:
            return self._unplugged(str(error))
        if ready:
            return self._receive(port)
        now_ns = time.monotonic_ns()
        items = self._give_up(now_ns) if is_waiting and now_ns >= end_ns else []
        if now_ns >= self._line.act_ns:  # never while bytes are waiting
            items += self._renew()
        return items

    def _give_up(self, now_ns: int) -> list[Item]:
        """Close the exchange: no byte has come for too long."""
        exchange = self._exchange
        self._decode()
        items = self._close_exchange()
        self._next = None
        self._plan.ended(exchange, False, now_ns)
        return self._heard(items)

    def _close_exchange(self) -> list[Item]:
        self._follow(LineEvent.OVER)
        return self._feed("link", OVER)

    def _heard(self, items: list[Item]) -> list[Item]:
        if self._decoder.last_heard_ns != self._answered_ns:
            self._answered_ns, self._strange_bytes = self._decoder.last_heard_ns, 0
            self._echoes = self._decoder.counted["echoes"]
        return self._line.heard(self._decoder.last_heard_ns, items)

    # --- asking --------------------------------------------------------------------------------

    def _send_due(self, port: serial.Serial, now_ns: int) -> list[Item]:
        """Send a write or a request, if one is due; return the items of the exchange that it
        closes.
        """
        items: list[Item] = []
        question: ReadRequest | None = None
        if not self._plan.within_cycle:
            for data in self._acquaintance.notes(now_ns):
                items += self._feed("link", data)
            write = self._acquaintance.write_due()
            if write is not None:
                written = self._write(port, write)
                self._block(now_ns)
                return items if written is None else items + self._take(written)
            question = self._acquaintance.question(now_ns)
        request = self._plan.take_due(now_ns, question)
        return items if request is None else items + self._ask(port, request)

    def _block(self, now_ns: int) -> None:
        self._follow(LineEvent.PAUSED)
        self._blocked_until_ns = now_ns + WRITE_NS

    def _ask(self, port: serial.Serial, request: ReadRequest) -> list[Item]:
        sent = self._write(port, self._packet(request))
        if sent is None:
            self._block(time.monotonic_ns())
            return []
        return self._note_sent(sent)

    def _note_sent(self, sent: RawFrame) -> list[Item]:
        """Record a request that was sent; return the items of the exchange that it closes."""
        self._follow(LineEvent.SENT)
        items = self._take(sent)
        self._answers.begin(self._exchange)
        return items

    def _look_ahead(self, now_ns: int) -> None:
        """Choose, while answers arrive, the request that follows them at once."""
        if self._next is not None or not self._exchange.is_cycle:
            return
        if self._plan.within_cycle or self._acquaintance.idle:
            self._next = self._plan.look_ahead(now_ns)
            if self._next is not None:
                self._ahead = self._packet(self._next)

    def _packet(self, request: ReadRequest) -> bytes:
        packet = self._packets.get(request)
        if packet is None:
            family, span = self._decoder.family, (request.address, request.length)
            if request.is_single:
                packet = family.read(request.ids[0], *span)
            else:
                packet = family.sync_read(request.ids, *span, request.fast)
            self._packets[request] = packet
        return packet

    # --- the port --------------------------------------------------------------------------

    def _wait_for_port(self, deadline_ns: int) -> list[Item]:
        now_ns = time.monotonic_ns()
        due_ns = min(self._line.open_due_ns, deadline_ns)
        if due_ns > now_ns:
            time.sleep((due_ns - now_ns) / 1e9)
        return self._try_open(time.monotonic_ns()) if self._line.open_due_ns <= due_ns else []

    def _try_open(self, now_ns: int) -> list[Item]:
        missing = self._open_port(self._baud, now_ns)
        if self._port is None:
            return missing
        self._follow(LineEvent.OPENED)
        self._pause_s = CARRIED_S if is_pseudo(self._port.fileno()) else 0.0
        self._line.opened(now_ns)
        self._plan.restart(now_ns)
        self._next = None
        self._blocked_until_ns = now_ns
        items = self._feed("link", encode_note(note="up"))
        self._acquaintance.restart()
        return items

    def close(self) -> None:
        self._follow(LineEvent.LOST)
        self._answers.take()  # the next connection must not get bytes of this one
        super().close()

    def _hang_up(self) -> None:
        self._decode()
        super()._hang_up()

    # --- bytes -----------------------------------------------------------------------------

    def _received(self, port: serial.Serial, data: bytes) -> list[Item]:
        clock, sent, is_full = self._time.now(), None, False
        if self._next is not None and self._answers.are_completed_by(data, self._exchange):
            # The line is idle until then: all else can wait until the next answers come.
            sent = self._write(port, self._ahead)
            is_full = sent is None
            if self._pause_s:
                time.sleep(self._pause_s)
        self._follow(LineEvent.BYTES)
        self._strange_bytes += len(data)
        frame = RawFrame(*clock, "rx", data, CHANNEL)
        if self._state is not LineState.ANSWERING:
            return self._take(frame)
        exchange = self._exchange
        self._answers.add(frame)
        if sent is None and not self._answers.may_be_all(exchange):
            return []
        self._decode()
        if sent is None and not exchange.complete:
            return []
        self._follow(LineEvent.COMPLETE)
        self._answers.note_complete(exchange)
        if is_full:  # a part of a packet was sent: no packet may follow at once
            self._block(clock[0])
            self._next = None
        items = self._ask_next(port, exchange, sent, clock[0])
        if self._decoder.exchange is exchange:  # otherwise the next request has closed it
            items += self._close_exchange()
        return self._heard(items)

    def _ask_next(
        self, port: serial.Serial, exchange: Exchange, sent: RawFrame | None, now_ns: int
    ) -> list[Item]:
        """Send the request that was chosen ahead (*sent*: already done), or the one due now.

        *exchange* is complete. Returns the items of the exchange that is closed.
        """
        request, self._next = self._next, None
        if request is None:
            self._plan.ended(exchange, exchange.complete, now_ns)
            may_send = exchange.is_cycle and self._state is LineState.ANSWERED
            return self._send_due(port, now_ns) if may_send else []
        items = self._note_sent(sent) if sent else self._ask(port, request)
        self._plan.ended(exchange, exchange.complete, now_ns)
        self._plan.note_sent(request, now_ns)
        return items

    def _decode(self) -> None:
        """Decode the received frames; their items follow at the end of the exchange."""
        for frame in self._answers.take():
            self._take(frame)
