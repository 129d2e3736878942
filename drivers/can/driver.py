"""The CAN driver: opens and reads a bus that may vanish; the decoder never sees one.

One loop, within `read`, receives, sends SYNC at absolute deadlines and serves the nodes. Work that
blocks (opening an interface, configuring a node by SDO) is a `Job` in a thread of its own, one at a
time.
"""

from __future__ import annotations

import time

import can
import numpy as np

from armd.drivers.can.bus import BusFault, OwnNetwork, open_bus
from armd.drivers.can.decoder import CanDecoder, encode_note
from armd.drivers.can.objects import SDO_REPLY_BASE, CanFrame
from armd.drivers.can.setup.job import Job
from armd.drivers.can.setup.node_setup import NodeSetup
from armd.drivers.config import CanConfig
from armd.drivers.identity import Expectation
from armd.drivers.sample import Item
from armd.drivers.shell import Shell

RENEW_NS = 2_000_000_000  # a bus that stays silent is rebuilt this often
BURST = 64  # the most frames received before SYNC and the nodes are served
HELD_SYNC_NS = 1_000_000  # how often a SYNC that must wait is checked again
OPENING_MOST_NS = 3_000_000_000  # after this, an event is sent
SLICE_S = 0.01  # the longest wait for a frame, because a job may end meanwhile


class CanDriver(Shell[CanDecoder]):
    """The driver of CANopen arms; see `armd.drivers.sample.Driver`."""

    def __init__(self, config: CanConfig, expectation: Expectation) -> None:
        decoder = CanDecoder(expectation, config.rate_hz, config.max_joint_rate_deg_s)
        name = f"{config.interface} {config.channel or ''}".strip()
        super().__init__(decoder, name, RENEW_NS, "can")
        self._config = config
        self._setup = NodeSetup(expectation, config.rate_hz, config.encoder_serial_numbers)
        self._network: OwnNetwork | None = None
        self._opening: Job[can.BusABC] | None = None
        self._send_faults = self._garbled = 0  # counters of networks that are closed
        self._opening_since_ns = 0
        self._period_ns = round(1e9 / config.rate_hz)
        self._sync_due_ns = 0

    @property
    def counters(self) -> dict[str, int]:
        network = self._network
        return {
            **super().counters,
            "send_faults": self._send_faults + (network.send_faults if network else 0),
            "garbled": self._garbled + (network.garbled if network else 0),
        }

    def close(self) -> None:
        if self._network is not None:
            self._send_faults += self._network.send_faults
            self._garbled += self._network.garbled
            self._network.close()
            self._network = None

    def read(self, timeout_s: float) -> list[Item]:
        deadline_ns = time.monotonic_ns() + round(timeout_s * 1e9)
        items: list[Item] = []
        while not items:
            if self._network is None:
                items += self._try_open()
            else:
                items += self._turn(self._network, deadline_ns)
            if time.monotonic_ns() >= deadline_ns:
                break
        return _joined(items)

    # --- one turn of the loop ----------------------------------------------------------------

    def _turn(self, network: OwnNetwork, deadline_ns: int) -> list[Item]:
        """Receive all waiting frames, serve the nodes, and send SYNC if it is due."""
        now_ns = time.monotonic_ns()
        items = self._look_after_nodes(network, now_ns)
        due_ns = min(deadline_ns, self._line.act_ns)
        if self._config.sync == "producer":
            due_ns = min(due_ns, max(self._sync_due_ns, now_ns + HELD_SYNC_NS))
        received: list[Item] = []  # frames before a fault are still delivered
        broken: BusFault | None = None
        try:
            self._receive(network, (due_ns - now_ns) / 1e9, received)
        except BusFault as fault:
            broken = fault
        items += self._line.heard(self._decoder.last_heard_ns, received)
        now_ns = time.monotonic_ns()
        if broken is not None:
            self._hang_up()
            return [*items, *self._line.lost("bus_fault", str(broken), now_ns)]
        if now_ns >= self._line.act_ns:
            self._hang_up()
            items += self._line.silent(now_ns)
        return items

    def _receive(self, network: OwnNetwork, timeout_s: float, items: list[Item]) -> None:
        """Receive frames until there are none, then send SYNC: no answer waits unread then.

        The completed items are added to *items*. Raises `BusFault`.
        """
        items += self._feed_sent(network)
        frame = network.receive(max(0.0, min(timeout_s, SLICE_S)))
        for _ in range(BURST):
            if frame is None:
                self._sync_if_due(network)
                break
            items += self._feed_sent(network)  # frames sent before this one came
            items += self._take(frame)
            message = CanFrame.from_bytes(frame.data)
            if message.identifier & ~0x7F == SDO_REPLY_BASE:
                network.notify(message.identifier, bytearray(message.data), 0.0)
            frame = network.receive(0.0)

    def _sync_if_due(self, network: OwnNetwork) -> None:
        now_ns = time.monotonic_ns()
        is_due = self._config.sync == "producer" and now_ns >= self._sync_due_ns
        if is_due and self._decoder.may_sync(now_ns):
            network.send_sync()
            late = (now_ns - self._sync_due_ns) // self._period_ns
            self._sync_due_ns += (late + 1) * self._period_ns

    def _look_after_nodes(self, network: OwnNetwork, now_ns: int) -> list[Item]:
        wanting = [node.number for node in self._decoder.nodes.values() if node.wants_configuration]
        return [
            item for data in self._setup.step(network, wanting, now_ns) for item in self._note(data)
        ]

    # --- the bus -------------------------------------------------------------------------------

    def _try_open(self) -> list[Item]:
        if self._opening is None:
            wait_ns = self._line.open_due_ns - time.monotonic_ns()
            if wait_ns > 0:
                time.sleep(min(wait_ns / 1e9, SLICE_S))
                return []
            self._opening = Job(lambda: open_bus(self._config))
            self._opening_since_ns = time.monotonic_ns()
        if not self._opening.wait(SLICE_S):
            now_ns = time.monotonic_ns()
            if now_ns < self._opening_since_ns + OPENING_MOST_NS:
                return []
            text = f"not open within {OPENING_MOST_NS / 1e9:g} s, and still being waited for"
            return self._line.lost("bus_missing", text, now_ns)
        job, self._opening = self._opening, None
        now_ns = time.monotonic_ns()
        try:
            bus = job.result()
        except BusFault as fault:
            return self._line.lost("bus_missing", str(fault), now_ns)
        self._network = OwnNetwork(bus, self._time)
        self._setup.restart()
        self._line.opened(now_ns)
        self._sync_due_ns = now_ns
        return self._note(encode_note(note="up"))

    def _hang_up(self) -> None:
        self.close()
        self._note(encode_note(note="down"))

    # --- to the decoder ------------------------------------------------------------------------

    def _feed_sent(self, network: OwnNetwork) -> list[Item]:
        items: list[Item] = []
        while network.sent:
            items += self._take(network.sent.popleft())
        return items

    def _note(self, data: bytes) -> list[Item]:
        return self._feed("link", data)


def _joined(items: list[Item]) -> list[Item]:
    """Join arrays of samples that follow one another."""
    joined: list[Item] = []
    for item in items:
        if joined and isinstance(item, np.ndarray) and isinstance(joined[-1], np.ndarray):
            joined[-1] = np.concatenate([joined[-1], item])
        else:
            joined.append(item)
    return joined
