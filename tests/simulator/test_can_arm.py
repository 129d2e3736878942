"""The simulated arm on CAN in its own process, over each wire that this machine has."""

from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import numpy as np
import pytest

from armd.drivers.can import objects
from armd.simulator.live.electronics import COUNTS_PER_TURN
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects.effect import Conditions
from support.selection import parametrize_default
from support.simulated_arm import SimulatedArm, simulated_arm

SYNC_HZ = 50
SYNCS = 60


@contextmanager
def host(arm: SimulatedArm, interface: str) -> Iterator[can.BusABC]:
    """The other end of the bus; all nodes synchronous, with heartbeats, and started."""
    match interface:
        case "socketcand":
            name, port = arm.port.split(":")
            bus = can.Bus(interface=interface, host=name, port=int(port), channel="can0")
        case "slcan":
            bus = can.Bus(interface=interface, channel=arm.port, sleep_after_open=0.1)
        case "udp_multicast":
            group, port = arm.port.split(":")
            bus = can.Bus(interface=interface, channel=group, port=int(port))
    try:
        for node in range(1, 7):
            write(bus, node, objects.TPDO_COMMUNICATION, 2, bytes([1]))
            write(bus, node, objects.HEARTBEAT_TIME_MS, 0, b"\x64\0")
        for pdo in range(4):
            write(bus, 0x20, objects.TPDO_COMMUNICATION + pdo, 2, bytes([20]))
        send(bus, objects.NMT_ID, bytes([1, 0]))
        yield bus
    finally:
        bus.shutdown()


def send(bus: can.BusABC, can_id: int, data: bytes = b"") -> None:
    bus.send(can.Message(arbitration_id=can_id, data=data, is_extended_id=False))


def write(bus: can.BusABC, node: int, index: int, sub_index: int, data: bytes) -> None:
    command = {1: 0x2F, 2: 0x2B, 4: 0x23}[len(data)]
    request = bytes([command]) + index.to_bytes(2, "little") + bytes([sub_index])
    send(bus, objects.SDO_REQUEST_BASE + node, request + data.ljust(4, b"\0"))
    deadline = time.monotonic() + 60.0
    while time.monotonic() < deadline:
        reply = bus.recv(0.1)
        if reply is not None and reply.arbitration_id == objects.SDO_REPLY_BASE + node:
            assert reply.data[0] == 0x60, reply
            return
    pytest.fail(f"node {node} does not answer")


def exchange(bus: can.BusABC, n: int) -> list[can.Message]:
    """n SYNCs at a steady rate, and everything heard until shortly after the last."""
    heard = []
    start = time.monotonic()
    for k in range(n + round(0.5 * SYNC_HZ)):
        if k < n:
            send(bus, objects.SYNC_ID)
        while (wait := start + (k + 1) / SYNC_HZ - time.monotonic()) > 0:
            if (message := bus.recv(wait)) is not None:
                heard.append(message)
    return heard


@parametrize_default("interface", ["socketcand", "slcan", "udp_multicast"])
def test_every_sync_latches_the_true_arm(interface: str, tmp_path: Path) -> None:
    options = []
    if interface == "udp_multicast":
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("", 0))
            options = ["--channel", f"239.74.163.77:{free.getsockname()[1]}"]
    with simulated_arm(tmp_path, *options, wire=("--can", interface), seconds=30) as arm:
        with host(arm, interface) as bus:
            heard = exchange(bus, SYNCS)
            end = time.monotonic() + 20.0  # a starved machine sends late
            while [m.arbitration_id for m in heard].count(0x186) < SYNCS and time.monotonic() < end:
                heard += exchange(bus, 0)
        assert arm.stop() == 0
    assert not arm.events("preset_written")
    # Every node answers every SYNC once, in order.
    answers = [[bytes(m.data) for m in heard if m.arbitration_id == 0x180 + k] for k in range(1, 7)]
    assert {len(frames) for frames in answers} == {SYNCS}
    counts = np.array(
        [[objects.ENCODER_PDO.unpack(frame)[0] for frame in frames] for frames in answers],
        dtype=float,
    ).T
    assert [m.arbitration_id for m in heard if m.arbitration_id > 0x400].count(0x4A0) == SYNCS // 20
    truth = arm.truth()
    assert len(truth) == SYNCS
    conditions = Conditions.at_rest(len(counts), 6, 20.0)
    tips = TrueArm.default(1).tip(counts / COUNTS_PER_TURN * 2 * np.pi, conditions)
    error_um = 1e3 * np.linalg.norm(tips - truth["position_mm"], axis=1)
    assert np.median(error_um) < 10.0
    assert error_um.max() < 50.0


@pytest.mark.slow
def test_the_arm_may_produce_sync(tmp_path: Path) -> None:
    """Nobody answers more often than asked; where the machine starves, SYNCs come in bursts."""
    wanted = 10
    joints = range(0x181, 0x187)
    with (
        simulated_arm(
            tmp_path, "--sync-producer", wire=("--can", "socketcand"), rate_hz=SYNC_HZ, seconds=30
        ) as arm,
        host(arm, "socketcand") as bus,
    ):
        end = time.monotonic() + 25.0
        ids: list[int] = []
        while min(map(ids.count, joints)) < wanted and time.monotonic() < end:
            if (message := bus.recv(0.1)) is not None:
                ids.append(message.arbitration_id)
    ids = ids[ids.index(objects.SYNC_ID) :]
    syncs = np.cumsum(np.equal(ids, objects.SYNC_ID))
    for joint in joints:
        answers = np.cumsum(np.equal(ids, joint))
        assert answers[-1] >= wanted
        assert np.all(answers <= syncs)
