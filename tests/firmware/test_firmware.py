"""The reference sketch: its codec, compiled here, against the daemon's own; all of it compiles."""

from __future__ import annotations

import math
import random
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from armd.drivers.serial import wire

HERE = Path(__file__).parent
SKETCH = HERE.parent.parent / "docs/firmware/armd_arm"
STRICT = ["-Wall", "-Wextra", "-Werror"]

Say = Callable[..., list[str]]


@pytest.fixture(scope="module")
def say(tmp_path_factory: pytest.TempPathFactory) -> Say:
    """Feeds command lines to the codec; its lines."""
    program = tmp_path_factory.mktemp("firmware") / "codec"
    command = ["gcc", "-std=c99", "-O1", "-fsanitize=undefined", "-fno-sanitize-recover", *STRICT]
    source = str(HERE / "codec.c")
    subprocess.run([*command, f"-I{SKETCH}", source, "-o", str(program), "-lm"], check=True)

    def run(*lines: str) -> list[str]:
        text = "\n".join(lines) + "\n"
        done = subprocess.run([program], input=text, capture_output=True, text=True, check=True)
        return done.stdout.splitlines()

    return run


def _unpack(line: str) -> bytes:
    """The one packet that the line is, as the daemon cuts and checks it."""
    (packet,) = wire.CobsSplitter().push(bytes.fromhex(line))
    data = wire.unpack(packet)
    assert data is not None
    return data


def test_samples_are_what_the_daemon_reads(say: Say) -> None:
    rng = random.Random(5)
    cases = []
    for n in range(3, 10):
        for top in (0, 1, 255, 256, (1 << 32) - 1):  # zeros are what COBS is about
            counts = [rng.randint(0, top) for _ in range(n)]
            cases.append(
                (rng.randint(0, 255), rng.randint(0, 3), rng.randint(0, top), top * 999, counts)
            )
    lines = [
        f"sample {status} {buttons} {seq} {t_us} {len(counts)} {' '.join(map(str, counts))}"
        for status, buttons, seq, t_us, counts in cases
    ]
    for line, (status, buttons, seq, t_us, counts) in zip(say(*lines), cases, strict=True):
        data = _unpack(line)
        assert wire.is_sample(data, len(counts))
        (row,) = wire.decode_samples([data], len(counts))
        assert row["count"].tolist() == counts
        assert (row["joint_status"], row["buttons"]) == (status, buttons)
        assert (row["seq"], row["t_us"]) == (seq, t_us)


def test_temperatures_are_what_the_daemon_reads(say: Say) -> None:
    (line,) = say("temperature 11 123456789012 4 2150 -1 0 -4000")
    reading = wire.decode_temperature(_unpack(line))
    assert reading is not None and reading.t_us == 123456789012
    assert np.array_equal(reading.celsius, [21.5, -0.01, np.nan, -40.0], equal_nan=True)


def test_hello_and_pong_are_what_the_daemon_reads(say: Say) -> None:
    hello, long, pong = say(
        "hello 500 4026531841 MY-ARM-1 6", "hello 1 0 0123456789ABCDEFG 9", "pong 4294967295 7"
    )
    found = wire.decode_hello(_unpack(hello))
    assert found == wire.Hello(1, 6, 6, 500, 4026531841, "MY-ARM-1", (14,) * 6)
    cut = wire.decode_hello(_unpack(long))
    assert cut is not None and cut.serial_number == "0123456789ABCDEF" and len(cut.bits) == 9
    assert wire.decode_pong(_unpack(pong)) == wire.Pong(4294967295, 7)


def test_what_the_daemon_asks_is_heard_among_junk(say: Say) -> None:
    identify = wire.encode_identify()
    rng = random.Random(6)
    nonces = [0, 1, 255, 256, 0x01000100, (1 << 32) - 1, *(rng.getrandbits(32) for _ in range(50))]
    pings = [wire.encode_ping(nonce) for nonce in nonces]
    damaged = bytearray(pings[4])
    damaged[3] ^= 1
    junk = bytes(rng.randint(1, 255) for _ in range(300)) + b"\0" + b"\1\1\1\1\1\1\0" + damaged
    heard = say(
        f"hear {(junk + identify + b''.join(pings)).hex()}", *(f"hear {p[1:].hex()}" for p in pings)
    )
    expected = " ".join(f"{wire.Type.PING:d}:{nonce}" for nonce in nonces)
    assert heard[0] == f"heard {wire.Type.IDENTIFY:d}:0 {expected}"
    assert set(heard[1:]) == {"heard"}  # without its first byte none is whole


def test_encoders_that_must_not_be_believed_are_not(say: Say) -> None:
    # AS5600: magnet detected (bit 5 of the status), 12 bits of which the upper four are noise
    assert say("as5600 20FFFF", "as5600 000123", "as5600 270800") == ["1 4095", "0 291", "1 2048"]
    # AS5047: even parity over all 16 bits, and the error bit
    assert say("as5047 8001", "as5047 0001", "as5047 3FFF", "as5047 C000", "as5047 BFFE") == [
        "1 1",
        "0 1",
        "1 16383",
        "0 0",
        "1 16382",
    ]


def _crc6(data: int) -> int:
    """x^6 + x + 1 over 18 bits, by long division."""
    value = data << 6
    for bit in range(23, 5, -1):
        if value >> bit & 1:
            value ^= 0b1000011 << (bit - 6)
    return value


def test_an_mt6701s_crc_finds_every_flipped_bit(say: Say) -> None:
    rng = random.Random(7)
    lines, expected = [], []
    for _ in range(20):
        angle = rng.getrandbits(14)
        frame = (angle << 4) << 6 | _crc6(angle << 4)
        lines.append(f"mt6701 {frame:x}")
        expected.append(f"1 {angle}")
        for bit in range(24):
            lines.append(f"mt6701 {frame ^ 1 << bit:x}")
            expected.append("0")
    weak = (100 << 4 | 2) << 6 | _crc6(100 << 4 | 2)
    lines.append(f"mt6701 {weak:x}")
    expected.append("0 100")
    for line, want in zip(say(*lines), expected, strict=True):
        assert line.startswith(want)


def test_a_thermistor_reads_as_its_formula_and_open_or_shorted_ones_not_at_all(say: Say) -> None:
    full = 16 * 4095
    celsius = [-20.0, 0.0, 20.0, 25.0, 37.5, 80.0]
    readings = []
    for t in celsius:
        ohm = 10000.0 * math.exp(3950.0 * (1 / (t + 273.15) - 1 / 298.15))
        readings.append(round(full * ohm / (ohm + 10000.0)))
    lines = say(*(f"ntc {reading} {full}" for reading in readings))
    for line, t in zip(lines, celsius, strict=True):
        good, centi = line.split()
        assert good == "1" and abs(int(centi) / 100 - t) < 0.02
    assert say(f"ntc 0 {full}", f"ntc {full} {full}", f"ntc {full - 9} {full}") == ["0 0"] * 3


@pytest.mark.parametrize("encoder", ["AS5600", "AS5047", "MT6701"])
def test_the_whole_sketch_compiles(encoder: str, tmp_path: Path) -> None:
    text = (SKETCH / "armd_arm.ino").read_text()
    chosen = "#define ENCODER ENCODER_AS5047"
    assert chosen in text
    source = tmp_path / "sketch.cpp"
    text = text.replace(chosen, f"#define ENCODER ENCODER_{encoder}")
    source.write_text("#include <Arduino.h>\n" + text)
    includes = [f"-I{HERE / 'stub'}", f"-I{SKETCH}"]
    command = ["g++", "-std=c++11", "-fsyntax-only", *STRICT, "-Wno-unused-function"]
    subprocess.run([*command, "-Wno-unused-const-variable", *includes, str(source)], check=True)
