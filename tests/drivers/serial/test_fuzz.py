"""Random and mutated packets through decoder and assembler: no crash, no false accept, bounded.

The full million is the slow test; the same story, shorter, runs always.
"""

import os

import numpy as np
import pytest

from armd.drivers.identity import Expectation
from armd.drivers.sample import RawFrame
from armd.drivers.serial import wire
from armd.drivers.serial.decoder import SerialDecoder
from armd.drivers.serial.reading_buffer import HELD_SAMPLES

N = 6
EXPECTED = Expectation("SIM-0001", N, 6, (1 << 23,) * N)
HELLO = wire.encode_hello(wire.Hello(1, N, 6, 1000, 7, "SIM-0001", (23,) * N))


class Fuzzer:
    """Makes a stream of good, damaged and senseless packets, and knows which are good."""

    def __init__(self, seed):
        self.rng = np.random.default_rng(seed)
        self.seq = 0
        self.good = set()

    def packet(self):
        match int(self.rng.integers(0, 10)):
            case 0 | 1 | 2:
                return self._sample()
            case 3 | 4:
                return self._mutated(self._sample(good=False))
            case 5:
                return self._mutated(HELLO)
            case 6:  # a right CRC around nonsense
                kind = int(self.rng.integers(0, 256))
                if kind in (wire.Type.SAMPLE, wire.Type.HELLO):
                    kind = 0x77  # those would be believed, and rightly
                return wire.pack(bytes([kind]) + self._bytes(60))
            case 7:
                return wire.pack(b"\x01" + self._bytes(14))  # a SAMPLE too short for its n
            case 8:
                return self._bytes(300)
            case _:
                return self._bytes(20) + b"\0"

    def _bytes(self, most):
        return self.rng.bytes(int(self.rng.integers(0, most)))

    def _sample(self, good=True):
        self.seq += 1
        if good:
            self.good.add(self.seq)
        return wire.encode_sample(self.seq, 1000 * self.seq, np.arange(N) + self.seq)

    def _mutated(self, packet):
        """A byte changed, cut, doubled or two exchanged; never the packet itself."""
        data = bytearray(packet)
        a, b = (int(i) for i in self.rng.integers(0, len(data) - 1, 2))
        match int(self.rng.integers(0, 4)):
            case 0:
                data[a] ^= int(self.rng.integers(1, 256))
            case 1:
                del data[a : a + 1 + int(self.rng.integers(0, 4))]
            case 2:
                data.insert(a, int(self.rng.integers(1, 256)))
            case _:
                data[a], data[b] = data[b], data[a]
        return bytes(data) if data != packet else bytes(data[:-2]) + b"\0"


def fuzz(n_packets, seed):
    fuzzer, decoder = Fuzzer(seed), SerialDecoder(EXPECTED)
    frame_ns = 10**12
    decoder.feed(RawFrame(frame_ns, 0, "rx", HELLO))
    delivered = []
    for _ in range(0, n_packets, 50):
        stream = b"".join(fuzzer.packet() for _ in range(50))
        for cut in np.array_split(np.frombuffer(stream, np.uint8), 3):
            frame_ns += 15_000_000
            for item in decoder.feed(RawFrame(frame_ns, 0, "rx", cut.tobytes())):
                if isinstance(item, np.ndarray):
                    delivered += [int(seq) for seq in item["seq"]]
        assert len(decoder._splitter._tail) <= wire.PACKET_LIMIT
        assert (
            len(decoder._exchanges._pings) <= 64 and decoder._held_readings._weight <= HELD_SAMPLES
        )
    return fuzzer, decoder, delivered


def check(n_packets, seed):
    fuzzer, decoder, delivered = fuzz(n_packets, seed)
    false_accepts = [seq for seq in delivered if seq not in fuzzer.good]
    counters = {name: n for name, n in decoder.counters.items() if n}
    print(f"{n_packets} packets, seed {seed}: {len(delivered)} delivered, {counters}")
    assert false_accepts == []
    assert delivered == sorted(set(delivered))
    # A good packet is lost only together with senseless bytes that run into it.
    assert len(delivered) > 0.6 * len(fuzzer.good)


@pytest.mark.parametrize("seed", range(3))
def test_nothing_false_is_accepted(seed):
    check(10_000, seed)


@pytest.mark.slow
def test_a_million_packets():
    seed = int(os.environ.get("FUZZ_SEED", "1"))
    check(1_000_000, seed)
