"""What arrives on a wire, and the notes of a recording, through each decoder."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from fuzz.doors import Door

from armd.drivers.can import objects as can
from armd.drivers.can.decoder import CanDecoder
from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.microscribe.decoder import MicroScribeDecoder
from armd.drivers.poll.decoder import ServoDecoder
from armd.drivers.sample import RawFrame
from armd.drivers.serial import wire
from armd.drivers.serial.decoder import SerialDecoder

N = 6
#: Between two frames of a seed: a damaged one has another cut.
CUT = b"\n--\n"
EXPECTED = Expectation("SIM-0001", N, 6, (1 << 23,) * N)


def door(
    name: str,
    notes: list[bytes],
    seed: list[bytes],
    decoder: Callable[[], Any],
    framed: Callable[[bytes], bytes] = bytes,
) -> Door:
    """*notes* are the driver's own. Each part of *seed* begins with its direction, r or t; what is
    received may be damaged, what is sent is the driver's own as well. *framed* gives received bytes
    the form in which a bus hands them over."""

    def feed(data: bytes) -> None:
        fed, now_ns = decoder(), 10**12
        for part in [b"l" + text for text in notes] + data.split(CUT):
            now_ns += 1_000_000
            if part in seed or part[1:] in notes:
                direction = {b"t": "tx", b"l": "link"}.get(part[:1], "rx")
                fed.feed(RawFrame(now_ns, now_ns, direction, part[1:], "line"))
            else:
                fed.feed(RawFrame(now_ns, now_ns, "rx", framed(part[1:]), "line"))

    return Door(name, [CUT.join(seed)], feed)


def can_frame(data: bytes) -> bytes:
    """Any identifier of 11 bits, and at most eight bytes."""
    identifier = int.from_bytes(data[:4].ljust(4, b"\0"), "little") & 0x7FF
    return can.CanFrame(identifier, data[4:12]).to_bytes()


def note(**fields: Any) -> bytes:
    return json.dumps(fields).encode()


def wire_doors() -> Iterator[Door]:
    hello = wire.encode_hello(wire.Hello(1, N, 6, 1000, 7, "SIM-0001", (23,) * N))
    samples = [b"r" + wire.encode_sample(k, 1000 * k, np.arange(N) + k) for k in range(1, 9)]
    yield door("serial", [b"up"], [b"r" + hello, *samples], lambda: SerialDecoder(EXPECTED))
    for kind in ("feetech", "dynamixel", "dynamixel1"):
        config = ServoConfig(kind=kind, port="/dev/null", baud=1_000_000, ids=[1, 2, 3])
        expected = Expectation("SERVO-1", 3, 3, (4096,) * 3)
        family = ServoDecoder(config, expected).family
        identity = family.sync_read([1, 2, 3], 0, family.identity_bytes)
        asked = family.sync_read([1, 2, 3], 56, 4)
        notes = [note(note="up"), note(note="verdict", changed={})]
        seed = [b"t" + identity, b"r" + identity[::-1], b"t" + asked, b"r" + asked[::-1] + asked]
        yield door(kind, notes, seed, lambda c=config, e=expected: ServoDecoder(c, e))
    notes = [
        note(note="up"),
        *(
            note(note="configured", node=k, counts_per_turn=1 << 23, range_counts=1 << 23,
                 serial_number=k)
            for k in range(1, N + 1)
        ),
    ]  # fmt: skip
    frames = [
        b"t" + can.CanFrame(can.SYNC_ID, b"").to_bytes(),
        *(
            b"r" + can.CanFrame(can.TPDO_BASE[0] + k, can.ENCODER_PDO.pack(k, 0)).to_bytes()
            for k in range(1, N + 1)
        ),
    ]
    yield door("can", notes, frames, lambda: CanDecoder(EXPECTED, 500.0), can_frame)
    scribe = [b"tBEGIN", b"rMSCR", b"tGET_IDS", b"r" + bytes(20), b"r" + bytes(range(30))]
    yield door("microscribe", [b"up 115200"], scribe, lambda: MicroScribeDecoder(EXPECTED))
