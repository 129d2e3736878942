"""Decodes raw frames of a servo line to samples, temperatures and events, without port or clock.

Sent frames show what was requested and when. Other facts that the driver knows come as notes,
frames of direction "link", so that a recording replays to the same samples, bit by bit.
"""

from __future__ import annotations

import json
from collections import Counter
from typing import Any

from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.poll.exchange import Exchange, GatheredCycle, Said, is_contradiction
from armd.drivers.poll.protocol.families import FAMILIES
from armd.drivers.poll.protocol.packet import ReadRequest, Status
from armd.drivers.poll.sampler import ServoSampler
from armd.drivers.poll.servos.button import Button
from armd.drivers.poll.servos.one_by_one import OneByOne
from armd.drivers.poll.servos.pauses import Pauses
from armd.drivers.poll.servos.roster import Roster
from armd.drivers.poll.servos.stuck import StuckWatch
from armd.drivers.poll.servos.warmth import Warmth
from armd.drivers.sample import Event, Item, RawFrame
from armd.drivers.unwrap import load_compiled

CHANNEL = "poll"
COUNTED = ("missed", "late", "foreign", "repeated", "refused", "echoes", "unasked")
OVER = b'{"note": "over"}'  # no more answers to the last request; a new request means the same
BITS = 10  # bits of a byte on the line: start, eight, stop


def encode_note(**fields: Any) -> bytes:
    """Encode a note as data of a "link" frame.

    {"note": "up", "down", "one_by_one", "missing", "verdict", "foreign", "told", "state"}.
    """
    return json.dumps(fields).encode()


class ServoDecoder:
    """Decodes every `RawFrame` of a line in order, sent ones too."""

    def __init__(self, config: ServoConfig, expectation: Expectation) -> None:
        self.family = family = FAMILIES[config.kind]
        self.last_sample_ns: int | None = None  # arrival, host monotonic
        self.last_heard_ns: int | None = None  # arrival of the last answer, host monotonic
        self.exchange: Exchange | None = None  # the one whose answers may still come
        self.one_by_one = OneByOne(always=not family.has_sync)
        self._gathered: GatheredCycle | None = None  # the cycle that is being read one by one
        self._expected = expectation
        self._port = config.port
        self.byte_ns = BITS * 1e9 / config.baud
        self.joints = tuple(config.ids)
        self._trigger = config.trigger
        sensors = config.ids if config.temperature_ids is None else config.temperature_ids
        sensors = sensors[: expectation.n_sensors]
        #: the servos of a cycle, and those of a cycle that also reads temperatures
        self.cycle_ids = self.joints
        if self._trigger is not None and self._trigger.id not in self.joints:
            self.cycle_ids += (self._trigger.id,)
        self.everyone = tuple(dict.fromkeys((*self.cycle_ids, *sensors)))
        self.roster = Roster(family, self.joints, self.cycle_ids, self.everyone)
        self._button = Button(
            self._trigger, "" if self._trigger is None else self.roster.name(self._trigger.id)
        )
        self.stuck = StuckWatch()
        self.pauses = Pauses(family, self.roster.servos)
        self.chain_broken = False  # the last cycle's answers ended early, all in one packet
        self._sampler = ServoSampler(config.ids, config.max_joint_rate_deg_s)
        self._warmth = Warmth(sensors, self.roster.name, family.register("temperature"))
        self._splitter = family.splitter()
        self._request_splitter = family.splitter()  # splits our requests
        self._requests: dict[bytes, ReadRequest | None] = {}  # the meaning of each packet
        self._sizes = self._other_sizes = range(0)  # sizes of answers to the last requests
        self._number = -1  # number of the present cycle
        self._settled = False  # the arm's identity is known
        self.counted: Counter[str] = Counter()
        self._missed: Counter[int] = Counter()
        self._last_answers: Said = {}
        self._under_way: list[RawFrame] = []  # frames of the open exchange
        self._before = (-1, False)  # number and broken chain when it began

    @property
    def counters(self) -> dict[str, int]:
        """The number of cycles delivered, of cycles and answers that were not, and other bytes."""
        missed = {f"servo_{servo}_missed": n for servo, n in sorted(self._missed.items())}
        return {name: self.counted[name] for name in COUNTED} | {
            "samples": self._sampler.delivered,
            "lost": self._sampler.lost,
            "untimed": self._sampler.untimed,
            "bad_sum": self._splitter.bad_sum,
            "junk": self._splitter.junk,
            **missed,
        }

    @property
    def accepted(self) -> bool:
        """Whether the servos are those of the expected arm, with the geometry that was accepted."""
        roster = self.roster
        return self._settled and bool(roster.servos) and not (roster.changed or roster.foreign)

    def warm_up(self) -> None:
        """Compile the decoder, or load it from the cache, before the first sample arrives."""
        load_compiled()

    def preamble(self) -> list[RawFrame]:
        """Return the frames from which a fresh decoder continues."""
        if not self._under_way or not self._settled:
            return []
        under_way = self._under_way if self.exchange or self._gathered else []
        number, broken = self._before if under_way else (self._number, self.chain_broken)
        state = encode_note(
            note="state",
            number=number,
            broken=broken,
            one_by_one=self.one_by_one.active,
            said=[
                (status.id, status.error, status.data.hex())
                for status in self._last_answers.values()
            ],
            sampler=self._sampler.state(),
            **self.roster.state(),
            **self._warmth.state(),
        )
        began = self._under_way[0]._replace(direction="link", data=state)
        return [began, *under_way]

    def feed(self, frame: RawFrame) -> list[Item]:
        """Decode *frame*; return the items that it completes."""
        if frame.direction == "rx":
            self._under_way.append(frame)
            return self._receive(frame)
        if frame.direction == "tx":
            return self._send(frame)
        if frame.data == OVER:
            return self._close(frame)
        return self._take_note(json.loads(frame.data), frame.monotonic_ns)

    # --- asking and answering ----------------------------------------------------------------

    def _send(self, frame: RawFrame) -> list[Item]:
        items = self._close(frame)
        if frame.data not in self._requests:
            (packet,) = self._request_splitter.push(frame.data)
            self._requests[frame.data] = self.family.request(packet)
        request = self._requests[frame.data]
        if self._gathered is not None and not self._gathered.lacks(request):
            items += self._end_gathered(self._gathered)
        if self._gathered is None:
            self._before, self._under_way = (self._number, self.chain_broken), []
        self._under_way.append(frame)
        if request is None:  # a write: its effect is read back later
            return items
        retry, self.chain_broken = self.chain_broken and not request.fast, False
        if request.address == self.family.position and not retry and self._gathered is None:
            self._number += 1
            if request.is_single:
                warm = request.length >= self.family.warm_bytes
                ids = self.everyone if warm else self.cycle_ids
                self._gathered = GatheredCycle(request, frame, ids)
        self.exchange = Exchange(
            request, frame, self.family, self.counted, self._last_answers, self.everyone
        )
        sizes = self.family.sizes(request)
        if sizes != self._sizes:
            self._other_sizes, self._sizes = self._sizes, sizes
        # The size identifies a late answer.
        self._splitter.sizes = {len(frame.data), *self._sizes, *self._other_sizes}
        return items

    def _receive(self, frame: RawFrame) -> list[Item]:
        packets = self._splitter.push(frame.data)
        if self.exchange is None:
            self.counted["unasked"] += len(packets)
            statuses = [
                sent_status for packet in packets for sent_status in self.family.statuses(packet, 0)
            ]
            twice = {
                status.id for status in statuses if is_contradiction(status, self._last_answers)
            }
            return [*self.roster.contradicted(twice, frame.monotonic_ns)]
        self.exchange.take(packets, frame.monotonic_ns)  # its items follow when it is closed
        return []

    def _close(self, frame: RawFrame) -> list[Item]:
        """Close the exchange, as no further answer belongs to it; return its items."""
        exchange, self.exchange = self.exchange, None
        if exchange is None:
            self._splitter.flush()
            return []
        exchange.take(self._splitter.flush(), frame.monotonic_ns)
        if exchange.answers:
            self.last_heard_ns = exchange.heard_ns
        if exchange.request.is_single and not self.one_by_one.active:
            self.roster.single_answers |= exchange.answers.keys()
            return []
        exchange.note()
        twice = exchange.contradicted | exchange.doubtful
        items: list[Item] = [*self.roster.contradicted(twice, exchange.sent.monotonic_ns)]
        address = exchange.request.address
        if (gathered := self._gathered) is not None:
            gathered.add(exchange)
            return items + self._end_gathered(gathered) if gathered.complete else items
        if address == self.family.position:
            return items + self._cycle(exchange)
        if address == self.family.alarm:
            explain = self.roster.alerts.explain
            return items + [
                event
                for servo, answer in exchange.answers.items()
                for event in explain(servo, answer.status.data[0], answer.arrived_ns)
            ]
        return items + [
            event
            for servo, answer in exchange.answers.items()
            if servo not in self.roster.doubles
            for event in self.roster.identify(
                servo, self.family.identity(answer.status.data), answer.arrived_ns
            )
        ]

    # --- cycles --------------------------------------------------------------------------------

    def _end_gathered(self, cycle: GatheredCycle) -> list[Item]:
        self._gathered = None
        items = self._cycle(cycle)
        if cycle.answers:
            items += self.one_by_one.events(cycle.sent.monotonic_ns)
        return items

    def _cycle(self, exchange: Exchange | GatheredCycle) -> list[Item]:
        request = exchange.request
        self.chain_broken = request.fast and not exchange.answers
        if self.chain_broken:  # a missing servo ended the packet: request the cycle again
            return []
        now_ns = exchange.sent.monotonic_ns
        items: list[Item] = []
        silent, warned = set(), 0
        for servo in request.ids:
            answer = exchange.answers.get(servo)
            if answer is None or servo in exchange.doubtful:
                self.counted["missed"] += 1
                self._missed[servo] += 1
            if answer is None:
                silent.add(servo)
                self.roster.silent(servo, now_ns)
                continue
            self.roster.heard(servo, now_ns)
            if servo in self.roster.doubles:
                silent.add(servo)
                continue
            error = answer.status.error
            alerts = self.family.alerts(error)
            items += self.roster.alerts.update(servo, error if alerts else 0, now_ns)
            if alerts and servo in self.joints:
                warned |= 1 << self.joints.index(servo)
        if exchange.answers.keys() <= exchange.doubtful:
            return items
        self.last_sample_ns = self.last_heard_ns
        gaps_ns = self.pauses.before_ns(request, self.roster.version)
        at_ns = exchange.instants(self.byte_ns, gaps_ns)
        unix_minus_monotonic_ns = exchange.sent.unix_ns - now_ns
        items += self._temperatures(exchange, silent, round(at_ns[0]), unix_minus_monotonic_ns)
        positions = {
            servo: self.family.position_of(answer.status.data, self.roster.model(servo))
            for servo, answer in exchange.answers.items()
            if servo not in silent
        }
        pressed, events = self._button.look(positions, now_ns)
        items += events
        counts = [positions.get(servo) for servo in self.joints]
        stuck = self.stuck.look(counts)
        items += self.stuck.events(now_ns)
        items += self._sampler.sample(
            self._number,
            counts,
            at_ns[: len(self.joints)],
            exchange.late_ns(self.byte_ns, gaps_ns),
            unix_minus_monotonic_ns,
            (1 << len(counts)) - 1 if stuck else self.roster.unusable,
            warned,
            pressed,
        )
        for k, servo in enumerate(self.joints):
            if self._sampler.jumped >> k & 1:
                self.roster.suspect(servo, now_ns)
            if self._sampler.leapt >> k & 1:
                self.roster.ask_anew(servo)
        return items

    def _temperatures(
        self,
        exchange: Exchange | GatheredCycle,
        silent: set[int],
        at_ns: int,
        unix_minus_monotonic_ns: int,
    ) -> list[Item]:
        """Return the temperatures of the cycle before; NaN for servos that do not answer now."""
        items = self._warmth.reading(silent, self.roster.doubles, at_ns, unix_minus_monotonic_ns)
        if exchange.request.length >= self.family.warm_bytes:
            for servo in exchange.answers.keys() - silent:
                data = exchange.answers[servo].status.data
                self._warmth.hear(servo, self.family.celsius_of(data))
        return items

    # --- what else is known --------------------------------------------------------------------

    def _take_note(self, note: dict[str, Any], now_ns: int) -> list[Item]:
        match note["note"]:
            case "up" | "down":
                self.exchange = self._gathered = None
                self._settled = self.chain_broken = False
                self.one_by_one.end()
                self._splitter.flush()
                self._sampler.pause()
                self.roster.forget()
                self.stuck.forget()
            case "one_by_one":
                self.one_by_one.begin(self.roster.single_answers)
                self.roster.single_answers.clear()
            case "missing":
                return [*self.roster.miss(note["servos"], self._port, now_ns)]
            case "verdict":
                first, self._settled = not self._settled, True
                changed = {int(servo): phrases for servo, phrases in note["changed"].items()}
                return [*self.roster.judge(changed, first, self._expected.serial_number, now_ns)]
            case "foreign":
                self.roster.foreign = note["text"]
                return [Event("foreign_arm", note["text"], now_ns, "error")]
            case "told":
                return [Event(note["kind"], note["text"], now_ns, note["severity"])]
            case "state":  # a recording begins in the middle
                self._number, self._settled = note["number"], True
                self.chain_broken = note["broken"]
                self.one_by_one.restore(note.get("one_by_one", False))  # older recordings lack it
                self.roster.restore(note, now_ns)
                for servo, error, data in note.get("said", ()):
                    status = Status(servo, error, bytes.fromhex(data))
                    self._last_answers[servo, len(status.data)] = status
                self._warmth.restore(note)
                self._sampler.restore(note["sampler"])
        return []
