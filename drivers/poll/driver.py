"""The servo driver: a port that may vanish, and one request at a time on it.

One loop within `read`: ask, wait for the answers or for as long as they may take, ask again. The
next request is on the line before anybody looks at what the last one brought.

An open line is in one of these states. `_turn` waits in each; only what is named leads out of it:

- idle: no exchange, or a complete one. `_ask_if_due` sends what is due → asked. In this order: the
  rest of a cycle that is read one by one; a write, after which nothing is sent until `_hold_ns`; a
  question of the acquaintance; one besides the cycles, `_side`; a cycle, from `_due_ns` on.
- asked: a request is out, `_heard_ns` is 0. `_think_ahead` chooses `_next` with its packet,
  `_ahead`, or `_side`. Bytes → answering; none until `_end_ns` → ended.
- answering: bytes gather in `_undecoded`. When all answers are here, by `_brought`, `_ahead` goes
  out before they are decoded: the new exchange is asked while the old one ends. When all that are
  expected are here and nothing is ahead, they are decoded → idle. After a pause, by `_end_ns`, →
  ended.
- ended: what came is decoded, the decoder is told that it is over, `_next` is dropped → idle.

An error of the port leads from any of them to a closed line, which `_wait_for_port` opens again.
"""

from __future__ import annotations

import time

import serial

from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.poll.decoder import CHANNEL, OVER, ServoDecoder, encode_note
from armd.drivers.poll.exchange import Exchange
from armd.drivers.poll.plan import ACCUSTOMED_NS, FIRST_BYTE_NS, PAUSE_MOST_NS, Pace, RequestPlan
from armd.drivers.poll.protocol.packet import ReadRequest
from armd.drivers.poll.servos.acquaintance import Acquaintance
from armd.drivers.ports import is_pseudo
from armd.drivers.sample import Item, RawFrame
from armd.drivers.shell import SerialShell
from armd.drivers.waiting import has_bytes

WRITE_NS = 10_000_000  # what a servo needs to keep a register, and to say so
#: On a pseudo-terminal after a request: a kernel thread without any priority carries it, and would
#: wait until we have decoded what came before.
CARRIED_S = 30e-6
ASLEEP = 0.9  # of the time that answers need on the line at least, nobody listens for them


class ServoDriver(SerialShell[ServoDecoder]):
    """See `armd.drivers.sample.Driver`."""

    DOWN = encode_note(note="down")

    def __init__(self, config: ServoConfig, expectation: Expectation) -> None:
        super().__init__(ServoDecoder(config, expectation), config.port, CHANNEL)
        self._baud = config.baud
        self._plan = RequestPlan(self._decoder)
        self._pace = Pace()
        self._acquaintance = Acquaintance(
            config, self._decoder, self._plan, expectation.serial_number
        )
        self._packets: dict[ReadRequest, bytes] = {}  # those that were asked for
        self._period_ns = 0 if config.rate_hz is None else round(1e9 / config.rate_hz)
        self._due_ns = 0  # the next cycle
        self._hold_ns = 0  # nothing is sent before: a servo is busy with a write
        self._needs_ns = 0.0  # what the exchange under way needs on the line, at least
        self._heard_ns = 0  # its last bytes; 0: none yet
        self._answered_ns: int | None = None  # when a servo was heard last
        self._strange_bytes = 0  # that have come since then
        self._echoes = 0  # that had come by then
        self._undecoded: list[RawFrame] = []  # what it has brought, while more is to come
        self._brought = b""  # the bytes of these
        self._is_cycle = False
        self._side: ReadRequest | None = None  # due besides the cycles
        self._next: ReadRequest | None = None  # the next cycle's, should the present one complete
        self._ahead = b""  # its packet
        self._pause_s = 0.0  # after it

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
            now_ns = time.monotonic_ns()
            if self._port is None:
                items += self._wait_for_port(now_ns, deadline_ns)
            else:
                items += self._turn(self._port, deadline_ns)
            if time.monotonic_ns() >= deadline_ns:
                break
        return items

    # --- one turn of the loop ----------------------------------------------------------------

    def _turn(self, port: serial.Serial, deadline_ns: int) -> list[Item]:
        """Until some bytes have come, or it is time to act."""
        now_ns = time.monotonic_ns()
        items = self._ask_if_due(port, now_ns)
        if items:
            return items
        exchange = self._decoder.exchange
        if exchange is not None:
            if self._is_cycle and self._next is None:
                self._think_ahead(now_ns)
            end_ns = self._end_ns(exchange)
            look_ns = exchange.sent.monotonic_ns + round(ASLEEP * self._needs_ns)
            if self._heard_ns == 0 and min(look_ns, deadline_ns) > now_ns:
                time.sleep((min(look_ns, deadline_ns) - now_ns) / 1e9)
        else:
            end_ns = max(self._due_ns, self._hold_ns)
        wait_ns = min(end_ns, deadline_ns) - time.monotonic_ns()
        try:
            ready = has_bytes(port.fileno(), max(0.0, wait_ns / 1e9))
        except OSError as error:
            return self._unplugged(str(error))
        if ready:
            return self._receive(port)
        now_ns = time.monotonic_ns()
        if exchange is not None and now_ns >= end_ns:
            items += self._end(now_ns)
        if now_ns >= self._line.act_ns:  # never while bytes are waiting
            items += self._renew()
        return items

    def _end_ns(self, exchange: Exchange) -> int:
        """When no more answers are waited for."""
        due_ns = exchange.sent.monotonic_ns + self._needs_ns
        given_up = self._decoder.roster.given_up
        if exchange.request.is_single and self._is_cycle and self._heard_ns == 0:
            is_expected = not given_up(exchange.request.ids[0])
            return round(due_ns + (PAUSE_MOST_NS if is_expected else self._pace.accustomed_ns))
        if exchange.answers and all(map(given_up, exchange.missing)):
            return round(max(due_ns, self._heard_ns) + ACCUSTOMED_NS)
        if self._heard_ns == 0:
            return round(due_ns) + FIRST_BYTE_NS
        return round(max(due_ns, self._heard_ns) + self._pace.pause_ns)

    def _end(self, now_ns: int) -> list[Item]:
        self._decode()
        items = self._feed("link", OVER)
        self._next = None
        self._ended(False, now_ns)
        return self._heard(items)

    def _ended(self, complete: bool, now_ns: int) -> None:
        if self._is_cycle:
            self._plan.ended(complete, now_ns)

    def _heard(self, items: list[Item]) -> list[Item]:
        if self._decoder.last_heard_ns != self._answered_ns:
            self._answered_ns, self._strange_bytes = self._decoder.last_heard_ns, 0
            self._echoes = self._decoder.counted["echoes"]
        return self._line.heard(self._decoder.last_heard_ns, items)

    # --- asking --------------------------------------------------------------------------------

    def _ask_if_due(self, port: serial.Serial, now_ns: int) -> list[Item]:
        """Nothing is under way: the next request, or what is due instead; the items of that."""
        exchange = self._decoder.exchange
        if (exchange is not None and not exchange.complete) or now_ns < self._hold_ns:
            return []
        if self._plan.within_cycle:
            return self._ask_cycle(port, now_ns)
        items: list[Item] = []
        for data in self._acquaintance.notes(now_ns):
            items += self._feed("link", data)
        write = self._acquaintance.write_due()
        if write is not None:
            self._hold_ns = now_ns + WRITE_NS
            written = self._write(port, write)
            return items if written is None else items + self._take(written)
        request = (
            self._acquaintance.question(now_ns) or self._side or self._plan.side_question(now_ns)
        )
        self._side = None
        self._is_cycle = request is None
        if request is not None:
            return items + self._ask(port, request)
        if now_ns < self._due_ns:
            return items
        if not self._decoder.chain_broken:
            self._set_next_due(now_ns)
        return items + self._ask_cycle(port, now_ns)

    def _ask_cycle(self, port: serial.Serial, now_ns: int) -> list[Item]:
        request = self._plan.cycle(now_ns)
        self._plan.note_sent(request, now_ns)
        return self._ask(port, request)

    def _think_ahead(self, now_ns: int) -> None:
        """While answers are under way: what to ask as soon as the last of them is here."""
        if not self._plan.within_cycle:
            if self._period_ns or self._side is not None or not self._acquaintance.idle:
                return
            self._side = self._plan.side_question(now_ns)
            if self._side is not None:
                return
        self._next = self._plan.cycle(now_ns)
        self._ahead = self._packet(self._next)

    def _set_next_due(self, now_ns: int) -> None:
        if self._period_ns:
            late = max(0, now_ns - self._due_ns) // self._period_ns
            self._due_ns = max(self._due_ns, now_ns - late) + self._period_ns

    def _ask(self, port: serial.Serial, request: ReadRequest) -> list[Item]:
        sent = self._write(port, self._packet(request))
        if sent is None:
            self._hold_ns = time.monotonic_ns() + WRITE_NS
            return []
        return self._note_sent(request, sent)

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

    def _note_sent(self, request: ReadRequest, sent: RawFrame) -> list[Item]:
        """*request* went out; the items of what was under way before."""
        decoder = self._decoder
        items = self._take(sent)
        answers = len(request.ids) * decoder.family.answer_bytes(request)
        gaps_ns = sum(decoder.pauses.before_ns(request, decoder.roster.version))
        self._needs_ns = (len(sent.data) + answers) * decoder.byte_ns + gaps_ns
        self._heard_ns = 0
        return items

    # --- the port --------------------------------------------------------------------------

    def _wait_for_port(self, now_ns: int, deadline_ns: int) -> list[Item]:
        due_ns = min(self._line.open_due_ns, deadline_ns)
        if due_ns > now_ns:
            time.sleep((due_ns - now_ns) / 1e9)
        return self._try_open(time.monotonic_ns()) if self._line.open_due_ns <= due_ns else []

    def _try_open(self, now_ns: int) -> list[Item]:
        missing = self._open_port(self._baud, now_ns)
        if self._port is None:
            return missing
        self._pause_s = CARRIED_S if is_pseudo(self._port.fileno()) else 0.0
        self._line.opened(now_ns)
        self._plan.restart(now_ns)
        self._side = self._next = None
        self._due_ns = self._hold_ns = now_ns
        items = self._feed("link", encode_note(note="up"))
        self._acquaintance.restart()
        return items

    # --- bytes -----------------------------------------------------------------------------

    def _received(self, port: serial.Serial, data: bytes) -> list[Item]:
        clock = self._time.now()
        exchange, request = self._decoder.exchange, self._next
        self._brought += data
        sent: RawFrame | None = None
        if (
            request is not None
            and exchange is not None
            and self._decoder.family.completes(self._brought, exchange.request, exchange.missing)
        ):  # the line waits for this: all else can be done while the next answers come
            sent = self._write(port, self._ahead)
            if self._pause_s:
                time.sleep(self._pause_s)
        frame = RawFrame(*clock, "rx", data, CHANNEL)
        self._heard_ns = now_ns = frame.monotonic_ns
        self._strange_bytes += len(data)
        if exchange is None:
            self._brought = b""
            return self._take(frame)
        self._undecoded.append(frame)
        if sent is None and len(self._brought) < self._expected_bytes(exchange):
            return []
        self._decode()
        if sent is None and not exchange.complete:
            return []
        sent_ns, needs_ns = exchange.sent.monotonic_ns, self._needs_ns
        items: list[Item] = []
        if request is not None:
            self._next = None
            items += self._note_sent(request, sent) if sent else self._ask(port, request)
        self._pace.took(now_ns - sent_ns - needs_ns)
        self._ended(exchange.complete, now_ns)
        if request is not None:
            self._plan.note_sent(request, now_ns)
        elif self._is_cycle:
            items += self._ask_if_due(port, now_ns)
        if self._decoder.exchange is exchange:  # else the next request has ended it
            items += self._feed("link", OVER)
        return self._heard(items)

    def _expected_bytes(self, exchange: Exchange) -> float:
        """Bytes of the answers that are still expected."""
        given_up = self._decoder.roster.given_up
        expected = sum(not given_up(servo) for servo in exchange.missing)
        return expected * self._decoder.family.answer_bytes(exchange.request)

    def _decode(self) -> None:
        """What has been received: all at once, as each look takes time while answers come in.
        What they tell is said at the exchange's end."""
        for frame in self._undecoded:
            self._take(frame)
        self._undecoded.clear()
        self._brought = b""

    def _hang_up(self) -> None:
        self._decode()
        super()._hang_up()
