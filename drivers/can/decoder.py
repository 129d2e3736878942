"""Decodes raw CAN frames to samples, temperatures and events, without bus, clock or SDO.

The results of configuring a node come in as notes. These are frames of direction "link", recorded
like all others, so a recording replays to the same samples.
"""

from __future__ import annotations

import json
from collections import Counter
from typing import Any

from armd.drivers.can import news
from armd.drivers.can import objects as can
from armd.drivers.can.cycle import LATE_MOST_NS, CycleAssembler, EncoderReading
from armd.drivers.can.node import Node
from armd.drivers.can.sampler import CycleSampler
from armd.drivers.can.sync_time import SyncTime
from armd.drivers.can.thermometers import Thermometers
from armd.drivers.identity import Expectation
from armd.drivers.sample import Event, Item, RawFrame, Temperatures
from armd.drivers.unwrap import MAX_JOINT_RATE_DEG_S, load_compiled

COUNTED = ("malformed", "unknown", "error_frames", "foreign_sync")


def encode_note(**fields: Any) -> bytes:
    """Encode a note as data of a "link" frame: {"note": "up", "down", "configured", …}."""
    return json.dumps(fields).encode()


class CanDecoder:
    """Decodes every `RawFrame` of a bus in order, sent ones too: they carry the SYNC times."""

    def __init__(
        self,
        expectation: Expectation,
        rate_hz: float,
        max_joint_rate_deg_s: float = MAX_JOINT_RATE_DEG_S,
    ) -> None:
        self.last_sample_ns: int | None = None  # arrival, host monotonic
        self.last_heard_ns: int | None = None  # arrival of any frame of one of our nodes
        self._expected = expectation
        self._period_ns = round(1e9 / rate_hz)
        joints = range(1, expectation.n_joints + 1)
        self._thermometers = Thermometers(expectation.n_sensors)
        self.nodes = {k: Node(k, f"joint {k}") for k in joints} | {
            number: Node(number, f"temperature module {number:#x}", values_due=False)
            for number in self._thermometers.nodes
        }
        self._joints = [self.nodes[k] for k in joints]
        self._assembler = CycleAssembler()
        self._sampler = CycleSampler(self._joints, max_joint_rate_deg_s)
        self._sync_time = SyncTime()
        self._number = -1  # number of the present cycle
        self._last_sync_ns: int | None = None
        self._foreign = False
        self._bus_was_down = False
        self._await_all = True  # a connection begins with all joints, or with a known missing one
        self._heard = False  # any node has sent something since the last SYNC
        self._settings: dict[int, RawFrame] = {}  # the last note on each configured node
        self._alarms: dict[int, RawFrame] = {}  # the last note on each node's alarms since then
        self._warmth: dict[tuple[int, int], RawFrame] = {}  # the last of each temperature PDO
        self._limited: dict[int, str] = {}  # the last event about each encoder that lacks an object
        self._counted: Counter[str] = Counter()

    @property
    def counters(self) -> dict[str, int]:
        """The number of cycles delivered, and of each kind of frame or cycle not delivered."""
        return {name: self._counted[name] for name in COUNTED} | {
            "samples": self._sampler.delivered,
            "lost": self._sampler.lost,
            "incomplete": self._assembler.incomplete,
            "withheld": self._assembler.withheld,
            "repeated": self._assembler.repeated,
        }

    @property
    def accepted(self) -> bool:
        """Whether every joint has been configured at least once, and no foreign arm was found."""
        return self._sampler.ready and not self._foreign

    def warm_up(self) -> None:
        """Compile the decoder, or load it from the cache, before the first sample arrives."""
        load_compiled()

    def may_sync(self, now_ns: int) -> bool:
        """Return whether every answer to a SYNC sent now will be known to be its own."""
        return self._assembler.may_sync(now_ns)

    def preamble(self) -> list[RawFrame]:
        """Return the frames from which a fresh decoder continues: number, nodes, temperatures."""
        settings = list(self._settings.values())
        if not settings:
            return []
        number = encode_note(
            note="number",
            number=self._number,
            echo=self._sync_time.echo,
            first_latch_ns=self._sampler.first_latch_ns,
        )
        answers = [*self._alarms.values(), *self._warmth.values()]
        return [settings[0]._replace(data=number), *settings, *answers]

    def feed(self, frame: RawFrame) -> list[Item]:
        """Decode *frame*; return the items that it completes, in the order of the bus."""
        if frame.direction == "link":
            return self._take_note(json.loads(frame.data), frame)
        message = can.CanFrame.from_bytes(frame.data)
        if frame.direction == "tx":
            return self._sync_sent(frame.monotonic_ns) if message.identifier == can.SYNC_ID else []
        return self._receive(message, frame)

    # --- the bus ---------------------------------------------------------------------------

    def _receive(self, message: can.CanFrame, frame: RawFrame) -> list[Item]:
        identifier, now_ns = message.identifier, frame.monotonic_ns
        if identifier == can.SYNC_ID:
            latch_ns, lost = self._sync_time.received(now_ns)
            self._number += lost
            return [*self._second_producer(now_ns), *self._sync(latch_ns, now_ns)]
        if identifier & can.ERROR:
            self._counted["error_frames"] += 1
            return []
        if identifier > 0x7FF:  # extended or remote: armd uses none
            self._counted["unknown"] += 1
            return []
        number, function = identifier & 0x7F, identifier & ~0x7F
        node = self.nodes.get(number)
        if node is None:
            self._counted["unknown"] += function != can.NMT_ID
            return []
        self._heard = True
        self.last_heard_ns = now_ns
        if function == can.HEARTBEAT_BASE and len(message.data) == 1:
            fault = node.heartbeat(message.data[0] & 0x7F)
            return self._failed(node, fault, now_ns)
        if function == can.EMCY_BASE:
            return self._emergency(node, message.data, now_ns)
        if function in can.TPDO_BASE:
            pdo = can.TPDO_BASE.index(function) + 1
            return self._process_data(node, pdo, message.data, frame)
        return []

    def _emergency(self, node: Node, data: bytes, now_ns: int) -> list[Item]:
        if len(data) != can.EMCY.size:
            self._counted["malformed"] += 1
            return []
        code, register = can.EMCY.unpack(data)
        if code == 0:  # error reset: the configuration that follows restores the node
            return []
        fault = node.fail(f"emergency {code:#06x}, error register {register:#04x}")
        return self._failed(node, fault, now_ns)

    def _process_data(self, node: Node, pdo: int, data: bytes, frame: RawFrame) -> list[Item]:
        if node.wants_configuration:  # its mapping is not known
            return []
        if node.number in can.TEMPERATURE_NODES:
            return self._temperature_data(node, pdo, data, frame)
        if pdo != 1:
            return []
        layout = node.layout
        if len(data) != layout.size:
            self._counted["malformed"] += 1
            return []
        items: list[Item] = []
        if node.reported():
            items += self._recovered(node, frame.monotonic_ns)
            self._await_all &= not all(joint.reporting for joint in self._joints)
        position = int.from_bytes(data[layout.position_at : layout.position_at + 4], "little")
        alarms, alarms_at = node.alarms, layout.alarms_at
        if alarms_at is not None:
            alarms = int.from_bytes(data[alarms_at : alarms_at + 2], "little")
        reading = EncoderReading(position, alarms)
        cycle = self._assembler.report(node.number, reading, self._reporting())
        if cycle is not None and self._sampler.ready and self._in_service:
            self.last_sample_ns = frame.monotonic_ns
            items += self._sampler.sample(cycle, frame)
        return items

    @property
    def _in_service(self) -> bool:
        return not self._await_all and not self._foreign

    # --- cycles ----------------------------------------------------------------------------

    def _reporting(self) -> frozenset[int]:
        """Return the joints that a cycle must hold: at first all, later those that report."""
        if self._await_all:
            return frozenset(node.number for node in self._joints)
        return frozenset(node.number for node in self._joints if node.reporting)

    def _sync_sent(self, now_ns: int) -> list[Item]:
        echo = self._sync_time.echo
        if not self._sync_time.sent(now_ns):
            return []
        items = self._sync(now_ns, now_ns)
        if echo is None:
            text = "this interface does not return our SYNC: its sending counts as its instant"
            items.append(Event("no_echo", text, now_ns, "info"))
        return items

    def _sync(self, latch_ns: int, now_ns: int) -> list[Item]:
        since_ns = now_ns - (self._last_sync_ns or now_ns)
        self._last_sync_ns = now_ns
        self._number += 1
        if self._bus_was_down:  # count the cycles that nobody latched
            self._number += round(since_ns / self._period_ns)
        self._bus_was_down = False
        # If this process was held up, frames of the nodes still wait to be read. And if no node
        # sends, the fault is that of the bus, not of each node.
        elapsed_ns = min(since_ns, LATE_MOST_NS) if self._heard else 0
        self._heard = False
        if self.accepted:
            self._assembler.sync(self._number, latch_ns)
        return [
            event
            for node in self.nodes.values()
            for event in self._failed(node, node.grow_older(elapsed_ns), now_ns)
        ]

    def _second_producer(self, now_ns: int) -> list[Item]:
        was_counted, self._counted["foreign_sync"] = (
            self._counted["foreign_sync"],
            self._sync_time.foreign,
        )
        if was_counted or not self._sync_time.foreign:
            return []
        text = 'another SYNC producer is on the bus: configure sync = "follower" or switch it off'
        return [Event("second_sync_producer", text, now_ns, "error")]

    # --- temperatures ----------------------------------------------------------------------

    def _temperature_data(self, node: Node, pdo: int, data: bytes, frame: RawFrame) -> list[Item]:
        try:
            celsius = self._thermometers.take(node.number, pdo, data)
        except ValueError:
            self._counted["malformed"] += 1
            return []
        self._warmth[node.number, pdo] = frame
        if celsius is None:
            return []
        items: list[Item] = self._recovered(node, frame.monotonic_ns) if node.reported() else []
        device_ns = frame.monotonic_ns - (self._sampler.first_latch_ns or 0)
        return [*items, Temperatures(celsius, device_ns, frame.monotonic_ns, frame.unix_ns)]

    # --- nodes that fail and come back -------------------------------------------------------

    def _take_note(self, note: dict[str, Any], frame: RawFrame) -> list[Item]:
        now_ns = frame.monotonic_ns
        match note["note"]:
            case "up" | "down":
                self._bus_was_down = True
                self._foreign = False
                self._assembler.reset()
                self._sync_time = SyncTime()
                self._await_all = True
                for node in self.nodes.values():
                    node.bus_was_down()
                return []
            case "number":  # a recording begins within a connection
                self._number, self._sync_time.echo = note["number"], note["echo"]
                self._sampler.first_latch_ns = note["first_latch_ns"]
                return []
            case "configured":
                self._settings[note["node"]] = frame
                return self._configured(self.nodes[note["node"]], note, now_ns)
            case "refused":
                self._foreign |= note["kind"] == "foreign_arm"
                if self._sampler.delivered and note["node"] in self.nodes:
                    self._await_all = False  # continue without it
                return [Event(note["kind"], note["text"], now_ns, "error", note["detail"])]
            case "warnings":
                node = self.nodes[note["node"]]
                node.warnings = note["warnings"]
                return [news.report_warnings(node, now_ns)]
            case "alarms":  # of an encoder whose PDO has no alarms
                self._alarms[note["node"]] = frame
                self.nodes[note["node"]].alarms = note["alarms"]
        return []

    def _configured(self, node: Node, note: dict[str, Any], now_ns: int) -> list[Item]:
        node.configured()
        if node.number in can.TEMPERATURE_NODES:
            return []
        node.range_counts, node.counts_per_turn = note["range_counts"], note["counts_per_turn"]
        # Older recordings lack the layout: then every encoder had the usual one.
        node.layout = can.EncoderLayout(*note.get("layout", can.ENCODER_LAYOUT))
        node.alarms = note.get("alarms") or 0
        self._alarms.pop(node.number, None)
        events: list[Item] = [*self._limits(node, note, now_ns)]
        if self._sampler.learn_ranges():
            text = (
                f"arm {self._expected.serial_number}: all {len(self._joints)} encoders identified"
            )
            events.append(Event("identified", text, now_ns, "info"))
        return events

    def _limits(self, node: Node, note: dict[str, Any], now_ns: int) -> list[Event]:
        """Return an event of checks that an encoder cannot support; once, until they change."""
        nameless = "serial_number" in note and note["serial_number"] is None
        counts_told = note.get("counts_told", True)
        event = news.report_limits(node, nameless, counts_told, note.get("alarms"), now_ns)
        before, self._limited[node.number] = self._limited.get(node.number, ""), event.text
        return [event] if event.detail["lacks"] and event.text != before else []

    def _failed(self, node: Node, fault: str | None, now_ns: int) -> list[Item]:
        if fault is None:
            return []
        if node.number in can.TEMPERATURE_NODES:
            self._thermometers.lose(node.number)
        return [news.report_failure(node, fault, now_ns)]

    def _recovered(self, node: Node, now_ns: int) -> list[Item]:
        fault, node.fault = node.fault, ""
        return [news.report_recovery(node, fault, now_ns)] if fault else []
