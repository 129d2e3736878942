"""Configures one node by SDO: reads its identity, sets its PDOs, and checks them.

It blocks, so it runs beside the receive loop (see `driver`), which passes the SDO answers to it.
"""

from __future__ import annotations

import logging
import time
from dataclasses import dataclass, replace
from importlib.resources import files

import canopen
from canopen.sdo.exceptions import SdoCommunicationError, SdoError

from armd.drivers.can import objects as can
from armd.drivers.can.node import HEARTBEAT_MS
from armd.drivers.can.setup.mapping import check_mapping, find_layout, set_tpdo
from armd.drivers.can.setup.sdo import (
    NodeAbsent,
    NodeRefused,
    read_object,
    read_optional,
    write_object,
)

PROBE_S = 0.1
ANSWER_S = 0.3
VISIT_S = 5.0  # a node that takes longer, e.g. by an endless upload, is skipped
SYNCHRONOUS_MOST = 240  # the slowest synchronous transmission type: every 240th SYNC

# Faults reach the user as events; canopen's own log would repeat them on stderr.
logging.getLogger("canopen").addHandler(logging.NullHandler())


@dataclass(frozen=True, slots=True)
class EncoderFacts:
    """The properties that a joint's encoder reported."""

    counts_per_turn: int
    range_counts: int  # its position wraps at this
    serial_number: int | None  # None: it has none
    layout: can.EncoderLayout = can.ENCODER_LAYOUT
    alarms: int | None = None  # object 6503, read by SDO; None: in the layout, or missing
    counts_told: bool = True  # False: it has no 6501, and arm.toml's counts are used


@dataclass(frozen=True, slots=True)
class Complaints:
    """Objects 6505 and 6503 of an encoder; None where it has no such object, or was not asked."""

    warnings: int | None
    alarms: int | None = None


class PromptSdo(canopen.sdo.SdoClient):  # type: ignore[misc]
    """canopen's SDO client with a deadline: a node may send without end."""

    deadline_s = float("inf")  # on the monotonic clock

    def request_response(self, request: bytes) -> bytes:
        if time.monotonic() > self.deadline_s:
            raise SdoCommunicationError(f"it is not done within {VISIT_S:g} s")
        return bytes(super().request_response(request))


class PromptNode(canopen.RemoteNode):  # type: ignore[misc]
    """A node that is accessed through `PromptSdo`."""

    def add_sdo(self, request_id: int, reply_id: int) -> PromptSdo:
        client = PromptSdo(request_id, reply_id, self.object_dictionary)
        self.sdo_channels.append(client)
        return client

    def visited(self, answer_s: float) -> None:
        """Begin a visit: each answer may take *answer_s*, the whole visit `VISIT_S`."""
        self.sdo.RESPONSE_TIMEOUT = answer_s
        self.sdo.deadline_s = time.monotonic() + VISIT_S


def make_remote_node(number: int) -> PromptNode:
    """Make a node with the dictionary of its kind.

    Only standard objects are used, so nodes of any maker can answer.
    """
    kind = "temperature" if number in can.TEMPERATURE_NODES else "encoder"
    with (files("armd.drivers.can") / "eds" / f"{kind}.eds").open(encoding="ascii") as eds:
        return PromptNode(number, canopen.import_od(eds, number))


def is_encoder(node: PromptNode) -> bool:
    """Return whether a CiA 406 encoder answers at this number."""
    node.visited(PROBE_S)
    try:
        return bool(node.sdo[can.DEVICE_TYPE].raw & 0xFFFF == can.ENCODER_PROFILE)
    except SdoError:
        return False


def configure_encoder(node: PromptNode, expected_counts: int | None) -> EncoderFacts:
    """Make *node* a joint: position and alarms at every SYNC, a heartbeat.

    The node is operational afterwards. Raises `NodeRefused` or `NodeAbsent`.
    """
    try:
        _stop(node)
        _check_profile(node, can.ENCODER_PROFILE)
        encoder = _read_encoder(node, expected_counts)
        if expected_counts is not None and encoder.counts_per_turn != expected_counts:
            raise NodeRefused(
                f"counts per turn: found {encoder.counts_per_turn}, expected {expected_counts}"
            )
        _set_heartbeat(node)
        mapping = set_tpdo(
            node.sdo, node.id, 1, (can.ENCODER_MAPPING, can.POSITION_MAPPING), every_sync=1
        )
        layout = find_layout(mapping)
        alarms = None
        if layout.alarms_at is None:
            alarms = read_optional(node.sdo, can.ALARMS, 0, 2)
        _start(node)
    except SdoError as error:
        raise NodeAbsent(_say(error)) from error
    return replace(encoder, layout=layout, alarms=alarms)


def configure_module(node: PromptNode, n_channels: int, every_sync: int) -> None:
    """Make *node* a temperature module: values and status at every *every_sync*-th SYNC."""
    try:
        _stop(node)
        _check_profile(node, can.MEASURING_PROFILE)
        _set_heartbeat(node)
        every_sync = max(1, min(SYNCHRONOUS_MOST, every_sync))
        last = -(-n_channels // can.CHANNELS_PER_PDO)
        for pdo in (*range(1, last + 1), can.STATUS_PDO_NUMBER):
            mapping = can.list_mapped_values(pdo)
            check_mapping(pdo, set_tpdo(node.sdo, node.id, pdo, (mapping,), every_sync), mapping)
        _start(node)
    except SdoError as error:
        raise NodeAbsent(_say(error)) from error


def read_complaints(node: PromptNode, alarms_too: bool) -> Complaints:
    """Read the warnings of an encoder, and its alarms where its PDO has no room for them.

    Warnings do not affect the position, so they are only reported. Alarms do.
    """
    node.visited(ANSWER_S)
    try:
        alarms = read_optional(node.sdo, can.ALARMS, 0, 2) if alarms_too else None
        return Complaints(read_optional(node.sdo, can.WARNINGS, 0, 2), alarms)
    except SdoError as error:
        raise NodeAbsent(_say(error)) from error


def _stop(node: PromptNode) -> None:
    node.visited(ANSWER_S)
    node.nmt.state = "PRE-OPERATIONAL"  # mappings may be changed only there


def _start(node: PromptNode) -> None:
    register = read_object(node.sdo, can.ERROR_REGISTER, 0, 1)
    if register:
        raise NodeAbsent(f"its error register is {register:#04x}")
    node.nmt.state = "OPERATIONAL"


def _check_profile(node: PromptNode, expected: int) -> None:
    profile = read_object(node.sdo, can.DEVICE_TYPE, 0, 4) & 0xFFFF
    if profile != expected:
        raise NodeRefused(f"device profile: found {profile}, expected {expected}")


def _read_encoder(node: PromptNode, expected_counts: int | None) -> EncoderFacts:
    """Read counts per turn, range and serial number.

    Object 6501 holds the counts per turn, or 6001 if scaling is switched on. An encoder of class C1
    may lack both: then *expected_counts* is used. Raises `NodeRefused`.
    """
    sdo = node.sdo
    reported: int | None
    if (read_optional(sdo, can.OPERATING_PARAMETERS, 0, 2) or 0) & can.SCALING:
        reported = per_turn = read_object(sdo, can.UNITS_PER_TURN, 0, 4)
        total = read_object(sdo, can.TOTAL_RANGE, 0, 4) or 1 << 32  # 2^32 does not fit in 32 bits
    else:
        reported = read_optional(sdo, can.PHYSICAL_RESOLUTION, 0, 4)
        chosen_per_turn = expected_counts if reported is None else reported
        if chosen_per_turn is None:
            raise NodeRefused(
                "object 6501, counts per turn: found none, expected counts_per_turn in arm.toml"
            )
        per_turn = chosen_per_turn
        turns = read_optional(sdo, can.TURNS, 0, 2)
        total = per_turn * max(1, 1 if turns is None else turns)
    if per_turn < 2 or total < per_turn:
        raise NodeRefused(f"counts per turn {per_turn} and range {total} make no encoder")
    serial_number = read_optional(sdo, *can.SERIAL_NUMBER, 4)
    return EncoderFacts(
        per_turn, min(total, 1 << 32), serial_number, counts_told=reported is not None
    )


def _set_heartbeat(node: PromptNode) -> None:
    write_object(node.sdo, can.HEARTBEAT_TIME_MS, 0, 2, HEARTBEAT_MS)


def _say(error: SdoError) -> str:
    if isinstance(error, SdoCommunicationError):
        return str(error) if str(error).startswith("it is not done") else "it does not answer"
    return f"it refuses: {error}"
