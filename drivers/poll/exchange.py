"""One request and what came back for it: which bytes are its answers, and which are not."""

from __future__ import annotations

from collections import Counter

from armd.drivers.poll.family import Family
from armd.drivers.poll.packet import Packet, ReadRequest, Status
from armd.drivers.sample import RawFrame


class Answer:
    """A servo's status and when its last byte had arrived."""

    __slots__ = ("arrived_ns", "status")

    def __init__(self, status: Status, arrived_ns: int) -> None:
        self.status = status
        self.arrived_ns = arrived_ns


class Exchange:
    """Open while answers may come. A late answer to an earlier request has another length than
    this one's answers have, because no two requests in a row ask for the same."""

    def __init__(
        self, request: ReadRequest, sent: RawFrame, family: Family, counted: Counter[str]
    ) -> None:
        self.request = request
        self.sent = sent
        self.answers: dict[int, Answer] = {}
        self.doubtful: set[int] = set()  # two answers that differ: which is it?
        self._family = family
        self._counted = counted

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
        if status.id not in self.request.ids:
            self._counted["foreign"] += 1
        elif len(status.data) != self.request.length:
            self._counted["late" if status.data else "refused"] += 1
        elif status.id not in self.answers:
            self.answers[status.id] = Answer(status, arrived_ns)
        else:
            self._counted["repeated"] += 1
            if status != self.answers[status.id].status:
                self.doubtful.add(status.id)
