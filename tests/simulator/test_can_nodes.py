"""One simulated CANopen node at a time, without any bus: what it hears and what it says."""

from __future__ import annotations

import struct

import numpy as np
import pytest

from armd.drivers.can import objects as can
from armd.simulator.canbus.node import SimulatedNode
from armd.simulator.canbus.parts import Encoder, Thermometer
from armd.simulator.canbus.wires import Frame

EXPEDITED_WRITE = {1: 0x2F, 2: 0x2B, 4: 0x23}


def said(node: SimulatedNode) -> list[Frame]:
    frames = list(node.outbox)
    node.outbox.clear()
    return frames


def read(node: SimulatedNode, index: int, sub_index: int = 0) -> int:
    """An expedited SDO upload; fails the test on an abort."""
    request = struct.pack("<BHB4x", 0x40, index, sub_index)
    node.hear(Frame(can.SDO_REQUEST_BASE + node.node_id, request))
    (reply,) = said(node)
    assert reply.can_id == can.SDO_REPLY_BASE + node.node_id
    assert reply.data[0] & 0xF0 == 0x40
    return int.from_bytes(reply.data[4:], "little")


def write(node: SimulatedNode, index: int, sub_index: int, value: int, size: int) -> int:
    """An expedited SDO download; 0 or the abort code."""
    request = struct.pack("<BHBI", EXPEDITED_WRITE[size], index, sub_index, value)
    node.hear(Frame(can.SDO_REQUEST_BASE + node.node_id, request))
    (reply,) = said(node)
    return int.from_bytes(reply.data[4:], "little") if reply.data[0] == 0x80 else 0


def command(node: SimulatedNode, number: int) -> None:
    node.hear(Frame(can.NMT_ID, bytes([number, node.node_id])))


@pytest.fixture
def encoder() -> Encoder:
    node = Encoder(3)
    assert said(node) == [Frame(0x703, b"\0")]
    return node


def synchronous(node: SimulatedNode, pdo: int = 0, every: int = 1) -> None:
    assert write(node, can.TPDO_COMMUNICATION + pdo, 2, every, 1) == 0


def test_tells_what_it_is(encoder: Encoder) -> None:
    assert read(encoder, can.DEVICE_TYPE) & 0xFFFF == can.ENCODER_PROFILE
    assert read(encoder, can.PHYSICAL_RESOLUTION) == 1 << 23
    assert read(encoder, *can.SERIAL_NUMBER) == 406003
    thermometer = Thermometer(0x20)
    said(thermometer)
    assert read(thermometer, can.DEVICE_TYPE) & 0xFFFF == can.MEASURING_PROFILE


def test_answers_a_sync_only_when_told_to(encoder: Encoder) -> None:
    encoder.count, encoder.alarms = 0x123456, 1
    command(encoder, 1)
    encoder.on_sync()
    assert said(encoder) == []  # TPDO1 comes asynchronous from the factory
    synchronous(encoder)
    encoder.on_sync()
    assert said(encoder) == [Frame(0x183, struct.pack("<IH", 0x123456, 1))]
    synchronous(encoder, every=3)
    for _ in range(6):
        encoder.on_sync()
    assert len(said(encoder)) == 2
    command(encoder, 128)
    encoder.on_sync()
    assert said(encoder) == []


def test_a_pdo_is_remapped_in_order_or_not_at_all(encoder: Encoder) -> None:
    position = can.POSITION << 16 | 32
    assert write(encoder, can.TPDO_MAPPING, 1, position, 4) == 0x08000022
    assert write(encoder, can.TPDO_COMMUNICATION, 1, 0x80000183, 4) == 0
    assert write(encoder, can.TPDO_MAPPING, 1, position, 4) == 0x08000022
    assert write(encoder, can.TPDO_MAPPING, 0, 0, 1) == 0
    assert write(encoder, can.TPDO_MAPPING, 1, position, 4) == 0
    assert write(encoder, can.TPDO_MAPPING, 0, 1, 1) == 0
    synchronous(encoder)
    command(encoder, 1)
    encoder.on_sync()
    assert said(encoder) == []  # still switched off
    assert write(encoder, can.TPDO_COMMUNICATION, 1, 0x183, 4) == 0
    encoder.on_sync()
    assert said(encoder) == [Frame(0x183, bytes(4))]


def test_refuses_what_it_does_not_have(encoder: Encoder) -> None:
    assert write(encoder, 0x5FFF, 0, 1, 1) == 0x06020000
    assert write(encoder, can.TPDO_MAPPING, 99, 1, 4) == 0x06090011
    assert write(encoder, can.POSITION, 0, 1, 4) == 0x06010002
    assert write(encoder, can.HEARTBEAT_TIME_MS, 0, 1, 4) == 0x06070010
    assert not encoder.preset_written
    assert write(encoder, 0x6003, 0, 0, 4) == 0
    assert encoder.preset_written


def test_heartbeat_and_reset(encoder: Encoder) -> None:
    assert write(encoder, can.HEARTBEAT_TIME_MS, 0, 100, 2) == 0
    synchronous(encoder)
    command(encoder, 1)
    for ms in range(0, 250, 5):
        encoder.tick(ms * 1_000_000)
    assert said(encoder) == [Frame(0x703, b"\x05")] * 3
    command(encoder, 129)
    assert said(encoder) == [Frame(0x703, b"\0")]
    encoder.tick(10**12)
    encoder.on_sync()
    assert said(encoder) == []  # factory settings: no heartbeat, pre-operational
    assert read(encoder, can.HEARTBEAT_TIME_MS) == 0


def test_emergency_and_muteness(encoder: Encoder) -> None:
    encoder.emergency(0x5000, 1)
    assert said(encoder) == [Frame(0x83, bytes.fromhex("0050010000000000"))]
    encoder.mute = True
    encoder.emergency(0, 0)
    command(encoder, 129)
    assert said(encoder) == []


def test_temperatures_and_their_status() -> None:
    node = Thermometer(0x20)
    node.celsius = np.array([20.12, -3.5, np.nan, 21.0, 22.0, 23.0])
    for pdo in range(4):
        said(node)
        synchronous(node, pdo)
    command(node, 1)
    node.on_sync()
    frames = {frame.can_id: frame.data for frame in said(node)}
    assert can.VALUES_PDO.unpack(frames[0x1A0]) == (20120, -3500)
    assert can.VALUES_PDO.unpack(frames[0x2A0]) == (0, 21000)
    assert can.VALUES_PDO.unpack(frames[0x3A0]) == (22000, 23000)
    assert can.STATUS_PDO.unpack(frames[0x4A0]) == (0, 0, 1, 0, 0, 0)
