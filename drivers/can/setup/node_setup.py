"""Chooses the node to configure next, and reports the results to the decoder as notes."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from armd.drivers.can import objects as can
from armd.drivers.can.bus import OwnNetwork
from armd.drivers.can.decoder import encode_note
from armd.drivers.can.setup.configure import (
    Complaints,
    EncoderFacts,
    PromptNode,
    configure_encoder,
    configure_module,
    is_encoder,
    make_remote_node,
    read_complaints,
)
from armd.drivers.can.setup.job import Job
from armd.drivers.can.setup.sdo import NodeRefused
from armd.drivers.identity import Expectation

NODE_BACK_OFF_NS = 250_000_000
WARNINGS_INTERVAL_NS = 50_000_000  # between two joints
TEMPERATURES_HZ = 2.0

Visited = EncoderFacts | Complaints | bool | None


class NodeSetup:
    """Configures one node after the other, in a job beside the receive loop.

    First it checks whether there is one joint too many: an arm with more joints than arm.toml is a
    foreign one. An encoder must report the same serial number after every failure as at first:
    otherwise it is another encoder.
    """

    def __init__(
        self, expectation: Expectation, rate_hz: float, serial_numbers: Sequence[int] | None
    ) -> None:
        self._expected = expectation
        self._every_sync = round(rate_hz / TEMPERATURES_HZ)
        self._serial_numbers: dict[int, int | None] = dict(enumerate(serial_numbers or [], start=1))
        self._nodes: dict[int, PromptNode] = {}
        self._running: tuple[int, Job[Visited]] | None = None
        self._due_ns: dict[int, int] = {}
        self._asking = False  # the running job only reads warnings
        self._warned_joint = 0  # the joint last asked for its warnings
        self._warnings_due_ns = 0
        self._warnings: dict[int, int] = {}
        self._alarms: dict[int, int] = {}  # of joints whose PDO has no alarms
        self._without_warnings: set[int] = set()  # joints whose encoders have no such object
        self._complaint: dict[int, str] = {}  # the last complaint about each node, reported once

    def step(self, network: OwnNetwork, wanting: Sequence[int], now_ns: int) -> list[bytes]:
        """Return the notes of a job that has ended, if one has; then start the next job.

        *wanting* are the nodes to be configured. If there are none, one joint after the other is
        asked for its warnings.
        """
        notes: list[bytes] = []
        if self._running is not None:
            number, job = self._running
            if not job.done:
                return []
            self._running = None
            if not self._asking:
                self._due_ns[number] = now_ns + NODE_BACK_OFF_NS
            notes = self._conclude(number, job)
        extra = self._expected.n_joints + 1
        candidates = [*([] if extra in self._nodes else [extra]), *wanting]
        # Take the node that has waited longest: one that does not answer must not block the others.
        number = min(candidates, key=lambda number: self._due_ns.get(number, 0), default=extra)
        if candidates and self._due_ns.get(number, 0) <= now_ns:
            self._asking = False
            self._running = (number, Job(partial(self._visit, network, self._nodes, number)))
            return notes
        if not wanting and now_ns >= self._warnings_due_ns:
            self._warnings_due_ns = now_ns + WARNINGS_INTERVAL_NS
            self._warned_joint = self._warned_joint % self._expected.n_joints + 1
            has_warnings = self._warned_joint not in self._without_warnings
            has_alarms = self._warned_joint in self._alarms
            if self._warned_joint in self._nodes and (has_warnings or has_alarms):
                work = partial(read_complaints, self._nodes[self._warned_joint], has_alarms)
                self._asking = True
                self._running = (self._warned_joint, Job(work))
        return notes

    def restart(self) -> None:
        """Forget all nodes of the old bus; a running job has no connection any more."""
        self._running = None
        self._nodes = {}
        self._due_ns = {}

    # --- beside the loop ---------------------------------------------------------------------

    def _visit(self, network: OwnNetwork, nodes: dict[int, PromptNode], number: int) -> Visited:
        """Configure node *number*, or check that the joint after the last does not exist.

        *nodes* belong to *network*: a visit that outlives the network must not add to the next
        one's.
        """
        node = nodes.get(number)
        if node is None:
            node = nodes[number] = network.add_node(make_remote_node(number))
        if number > self._expected.n_joints and number not in can.TEMPERATURE_NODES:
            return is_encoder(node)
        if number in can.TEMPERATURE_NODES:
            before = can.CHANNELS_PER_MODULE * can.TEMPERATURE_NODES.index(number)
            channels = min(can.CHANNELS_PER_MODULE, self._expected.n_sensors - before)
            configure_module(node, channels, self._every_sync)
            return None
        return configure_encoder(node, self._expected.counts_per_turn[number - 1])

    # --- in the loop ---------------------------------------------------------------------------

    def _conclude(self, number: int, job: Job[Visited]) -> list[bytes]:
        try:
            outcome = job.result()
            if outcome is True:
                raise NodeRefused(f"an encoder, expected {self._expected.n_joints} joints")
            if isinstance(outcome, EncoderFacts):
                self._check_serial_number(number, outcome.serial_number)
        except NodeRefused as error:
            return self._complain(number, "foreign_arm", str(error))
        except Exception as error:  # NodeAbsent, or an answer that canopen cannot handle
            if self._asking:  # a missing heartbeat shows it better
                return []
            return self._complain(number, "node_absent", str(error) or repr(error))
        if outcome is False:
            return []
        if isinstance(outcome, Complaints):
            return self._note_complaints(number, outcome)
        self._complaint.pop(number, None)
        if outcome is None:
            return [encode_note(note="configured", node=number)]
        self._alarms.pop(number, None)
        if outcome.alarms is not None:
            self._alarms[number] = outcome.alarms
        return [
            encode_note(
                note="configured",
                node=number,
                counts_per_turn=outcome.counts_per_turn,
                range_counts=outcome.range_counts,
                serial_number=outcome.serial_number,
                layout=outcome.layout,
                alarms=outcome.alarms,
                counts_told=outcome.counts_told,
            )
        ]

    def _note_complaints(self, number: int, complaints: Complaints) -> list[bytes]:
        notes = []
        if complaints.warnings is None:
            self._without_warnings.add(number)
        elif complaints.warnings != self._warnings.get(number, 0):
            self._warnings[number] = complaints.warnings
            notes.append(encode_note(note="warnings", node=number, warnings=complaints.warnings))
        alarms = complaints.alarms
        if alarms is not None and alarms != self._alarms.get(number):
            self._alarms[number] = alarms
            notes.append(encode_note(note="alarms", node=number, alarms=alarms))
        return notes

    def _check_serial_number(self, number: int, reported: int | None) -> None:
        expected = self._serial_numbers.setdefault(number, reported)
        if reported != expected:
            index, sub = can.SERIAL_NUMBER
            text = "none" if reported is None else reported
            raise NodeRefused(
                f"serial number (object {index:04X}:{sub}): found {text}, expected"
                f" {'none' if expected is None else expected}"
            )

    def _complain(self, number: int, kind: str, fault: str) -> list[bytes]:
        if self._complaint.get(number) == fault:
            return []
        self._complaint[number] = fault
        text = f"CAN node {number}: {fault}"
        detail = {"node": number, "faults": [fault]}
        return [encode_note(note="refused", node=number, kind=kind, text=text, detail=detail)]
