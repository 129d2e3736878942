"""Drivers of other packages: packets become samples once and in order, and whatever such a driver
raises becomes an event."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterator

import numpy as np
import pytest

from armd.drivers.identity import Expectation
from armd.drivers.packets import LATE_NUMBERS, PacketDecoder, PacketDriver, SamplePacket
from armd.drivers.plugin import DriverPlugin, GuardedDriver
from armd.drivers.sample import Event, Item, RawFrame, Temperatures, sample_dtype
from armd.errors import ArmdError
from support.sampled import rows_of

TURN = 1 << 12
ARM = Expectation("A-1", 3, 2, (TURN,) * 3)


class Decoder(PacketDecoder):
    """u32 number, u16 × 3 counts, u8 invalid; then perhaps i16 × 2 in 0.01 °C."""

    def read_packet(self, data: bytes) -> SamplePacket:
        number, *counts, invalid = struct.unpack("<I3HB", data[:11])
        celsius = [c / 100 for c in struct.unpack(f"<{(len(data) - 11) // 2}h", data[11:])]
        return SamplePacket(number, counts, joint_invalid=invalid, celsius=celsius)


def packet(number: int, counts: tuple[int, int, int] = (1, 2, 3), invalid: int = 0) -> bytes:
    return struct.pack("<I3HB", number, *counts, invalid)


def fed(*packets: bytes, decoder: PacketDecoder | None = None, from_ms: int = 0) -> list[Item]:
    """A millisecond apart."""
    decoder = decoder or Decoder(ARM)
    frames = [
        RawFrame((from_ms + i) * 1_000_000, (from_ms + i) * 1_000_000 + 7, "rx", data)
        for i, data in enumerate(packets, 1)
    ]
    return [item for frame in frames for item in decoder.feed(frame)]


def test_packets_become_samples_with_their_arrival() -> None:
    got = rows_of(fed(packet(5), packet(6, (4000, 2, 3))))
    assert got["seq"].tolist() == [5, 6]
    assert got["count"].tolist() == [[1, 2, 3], [-96, 2, 3]]  # 4000 is 96 before the turn's end
    assert got["monotonic_ns"].tolist() == [1_000_000, 2_000_000]
    assert got["stamp_ns"].tolist() == [1_000_007, 2_000_007]
    assert not got["clock_mapped"].any() and not got["lost_before"].any()


def test_each_number_is_a_sample_once_whatever_comes_twice_late_or_torn() -> None:
    decoder = Decoder(ARM)
    numbers = [1, 2, 2, 3, 1, 6, 5, 7]  # 2 twice, 1 again and 5 late: after 6 it is lost
    items = fed(*map(packet, numbers), packet(8)[:-1], b"", decoder=decoder)
    got = rows_of(items)
    assert got["seq"].tolist() == [1, 2, 3, 6, 7]
    assert got["lost_before"].tolist() == [False, False, False, True, False]
    assert decoder.counters == {"samples": 5, "lost": 2, "malformed": 2, "repeated": 3}


def test_the_number_wraps_and_an_arm_that_restarts_begins_another_epoch() -> None:
    last = (1 << 32) - 1
    got = rows_of(fed(packet(last - 1), packet(last), packet(0), packet(1)))
    assert got["seq"].tolist() == [last - 1, last, 1 << 32, (1 << 32) + 1]
    assert not got["lost_before"].any()
    decoder = Decoder(ARM)
    after = LATE_NUMBERS + 100
    packets = packet(after, (4000, 0, 0)), packet(0, (10, 0, 0)), packet(1)
    got = rows_of(fed(*packets, decoder=decoder))
    assert got["seq"].tolist() == [after, 1 << 32, (1 << 32) + 1]
    assert got["lost_before"].tolist() == [False, True, False]
    assert got["count"][:2, 0].tolist() == [-96, 10]  # the turns are unknown again
    assert decoder.counters["lost"] == 0


def test_joints_that_jump_or_are_invalid_are_marked_and_told_once() -> None:
    jump = (1 + TURN // 2 - 50, 2, 3)  # half a turn in a millisecond
    items = fed(packet(1), packet(2, jump), packet(3), packet(4, invalid=0b100), packet(5))
    assert rows_of(items)["joint_invalid"].tolist() == [0, 0b001, 0, 0b100, 0]
    told = [(item.kind, item.detail["joint"]) for item in items if isinstance(item, Event)]
    assert told == [("count_jump", 1), ("joint_invalid", 3)]


def test_temperatures_come_with_a_packet_or_not() -> None:
    items = fed(packet(1) + struct.pack("<2h", 2050, -100), packet(2), packet(3) + b"\0\0")
    (celsius,) = (item for item in items if isinstance(item, Temperatures))
    assert celsius.celsius.tolist() == [20.5, -1.0]
    assert rows_of(items)["seq"].tolist() == [1, 2]  # one temperature of two is malformed


class Line(PacketDriver):
    """Packets from a list; then nothing."""

    def __init__(self, packets: list[bytes]) -> None:
        super().__init__(Decoder(ARM), "a line")
        self._packets = packets
        self.opened = 0

    def open(self) -> None:
        self.opened += 1

    def receive(self, timeout_s: float) -> bytes:
        if not self._packets:
            time.sleep(timeout_s)
            raise TimeoutError
        return self._packets.pop(0)

    def close(self) -> None:
        pass


def test_a_read_takes_all_that_waits_and_tells_of_silence() -> None:
    line = Line([packet(1), packet(2)])
    assert rows_of(line.read(1.0))["seq"].tolist() == [1, 2] and line.connected
    time.sleep(0.55)
    assert [item.kind for item in line.read(0.0) if isinstance(item, Event)] == ["silence"]
    assert line.read(0.0) == [] and not line.connected
    line._packets.append(packet(3))
    recovered, sample = line.read(1.0)
    assert isinstance(recovered, Event) and recovered.kind == "recovered"
    assert isinstance(sample, np.ndarray) and [f.data for f in line.take_raw()][-1] == packet(3)


class Plugin(DriverPlugin):
    def make_driver(self, expectation: Expectation) -> Line:
        return Line([])


class Script(Line):
    """Each `read` does the next step."""

    steps: Iterator[Callable[[], list[Item]]]

    def read(self, timeout_s: float) -> list[Item]:
        return next(self.steps)()


def guarded(*steps: Callable[[], list[Item]]) -> tuple[GuardedDriver, Script]:
    script = Script([])
    script.steps = iter(steps)
    driver = GuardedDriver(Plugin(kind="mine"), ARM)
    driver._driver = script
    driver.open()
    return driver, script


def fail() -> list[Item]:
    raise KeyError("q7")


def one() -> list[Item]:
    return [np.zeros(1, sample_dtype(3))]


def read_until_it_tries(driver: GuardedDriver) -> list[Item]:
    """It backs off for 20 ms at first, then longer."""
    end_s = time.monotonic() + 60
    while time.monotonic() < end_s:
        if items := driver.read(1.0):
            return items
    raise AssertionError("it tried no more")


def test_a_driver_that_raises_is_opened_again_and_told_of_once(
    caplog: pytest.LogCaptureFixture,
) -> None:
    driver, script = guarded(one, fail, fail, fail, one, one)
    assert len(driver.read(1.0)) == 1
    (failed,) = driver.read(1.0)
    assert isinstance(failed, Event) and (failed.kind, failed.severity) == (
        "driver_failed", "error",
    )  # fmt: skip
    assert failed.text == "the driver mine failed and is opened again: KeyError: 'q7'"
    assert not driver.connected and driver.stale
    recovered, sample = read_until_it_tries(driver)  # the two further failures tell nothing
    assert isinstance(recovered, Event) and recovered.kind == "recovered"
    assert isinstance(sample, np.ndarray) and len(driver.read(1.0)) == 1
    assert script.opened == 4 and driver.counters["reconnects"] == 3
    assert [record.message for record in caplog.records] == ["driver mine: KeyError: 'q7'"]


@pytest.mark.parametrize(
    "junk",
    [
        np.zeros(1, sample_dtype(4)), np.zeros(1), np.zeros((1, 1), sample_dtype(3)), "a", None,
        Temperatures(np.zeros(3), 0, 0, 0),
    ],
)  # fmt: skip
def test_what_the_daemon_could_not_use_is_a_failure(junk: Item) -> None:
    driver, _ = guarded(lambda: [junk], one)
    (failed,) = driver.read(1.0)
    assert isinstance(failed, Event) and "TypeError: read gave " in failed.text
    assert "2 Temperatures or an array of sample_dtype" in failed.text


def test_hardware_that_is_missing_is_waited_for() -> None:
    driver, script = guarded(one)
    results = iter([OSError("no such device"), OSError("no such device"), None])

    def open_line() -> None:
        if error := next(results):
            raise error

    script.open = open_line  # type: ignore[method-assign]
    (failed,) = driver.read(1.0)
    assert isinstance(failed, Event) and failed.text.endswith("OSError: no such device")
    assert [type(item) for item in read_until_it_tries(driver)] == [Event, np.ndarray]
    driver.close()
    driver.close()


def test_questions_that_raise_have_an_answer() -> None:
    class Silly:
        def __getattr__(self, name: str) -> object:
            raise RuntimeError(name)

    driver, _ = guarded()
    driver._driver = Silly()  # type: ignore[assignment]
    driver._is_open = True
    assert not driver.connected and driver.stale and driver.hindrance == ""
    assert driver.counters == {"reconnects": 0}
    assert driver.take_raw() == [] and driver.preamble() == []


def test_a_driver_that_cannot_be_made_is_an_error_with_its_reason() -> None:
    class Unable(DriverPlugin):
        pass

    with pytest.raises(ArmdError, match="driver mine: NotImplementedError"):
        GuardedDriver(Unable(kind="mine"), ARM)
