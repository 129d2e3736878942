"""Setting up one node by SDO: ask what it is, tell it what to send, check that it understood.

Blocking, so it runs beside the receive loop (see `driver`), which feeds it the SDO answers.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, TypeVar

import canopen
from canopen.sdo.exceptions import SdoAbortedError, SdoCommunicationError, SdoError

from armd.drivers.can import objects as can
from armd.drivers.can.node import HEARTBEAT_MS

T = TypeVar("T")
PROBE_S = 0.1
ANSWER_S = 0.3
VISIT_S = 5.0  # a node that takes longer, as by an upload that never ends, is passed over
SYNCHRONOUS_MOST = 240  # the slowest synchronous transmission type: every 240th SYNC

# What fails reaches a person as an event; canopen's own log would say it again on stderr.
logging.getLogger("canopen").addHandler(logging.NullHandler())


class NodeRefused(Exception):
    """The node answers, but is not what arm.toml (or this session so far) expects."""


class NodeAbsent(Exception):
    """The node does not answer, or not sensibly."""


@dataclass(frozen=True, slots=True)
class EncoderFacts:
    """What a joint's encoder said of itself."""

    counts_per_turn: int
    range_counts: int  # its position wraps at this
    serial_number: int


@dataclass(frozen=True, slots=True)
class Warnings:
    """6505 of an encoder; None where it has no such object."""

    bits: int | None


class PromptSdo(canopen.sdo.SdoClient):  # type: ignore[misc]
    """canopen's, which would read for ever what a node goes on sending."""

    deadline_s = float("inf")  # on the monotonic clock

    def request_response(self, request: bytes) -> bytes:
        if time.monotonic() > self.deadline_s:
            raise SdoCommunicationError(f"it is not done within {VISIT_S:g} s")
        return bytes(super().request_response(request))


class PromptNode(canopen.RemoteNode):  # type: ignore[misc]
    """A node that is asked through `PromptSdo`."""

    def add_sdo(self, request_id: int, reply_id: int) -> PromptSdo:
        client = PromptSdo(request_id, reply_id, self.object_dictionary)
        self.sdo_channels.append(client)
        return client

    def visited(self, answer_s: float) -> None:
        """A visit begins: each answer has *answer_s*, the whole `VISIT_S`."""
        self.sdo.RESPONSE_TIMEOUT = answer_s
        self.sdo.deadline_s = time.monotonic() + VISIT_S


def remote_node(number: int) -> PromptNode:
    """A node with the dictionary of its kind; only standard objects are used, so that of any
    maker will answer."""
    kind = "temperature" if number in can.TEMPERATURE_NODES else "encoder"
    with (files("armd.drivers.can") / "eds" / f"{kind}.eds").open(encoding="ascii") as eds:
        return PromptNode(number, canopen.import_od(eds, number))


def is_encoder(node: PromptNode) -> bool:
    """Whether anybody answers at this number, and is a CiA 406 encoder."""
    node.visited(PROBE_S)
    try:
        return bool(node.sdo[can.DEVICE_TYPE].raw & 0xFFFF == can.ENCODER_PROFILE)
    except SdoError:
        return False


def configure_encoder(node: PromptNode, expected_counts: int | None) -> EncoderFacts:
    """Make *node* a joint: position and alarms at every SYNC, a heartbeat.

    Raises `NodeRefused` or `NodeAbsent`. The node is left operational.
    """
    try:
        _stop(node)
        _check_profile(node, can.ENCODER_PROFILE)
        encoder = _read_encoder(node)
        if expected_counts is not None and encoder.counts_per_turn != expected_counts:
            raise NodeRefused(
                f"counts per turn: found {encoder.counts_per_turn}, expected {expected_counts}"
            )
        _set_heartbeat(node)
        _map(node, 1, can.ENCODER_MAPPING, every_sync=1)
        _start(node)
    except SdoError as error:
        raise NodeAbsent(_say(error)) from error
    return encoder


def configure_module(node: PromptNode, n_channels: int, every_sync: int) -> None:
    """Make *node* a temperature module: values and status at every *every_sync*-th SYNC."""
    try:
        _stop(node)
        _check_profile(node, can.MEASURING_PROFILE)
        _set_heartbeat(node)
        every_sync = max(1, min(SYNCHRONOUS_MOST, every_sync))
        last = -(-n_channels // can.CHANNELS_PER_PDO)
        for pdo in (*range(1, last + 1), can.STATUS_PDO_NUMBER):
            _map(node, pdo, can.values_mapping(pdo), every_sync)
        _start(node)
    except SdoError as error:
        raise NodeAbsent(_say(error)) from error


def read_warnings(node: PromptNode) -> Warnings:
    """Warnings do not touch the position; they are only reported."""
    node.visited(ANSWER_S)
    try:
        return Warnings(_optional(node.sdo, can.WARNINGS, None))
    except SdoError as error:
        raise NodeAbsent(_say(error)) from error


def _stop(node: PromptNode) -> None:
    node.visited(ANSWER_S)
    node.nmt.state = "PRE-OPERATIONAL"  # mappings may be changed only there


def _start(node: PromptNode) -> None:
    register = node.sdo[can.ERROR_REGISTER].raw
    if register:
        raise NodeAbsent(f"its error register is {register:#04x}")
    node.nmt.state = "OPERATIONAL"


def _check_profile(node: PromptNode, expected: int) -> None:
    found = node.sdo[can.DEVICE_TYPE].raw & 0xFFFF
    if found != expected:
        raise NodeRefused(f"device profile: found {found}, expected {expected}")


def _read_encoder(node: PromptNode) -> EncoderFacts:
    """6501 tells the steps of a turn; with scaling switched on, 6001 tells the units instead."""
    sdo = node.sdo
    index, sub = can.SERIAL_NUMBER
    per_turn = sdo[can.PHYSICAL_RESOLUTION].raw
    if _optional(sdo, can.OPERATING_PARAMETERS, 0) & can.SCALING:
        per_turn = sdo[can.UNITS_PER_TURN].raw
        total = sdo[can.TOTAL_RANGE].raw or 1 << 32  # 32 bits cannot say 2^32
    else:
        total = per_turn * max(1, _optional(sdo, can.TURNS, 1))
    if per_turn < 2 or total < per_turn:
        raise NodeRefused(f"counts per turn {per_turn} and range {total} make no encoder")
    return EncoderFacts(per_turn, min(total, 1 << 32), sdo[index][sub].raw)


def _optional(sdo: Any, index: int, default: T) -> int | T:
    try:
        return int(sdo[index].raw)
    except SdoAbortedError:  # an object that the profile does not demand
        return default


def _set_heartbeat(node: PromptNode) -> None:
    node.sdo[can.HEARTBEAT_TIME_MS].raw = HEARTBEAT_MS


def _map(
    node: PromptNode, pdo: int, mapping: tuple[tuple[int, int, int], ...], every_sync: int
) -> None:
    """Switch the PDO off, write its map, switch it on (canopen's `save` does so in this order),
    then read back what the node made of it."""
    entry = node.tpdo[pdo]
    entry.clear()
    for index, subindex, bits in mapping:
        entry.add_variable(index, subindex, bits)
    entry.cob_id = can.TPDO_BASE[pdo - 1] + node.id
    entry.trans_type = every_sync
    entry.enabled = True
    entry.save()
    wanted = [index << 16 | subindex << 8 | bits for index, subindex, bits in mapping]
    record = node.sdo[can.TPDO_MAPPING + pdo - 1]
    found = [record[i].raw for i in range(1, record[0].raw + 1)]
    kind = node.sdo[can.TPDO_COMMUNICATION + pdo - 1][2].raw
    if found != wanted or kind != every_sync:
        raise NodeRefused(
            f"TPDO{pdo}: found mapping {_hex(found)} of type {kind}, "
            f"expected {_hex(wanted)} of type {every_sync}"
        )


def _hex(entries: list[int]) -> str:
    return " ".join(f"{entry:08x}" for entry in entries) or "none"


def _say(error: SdoError) -> str:
    if isinstance(error, SdoCommunicationError):
        return str(error) if str(error).startswith("it is not done") else "it does not answer"
    return f"it refuses: {error}"
