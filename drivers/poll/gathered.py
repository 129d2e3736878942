"""A cycle gathered from one exchange per servo: for servos that answer no sync read.

Each servo's instant comes from its own exchange. The sampler then moves all joints to the first
one's instant, as it does for a sync read, over a longer time: see docs/servo.md.
"""

from __future__ import annotations

from collections.abc import Sequence

from armd.drivers.poll.exchange import Exchange, TimedStatus
from armd.drivers.poll.protocol.packet import ReadRequest
from armd.drivers.sample import RawFrame


class GatheredCycle:
    """The exchanges of one cycle; it has what the decoder reads of an `Exchange`."""

    def __init__(self, first: ReadRequest, sent: RawFrame, ids: tuple[int, ...]) -> None:
        """*first*: the cycle's first request, *sent* in that frame; *ids*: all that it asks."""
        self.request = first._replace(ids=ids, alone=False)
        self.sent = sent
        self.answers: dict[int, TimedStatus] = {}
        self.doubtful: set[int] = set()
        self._exchanges: dict[int, Exchange] = {}

    def lacks(self, request: ReadRequest | None) -> bool:
        """Whether *request* asks for a part of this cycle that is still missing."""
        return (
            request is not None
            and request.alone
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
