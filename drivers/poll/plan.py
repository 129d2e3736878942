"""What to ask next on a servo line, and how long to wait for the answers. No port, no clock."""

from __future__ import annotations

from collections.abc import Sequence

from armd.drivers.poll.decoder import ServoDecoder
from armd.drivers.poll.protocol.packet import ReadRequest

WARM_EVERY_NS = 500_000_000
RECHECK_EVERY_NS = 500_000_000  # one servo after the other says again who it is
EXPLAIN_EVERY_NS = 1_000_000_000
STRANGER_EVERY_NS = 50_000_000
#: Nothing has come at all: a busy host, or a line that is silent.
FIRST_BYTE_NS = 50_000_000
#: Answers have begun to come, then no more: three times what they were ever late, within these.
PAUSE_LEAST_NS, PAUSE_MOST_NS = 5_000_000, 30_000_000
#: All but those that have not answered for some cycles have.
ACCUSTOMED_NS = 1_000_000
EXCESS_KEPT = 0.998  # of what answers were late, from cycle to cycle
FAST_AGAIN_NS = 10_000_000_000
CALM_CYCLES = 4  # complete ones, after which an answer can only be late by one


class Pace:
    """How long answers take on this line, beyond what its arithmetic says."""

    def __init__(self) -> None:
        self._excess_ns = PAUSE_MOST_NS / 3

    def took(self, excess_ns: float) -> None:
        """A complete exchange took so much longer than the line needs."""
        self._excess_ns = max(excess_ns, self._excess_ns * EXCESS_KEPT)

    @property
    def pause_ns(self) -> float:
        """No answer comes so long after the one before."""
        return min(max(3 * self._excess_ns, PAUSE_LEAST_NS), PAUSE_MOST_NS)

    @property
    def accustomed_ns(self) -> float:
        """The same where nobody expects an answer."""
        return self._excess_ns + ACCUSTOMED_NS


class RequestPlan:
    """Chooses the requests of one connection."""

    def __init__(self, decoder: ServoDecoder) -> None:
        self._decoder = decoder
        self._extra = 0  # bytes asked for beyond those wanted: no two cycles ask for as many
        self._calm = CALM_CYCLES
        self._turn = 0  # of those that can only be asked one by one
        self.restart(0)

    def restart(self, now_ns: int) -> None:
        """Another connection."""
        self._warm_due_ns = now_ns
        self._recheck_due_ns = now_ns + RECHECK_EVERY_NS
        self._rechecked = 0
        self._explain_due_ns = now_ns
        self._strangers_due_ns: dict[int, int] = {}  # by servo
        self._fast_failures = 0
        self._fast_worked = False
        self._fast_from_ns = now_ns
        self._asked_fast = self._asked_warm = False
        self._remaining: list[ReadRequest] = []  # of a cycle that is read one by one
        self._is_complete = True  # nobody has failed to answer in it so far

    @property
    def within_cycle(self) -> bool:
        """Whether other servos of the same cycle are to be asked next."""
        return bool(self._remaining)

    def select(self, servos: Sequence[int]) -> tuple[int, ...]:
        """Those of *servos* that the next request can ask: all, or one after the other."""
        if not self._decoder.one_by_one.active:
            return tuple(servos)
        self._turn += 1
        return (servos[self._turn % len(servos)],)

    def identity(self, servos: Sequence[int]) -> ReadRequest:
        """Who are you? *servos* as selected."""
        if self._decoder.one_by_one.active:
            return self.identity_alone(servos[0])
        return ReadRequest(tuple(servos), 0, self._decoder.family.identity_bytes)

    def identity_alone(self, servo: int) -> ReadRequest:
        """The same, of one that may not know sync reads. It asks for another length, so that a
        late answer to a sync read does not pass for an answer to this."""
        return ReadRequest((servo,), 0, self._decoder.family.identity_bytes + 1, is_single=True)

    def side_question(self, now_ns: int) -> ReadRequest | None:
        """What is due besides the cycles."""
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
        if family.alarm is not None and now_ns >= self._explain_due_ns and roster.alerting:
            self._explain_due_ns = now_ns + EXPLAIN_EVERY_NS
            one_by_one = self._decoder.one_by_one.active
            return ReadRequest(self.select(roster.alerting), family.alarm, 1, is_single=one_by_one)
        if now_ns >= self._recheck_due_ns and roster.servos:
            self._recheck_due_ns = now_ns + RECHECK_EVERY_NS
            self._rechecked += 1
            identified = list(roster.servos)
            return self.identity([identified[self._rechecked % len(identified)]])
        return None

    def cycle(self, now_ns: int) -> ReadRequest:
        """All positions, and the temperatures where these are due; nothing is changed by asking
        for it, `asked` tells that it was sent. One by one: the part that is next."""
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
        """A `cycle` went out."""
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

    def ended(self, complete: bool, now_ns: int) -> None:
        """The answers to the last `cycle` have come, or will not."""
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
        if self._asked_warm:  # whatever was asked is asked again
            self._warm_due_ns = now_ns
        if self._fast_failures >= 3:
            self._fast_failures = 0
            # Firmware that does not know it will not learn it.
            self._fast_from_ns = now_ns + (FAST_AGAIN_NS if self._fast_worked else 10**15)
