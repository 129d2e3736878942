"""What a MicroScribe sends by itself: the codec against the manual and by property, the timer, and
the driver on a line that loses, inserts and stops."""

from __future__ import annotations

import os
import select
import time
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armd.drivers.config import MicroScribeConfig
from armd.drivers.microscribe import wire
from armd.drivers.microscribe.decoder import MicroScribeDecoder
from armd.drivers.microscribe.instants import ReadingInstants
from armd.drivers.microscribe.stream import PacketStream, Streamed
from armd.drivers.microscribe.timer import Timer
from armd.drivers.sample import Event, RawFrame
from armd.drivers.table import open_driver
from armd.simulator.microscribe import motion
from support.microscribe import EXPECTED, held_against_truth, read_until_end
from support.sampled import events_of, rows_of
from support.selection import parametrize_default
from support.simulated_arm import simulated_arm

# As a client of others sends it: 50 ticks, command 03, four buttons, any change of any angle.
BY_MOTION = bytes.fromhex("cf 0032 03 0f 0000000000000000 000100010001000100010001")
MS = 1_000_000


# --- the command --------------------------------------------------------------------------------


def test_the_command_is_the_manuals() -> None:
    """Byte 0 CF, 1-2 delay, 3 command, 4 buttons, 5-12 controllers, 13-24 angles 0 to 5."""
    request = wire.start_streaming(0x21, 2)
    assert request == bytes.fromhex("CF 0002 21 00 0000000000000000") + bytes(12)
    assert wire.parse_streamed_command(request) == (0x21, 2)
    assert len(request) == len(BY_MOTION) and wire.parse_streamed_command(BY_MOTION) == (0x03, 50)


@given(st.integers(1, 63), st.sampled_from(wire.POLLS))
def test_an_arm_that_does_not_know_it_takes_it_for_questions(delay: int, command: int) -> None:
    """Commands from 40 on change the arm; none of the bytes is one."""
    assert max(wire.start_streaming(command, delay)[1:]) < 0x40


@pytest.mark.parametrize(("command", "delay"), [(0x21, 0), (0x21, 64), (0x61, 2)])
def test_a_command_that_would_be_none_is_refused(command: int, delay: int) -> None:
    with pytest.raises(ValueError, match="1 to 63 ticks, below 0x40"):
        wire.start_streaming(command, delay)


@pytest.mark.parametrize("baud", wire.BAUDS)
def test_a_packet_passes_the_line_within_the_delay(baud: int) -> None:
    delay = wire.compute_delay_ticks(0x21, baud)
    on_the_line_ms = 14 * 10 / baud * 1000
    assert on_the_line_ms <= delay < 64 and (delay == 2 or delay - 1 <= on_the_line_ms)


def test_the_simulated_arm_responds_to_motion_as_it_is_told() -> None:
    """A client's own command: nothing at rest; a packet for one count, or for a pedal."""
    timer = motion.Timer(0.0, 0)
    heard = motion.MotionReport(BY_MOTION, timer, 115_200, 0.0)
    still = wire.StandardReply(0, 0, (5, 5, 5, 5, 5))
    sent = []
    for reading in (
        still,
        still,
        still._replace(counts=(5, 5, 6, 5, 5)),
        still._replace(buttons=1),
    ):
        before_s = heard.due_s
        heard.read(reading)
        sent.append(heard.packet != b"")
        if heard.packet:
            heard.drop_packet()
        assert heard.due_s - before_s == pytest.approx(50 / 900, abs=1e-6)
    assert sent == [True, False, True, True]  # the last one: pedal and count


# --- packets by property -------------------------------------------------------------------------


def _frame(data: bytes, at_ns: int = 0) -> RawFrame:
    return RawFrame(at_ns, at_ns, "rx", data)


def _packets(n: int, first: int, pace: int = 2) -> list[bytes]:
    """Each of another pose."""
    return [
        wire.encode_standard(
            0x21,
            wire.StandardReply(
                k % 3, (first + pace * k) % 0x4000, tuple(37 * k + j for j in range(5))
            ),
        )
        for k in range(n)
    ]


def _taken(line: bytes, cuts: list[int], delay: int = 2) -> list[Streamed]:
    stream = PacketStream(wire.start_streaming(0x21, delay))
    edges = [0, *sorted(cut % (len(line) + 1) for cut in cuts), len(line)]
    return [
        taken
        for at, (a, b) in enumerate(pairwise(edges))
        for taken in stream.push(_frame(line[a:b], at))
    ]


def _whose(taken: list[Streamed], packets: list[bytes]) -> list[int]:
    """Which packet each is, by its time and angles; buttons may be those of the packet before."""
    known = {packet[2:]: k for k, packet in enumerate(packets)}
    return [known[t.packet[2:]] for t in taken]


CUTS = st.lists(st.integers(0, 2000), max_size=40)
FIRST = st.integers(0, 0x3FFF)


@given(FIRST, CUTS)
def test_a_whole_line_gives_each_packet_once_however_it_is_cut(first: int, cuts: list[int]) -> None:
    packets = _packets(20, first)
    taken = _taken(b"".join(packets), cuts)
    assert [t.packet for t in taken] == packets[:-1]  # nothing tells of the last one yet
    assert [t.lost for t in taken] == [None] + [0] * 18


@pytest.mark.slow
@settings(max_examples=400)
@given(FIRST, CUTS, st.integers(0, 279), st.integers(1, 90))
def test_lost_bytes_cost_what_they_touched_and_make_nothing(
    first: int, cuts: list[int], at: int, amount: int
) -> None:
    packets = _packets(30, first)
    line = b"".join(packets)
    taken = _taken(line[:at] + line[at + amount :], cuts)
    which = _whose(taken, packets)  # each of them was sent, as it was
    assert [b - a for a, b in pairwise(which)] == [1 + (t.lost or 0) for t in taken[1:]]
    touched = range(at // 14 - 1, (at + amount - 1) // 14 + 1)
    assert set(which) >= set(range(29)) - set(touched)


@pytest.mark.slow
@settings(max_examples=400)
@given(FIRST, CUTS, st.integers(0, 279), st.lists(st.integers(0, 127), min_size=1, max_size=40))
def test_inserted_bytes_cost_what_they_touched_and_make_nothing(
    first: int, cuts: list[int], at: int, junk: list[int]
) -> None:
    packets = _packets(30, first)
    line = b"".join(packets)
    taken = _taken(line[:at] + bytes(junk) + line[at:], cuts)
    which = _whose(taken, packets)
    assert set(which) >= set(range(29)) - {at // 14 - 1, at // 14}
    assert all(
        b - a == 1 + (t.lost or 0) for a, b, t in zip(which, which[1:], taken[1:], strict=False)
    )


@pytest.mark.slow
@settings(max_examples=400)
@given(FIRST, CUTS, st.integers(0, 279), st.integers(128, 255))
def test_a_false_beginning_makes_no_packet(first: int, cuts: list[int], at: int, mark: int) -> None:
    packets = _packets(30, first)
    line = b"".join(packets)
    which = _whose(_taken(line[:at] + bytes([mark]) + line[at:], cuts), packets)
    assert set(which) >= set(range(29)) - {at // 14 - 1, at // 14}


@given(FIRST, st.integers(3, 12))
def test_an_arm_slower_than_it_was_told_is_believed_after_a_while(first: int, pace: int) -> None:
    packets = _packets(60, first, pace)
    which = _whose(_taken(b"".join(packets), []), packets)
    assert which[-30:] == list(range(29, 59))


def test_a_pace_between_two_ticks_loses_nothing() -> None:
    """Were the delay's tick 1 ms: 1.8 of the timer's."""
    packets = [
        wire.encode_standard(0x21, wire.StandardReply(0, int(1.8 * k), (k,) * 5)) for k in range(99)
    ]
    taken = _taken(b"".join(packets), [])
    assert len(taken) == 98 and not any(t.lost for t in taken)


def test_what_is_no_packet_is_counted() -> None:
    stream = PacketStream(wire.start_streaming(0x21, 2))
    packets = _packets(9, 100)
    packets[4] = packets[4][:9] + packets[4][10:]
    taken = stream.push(_frame(b"".join(packets)))
    assert _whose(taken, _packets(9, 100)) == [0, 1, 2, 3, 5, 6, 7]
    assert stream.malformed == 1 and [t.lost for t in taken[4:]] == [1, 0, 0]


# --- the timer -----------------------------------------------------------------------------------


@pytest.mark.parametrize("ppm", [-90.0, 35.0, 90.0])
def test_the_timer_is_mapped_to_the_tick(ppm: float) -> None:
    """Bounded every 5 s by four readings, each somewhere in its turn-round; a minute with 14 bits
    is three turns of the timer, and a silence is one more."""
    rng = np.random.default_rng(5)
    timer, hz = Timer(), 900 * (1 + ppm * 1e-6)

    def device(t_ns: float) -> int:
        return int(t_ns * 1e-9 * hz + 12_345) % wire.TICKS

    error_ms, t_ns = [], 10**12
    for round_ in range(12):
        for _ in range(4 if round_ else 12):
            t_ns += 2 * MS + int(rng.integers(MS))
            made_ns = t_ns + int(rng.integers(900_000))
            heard_ns = t_ns + 900_000 + int(rng.exponential(200_000))
            timer.add_exchange(t_ns, heard_ns, timer.ticks(device(made_ns), heard_ns))
        assert timer.mapped
        for _ in range(500):
            t_ns += 10 * MS
            if round_ == 6 and len(error_ms) == 3200:
                t_ns += 17_000 * MS
            heard_ns = t_ns + 700_000 + int(rng.exponential(3e6))
            found_ns = timer.instant_ns(timer.ticks(device(t_ns), heard_ns), heard_ns)
            assert found_ns is not None
            error_ms.append((found_ns - t_ns) / MS)
    assert np.abs(error_ms).max() < 1.3 and np.median(np.abs(error_ms)) < 0.5


def test_a_reading_of_a_tick_to_come_has_no_instant() -> None:
    timer = Timer()
    for k in range(12):
        at_ns = 10**12 + k * 2_300_000
        reading = int(at_ns * 9e-7) % wire.TICKS
        timer.add_exchange(at_ns - MS // 2, at_ns + MS // 2, timer.ticks(reading, at_ns))
    later = timer.ticks((reading + 40) % wire.TICKS, at_ns)
    assert timer.instant_ns(later, at_ns) is None


def test_a_line_without_pace_streams_at_any_rate() -> None:
    """A pseudo-terminal that is told 19 200 baud: 14 bytes would take 7 ms, and take none."""
    instants, t_ns = ReadingInstants(), 10**12
    instants.baud = 19_200

    def heard(data: bytes) -> RawFrame:
        return RawFrame(t_ns, t_ns, "rx", data)

    def tick(at_ns: int) -> int:
        return int(at_ns * 9e-7) % wire.TICKS

    for _ in range(12):
        request = RawFrame(t_ns, t_ns, "tx", b"\x21")
        made_ns = t_ns = t_ns + 900_000  # "just under a millisecond"; then it is here at once
        at_ns, _ = instants.estimate_instant(request, heard(bytes(14)), 14, tick(made_ns), True)
        instants.note_sample(at_ns)
        t_ns += 5 * MS
    error_ms = []
    for _ in range(200):
        t_ns += 8_888_888
        packet = Streamed(bytes(14), heard(bytes(14)), tick(t_ns), 0)
        found = instants.streamed(packet, 8.0)
        assert found is not None and found[1]
        instants.note_sample(found[0])
        error_ms.append((found[0] - t_ns) / MS)
    assert np.abs(error_ms).max() < 1.3


@pytest.mark.parametrize(("took_ms", "holds"), [(2, True), (11, True), (13, False), (40, False)])
def test_a_reading_that_may_be_more_than_5_ms_off_says_so(took_ms: int, holds: bool) -> None:
    """Asked for at 115 200 baud: 15 bytes take 1.3 ms; when within the rest it was made, nobody
    knows. A stamp without flag 8 is right within 5 ms."""
    request = RawFrame(10**12, 10**12, "tx", b"\x21")
    reply = RawFrame(10**12 + took_ms * MS, 10**12 + took_ms * MS, "rx", bytes(14))
    at_ns, certain = ReadingInstants().estimate_instant(request, reply, 14, 7, False)
    assert certain == holds
    rest_ms = took_ms - 15 * 10 / 115.2
    assert (rest_ms / 2 <= 5.0) == holds and abs(at_ns - 10**12) < took_ms * MS


def test_a_timer_of_another_rate_is_hopeless() -> None:
    timer = Timer()
    for k in range(300):
        at_ns = 10**12 + k * 20 * MS
        timer.add_exchange(
            at_ns - MS // 2, at_ns + MS // 2, timer.ticks(20 * k % wire.TICKS, at_ns)
        )
    assert timer.hopeless and not timer.mapped


# --- the driver ----------------------------------------------------------------------------------

FAULTS = """fault = [
  { name = "lost_byte", at_s = 7 }, { name = "lost_byte", at_s = 7.3, amount = 14 },
  { name = "lost_byte", at_s = 7.6, amount = 140 }, { name = "inserted_byte", at_s = 7.9 },
  { name = "inserted_byte", at_s = 8.2, amount = 30 },
  { name = "lost_byte", at_s = 8.5, duration_s = 0.3 },
  { name = "inserted_byte", at_s = 9.1, duration_s = 0.3 },
  { name = "stuck", at_s = 11, duration_s = 0.3 },
  { name = "unplug", at_s = 13, duration_s = 0.3 },
]
"""


@pytest.fixture(scope="module", autouse=True)
def _compiled() -> None:
    """Before an arm's seconds begin to run."""
    MicroScribeDecoder(EXPECTED).warm_up()


@pytest.fixture(scope="module")
def spoilt(tmp_path_factory: pytest.TempPathFactory):
    folder = tmp_path_factory.mktemp("spoilt")
    (folder / "scenario.toml").write_text(FAULTS)
    options = ("--scenario", str(folder / "scenario.toml"))
    with simulated_arm(folder, *options, wire=("--microscribe",), seconds=17.5, link=True) as arm:
        items, raw, counters = read_until_end(arm)
    return arm, items, raw, counters


@pytest.mark.slow
def test_no_spoilt_packet_gives_a_point(spoilt) -> None:
    arm, items, _, counters = spoilt
    rows = rows_of(items)
    rows = rows[rows["monotonic_ns"] < arm.events("begin")[-1]["monotonic_ns"]]  # the plug
    good = rows[rows["joint_invalid"] == 0]
    assert counters["streamed"] > 1500 and counters["malformed"] > 100
    true_mm, error_mm, _ = held_against_truth(arm, good)
    assert np.ptp(true_mm, axis=0).max() > 50
    assert error_mm.max() < 0.5  # its resolution; no damaged one among them


@pytest.mark.slow
def test_every_gap_is_marked(spoilt) -> None:
    arm, items, _, counters = spoilt
    rows = rows_of(items)
    apart = np.diff(rows["seq"].astype(np.int64))
    assert (apart > 0).all() and np.array_equal(rows["lost_before"][1:], apart != 1)
    begun_ns = {line["fault"]: line["monotonic_ns"] for line in arm.events("begin")}
    for fault in ("stuck", "unplug"):  # each is longer than this
        after = rows["monotonic_ns"] > begun_ns[fault] + 100 * MS
        assert rows["lost_before"][after.argmax()], fault
    assert (np.diff(rows["monotonic_ns"]) > 0).all()
    assert counters["samples"] == len(rows)


@pytest.mark.slow
def test_it_streams_again_after_it_was_stuck_and_is_to_be_homed_after_the_plug(spoilt) -> None:
    arm, items, raw, _ = spoilt
    begins = {line["fault"]: line["monotonic_ns"] for line in arm.events("begin")}
    ends = {line["fault"]: line["monotonic_ns"] for line in arm.events("end")}
    starts = [f.monotonic_ns for f in raw if f.direction == "tx" and f.data[0] == 0xCF]
    assert any(begins["stuck"] < at < ends["stuck"] + 1000 * MS for at in starts)
    rows = rows_of(items)
    between = rows[
        (rows["monotonic_ns"] > ends["stuck"] + 500 * MS)
        & (rows["monotonic_ns"] < begins["unplug"])
    ]
    assert len(between) > 200 and (between["joint_invalid"] == 0).mean() > 0.99
    homed = [i.monotonic_ns for i in items if isinstance(i, Event) and i.kind == "homed"]
    until = homed[1] if len(homed) > 1 else rows["monotonic_ns"][-1]  # should a pedal be pressed
    after = rows[(rows["monotonic_ns"] > ends["unplug"]) & (rows["monotonic_ns"] < until)]
    assert len(after) > 50 and (after["joint_invalid"] == 0b11111).all()
    events = events_of(items)
    assert 1 <= events.count("streaming") <= len(homed) and events.count("not_homed") == 2
    assert "unplugged" in events and "recovered" in events and "not_streaming" not in events


@pytest.mark.slow
def test_before_any_other_command_streaming_is_ended(spoilt) -> None:
    """From each CF that was acknowledged on, what goes out next is 00."""
    _, _, raw, _ = spoilt
    sent = [f.data for f in raw if f.direction == "tx"]
    after = {sent[k + 1] for k, data in enumerate(sent[:-1]) if data[0] == 0xCF}
    assert after <= {wire.STOP, bytes([wire.END])} and wire.STOP in after


@pytest.mark.slow
def test_a_closed_driver_leaves_a_silent_arm(tmp_path: Path) -> None:
    with simulated_arm(tmp_path, wire=("--microscribe",), seconds=20.0) as arm:
        config = MicroScribeConfig(kind="microscribe", port=arm.port)
        deadline = time.monotonic() + 60
        with closing(open_driver(config, EXPECTED)) as driver:
            while driver.counters["streamed"] < 100 and time.monotonic() < deadline:
                driver.read(0.05)
            assert driver.counters["streamed"] >= 100
        port = os.open(arm.port, os.O_RDWR | os.O_NOCTTY)
        time.sleep(0.1)  # what was under way
        while select.select([port], [], [], 0)[0]:
            os.read(port, 4096)
        assert not select.select([port], [], [], 0.5)[0]
        os.close(port)


@pytest.mark.slow
def test_an_arm_that_ceases_to_stream_is_asked_and_that_is_told(tmp_path: Path) -> None:
    options = ("--fault", "stuck@6:3")
    with simulated_arm(tmp_path, *options, wire=("--microscribe",), seconds=10.0) as arm:
        items, _, counters = read_until_end(arm)
    told = [kind for kind in events_of(items) if kind in ("streaming", "not_streaming")]
    assert told == ["streaming", "not_streaming"] and counters["streamed"] > 100
    (end,) = arm.events("end")
    later = rows_of(items)["monotonic_ns"] > end["monotonic_ns"] - 1000 * MS
    assert later.sum() > 20


@pytest.mark.slow
@pytest.mark.serial  # an answer that a starved machine reads late is taken for a timer's
@parametrize_default("baud", ["115200", "19200"])
def test_an_arm_that_cannot_stream_is_asked_and_that_is_told(tmp_path: Path, baud: str) -> None:
    options = ("--fault", "no_streaming@0", "--baud", baud)
    with simulated_arm(tmp_path, *options, wire=("--microscribe",), seconds=6.0) as arm:
        items, raw, counters = read_until_end(arm, baud=int(baud))
    rows = rows_of(items)
    assert counters["streamed"] == 0 and (rows["joint_invalid"] == 0).sum() > 100
    (told,) = [i for i in items if isinstance(i, Event) and i.kind == "not_streaming"]
    assert "asked for each reading, as it does not follow the command to stream (CF)" in told.text
    assert sum(f.direction == "tx" and f.data[0] == 0xCF for f in raw) == 3
    assert held_against_truth(arm, rows[rows["joint_invalid"] == 0])[1].max() < 0.5


@pytest.mark.slow
def test_at_a_slow_line_it_streams_as_fast_as_the_line_goes(tmp_path: Path) -> None:
    options = ("--baud", "19200")
    with simulated_arm(tmp_path, *options, wire=("--microscribe",), seconds=6.0) as arm:
        items, _, counters = read_until_end(arm, baud=19_200)
    assert counters["streamed"] > 100 and "streaming" in events_of(items)
