"""SAMPLEs unpacked by a compiled loop: packet by packet what `wire` makes of them."""

from __future__ import annotations

import random

import numpy as np
import pytest
from cobs import cobs

from armd.drivers.identity import Expectation
from armd.drivers.sample import Item, RawFrame
from armd.drivers.serial import wire
from armd.drivers.serial.decoder import SerialDecoder
from armd.drivers.serial.unpacking import ROOM, SampleBytes, unpack_samples

BITS = 20


def unpacked(packet: bytes, joints: int) -> bytes | None:
    """By `wire`: the SAMPLE in *packet* with its 0x00; None where there is none."""
    try:
        data = wire.unpack(packet[:-1])
    except cobs.DecodeError:
        return None
    good = data is not None and data[0] == wire.Type.SAMPLE and wire.is_sample(data, joints)
    return data if good else None


def damaged(packet: bytes, chance: random.Random) -> bytes:
    """With up to two other bytes; those that mean something to COBS or the layout come often."""
    data = bytearray(packet)
    for _ in range(chance.choice((0, 0, 1, 2))):
        k = chance.randrange(len(data))
        data[k] = chance.choice((0, 1, 255, len(data) - 1, chance.getrandbits(8)))
    return bytes(data)


@pytest.mark.parametrize("joints", [3, 6, 9])
def test_a_compiled_loop_accepts_what_wire_accepts(joints: int) -> None:
    chance = random.Random(joints)
    sample_bytes = SampleBytes(joints)
    accepted = 0
    for _ in range(4000):
        seq, t_us = chance.choice((0, 256, 1 << 24)), 1 << chance.randrange(56)
        counts = [chance.choice((0, 1, 1 << 16, chance.getrandbits(32))) for _ in range(joints)]
        packet = damaged(wire.encode_sample(seq, t_us, counts), chance)
        expected = unpacked(packet, joints) if packet.find(b"\0") == len(packet) - 1 else None
        assert sample_bytes.put(packet) == 1
        good = unpack_samples(1, sample_bytes.packets, sample_bytes.row_bytes)
        assert (sample_bytes.row_bytes[0].tobytes() if good else None) == expected
        accepted += good
    assert 1000 < accepted < 3000  # so that both are tried


def test_what_is_no_whole_number_of_samples_is_left_to_wire() -> None:
    sample_bytes, packet = SampleBytes(6), wire.encode_sample(1, 1, [0] * 6)
    assert sample_bytes.put(packet * ROOM) == ROOM
    assert [sample_bytes.put(data) for data in (b"", packet + b"\0", packet * (ROOM + 1))] == [
        0
    ] * 3


def decoded(chunks: list[bytes]) -> tuple[list[Item], dict[str, int]]:
    """What a decoder that knows its arm makes of them, each read at another time."""
    decoder = SerialDecoder(Expectation("T", 3, 1, (1 << BITS,) * 3))
    hello = wire.encode_hello(wire.Hello(1, 3, 1, 1000, 1, "T", (BITS,) * 3))
    items: list[Item] = []
    for k, data in enumerate([b"\0" + hello, *chunks]):
        items += decoder.feed(RawFrame(1000 * k, 1000 * k + 5, "rx", data))
    return items[1:], decoder.counters  # without "identified"


def test_samples_are_the_same_whatever_is_among_them_and_however_they_are_cut(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Bad packets, a repeated one and a temperature among good ones; whole, in packets, in bytes
    that end anywhere: bit by bit what packets taken one by one give."""
    chance = random.Random(5)
    packets = [wire.encode_sample(k, 1000 * k, [k, 0, 7]) for k in range(1, 400)]
    packets[50] = packets[50][:8] + b"\x99" + packets[50][9:]
    packets[120] = packets[119]
    packets[200:200] = [wire.encode_temperature(200_000, [20.0]), b"\0", b"junk\0"]
    stream = b"".join(packets)
    cuts = sorted(chance.randrange(len(stream)) for _ in range(300))
    anywhere = [stream[a:b] for a, b in zip([0, *cuts], [*cuts, None], strict=True)]
    for chunks in (packets, [stream[:8192], stream[8192:]], anywhere):
        monkeypatch.undo()
        items, counters = decoded(chunks)
        monkeypatch.setattr(SerialDecoder, "_plain_samples", lambda *_: None)
        one_by_one, counters_one_by_one = decoded(chunks)
        rows, expected = (
            [item for item in found if isinstance(item, np.ndarray)]
            for found in (items, one_by_one)
        )
        assert len(np.concatenate(rows)) == 397  # of 399, one bad and one there before
        assert np.concatenate(rows).tobytes() == np.concatenate(expected).tobytes()
        assert list(map(type, items)) == list(map(type, one_by_one))
        assert counters == counters_one_by_one
