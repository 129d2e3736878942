"""One request and its answers: finds the answers, and estimates when each servo measured.

Servos answer one after the other, each in its own slot. The request bounds the slots from below,
the arrivals (batched by USB) from above; the middle is taken. A servo's position is assumed to be
that at the beginning of its own answer. No document states when a servo samples. It may be earlier
by at most one slot and one period of the servo's own 1 ms loop.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Sequence

from armd.drivers.poll.protocol.family import Family
from armd.drivers.poll.protocol.packet import Packet, ReadRequest, Status
from armd.drivers.sample import RawFrame

#: The last answers of servos, by id and number of requested bytes.
Said = dict[tuple[int, int], Status]


class TimedStatus:
    """A servo's status and the arrival of its last byte."""

    __slots__ = ("arrived_ns", "status")

    def __init__(self, status: Status, arrived_ns: int) -> None:
        self.status = status
        self.arrived_ns = arrived_ns


class Exchange:
    """A request that is open while answers may come.

    A late answer to an earlier request has another length than this one's answers, because no two
    successive requests ask for the same length.
    """

    def __init__(
        self,
        request: ReadRequest,
        sent: RawFrame,
        family: Family,
        counted: Counter[str],
        last_answers: Said,
        other_ids: Container[int],
    ) -> None:
        """Open the exchange of *request*.

        *last_answers*: the servos' answers to the requests before this one; *other_ids*: ids that
        other requests ask.
        """
        self.request = request
        self.sent = sent
        self.answers: dict[int, TimedStatus] = {}
        self.doubtful: set[int] = set()  # servos with two answers that differ
        #: servos that answered an earlier request again, and differently
        self.contradicted: set[int] = set()
        self._last_answers = last_answers
        self._other_ids = other_ids
        self._family = family
        self._counted = counted

    def note(self) -> None:
        """Record the answers at the end, to distinguish later second answers from late ones."""
        length = self.request.length
        for servo in self.request.ids:
            self._last_answers.pop((servo, length), None)
        for servo, answer in self.answers.items():
            self._last_answers[servo, length] = answer.status

    @property
    def is_cycle(self) -> bool:
        """Whether it reads the angles of all joints, or of the next one."""
        return self.request.address == self._family.position

    @property
    def complete(self) -> bool:
        return len(self.answers) == len(self.request.ids)

    @property
    def missing(self) -> list[int]:
        return [servo for servo in self.request.ids if servo not in self.answers]

    def take(self, packets: list[Packet], arrived_ns: int) -> None:
        for packet in packets:
            if packet.raw == self.sent.data:  # some adapters echo what they send
                self._counted["echoes"] += 1
                continue
            for status in self._family.statuses(packet, self.request.length):
                self._accept(status, arrived_ns)

    def _accept(self, status: Status, arrived_ns: int) -> None:
        is_asked = status.id in self.request.ids
        refuses = self._family.refuses(status.error) or not status.data
        if not is_asked or len(status.data) != self.request.length:
            is_known = is_asked or status.id in self._other_ids
            why = "foreign" if not is_known else "refused" if refuses else "late"
            self._counted[why] += 1
            if is_contradiction(status, self._last_answers):
                self.contradicted.add(status.id)
        elif refuses:
            self._counted["refused"] += 1
        elif status.id not in self.answers:
            self.answers[status.id] = TimedStatus(status, arrived_ns)
        else:
            self._counted["repeated"] += 1
            if status != self.answers[status.id].status:
                self.doubtful.add(status.id)

    def instants(self, byte_ns: float, gaps_ns: Sequence[float]) -> list[float]:
        """Return the instant of each servo's position, in the order of the request.

        *gaps_ns*: the pauses before their answers.
        """
        request = self.request
        arrived = [
            None if (answer := self.answers.get(servo)) is None else answer.arrived_ns
            for servo in request.ids
        ]
        size_ns = self._family.answer_bytes(request) * byte_ns
        request_ns = len(self.sent.data) * byte_ns
        return compute_instants(self.sent.monotonic_ns, request_ns, arrived, size_ns, gaps_ns)

    def late_ns(self, byte_ns: float, gaps_ns: Sequence[float]) -> int:
        """Return how much later than the line's own time the last answer came.

        The instants are known only within this time.
        """
        request = self.request
        n_bytes = len(self.sent.data) + len(self.answers) * self._family.answer_bytes(request)
        needs_ns = n_bytes * byte_ns + sum(
            gap_ns
            for servo, gap_ns in zip(request.ids, gaps_ns, strict=True)
            if servo in self.answers
        )
        return round(self.heard_ns - self.sent.monotonic_ns - needs_ns)

    @property
    def heard_ns(self) -> int:
        """The arrival of its last answer; there must be one."""
        return max(answer.arrived_ns for answer in self.answers.values())


class GatheredCycle:
    """The exchanges of a cycle whose servos are read one by one; used like an `Exchange`.

    Each servo's instant comes from its own exchange. The sampler moves all joints to the first of
    these instants, as after a sync read, over a longer time: see docs/reference/servo.md.
    """

    def __init__(self, first: ReadRequest, sent: RawFrame, ids: tuple[int, ...]) -> None:
        """Take the cycle's *first* request, *sent* in that frame; *ids*: all its servos."""
        self.request = first._replace(ids=ids, is_single=False)
        self.sent = sent
        self.answers: dict[int, TimedStatus] = {}
        self.doubtful: set[int] = set()
        self._exchanges: dict[int, Exchange] = {}

    def lacks(self, request: ReadRequest | None) -> bool:
        """Return whether *request* asks for a part of this cycle that is still missing."""
        return (
            request is not None
            and request.is_single
            and request.address == self.request.address
            and request.length == self.request.length
            and request.ids[0] not in self._exchanges
        )

    def add(self, exchange: Exchange) -> None:
        """Add *exchange*, which is closed."""
        self._exchanges[exchange.request.ids[0]] = exchange
        self.answers.update(exchange.answers)
        self.doubtful |= exchange.doubtful

    @property
    def complete(self) -> bool:
        """Whether the last servo has been asked; some may not have answered."""
        return self.request.ids[-1] in self._exchanges

    @property
    def heard_ns(self) -> int:
        return max(answer.arrived_ns for answer in self.answers.values())

    def instants(self, byte_ns: float, gaps_ns: Sequence[float]) -> list[float]:
        """Return each servo's instant; for a missing answer, when it could have come."""
        at_ns: list[float] = []
        here_ns = float(self.sent.monotonic_ns)
        for servo, gap_ns in zip(self.request.ids, gaps_ns, strict=True):
            exchange = self._exchanges.get(servo)
            if exchange is not None and exchange.answers:
                (here_ns,) = exchange.instants(byte_ns, [gap_ns])
            elif exchange is not None:
                sent = exchange.sent
                here_ns = sent.monotonic_ns + len(sent.data) * byte_ns + gap_ns
            at_ns.append(here_ns)
        return at_ns

    def late_ns(self, byte_ns: float, gaps_ns: Sequence[float]) -> int:
        """Return the largest `Exchange.late_ns`, or the host's longest pause if that is longer.

        A pause between an answer and the next request spreads the joints' instants.
        """
        late_ns: list[int] = []
        before: Exchange | None = None
        for servo, gap_ns in zip(self.request.ids, gaps_ns, strict=True):
            exchange = self._exchanges.get(servo)
            if exchange is not None and before is not None and before.answers:
                late_ns.append(exchange.sent.monotonic_ns - before.heard_ns)
            if exchange is not None and exchange.answers:
                late_ns.append(exchange.late_ns(byte_ns, [gap_ns]))
            before = exchange
        return max(late_ns)


def is_contradiction(status: Status, last_answers: Said) -> bool:
    """Return whether the servo has answered that request before, with another answer."""
    return last_answers.get((status.id, len(status.data)), status) != status


def compute_instants(
    sent_ns: int,
    request_ns: float,
    arrived_ns: Sequence[int | None],
    size_ns: float,
    gaps_ns: Sequence[float],
) -> list[float]:
    """Compute the instant of each servo's position, in the order of the request.

    *sent_ns*: when the request was sent, which takes *request_ns*; *arrived_ns*: arrival of each
    answer's last byte, None for one that did not come (its slot is skipped; one must have come);
    *size_ns*: the duration of an answer; *gaps_ns*: the least pause before each. Each instant is
    the middle between the earliest and the latest that these allow.
    """
    last = max(j for j, arrived in enumerate(arrived_ns) if arrived is not None)
    end: float = max(arrived for arrived in arrived_ns if arrived is not None)
    anchor = end
    begins = [anchor] * len(arrived_ns)
    for j in range(last, -1, -1):
        arrived = arrived_ns[j]
        if arrived is None:
            begins[j] = end
            continue
        begins[j] = min(end, arrived) - size_ns
        end = begins[j] - gaps_ns[j]
    # A line faster than its baud rate (a pseudo-terminal): stay within the certain bounds.
    early = sent_ns - begins[0]
    if early > 0:
        shrink = (anchor - sent_ns) / (anchor - begins[0])
        begins = [anchor - (anchor - begin) * shrink for begin in begins]
    earliest = sent_ns + request_ns
    for j, arrived in enumerate(arrived_ns):
        if arrived is not None:
            earliest += gaps_ns[j]
            begins[j] -= max(0.0, begins[j] - earliest) / 2
            earliest += size_ns
    return begins
