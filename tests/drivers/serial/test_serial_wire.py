"""The serial codec: what is encoded comes back, what is damaged never does."""

import itertools
import zlib

import numpy as np
import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st

from armd.drivers.serial import wire

u32 = st.integers(0, 2**32 - 1)
times = st.integers(0, wire.T_US_LIMIT - 1)
samples = st.tuples(
    u32,
    times,
    st.lists(u32, min_size=1, max_size=9),
    st.integers(0, 255),
    st.integers(0, 255),
)


def data_of(packet: bytes) -> bytes:
    assert packet.endswith(b"\0") and packet.count(b"\0") == 1
    data = wire.unpack(packet[:-1])
    assert data is not None
    return data


def test_a_sample_byte_by_byte_as_the_contract_lays_it_out():
    body = data_of(wire.encode_sample(0x04030201, 0x0C0B0A0908070605, [0x100F0E0D], 1, 2))[:-4]
    assert body == bytes([1, 1, 2, 1, *range(1, 0x11)])


def test_a_hello_byte_by_byte_as_the_contract_lays_it_out():
    hello = wire.Hello(1, 2, 3, 1000, 0x01020304, "SIM-0001", (23, 20))
    body = data_of(wire.encode_hello(hello))[:-4]
    assert body == b"\x03\x01\x02\x03\xe8\x03\x04\x03\x02\x01SIM-0001" + bytes(8) + bytes([23, 20])


def test_the_crc_is_zlibs():
    decoded = cobs.decode(wire.encode_identify()[:-1])
    assert decoded == b"\x81" + zlib.crc32(b"\x81").to_bytes(4, "little")


@given(samples)
def test_samples_come_back(sample):
    seq, t_us, counts, status, buttons = sample
    data = data_of(wire.encode_sample(seq, t_us, counts, status, buttons))
    assert wire.is_sample(data, len(counts))
    assert not wire.is_sample(data, len(counts) + 1)
    row = wire.decode_samples([data, data], len(counts))[1]
    assert (row["seq"], row["t_us"], row["joint_status"], row["buttons"]) == (
        seq,
        t_us,
        status,
        buttons,
    )
    assert row["count"].tolist() == counts


@given(times, st.lists(st.none() | st.integers(-32767, 32767), max_size=16))
def test_temperatures_come_back(t_us, ticks):
    celsius = np.array([np.nan if tick is None else tick / 100 for tick in ticks])
    reading = wire.decode_temperature(data_of(wire.encode_temperature(t_us, celsius)))
    assert reading is not None and reading.t_us == t_us
    np.testing.assert_allclose(reading.celsius, celsius, atol=1e-9)


def test_a_temperature_that_does_not_fit_is_sent_as_invalid():
    reading = wire.decode_temperature(data_of(wire.encode_temperature(0, [400.0, -400.0, 20.0])))
    assert reading is not None
    assert np.isnan(reading.celsius).tolist() == [True, True, False]


@given(u32, times)
def test_pings_and_pongs_come_back(nonce, t_us):
    assert wire.decode_ping(data_of(wire.encode_ping(nonce))) == nonce
    assert wire.decode_pong(data_of(wire.encode_pong(nonce, t_us))) == wire.Pong(nonce, t_us)


@given(
    st.lists(st.integers(0, 255), max_size=9),
    st.text(st.characters(min_codepoint=33, max_codepoint=126), max_size=16),
    u32,
)
def test_hellos_come_back(bits, serial, boot_id):
    hello = wire.Hello(1, len(bits), 2, 1000, boot_id, serial, tuple(bits))
    assert wire.decode_hello(data_of(wire.encode_hello(hello))) == hello


def test_of_another_protocol_only_its_number_is_read():
    body = bytes([wire.Type.HELLO, 2]) + b"whatever version two may say"
    hello = wire.decode_hello(data_of(wire.pack(body)))
    assert hello is not None and hello.protocol == 2 and hello.serial_number == ""


@given(samples, st.data())
def test_a_flipped_byte_is_never_accepted(sample, data):
    packet = bytearray(wire.encode_sample(*sample)[:-1])
    place = data.draw(st.integers(0, len(packet) - 1))
    packet[place] ^= data.draw(st.integers(1, 255))
    try:
        accepted = wire.unpack(bytes(packet)) is not None
    except cobs.DecodeError:
        accepted = False
    assert not accepted


@pytest.mark.parametrize("extra", [-4, -1, 1, 4])
def test_a_length_that_contradicts_n_is_refused(extra):
    body = data_of(wire.encode_sample(1, 2, [3, 4, 5]))[:-4]
    wrong = body[:extra] if extra < 0 else body + bytes(extra)
    assert not wire.is_sample(data_of(wire.pack(wrong)), 3)
    body = data_of(wire.encode_temperature(1, [20.0, 21.0]))[:-4]
    wrong = body[:extra] if extra < 0 else body + bytes(extra)
    assert wire.decode_temperature(data_of(wire.pack(wrong))) is None


@given(st.integers(1, 4), st.binary(max_size=40))
def test_no_body_of_any_content_breaks_a_decoder(kind, rest):
    data = data_of(wire.pack(bytes([kind]) + rest))
    wire.is_sample(data, 6)
    for decode in (wire.decode_temperature, wire.decode_hello, wire.decode_pong, wire.decode_ping):
        decode(data)


packets = st.lists(st.binary(min_size=1, max_size=60).map(lambda b: b.replace(b"\0", b"\1")))


@given(packets, st.lists(st.integers(0, 400), max_size=10))
def test_packets_are_cut_alike_however_the_bytes_come(packets, cuts):
    stream = b"".join(p + b"\0" for p in packets)
    cuts = sorted({0, *[min(cut, len(stream)) for cut in cuts], len(stream)})
    splitter = wire.CobsSplitter()
    got = [p for a, b in itertools.pairwise(cuts) for p in splitter.push(stream[a:b])]
    assert got == packets and splitter.junk == 0


@pytest.mark.parametrize("chunk", [1, 100, 4095, 4096, 4097, 20000])
def test_junk_beyond_four_kilobytes_is_dropped_up_to_the_next_zero(chunk):
    stream = b"ok\0" + b"x" * 4096 + b"\0" + b"x" * 4097 + b"\0" + b"x" * 9999 + b"\0ok\0"
    splitter = wire.CobsSplitter()
    got = []
    for i in range(0, len(stream), chunk):
        got += splitter.push(stream[i : i + chunk])
    assert got == [b"ok", b"x" * 4096, b"ok"]
    assert splitter.junk == 2


def test_endless_junk_takes_no_memory():
    splitter = wire.CobsSplitter()
    for _ in range(1000):
        assert splitter.push(b"x" * 1000) == []
    assert len(splitter._tail) <= wire.PACKET_LIMIT
    assert splitter.junk == 1
