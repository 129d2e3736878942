"""One request and what came back for it: which bytes are its answers, and when each servo answered.

Servos answer one after the other, each in a slot of its own. The request bounds the slots from
below, what arrives (batched by USB) from above; the middle is taken. A servo's position is taken
to be that at the beginning of its own answer: when exactly a servo samples is documented nowhere;
at the most it is one slot earlier, and one run of the servo's own 1 ms loop.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Container, Sequence

from armd.drivers.poll.protocol.family import Family
from armd.drivers.poll.protocol.packet import Packet, ReadRequest, Status
from armd.drivers.sample import RawFrame

#: What servos have answered, by their id and how many bytes they were asked for last.
Said = dict[tuple[int, int], Status]


class TimedStatus:
    """A servo's status and when its last byte had arrived."""

    __slots__ = ("arrived_ns", "status")

    def __init__(self, status: Status, arrived_ns: int) -> None:
        self.status = status
        self.arrived_ns = arrived_ns


class Exchange:
    """Open while answers may come. A late answer to an earlier request has another length than
    this one's answers have, because no two requests in a row ask for the same."""

    def __init__(
        self,
        request: ReadRequest,
        sent: RawFrame,
        family: Family,
        counted: Counter[str],
        last_answers: Said,
        other_ids: Container[int],
    ) -> None:
        """*last_answers*: what the servos answered to the requests before this one; *other_ids*:
        ids that other requests ask."""
        self.request = request
        self.sent = sent
        self.answers: dict[int, TimedStatus] = {}
        self.doubtful: set[int] = set()  # two answers that differ: which is it?
        #: who had answered an earlier request, and now does once more, in other words
        self.contradicted: set[int] = set()
        self._last_answers = last_answers
        self._other_ids = other_ids
        self._family = family
        self._counted = counted

    def note(self) -> None:
        """It is over: of whom another answer is a second one, and of whom it is only late."""
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
            if packet.raw == self.sent.data:  # some adapters hear what they say
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
        """Of each servo's position, in the order in which they were asked. *gaps_ns*: the pauses
        before their answers."""
        request = self.request
        arrived = [
            None if (answer := self.answers.get(servo)) is None else answer.arrived_ns
            for servo in request.ids
        ]
        size_ns = self._family.answer_bytes(request) * byte_ns
        request_ns = len(self.sent.data) * byte_ns
        return compute_instants(self.sent.monotonic_ns, request_ns, arrived, size_ns, gaps_ns)

    def late_ns(self, byte_ns: float, gaps_ns: Sequence[float]) -> int:
        """How long after the line's own time the last answer was here: within so long, and no
        closer, the instants are known."""
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
        """When the last of its answers had arrived; there must be one."""
        return max(answer.arrived_ns for answer in self.answers.values())


class GatheredCycle:
    """The exchanges of a cycle whose servos are read one by one; as an `Exchange` to the decoder.

    Each servo's instant comes from its own exchange. The sampler moves all joints to the first of
    these instants, as after a sync read, over a longer time: see docs/reference/servo.md.
    """

    def __init__(self, first: ReadRequest, sent: RawFrame, ids: tuple[int, ...]) -> None:
        """*first*: the cycle's first request, *sent* in that frame; *ids*: all that it asks."""
        self.request = first._replace(ids=ids, is_single=False)
        self.sent = sent
        self.answers: dict[int, TimedStatus] = {}
        self.doubtful: set[int] = set()
        self._exchanges: dict[int, Exchange] = {}

    def lacks(self, request: ReadRequest | None) -> bool:
        """Whether *request* asks for a part of this cycle that is still missing."""
        return (
            request is not None
            and request.is_single
            and request.address == self.request.address
            and request.length == self.request.length
            and request.ids[0] not in self._exchanges
        )

    def add(self, exchange: Exchange) -> None:
        """*exchange* is closed."""
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
        """As `Exchange.instants`; of a servo without an answer, when it could have answered."""
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
        """As `Exchange.late_ns`, the largest of all exchanges; or the longest time that the host
        let pass between an answer and the next request, as that spreads the joints' instants."""
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
    """Whether its sender has answered that request before, and said something else."""
    return last_answers.get((status.id, len(status.data)), status) != status


def compute_instants(
    sent_ns: int,
    request_ns: float,
    arrived_ns: Sequence[int | None],
    size_ns: float,
    gaps_ns: Sequence[float],
) -> list[float]:
    """The instant of each servo's position, in the order in which they were asked.

    *sent_ns*: when the request went out, which takes *request_ns*; *arrived_ns*: of each answer's
    last byte, None for one that did not come (its slot is skipped; one must have come); *size_ns*:
    how long an answer takes; *gaps_ns*: the pause before each, at least. Each is the middle between
    the earliest that these allow and the latest.
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
    # A line faster than it claims to be (a pseudo-terminal): within what is known for certain.
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
