"""Chooses the next request of a servo line. No port, no clock.

There are three kinds of exchange. The acquaintance identifies the servos, before the first cycle
and after each write. A side question asks some servos for the reason of an alert, or whether they
are still the same. A cycle reads all angles, and the temperatures where these are due. Each kind
waits for those before it, but a cycle that is read one by one is finished first.
"""

from __future__ import annotations

from collections.abc import Sequence

from armd.drivers.poll.decoder import ServoDecoder
from armd.drivers.poll.exchange import Exchange
from armd.drivers.poll.protocol.packet import ReadRequest

WARM_EVERY_NS = 500_000_000
RECHECK_EVERY_NS = 500_000_000  # one servo after the other is identified again
EXPLAIN_EVERY_NS = 1_000_000_000
STRANGER_EVERY_NS = 50_000_000
FAST_AGAIN_NS = 10_000_000_000
CALM_CYCLES = 4  # after this many complete cycles, an answer can be late by one only


class RequestPlan:
    """The requests of one connection, in their order."""

    def __init__(self, decoder: ServoDecoder, period_ns: int) -> None:
        """Take the decoder, and the *period_ns* of the cycles; 0: as fast as the line allows."""
        self._decoder = decoder
        self._period_ns = period_ns
        self._extra = 0  # extra bytes: successive cycles must differ in length
        self._calm = CALM_CYCLES
        self._turn = 0  # counter of servos that are asked one by one
        self.restart(0)

    def restart(self, now_ns: int) -> None:
        """Begin another connection."""
        self.due_ns = now_ns  # the next cycle
        self._side: ReadRequest | None = None  # a side question that is due
        self._warm_due_ns = now_ns
        self._recheck_due_ns = now_ns + RECHECK_EVERY_NS
        self._rechecked = 0
        self._explain_due_ns = now_ns
        self._strangers_due_ns: dict[int, int] = {}  # by servo
        self._fast_failures = 0
        self._fast_worked = False
        self._fast_from_ns = now_ns
        self._asked_fast = self._asked_warm = False
        self._remaining: list[ReadRequest] = []  # the rest of a cycle that is read one by one
        self._is_complete = True  # every servo asked in it so far has answered

    @property
    def within_cycle(self) -> bool:
        """Whether other servos of the same cycle must be asked next."""
        return bool(self._remaining)

    def take_due(self, now_ns: int, question: ReadRequest | None) -> ReadRequest | None:
        """Return the request that is due, as sent; *question*: that of the acquaintance, if any."""
        if not self._remaining:
            question = question or self._side or self._side_question(now_ns)
            self._side = None
            if question is not None:
                return question
            if now_ns < self.due_ns:
                return None
            if not self._decoder.chain_broken:
                self._set_next_due(now_ns)
        request = self.cycle(now_ns)
        self.note_sent(request, now_ns)
        return request

    def look_ahead(self, now_ns: int) -> ReadRequest | None:
        """Return the cycle to request as soon as the present one's last answer is here.

        None where something else is due before it. The acquaintance must be idle.
        """
        if not self._remaining:
            if self._period_ns or self._side is not None:
                return None
            self._side = self._side_question(now_ns)
            if self._side is not None:
                return None
        return self.cycle(now_ns)

    def _set_next_due(self, now_ns: int) -> None:
        if self._period_ns:
            late = max(0, now_ns - self.due_ns) // self._period_ns
            self.due_ns = max(self.due_ns, now_ns - late) + self._period_ns

    def select(self, servos: Sequence[int]) -> tuple[int, ...]:
        """Return the *servos* that the next request can ask: all, or one after the other."""
        if not self._decoder.one_by_one.active:
            return tuple(servos)
        self._turn += 1
        return (servos[self._turn % len(servos)],)

    def identity(self, servos: Sequence[int]) -> ReadRequest:
        """Return the request that identifies *servos*, as selected."""
        if self._decoder.one_by_one.active:
            return self.identity_alone(servos[0])
        return ReadRequest(tuple(servos), 0, self._decoder.family.identity_bytes)

    def identity_alone(self, servo: int) -> ReadRequest:
        """Return the request that identifies one servo, which may not know sync reads.

        It asks for another length, so that a late answer to a sync read does not count as its
        answer.
        """
        return ReadRequest((servo,), 0, self._decoder.family.identity_bytes + 1, is_single=True)

    def _side_question(self, now_ns: int) -> ReadRequest | None:
        """Return the request that is due besides the cycles, if there is one."""
        roster, family = self._decoder.roster, self._decoder.family
        if suspects := roster.suspects & roster.servos.keys():
            selected = self.select(sorted(suspects))
            roster.suspects = suspects.difference(selected)
            return self.identity(selected)
        if strangers := roster.strangers:
            due_ns = self._strangers_due_ns
            due_strangers = [servo for servo in strangers if now_ns >= due_ns.get(servo, 0)]
            if due_strangers:
                selected = self.select(due_strangers)
                due_ns.update(dict.fromkeys(selected, now_ns + STRANGER_EVERY_NS))
                return self.identity(selected)
        alerting = roster.alerts.servos
        if alerting and family.alarm is not None and now_ns >= self._explain_due_ns:
            self._explain_due_ns = now_ns + EXPLAIN_EVERY_NS
            one_by_one = self._decoder.one_by_one.active
            return ReadRequest(self.select(alerting), family.alarm, 1, is_single=one_by_one)
        if now_ns >= self._recheck_due_ns and roster.servos:
            self._recheck_due_ns = now_ns + RECHECK_EVERY_NS
            self._rechecked += 1
            identified = list(roster.servos)
            return self.identity([identified[self._rechecked % len(identified)]])
        return None

    def cycle(self, now_ns: int) -> ReadRequest:
        """Return the request of all positions, and of the temperatures where these are due.

        One by one, it is the next part. `note_sent` reports that it was sent.
        """
        if self._remaining:
            return self._remaining[0]
        decoder, family = self._decoder, self._decoder.family
        warm = now_ns >= self._warm_due_ns or decoder.roster.wants_warmth
        ids = decoder.everyone if warm else decoder.cycle_ids
        extra = (self._extra + 1) % (2 if self._calm >= CALM_CYCLES else 4)
        length = self._least_bytes(warm) + extra
        if decoder.one_by_one.active:
            return ReadRequest(ids[:1], family.position, length, is_single=True)
        fast = (
            family.has_fast
            and not decoder.chain_broken
            and now_ns >= self._fast_from_ns
            and all(map(decoder.roster.servos.__contains__, ids))
        )
        return ReadRequest(ids, family.position, length, fast)

    def _least_bytes(self, warm: bool) -> int:
        family = self._decoder.family
        if warm:
            return family.warm_bytes
        # A Feetech's answer of 2 bytes looks like a late echo of a plain read.
        return family.position_bytes + self._decoder.one_by_one.active

    def note_sent(self, request: ReadRequest, now_ns: int) -> None:
        """Record that a cycle was sent."""
        if self._remaining:
            del self._remaining[0]
            return
        decoder, family = self._decoder, self._decoder.family
        self._asked_fast = request.fast
        self._asked_warm = request.length >= family.warm_bytes
        self._extra = request.length - self._least_bytes(self._asked_warm)
        if request.is_single:
            ids = decoder.everyone if self._asked_warm else decoder.cycle_ids
            self._remaining = [request._replace(ids=(servo,)) for servo in ids[1:]]
        if self._asked_warm:
            self._warm_due_ns = now_ns + WARM_EVERY_NS
            decoder.roster.wants_warmth = False

    def ended(self, exchange: Exchange, complete: bool, now_ns: int) -> None:
        """Record that *exchange* has ended, *complete* or not.

        Only cycles count here.
        """
        if not exchange.is_cycle:
            return
        self._is_complete = complete = self._is_complete and complete
        if self._remaining:
            return
        self._is_complete = True
        self._calm = self._calm + 1 if complete else 0
        if not self._asked_fast:
            return
        self._asked_fast = False
        if complete:
            self._fast_worked, self._fast_failures = True, 0
            return
        self._fast_failures += 1
        if self._asked_warm:  # the temperatures are requested again
            self._warm_due_ns = now_ns
        if self._fast_failures >= 3:
            self._fast_failures = 0
            # Firmware that does not know Fast Sync Read never will.
            self._fast_from_ns = now_ns + (FAST_AGAIN_NS if self._fast_worked else 10**15)
