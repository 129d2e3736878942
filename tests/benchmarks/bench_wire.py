"""What a SAMPLE costs from its bytes to the structured array, in large reads and one by one.

The floor, in the same run: nothing but COBS and CRC-32 by their C libraries on the same packets.
"""

from __future__ import annotations

import time
import zlib
from typing import Any

import numpy as np
from cobs import cobs

from armd.drivers.identity import Expectation
from armd.drivers.sample import RawFrame
from armd.drivers.serial import wire
from armd.drivers.serial.decoder import SerialDecoder

N_JOINTS = 6
SAMPLES = 20_000
PER_READ = 200  # what has gathered at 5 kHz after 40 ms
ROUNDS = 5
HELLO = wire.Hello(1, N_JOINTS, 0, 1000, 1, "BENCH", (23,) * N_JOINTS)


def run() -> dict[str, Any]:
    """µs per sample: `large_reads`, `single_reads`, `cobs_and_crc_alone`, and the two ratios."""
    count = np.arange(N_JOINTS) * 1000
    packets = [wire.encode_sample(i, 1000 * i, count + i) for i in range(SAMPLES)]
    large = [b"".join(packets[i : i + PER_READ]) for i in range(0, SAMPLES, PER_READ)]
    figures = {"large_reads_us": [], "single_reads_us": [], "cobs_and_crc_alone_us": []}
    for _ in range(ROUNDS):  # in turn, so that a busy machine slows all alike
        figures["large_reads_us"].append(_decode(large))
        figures["single_reads_us"].append(_decode(packets))
        figures["cobs_and_crc_alone_us"].append(_floor(packets))
    best: dict[str, Any] = {name: min(values) for name, values in figures.items()}
    floor = best["cobs_and_crc_alone_us"]
    best["large_reads_ratio"] = best["large_reads_us"] / floor
    best["single_reads_ratio"] = best["single_reads_us"] / floor
    return best


def _decode(reads: list[bytes]) -> float:
    decoder = SerialDecoder(Expectation("BENCH", N_JOINTS, 0, (1 << 23,) * N_JOINTS))
    decoder.feed(RawFrame(0, 0, "link", b"up"))
    decoder.feed(RawFrame(0, 0, "rx", b"\0" + wire.encode_hello(HELLO)))
    frames = [RawFrame(i * 1_000_000, i, "rx", data) for i, data in enumerate(reads)]
    start = time.perf_counter()
    for frame in frames:
        decoder.feed(frame)
    seconds = time.perf_counter() - start
    assert decoder.counters["samples"] == SAMPLES, decoder.counters
    return seconds / SAMPLES * 1e6


def _floor(packets: list[bytes]) -> float:
    start = time.perf_counter()
    for packet in packets:
        body = cobs.decode(packet[:-1])
        assert zlib.crc32(body[:-4]) == int.from_bytes(body[-4:], "little")
    return (time.perf_counter() - start) / SAMPLES * 1e6
