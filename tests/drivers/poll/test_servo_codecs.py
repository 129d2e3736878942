"""Both servo protocols against the makers' published vectors, and against all that may happen to
bytes on a line."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from armd.drivers.poll.protocol import dynamixel, feetech
from armd.drivers.poll.protocol.packet import Packet, ReadRequest, Splitter, Status


def hexed(text):
    return bytes.fromhex(text.replace("|", ""))


#: from the maker's protocol manual and memory table
FEETECH = {
    "ping": (feetech.make_ping(1), "FF FF 01 02 01 FB"),
    "ping all": (feetech.make_ping(0xFE), "FF FF FE 02 01 FE"),
    "read position": (feetech.make_read(1, 56, 2), "FF FF 01 04 02 38 02 BE"),
    "read model": (feetech.make_read(1, 3, 2), "FF FF 01 04 02 03 02 F3"),
    "read phase": (feetech.make_read(1, 18, 1), "FF FF 01 04 02 12 01 E5"),
    "read homing offset": (feetech.make_read(1, 31, 2), "FF FF 01 04 02 1F 02 D7"),
    "torque off": (feetech.make_write(1, 40, b"\0"), "FF FF 01 04 03 28 00 CF"),
    "write goal": (
        feetech.make_write(1, 42, bytes.fromhex("00080000E803")),
        "FF FF 01 09 03 2A 00 08 00 00 E8 03 D5",
    ),
    "sync 56/8": (feetech.make_sync_read([1, 2], 56, 8), "FF FF FE 06 82 38 08 01 02 36"),
    "sync 56/2": (
        feetech.make_sync_read([1, 2, 3, 4, 5, 6], 56, 2),
        "FF FF FE 0A 82 38 02 01 02 03 04 05 06 26",
    ),
    "sync 56/15": (
        feetech.make_sync_read([1, 2, 3, 4, 5, 6], 56, 15),
        "FF FF FE 0A 82 38 0F 01 02 03 04 05 06 19",
    ),
    "answer to a ping": (feetech.make_status(1, 0), "FF FF 01 02 00 FC"),
    "position 1304": (feetech.make_status(1, 0, b"\x18\x05"), "FF FF 01 04 00 18 05 DD"),
    "position −100": (feetech.make_status(1, 0, b"\x64\x80"), "FF FF 01 04 00 64 80 16"),
    "model 777": (feetech.make_status(1, 0, b"\x09\x03"), "FF FF 01 04 00 09 03 EE"),
    "eight bytes": (
        feetech.make_status(2, 0, bytes.fromhex("FF07000000007723")),
        "FF FF 02 0A 00 FF 07 00 00 00 00 77 23 53",
    ),
}

#: from the e-Manual's protocol page
DYNAMIXEL = {
    "ping": (dynamixel.make_ping(1), "FFFFFD00 01 0300 01 194E"),
    "ping all": (dynamixel.make_ping(0xFE), "FFFFFD00 FE 0300 01 3142"),
    "answer to a ping": (
        dynamixel.make_status(1, 0, bytes.fromhex("060426")),
        "FFFFFD00 01 0700 55 00 060426 655D",
    ),
    "read position": (dynamixel.make_read(1, 132, 4), "FFFFFD00 01 0700 02 8400 0400 1D15"),
    "position 166": (
        dynamixel.make_status(1, 0, bytes.fromhex("A6000000")),
        "FFFFFD00 01 0800 55 00 A6000000 8CC0",
    ),
    "write goal": (
        dynamixel.make_write(1, 116, (512).to_bytes(4, "little")),
        "FFFFFD00 01 0900 03 7400 00020000 CA89",
    ),
    "answer to a write": (dynamixel.make_status(1, 0), "FFFFFD00 01 0400 55 00 A10C"),
    "reboot": (dynamixel.make_packet(1, dynamixel.REBOOT), "FFFFFD00 01 0300 08 2F4E"),
    "sync read": (
        dynamixel.make_sync_read([1, 2], 132, 4),
        "FFFFFD00 FE 0900 82 8400 0400 01 02 CEFA",
    ),
    "sync read of six": (
        dynamixel.make_sync_read([1, 2, 3, 4, 5, 6], 132, 4),
        "FFFFFD00 FE 0D00 82 8400 0400 010203040506 B29B",
    ),
    "sync read 120/27": (
        dynamixel.make_sync_read([1, 2, 3, 4, 5, 6], 120, 27),
        "FFFFFD00 FE 0D00 82 7800 1B00 010203040506 06E7",
    ),
    "fast sync read": (
        dynamixel.make_fast_sync_read([3, 7, 4], 132, 4),
        "FFFFFD00 FE 0A00 8A 8400 0400 030704 20F2",
    ),
    "fast answer": (
        b"".join(
            dynamixel.make_fast_status_blocks(
                [
                    Status(3, 0, bytes.fromhex("A6000000")),
                    Status(7, 0, bytes.fromhex("1F080000")),
                    Status(4, 0, bytes.fromhex("FF030000")),
                ]
            )
        ),
        "FFFFFD00 FE 1900 55 | 00 03 A6000000 8408 | 00 07 1F080000 16CA | 00 04 FF030000 D19E",
    ),
    "stuffed write": (
        dynamixel.make_write(1, 116, bytes.fromhex("FFFFFD00")),
        "FFFFFD00 01 0A00 03 7400 FFFFFDFD00 21E7",
    ),
    "stuffed answer": (
        dynamixel.make_status(1, 0, bytes.fromhex("FFFFFD00")),
        "FFFFFD00 01 0900 55 00 FFFFFDFD00 D89C",
    ),
}


@pytest.mark.parametrize(
    ("codec", "ours", "published"),
    [
        pytest.param(codec, *vector, id=f"{codec.__name__.rpartition('.')[2]}, {name}")
        for codec, vectors in ((feetech, FEETECH), (dynamixel, DYNAMIXEL))
        for name, vector in vectors.items()
    ],
)
def test_packets_are_as_published(codec, ours, published):
    assert ours == hexed(published)
    (packet,) = codec.make_splitter().push(hexed(published))
    assert packet.raw == hexed(published)


def test_sync_answers_as_published():
    wire = "FF FF 01 0A 00 | 00 08 | 00 00 | 00 00 | 79 | 1E | 55 FFFF020A00 FF07000000007723 53"
    first, second = [
        feetech.decode_statuses(p)[0] for p in feetech.make_splitter().push(hexed(wire))
    ]
    assert (first.id, first.data[0] | first.data[1] << 8, first.data[7]) == (1, 2048, 30)
    assert (second.id, second.data[0] | second.data[1] << 8, second.data[7]) == (2, 2047, 35)

    wire = "FFFFFD00 FE 3100 55 | 00 01 A6000000 7777 | 00 02 1F080000 568C | 00 03 FF030000 CE79"
    wire += "| 00 04 FBFFFFFF 329E | 00 05 88130000 CF45 | 00 06 00080000 1FA0"
    (packet,) = dynamixel.make_splitter().push(hexed(wire))
    answers = dynamixel.decode_statuses(packet, 4)
    positions = [int.from_bytes(a.data, "little", signed=True) for a in answers]
    assert [a.id for a in answers] == [1, 2, 3, 4, 5, 6]
    assert positions == [166, 2079, 1023, -5, 5000, 2048]

    wire = "FFFFFD00 01 1F00 55 00 E9030000000000000000 0000A600000000000000000000003200 1F B38A"
    (packet,) = dynamixel.make_splitter().push(hexed(wire))
    (answer,) = dynamixel.decode_statuses(packet)
    assert len(answer.data) == 27 and answer.data[26] == 31 and answer.data[12] == 166


def test_requests_are_read_as_they_were_meant():
    ids, span = (1, 2, 5), (56, 8)
    (packet,) = feetech.make_splitter().push(feetech.make_sync_read(ids, *span))
    assert feetech.decode_read_request(packet) == ReadRequest(ids, *span)
    for build, fast in ((dynamixel.make_sync_read, False), (dynamixel.make_fast_sync_read, True)):
        (packet,) = dynamixel.make_splitter().push(build(ids, 132, 15))
        assert dynamixel.decode_read_request(packet) == ReadRequest(ids, 132, 15, fast)


def test_sign_and_magnitude():
    assert feetech.decode_signed(0x8064, 15) == -100 and feetech.decode_signed(1304, 15) == 1304
    assert feetech.decode_signed(0x0FFF, 11) == -2047 and feetech.decode_signed(0x8000, 15) == 0


ID = st.integers(0, 0xFD)
DATA = st.one_of(
    st.binary(max_size=60),
    st.lists(st.sampled_from([0xFF, 0xFD, 0x00]), max_size=60).map(bytes),  # asks for stuffing
)
CODECS = pytest.mark.parametrize("codec", [feetech, dynamixel], ids=["feetech", "dynamixel"])


@CODECS
@given(servo_id=ID, error=st.integers(0, 0x7F), data=DATA)
def test_what_is_built_is_found_again(codec, servo_id, error, data):
    splitter = codec.make_splitter()
    (packet,) = splitter.push(codec.make_status(servo_id, error, data))
    assert codec.decode_statuses(packet) == [Status(servo_id, error, data)]
    assert splitter.junk == splitter.bad_sum == 0


@CODECS
@given(
    answers=st.lists(st.tuples(ID, DATA), min_size=1, max_size=6),
    cuts=st.lists(st.integers(0, 400), max_size=8),
)
def test_chunks_do_not_matter(codec, answers, cuts):
    wire = b"".join(codec.make_status(i, 0, data) for i, data in answers)
    splitter: Splitter = codec.make_splitter()
    found: list[Packet] = []
    edges = sorted({0, len(wire), *(cut for cut in cuts if cut < len(wire))})
    for begin, end in itertools.pairwise(edges):
        found += splitter.push(wire[begin:end])
    assert [codec.decode_statuses(p)[0][::2] for p in found] == answers


@CODECS
@given(
    data=st.lists(st.binary(min_size=4, max_size=4), min_size=3, max_size=6),
    where=st.floats(0, 1, exclude_max=True),
    change=st.integers(1, 255),
    before=st.binary(max_size=12),
)
def test_a_damaged_byte_costs_no_other_answer(codec, data, where, change, before):
    """Whatever byte of one answer changes, and whatever lay in the buffer: all others are found."""
    wires = [codec.make_status(i, 0, answer) for i, answer in enumerate(data, 1)]
    spoilt = 1 + int(where * (len(wires) - 1))  # not the first: junk before may eat its header
    wire = bytearray(wires[spoilt])
    wire[int(where * 997) % len(wire)] ^= change
    splitter = codec.make_splitter()
    splitter.sizes = {len(wire) for wire in wires}
    found = splitter.push(before + b"".join(wires[:spoilt]) + bytes(wire))
    found += splitter.push(b"".join(wires[spoilt + 1 :]))
    found += splitter.flush()
    raws = [packet.raw for packet in found]
    others = [raw for i, raw in enumerate(wires) if i not in (0, spoilt)]
    kept = [raw for raw in raws if raw in others]
    assert kept == others


TWO_STATUSES = hexed(
    "FF FF 01 0A 00 00 08 00 00 00 00 79 1E 55 FF FF 02 0A 00 FF 07 00 00 00 00 77 23 53"
)


def test_at_a_glance_the_published_answers_of_two_servos_are_whole():
    assert feetech.are_statuses(TWO_STATUSES, [1, 2], 8)
    assert feetech.are_statuses(TWO_STATUSES[14:], [2], 8)
    for ids, length in (([2, 1], 8), ([1], 8), ([1, 2, 3], 8), ([1, 2], 7), ([], 8)):
        assert not feetech.are_statuses(TWO_STATUSES, ids, length)


@given(st.integers(0, len(TWO_STATUSES) - 1), st.integers(1, 255))
def test_at_a_glance_no_damaged_answer_is_whole(place, flip):
    damaged = bytearray(TWO_STATUSES)
    damaged[place] ^= flip
    assert not feetech.are_statuses(bytes(damaged), [1, 2], 8)
