"""The makers' own libraries, unmodified, on the simulated servos: they and armd agree joint for
joint. And the simulator keeps to the line's pace."""

import time
from contextlib import contextmanager
from functools import partial

import numpy as np
import pytest

from armd.drivers.poll.protocol import dynamixel, feetech
from armd.simulator.servobus.arm import COUNTS_PER_TURN, list_servo_ids
from support.selection import parametrize_default
from support.servo_truth import JOINTS, Truth
from support.simulated_arm import simulated_arm

IDS = list_servo_ids(5)


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))


def timed(call):
    before_ns = time.monotonic_ns()
    result = call()
    return result, before_ns, time.monotonic_ns()


def answered(port, call):
    """As `timed`; the SDKs wait for 34 ms, which a busy machine may stand still for."""
    for _ in range(5):
        result, before_ns, after_ns = timed(call)
        told = result[1] if isinstance(result, tuple) else result
        if told not in (-3001, -6):  # COMM_RX_TIMEOUT of the one and the other
            break
        time.sleep(0.1)
        port.ser.reset_input_buffer()  # which the SDKs leave to the next read
    return result, before_ns, after_ns


@pytest.mark.slow
def test_dynamixel_sdk_reads_what_is_true(tmp_path):
    sdk = pytest.importorskip("dynamixel_sdk")
    with simulated_arm(tmp_path, wire=("--servo", "dynamixel")) as arm:
        truth = Truth(arm)
        port, packets = sdk.PortHandler(arm.port), sdk.PacketHandler(2.0)
        assert port.openPort() and port.setBaudRate(1_000_000)
        found, _ = packets.broadcastPing(port)
        assert sorted(found) == list(IDS) and found[1][0] == 1060
        sync, fast = (sdk.GroupSyncRead(port, packets, 132, 15) for _ in range(2))
        for reader in (sync, fast):
            for servo in IDS:
                assert reader.addParam(servo)
        for _ in range(20):
            for reader, read in ((sync, sync.txRxPacket), (fast, fast.fastSyncRead)):
                result, before, after = answered(port, read)
                assert result == sdk.COMM_SUCCESS
                told = [reader.getData(servo, 132, 4) for servo in JOINTS]
                assert truth.agrees(told, before, after)
                assert all(18 <= reader.getData(servo, 146, 1) <= 45 for servo in IDS)
            time.sleep(0.1)
        port.closePort()


@pytest.mark.slow
def test_feetech_sdk_reads_what_is_true(tmp_path):
    sdk = pytest.importorskip("scservo_sdk")
    with simulated_arm(tmp_path, wire=("--servo", "feetech")) as arm:
        truth = Truth(arm)
        port, packets = sdk.PortHandler(arm.port), sdk.PacketHandler(0)
        assert port.openPort() and port.setBaudRate(1_000_000)
        for servo in IDS:
            assert answered(port, lambda servo=servo: packets.ping(port, servo))[0] == (777, 0, 0)
        reader = sdk.GroupSyncRead(port, packets, 56, 8)
        for servo in IDS:
            assert reader.addParam(servo)
        for _ in range(20):
            result, before, after = answered(port, reader.txRxPacket)
            assert result == sdk.COMM_SUCCESS
            told = [reader.getData(servo, 56, 2) for servo in JOINTS]
            assert truth.agrees(told, before, after)
            assert all(18 <= reader.getData(servo, 63, 1) <= 45 for servo in IDS)
            time.sleep(0.1)
        port.closePort()


@pytest.mark.slow
@parametrize_default("kind", ["feetech", "dynamixel"])
def test_rustypot_reads_what_is_true(tmp_path, kind):
    rustypot = pytest.importorskip("rustypot")
    controller = {"feetech": "Sts3215PyController", "dynamixel": "Xl330PyController"}[kind]
    with simulated_arm(tmp_path, wire=("--servo", kind)) as arm:
        truth = Truth(arm)
        bus = getattr(rustypot, controller)(arm.port, 1_000_000, 10.0)
        for _ in range(20):
            angles, before, after = timed(partial(bus.sync_read_present_position, JOINTS))
            told = np.array(angles) / (2 * np.pi) * COUNTS_PER_TURN + 2048
            assert truth.agrees(told, before, after)
            time.sleep(0.1)


@contextmanager
def raw_port(path):
    import serial

    with serial.Serial(path, 1_000_000, timeout=10.0) as port:  # a busy machine may stand still
        yield port


@parametrize_default(("kind", "codec"), [("feetech", feetech), ("dynamixel", dynamixel)])
def test_the_line_is_as_slow_as_a_real_one(tmp_path, kind, codec):
    address, length, gap_us = (56, 8, 50) if kind == "feetech" else (132, 15, 40)
    request = codec.make_sync_read(IDS, address, length)
    expected = len(IDS) * codec.compute_status_size(length)
    with simulated_arm(tmp_path, wire=("--servo", kind)) as arm, raw_port(arm.port) as port:
        took = []
        for _ in range(50):
            began = time.perf_counter()
            port.write(request)
            assert len(port.read(expected)) == expected
            took.append(time.perf_counter() - began)
    line_s = (len(request) + expected) * 10e-6 + len(IDS) * gap_us * 1e-6
    assert min(took) >= 0.98 * line_s
