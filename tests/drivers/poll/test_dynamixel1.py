"""Dynamixel's protocol 1.0: the maker's published packets, an AX's counts, and a bus of them that
the maker's own library and armd read alike."""

import time
from contextlib import closing
from functools import partial

import numpy as np
import pytest

from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.poll.protocol import dynamixel1
from armd.drivers.poll.protocol.families import FAMILIES
from armd.drivers.poll.protocol.packet import ReadRequest
from armd.drivers.poll.protocol.rates import BAUDS
from armd.drivers.table import open_driver
from armd.simulator.servobus.arm import list_servo_ids
from support.servo_truth import JOINTS, Truth
from support.simulated_arm import simulated_arm

FAMILY = FAMILIES["dynamixel1"]
IDS = list_servo_ids(5)
MX_28, AX_12 = 29, 12

#: from the e-Manual's page of the protocol, and the manuals of the AX-12 and the DX-116
PUBLISHED = {
    "ping": (dynamixel1.make_ping(1), "FF FF 01 02 01 FB"),
    "answer to a ping": (dynamixel1.make_status(1, 0), "FF FF 01 02 00 FC"),
    "read temperature": (dynamixel1.make_read(1, 43, 1), "FF FF 01 04 02 2B 01 CC"),
    "temperature 32": (dynamixel1.make_status(1, 0, b"\x20"), "FF FF 01 03 00 20 DB"),
    "write an id": (dynamixel1.make_write(0xFE, 3, b"\x01"), "FF FF FE 04 03 03 01 F6"),
    "write a lock": (dynamixel1.make_write(0, 47, b"\x01"), "FF FF 00 04 03 2F 01 C8"),
    "write a punch": (dynamixel1.make_write(0, 48, b"\x40\x00"), "FF FF 00 05 03 30 40 00 87"),
    "range error": (dynamixel1.make_status(0, 8), "FF FF 00 02 08 F5"),
    "bulk read": (
        dynamixel1.make_bulk_read([(1, 30, 2), (2, 36, 2)]),
        "FF FF FE 09 92 00 02 01 1E 02 02 24 1D",
    ),
    "answer to a bulk read": (dynamixel1.make_status(2, 0, b"\x00\x80"), "FF FF 02 04 00 00 80 79"),
}


@pytest.mark.parametrize("name", PUBLISHED)
def test_packets_are_as_published(name):
    ours, published = PUBLISHED[name]
    wire = bytes.fromhex(published)
    assert ours == wire
    (packet,) = dynamixel1.make_splitter().push(b"\xff" + wire)
    assert packet.raw == wire
    for at in range(2, len(wire)):  # no packet comes of a damaged one
        damaged = wire[:at] + bytes([wire[at] ^ 4]) + wire[at + 1 :]
        splitter = dynamixel1.make_splitter()
        assert [*splitter.push(damaged), *splitter.flush()] == []
        assert splitter.bad_sum + splitter.junk > 0


def test_the_error_byte():
    assert FAMILY.refuses(0x08) and FAMILY.refuses(0x10) and FAMILY.refuses(0x40)
    for bit, words in dynamixel1.ERRORS.items():
        assert not FAMILY.refuses(1 << bit) and FAMILY.alerts(1 << bit)
        assert FAMILY.complaints(1 << bit) == words
    assert not FAMILY.alerts(0) and not FAMILY.alerts(0x08)


def test_requests_are_read_as_they_were_meant():
    for data, meant in (
        (FAMILY.read(3, 36, 8), ReadRequest((3,), 36, 8, is_single=True)),
        (FAMILY.sync_read([1, 2, 5], 36, 8), ReadRequest((1, 2, 5), 36, 8)),
        (dynamixel1.make_bulk_read([(1, 30, 2), (2, 36, 2)]), None),
        (dynamixel1.make_write(1, 24, b"\0"), None),
    ):
        (packet,) = dynamixel1.make_splitter().push(data)
        assert FAMILY.request(packet) == meant


def test_counts_are_of_4096_a_turn():
    """An AX has 1024 over 300°; the sixty degrees that it does not see are the rest of the turn."""
    for model in (AX_12, 18, 300, 24, 28, 64, 113):
        positions = [FAMILY.position_of(bytes([r & 255, r >> 8]), model) for r in range(1024)]
        degrees = (np.array(positions) - 2048) * 360 / 4096
        assert np.abs(degrees - (np.arange(1024) - 512) * 300 / 1024).max() < 0.03
        assert (np.diff(positions) >= 3).all()
    for position in (0, 2048, 4095, -1, -28672, 28672):
        data = position.to_bytes(2, "little", signed=True)
        assert FAMILY.position_of(data, MX_28) == position


def registers(model, **values):
    table = bytearray(48)
    table[0:2] = model.to_bytes(2, "little")
    table[2:6] = bytes([36, 1, 1, 125])
    table[8:10] = (4095).to_bytes(2, "little")
    for name, value in values.items():
        at = int(name[1:])
        table[at : at + len(value)] = value
    return FAMILY.identity(bytes(table))


def test_what_a_servo_is():
    mx = registers(MX_28)
    assert (mx.firmware, mx.mode, mx.return_delay_us, mx.torque) == ("36", 3, 250, False)
    assert not FAMILY.refusal(mx)
    turning = {"r6": b"\xff\x0f\xff\x0f", "r20": (-100).to_bytes(2, "little", signed=True)}
    many = registers(MX_28, **turning)
    assert (many.mode, many.homing_offset, many.offset_in_force) == (4, -100, True)
    assert many.geometry != mx.geometry
    divided = registers(MX_28, **turning, r22=b"\x04")
    assert FAMILY.refusal(divided) == "divider (register 22): found 4, expected 1"
    ax = registers(AX_12, r20=b"\x10\x20\x30", r10=b"\x01")  # of which these say nothing
    assert (ax.homing_offset, ax.reversed, ax.divider) == (0, False, 1)
    assert registers(320, r10=b"\x01").reversed and not registers(320).reversed
    for model in (107, 350, 777):  # EX-106, XL-320 and a Feetech
        assert "model (register 0)" in FAMILY.refusal(registers(model))


def test_the_doctor_knows_the_rates():
    assert BAUDS["dynamixel1"][:2] == (1_000_000, 57_600)
    # 2 Mbaud divided by a whole number; the maker calls 117647 the rate of 115200.
    for baud in BAUDS["dynamixel1"]:
        if baud < 2_000_000:
            assert abs(2_000_000 / round(2_000_000 / baud) / baud - 1) < 0.022


def answered(port, call):
    """What *call* returns and when it was made; asked again where a busy machine took longer than
    the SDK waits."""
    for _ in range(8):
        before_ns = time.monotonic_ns()
        result = call()
        after_ns = time.monotonic_ns()
        if result[1] == 0:
            break
        time.sleep(0.1)
        port.ser.reset_input_buffer()
    return result, before_ns, after_ns


#: An MX's counts; the last joint is an AX, which tells every 3.3 of them.
WITHIN = np.array([1, 1, 1, 1, 5])


@pytest.mark.slow
def test_the_makers_library_and_armd_read_what_is_true(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    sdk = pytest.importorskip("dynamixel_sdk")
    with simulated_arm(tmp_path, wire=("--servo", "dynamixel1")) as arm:
        truth = Truth(arm)
        port, packets = sdk.PortHandler(arm.port), sdk.PacketHandler(1.0)
        assert port.openPort() and port.setBaudRate(1_000_000)
        for servo in IDS:
            model = AX_12 if servo in IDS[-2:] else MX_28
            assert answered(port, partial(packets.ping, port, servo))[0] == (model, 0, 0)
        for _ in range(10):
            for k, servo in enumerate(JOINTS):
                read = partial(packets.read2ByteTxRx, port, servo, 36)
                (raw, result, error), before_ns, after_ns = answered(port, read)
                assert (result, error) == (0, 0)
                told = 2048 + (raw - 512) * 10 / 3 if servo == JOINTS[-1] else raw
                shown = [truth.raw(t)[k] for t in np.linspace(before_ns, after_ns, 20)]
                assert min(shown) - WITHIN[k] <= told <= max(shown) + WITHIN[k]
        # The group of SDK 4.1.0 hands over one argument too many; its packets are right.
        asked = [value for servo in JOINTS[:4] for value in (8, servo, 36)]

        def bulk():
            assert packets.bulkReadTx(port, asked, len(asked)) == sdk.COMM_SUCCESS
            answers = [packets.readRx(port, servo, 8) for servo in JOINTS[:4]]
            return answers, max(abs(result) for _, result, _ in answers)

        answers, result = answered(port, bulk)[0]
        assert result == 0 and all(18 <= data[7] <= 45 for data, _, _ in answers)
        port.closePort()
        config = ServoConfig(
            kind="dynamixel1", port=arm.port, ids=JOINTS, temperature_ids=[2, 3, 4, 5, 6],
            trigger={"id": 6, "pressed_below": 1900},
        )  # fmt: skip
        rows, events, end = [], [], time.monotonic() + 30.0
        expected = Expectation("SERVO", 5, 5, (4096,) * 5)
        with closing(open_driver(config, expected)) as driver:
            while time.monotonic() < end and sum(map(len, rows)) < 300:
                for item in driver.read(0.05):
                    if isinstance(item, np.ndarray) and "count" in (item.dtype.names or ()):
                        rows.append(item)
                    elif hasattr(item, "kind"):
                        events.append(item)
        joined = np.concatenate(rows)
        good = joined[5:][joined["joint_invalid"][5:] == 0]
        assert len(good) > 0.9 * len(joined)
        off = good["count"] + 2048 - [truth.raw(int(t)) for t in good["monotonic_ns"]]
        assert (np.abs(off) <= WITHIN + 3).mean() > 0.95  # what a busy host adds to an instant
        texts = [event.text for event in events if event.kind == "servo"]
        assert any("servo 5 (joint 5) is a AX-12" in text for text in texts), texts
        assert "no_sync_read" not in {event.kind for event in events}
        assert "identified" in {event.kind for event in events}
