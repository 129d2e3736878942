"""The decoder, fed frames by hand: no port, no time of its own."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from armd.drivers.identity import Expectation
from armd.drivers.sample import RawFrame, Temperatures
from armd.drivers.serial import wire
from armd.drivers.serial.clock import EAGER_INTERVAL_NS
from armd.drivers.serial.decoder import SerialDecoder
from armd.drivers.serial.reading_buffer import HELD_SAMPLES
from support.sampled import Heard

MS = 1_000_000
EXPECTED = Expectation("SIM-0001", 3, 2, (1 << 20,) * 3)
HELLO = wire.Hello(1, 3, 2, 1000, 77, "SIM-0001", (20, 20, 20))


def hello(**changed):
    fields = {name: getattr(HELLO, name) for name in HELLO.__slots__}
    return wire.encode_hello(wire.Hello(**{**fields, **changed}))


def sample(seq, counts=(1, 2, 3), status=0, t_us=None):
    return wire.encode_sample(seq, 1000 * seq if t_us is None else t_us, counts, status)


class Line(Heard):
    """Feeds a decoder; sorts what comes out."""

    def __init__(self):
        self.decoder = SerialDecoder(EXPECTED)
        self.items = []
        self.now_ns = 10**12
        self.latched_ns = []  # by `stream`

    def rx(self, *packets, after_ns=MS):
        self.now_ns += after_ns
        self.items += self.decoder.feed(self.frame("rx", b"".join(packets)))
        return self

    def tx(self, packet):
        self.items += self.decoder.feed(self.frame("tx", packet))
        return self

    def link(self, state):
        self.items += self.decoder.feed(self.frame("link", state))
        return self

    def frame(self, direction, data):
        return RawFrame(self.now_ns, self.now_ns + 10**18, direction, data)

    def pong(self, t_us):
        """To a PING of its own, at once."""
        self.tx(wire.encode_ping(t_us)).rx(wire.encode_pong(t_us, t_us))
        return self


@pytest.fixture
def line():
    return Line()


def test_samples_wait_for_hello_and_then_come_in_order(line):
    line.rx(sample(1)).rx(sample(2), wire.encode_temperature(0, [20.0, 21.0]), sample(3))
    assert line.items == []
    line.rx(hello(), sample(4))
    assert line.seqs == [1, 2, 3, 4]
    kinds = [type(item) for item in line.items]
    assert kinds.index(Temperatures) == 3  # identified, [1], [2], temperatures, [3], [4]


def test_what_is_held_is_bounded(line):
    for seq in range(HELD_SAMPLES + 500):
        line.rx(sample(seq))
    line.rx(hello())
    assert len(line.seqs) == HELD_SAMPLES and line.seqs[0] == 500
    assert line.decoder.counters["unidentified"] == 500


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"serial_number": "OTHER"}, "serial number: found OTHER, expected SIM-0001"),
        ({"bits": (20, 21, 20)}, "joint 2 counts per turn: found 2097152, expected 1048576"),
        ({"n_joints": 4, "bits": (20,) * 4}, "joints: found 4, expected 3"),
        ({"protocol": 2}, "protocol: found 2, expected 1"),
        ({"bits": (20, 20, 40)}, "joint 3 counts per turn"),
    ],
)
def test_a_foreign_arm_delivers_nothing_and_is_explained(line, changed, words):
    line.rx(sample(1), hello(**changed), sample(2), wire.encode_temperature(0, [20.0, 21.0]))
    assert line.events == ["foreign_arm"] and len(line.items) == 1
    assert words in line.items[0].text
    assert line.decoder.counters["foreign"] == 3
    line.rx(hello(), sample(3))  # the right one after all
    assert line.seqs == [3]


def test_after_a_reconnection_the_arm_is_asked_again(line):
    line.rx(hello(), sample(1))
    line.link(b"down").link(b"up").rx(sample(2))
    assert line.seqs == [1] and line.decoder.wants_identity
    line.rx(hello(), sample(3))
    assert line.seqs == [1, 2, 3]
    assert not line.samples["lost_before"].any()


def test_another_boot_id_begins_an_epoch(line):
    line.rx(hello(), sample(8), sample(9)).rx(hello(boot_id=78), sample(0), sample(1))
    assert line.seqs == [8, 9, 1 << 32, (1 << 32) + 1]
    assert line.samples["lost_before"].tolist() == [False, False, True, False]
    assert line.events == ["identified", "reboot", "identified"]


def test_a_reboot_without_hello_is_seen_by_the_clock_and_counted_once(line):
    line.rx(hello(), sample(5000), sample(5001))
    line.rx(sample(0), after_ns=300 * MS).rx(sample(1)).rx(sample(2))
    assert line.decoder.wants_identity
    line.rx(hello(boot_id=78), sample(3))
    assert line.seqs[2:] == [(1 << 32) + i for i in range(4)]
    assert line.events.count("reboot") == 1


def test_damage_is_counted_by_kind_and_never_delivered(line):
    good = sample(2)
    wrong_crc = wire.pack(b"x" * 20)[:-2] + b"\x7f\0"
    line.rx(hello(), sample(1))
    line.rx(wrong_crc, b"\x09\x01\0", wire.pack(bytes([1, 0, 0, 3, 0])), wire.pack(b"\x55data"))
    line.rx(b"y" * 5000 + b"\0", good, good, sample(4))
    assert line.seqs == [1, 2, 4]
    assert line.samples["lost_before"].tolist() == [False, False, True]
    counted = {k: n for k, n in line.decoder.counters.items() if n}
    assert counted == {
        "samples": 3, "bad_crc": 1, "bad_cobs": 1, "malformed": 1, "unknown": 1,
        "junk": 1, "repeated": 1, "lost": 1,
    }  # fmt: skip


def test_the_tail_of_a_packet_at_connection_is_nobodys_fault(line):
    line.rx(sample(1)[7:], hello(), sample(2))
    assert line.seqs == [2]
    assert line.decoder.counters["bad_crc"] + line.decoder.counters["bad_cobs"] == 0


def test_another_number_of_joints_in_a_sample_is_malformed(line):
    line.rx(hello(), wire.encode_sample(1, 1000, [1, 2, 3, 4]), sample(2))
    assert line.seqs == [2] and line.decoder.counters["malformed"] == 1


def test_status_bits_and_jumps_make_their_joint_invalid(line):
    line.rx(hello(), sample(1), sample(2, status=0b100), sample(3, (1, 500_000, 3)), sample(4))
    assert line.samples["joint_invalid"].tolist() == [0, 0b100, 0b010, 0]
    assert line.events == ["identified", "joint_invalid", "count_jump"]
    for seq in range(5, 600):
        line.rx(sample(seq))
    assert line.events.count("joint_valid") == 2


def test_a_channel_without_its_bit_is_nan_and_a_missing_one_too(line):
    line.rx(hello(n_sensors=1), wire.encode_temperature(1000, [np.nan]))
    (reading,) = [item for item in line.items if isinstance(item, Temperatures)]
    assert np.isnan(reading.celsius).all() and len(reading.celsius) == 2
    assert "sensor_count" in line.events


def test_before_the_clock_is_mapped_stamps_come_from_arrival(line):
    line.rx(hello(), sample(1), sample(2), sample(3))
    ages = line.now_ns - line.samples["monotonic_ns"]
    assert ages.tolist() == [2 * MS, 1 * MS, 0]
    assert not line.samples["clock_mapped"].any()
    assert (line.samples["stamp_ns"] - line.samples["monotonic_ns"] == 10**18).all()


def map_clock(line, boot_ns, n=10):
    for nonce in range(n):
        line.tx(wire.encode_ping(nonce))
        stamped_us = (line.now_ns + 50_000 - boot_ns) // 1000
        line.rx(wire.encode_pong(nonce, stamped_us), after_ns=100_000)
        line.now_ns += 49_900_000


def test_once_mapped_stamps_come_from_the_device(line):
    boot_ns = line.now_ns - 10_000_000_000
    line.rx(hello(), sample(1, t_us=1000))
    map_clock(line, boot_ns)
    t_us = (line.now_ns - boot_ns) // 1000
    line.rx(sample(2, t_us=t_us), after_ns=40 * MS)  # it came 40 ms late
    last = line.samples[-1]
    assert last["clock_mapped"]
    assert abs(int(last["monotonic_ns"]) - (boot_ns + t_us * 1000)) < 10_000


def stream(line, boot_ns, seconds, pong_ahead_us=0, jump_us=0):
    """1 kHz with an exchange every 50 ms, PONGs *pong_ahead_us* before the samples' clock."""
    for i in range(round(seconds * 1000)):
        line.now_ns += MS
        t_us = (line.now_ns - boot_ns) // 1000 - 100 + jump_us
        line.latched_ns.append(line.now_ns - 100_000)
        seq = len(line.latched_ns)
        line.rx(sample(seq, t_us=t_us), after_ns=0)
        if i % 50 == 0:
            line.tx(wire.encode_ping(seq))
            line.now_ns += MS // 2
            line.rx(wire.encode_pong(seq, t_us + 300 + pong_ahead_us), after_ns=0)
    return line.samples[-1]


@pytest.mark.parametrize("pong_ahead_s", [-3600, -0.02, 0.02, 2, 3600])
def test_answers_of_another_clock_than_the_samples_map_nothing(line, pong_ahead_s):
    line.rx(hello())
    last = stream(line, line.now_ns - 5000 * 10**9, 2.0, round(pong_ahead_s * 1e6))
    assert not last["clock_mapped"]
    assert abs(line.now_ns - int(last["monotonic_ns"])) < 5 * MS
    assert line.decoder.counters["clock_contradictions"]


def test_a_clock_that_jumps_ahead_is_flagged_at_once_and_mapped_anew(line):
    line.rx(hello())
    boot_ns = line.now_ns - 10**9
    assert stream(line, boot_ns, 1.0)["clock_mapped"]
    known = len(line.samples)
    assert stream(line, boot_ns, 1.0, jump_us=3600 * 10**6)["clock_mapped"]
    assert not line.samples[known]["clock_mapped"]
    # None is off by more than was promised without saying so.
    off_ns = np.abs(line.samples["monotonic_ns"] - np.array(line.latched_ns))
    assert off_ns[line.samples["clock_mapped"]].max() < 5 * MS


@pytest.mark.parametrize("t_us", [0, 2**40, 2**53 - 1])
def test_a_temperature_is_never_stamped_in_the_future(line, t_us):
    line.rx(hello())
    stream(line, line.now_ns - 10**9, 1.0)
    assert line.decoder.clock.mapped
    line.rx(wire.encode_temperature(t_us, [20.0, 21.0]))
    (reading,) = [item for item in line.items if isinstance(item, Temperatures)]
    assert reading.monotonic_ns <= line.now_ns


def test_a_reboot_forgets_the_clock(line):
    line.rx(hello(), sample(1))
    map_clock(line, line.now_ns)
    line.rx(hello(boot_id=78), sample(0))
    assert not line.samples[-1]["clock_mapped"]


def test_a_stepped_wall_clock_moves_only_unix_time(line):
    line.rx(hello(), sample(1))
    before = line.samples[-1]
    line.now_ns += MS
    frame = RawFrame(line.now_ns, line.now_ns + 10**18 + 3600 * 10**9, "rx", sample(2))
    line.items += line.decoder.feed(frame)
    after = line.samples[-1]
    assert after["monotonic_ns"] - before["monotonic_ns"] == MS
    assert after["stamp_ns"] - before["stamp_ns"] == MS + 3600 * 10**9


@settings(deadline=None, max_examples=50)
@given(st.lists(st.integers(1, 400), min_size=1, max_size=40), st.integers(0, 2**32))
def test_points_do_not_depend_on_how_the_bytes_were_cut(cuts, seed):
    rng = np.random.default_rng(seed)
    packets = [hello()]
    counts = np.zeros(3, np.int64)
    for seq in range(60):
        counts += rng.integers(-3000, 3000, 3)
        if rng.random() < 0.9:
            packets.append(sample(seq, counts, status=int(rng.random() < 0.05)))
        if rng.random() < 0.1:
            packets.append(wire.encode_temperature(seq * 1000, rng.uniform(18, 30, 2)))
        if rng.random() < 0.05:
            packets.append(rng.bytes(30) + b"\0")
    stream = b"".join(packets)
    whole, pieces = Line().rx(stream), Line()
    place = 0
    for cut in cuts:
        pieces.rx(stream[place : place + cut], after_ns=0)
        place += cut
    pieces.rx(stream[place:], after_ns=0)
    names = ["seq", "device_ns", "count", "joint_invalid", "lost_before"]
    assert len(whole.samples) and np.array_equal(whole.samples[names], pieces.samples[names])
    assert whole.decoder.counters == pieces.decoder.counters


def test_a_block_of_32_old_packets_played_again_is_no_reboot(line):
    line.rx(hello())
    for seq in range(200):
        line.rx(sample(seq))
    line.rx(*[sample(seq) for seq in range(20, 60)])
    line.pong(200_000)
    for seq in range(200, 210):
        line.rx(sample(seq))
    assert line.seqs == list(range(210)) and "reboot" not in line.events
    assert line.decoder.counters["repeated"] == 40


def test_a_reboot_whose_samples_come_before_its_hello_loses_none(line):
    line.rx(hello())
    for seq in range(300):
        line.rx(sample(seq))
    line.rx(sample(0), after_ns=200 * MS)
    for seq in range(1, 80):
        line.rx(sample(seq))
    assert line.decoder.ping_interval_ns == EAGER_INTERVAL_NS and len(line.seqs) == 300
    line.rx(hello(boot_id=78)).rx(sample(80))
    assert line.seqs[300:] == [1 << 32 | seq for seq in range(81)]
    assert line.events.count("reboot") == 1


def test_a_reboot_with_the_same_boot_id_and_everything_at_zero_again_loses_none(line):
    line.rx(hello())
    for seq in range(3000):
        line.rx(sample(seq))
    line.rx(hello(), sample(0), after_ns=200 * MS)
    for seq in range(1, 30):
        line.rx(sample(seq))
    line.rx(hello())  # asked or not: it says nothing new
    line.pong(30_000)
    for seq in range(30, 60):
        line.rx(sample(seq))
    assert line.seqs[3000:] == [1 << 32 | seq for seq in range(60)]
    assert line.events.count("reboot") == 1 and line.decoder.counters["repeated"] == 0
    assert line.samples["lost_before"].sum() == 1
