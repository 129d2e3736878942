"""The CAN decoder, fed frames by hand: cycles never mix, and a joint that fails says why."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from armd.drivers.can import objects as can
from armd.drivers.can.cycle import LATE_MOST_NS, CycleAssembler, EncoderReading
from armd.drivers.can.decoder import CanDecoder, encode_note
from armd.drivers.can.objects import CanFrame
from armd.drivers.identity import Expectation
from armd.drivers.sample import Event, RawFrame, Temperatures
from support.sampled import Heard

N = 3
TURN = 1 << 20
MS = 1_000_000
EXPECTED = Expectation("SIM-0001", N, 2, (TURN,) * N)


class Bus(Heard):
    """Three encoders and a module on 500 Hz; `cycle` is one SYNC with all that follows it."""

    def __init__(self, echo=True):
        self.decoder = CanDecoder(EXPECTED, 500.0)
        self.items, self.frames = [], []
        self.now_ns = 10**12
        self.echo = echo
        self.tell(note="up")

    def tell(self, **fields):
        self._feed("link", encode_note(**fields))

    def configure(self, node):
        self.tell(
            note="configured", node=node, counts_per_turn=TURN, range_counts=TURN, serial_number=1
        )

    def rx(self, identifier, data=b""):
        self._feed("rx", CanFrame(identifier, data).to_bytes())

    def sync(self):
        self.now_ns += 2 * MS
        self._feed("tx", CanFrame(can.SYNC_ID, b"").to_bytes())
        if self.echo:
            self.rx(can.SYNC_ID)

    def pdo(self, joint, position=0, alarms=0):
        self.rx(can.TPDO_BASE[0] + joint, can.ENCODER_PDO.pack(position, alarms))

    def beat(self, node, state=can.OPERATIONAL):
        self.rx(can.HEARTBEAT_BASE + node, bytes([state]))

    def cycle(self, n=1, without=(), silent=(), **positions):
        for _ in range(n):
            self.sync()
            for joint in range(1, N + 1):
                if joint not in silent:
                    self.beat(joint)
                if joint not in without:
                    self.pdo(joint, positions.get(f"q{joint}", 0))
        return self

    def _feed(self, direction, data):
        frame = RawFrame(self.now_ns, self.now_ns + 10**18, direction, data, "can")
        self.frames.append(frame)
        self.items += self.decoder.feed(frame)


@pytest.fixture(params=[True, False], ids=["echo", "no echo"])
def bus(request):
    bus = Bus(request.param)
    for node in range(1, N + 1):
        bus.configure(node)
    bus.cycle(20)  # as many as tell that there is no echo
    assert len(bus.samples) and not bus.samples["joint_invalid"].any()
    return bus


def test_joints_that_come_one_after_the_other_make_no_invalid_points():
    bus = Bus()
    for node in range(1, N + 1):
        bus.configure(node)
        bus.cycle(20, silent=(1,) if node == N else ())
    bus.cycle(20)
    assert len(bus.samples) and not bus.samples["joint_invalid"].any()


def test_a_cycle_is_one_sample_latched_at_its_sync(bus):
    bus.cycle(q1=5, q2=TURN - 7, q3=9)
    last = bus.samples[-1]
    assert last["count"].tolist() == [5, -7, 9]
    assert last["monotonic_ns"] == bus.now_ns and last["clock_mapped"]
    assert last["stamp_ns"] == bus.now_ns + 10**18
    assert np.array_equal(np.diff(bus.samples["seq"]), np.ones(len(bus.samples) - 1))


def test_nothing_is_delivered_before_every_joint_is_identified():
    bus = Bus()
    bus.configure(1)
    bus.configure(2)
    bus.cycle(50, without=(3,))
    bus.cycle(50)
    assert len(bus.samples) == 0
    bus.configure(3)
    bus.cycle(5)
    assert len(bus.samples) and "identified" in bus.events


def test_a_missing_reading_costs_its_cycle_and_the_doubtful_ones(bus):
    before = len(bus.samples)
    bus.cycle(1, without=(2,)).cycle(60)  # as from a SYNC producer that does not wait for us
    after = bus.samples[before:]
    assert after["lost_before"].tolist() == [True] + [False] * (len(after) - 1)
    assert bus.decoder.counters["incomplete"] == 1
    assert bus.decoder.counters["withheld"] == 60 - len(after) == LATE_MOST_NS // (2 * MS) - 1


class Encoders:
    """Two encoders that answer a SYNC after their own delays, in ms, or never (None)."""

    def __init__(self):
        self.on_their_way = []  # (when, joint, cycle)

    def latch(self, now, number, delays):
        for joint, delay in enumerate(delays, start=1):
            if delay is not None:
                self.on_their_way.append((now + delay, joint, number))

    def arrived(self, now):
        here = sorted(answer for answer in self.on_their_way if answer[0] <= now)
        self.on_their_way = [answer for answer in self.on_their_way if answer[0] > now]
        return here


delays = st.none() | st.integers(0, LATE_MOST_NS // MS)


@given(st.lists(st.tuples(delays, delays), max_size=40))
def test_late_and_lost_answers_never_make_a_mixed_cycle(story):
    assembler, encoders, everybody = CycleAssembler(), Encoders(), frozenset({1, 2})
    delivered = []
    number = 0
    for now in range(1, (LATE_MOST_NS // MS + 3) * (len(story) + 1)):  # steps of a millisecond
        for _, joint, cycle_number in encoders.arrived(now):
            cycle = assembler.report(joint, EncoderReading(cycle_number, 0), everybody)
            if cycle is not None:
                assert {r.position for r in cycle.readings.values()} == {cycle.number}
                delivered.append(cycle.number)
        if number < len(story) and now % 2 == 0 and assembler.may_sync(now * MS):
            assembler.sync(number, now * MS)
            encoders.latch(now, number, story[number])
            number += 1
    assert delivered == [i for i, both in enumerate(story) if None not in both]


def test_an_alarm_marks_its_joint_for_as_long_as_it_lasts(bus):
    for alarms in (0, 1, 1, 0):
        bus.sync()
        for joint in range(1, N + 1):
            bus.beat(joint)
            bus.pdo(joint, 0, alarms if joint == 2 else 0)
    assert bus.samples["joint_invalid"][-4:].tolist() == [0, 0b010, 0b010, 0]
    assert bus.events[-1] == "joint_invalid"


@pytest.mark.parametrize(
    ("fault", "reason"),
    [
        (lambda bus: bus.rx(can.EMCY_BASE + 2, can.EMCY.pack(0x5000, 1)), "emergency 0x5000"),
        (lambda bus: bus.beat(2, can.BOOT_UP), "it has restarted"),
        (lambda bus: bus.beat(2, can.PRE_OPERATIONAL), "it has left operation"),
        (lambda bus: bus.cycle(200, silent=(2,)), "its heartbeat is lost"),
        (lambda bus: bus.cycle(200, without=(2,)), "it sends no values"),
    ],
)
def test_a_joint_that_fails_is_invalid_with_its_reason_and_taken_back(bus, fault, reason):
    fault(bus)
    bus.cycle(60)  # readings are in doubt for a while after a missing one
    assert (bus.samples["joint_invalid"][-3:] == 0b010).all()
    (event,) = [i for i in bus.items if isinstance(i, Event) and i.kind == "joint_invalid"]
    assert reason in event.text and "joint 2" in event.text
    assert [n for n, node in bus.decoder.nodes.items() if node.wants_configuration] == [2, 0x20]
    bus.configure(2)
    bus.cycle(5)
    assert (bus.samples["joint_invalid"][-3:] == 0).all()
    assert bus.events[-1] == "joint_valid"


def test_without_its_heartbeat_a_joint_is_not_taken_back(bus):
    bus.cycle(200, silent=(2,))
    bus.configure(2)
    bus.cycle(100, silent=(2,))
    assert (bus.samples["joint_invalid"][-50:] == 0b010).all()
    assert bus.events.count("joint_invalid") == 1


def test_a_stalled_host_does_not_declare_the_nodes_dead(bus):
    bus.now_ns += 2000 * MS
    bus.cycle(5)
    assert "joint_invalid" not in bus.events


def test_an_own_sync_that_waited_to_be_read_is_at_its_instant_and_nobody_elses():
    bus = Bus()
    for node in range(1, N + 1):
        bus.configure(node)
    bus.cycle(5)
    last = bus.samples[-1]
    bus.now_ns += 2 * MS
    sent_ns = bus.now_ns
    bus._feed("tx", CanFrame(can.SYNC_ID, b"").to_bytes())
    bus.now_ns += 250 * MS  # the host stands still
    bus.rx(can.SYNC_ID)
    for joint in range(1, N + 1):
        bus.pdo(joint)
    sample = bus.samples[-1]
    assert (sample["seq"], sample["monotonic_ns"]) == (last["seq"] + 1, sent_ns)
    assert bus.decoder.counters["foreign_sync"] == 0


def test_a_warning_leaves_the_position_valid(bus):
    bus.tell(note="warnings", node=3, warnings=4)
    bus.cycle()
    assert bus.samples[-1]["joint_warning"] == 0b100 and bus.samples[-1]["joint_invalid"] == 0


def test_a_jump_is_withheld(bus):
    bus.cycle(q1=TURN // 3).cycle()
    assert bus.samples["joint_invalid"][-2:].tolist() == [0b001, 0]


def test_after_a_loss_of_the_bus_seq_goes_on_with_a_gap(bus):
    last = int(bus.samples["seq"][-1])
    bus.tell(note="down")
    bus.now_ns += 1000 * MS
    bus.tell(note="up")
    for node in range(1, N + 1):
        bus.configure(node)
    before = len(bus.samples)
    bus.cycle(25)
    first = bus.samples[before]
    assert first["lost_before"] and first["seq"] > last + 400
    assert "joint_invalid" not in bus.events  # no joint has done anything wrong


def test_another_sync_producer_is_told_once(bus):
    for _ in range(3):
        bus.cycle()
        bus.now_ns += MS
        bus.rx(can.SYNC_ID)
    assert bus.events.count("second_sync_producer") == 1
    assert bus.decoder.counters["foreign_sync"] == 3


def test_as_a_follower_the_arrival_of_sync_is_the_latch():
    bus = Bus()
    for node in range(1, N + 1):
        bus.configure(node)
    for _ in range(5):
        bus.now_ns += 2 * MS
        bus.rx(can.SYNC_ID)
        for joint in range(1, N + 1):
            bus.beat(joint)
            bus.pdo(joint)
    assert bus.samples["monotonic_ns"][-1] == bus.now_ns
    assert bus.decoder.counters["foreign_sync"] == 0


def test_temperatures_come_whole_and_fresh_or_not_at_all(bus):
    bus.configure(0x20)
    bus.beat(0x20)
    bus.rx(can.TPDO_BASE[0] + 0x20, can.VALUES_PDO.pack(21_500, 22_250))
    bus.rx(can.TPDO_BASE[3] + 0x20, can.STATUS_PDO.pack(0, 1, 0, 0, 0, 0))
    bus.rx(can.TPDO_BASE[3] + 0x20, can.STATUS_PDO.pack(0, 0, 0, 0, 0, 0))  # no new values
    first, second = [i for i in bus.items if isinstance(i, Temperatures)]
    assert first.celsius[0] == pytest.approx(21.5) and np.isnan(first.celsius[1])
    assert np.isnan(second.celsius).all()


def test_frames_of_a_wrong_length_are_counted_and_ignored(bus):
    bus.sync()
    bus.rx(can.TPDO_BASE[0] + 1, b"\0" * 4)
    bus.rx(can.EMCY_BASE + 1, b"\1")
    assert bus.decoder.counters["malformed"] == 2


@given(st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), max_size=60))
def test_no_frame_breaks_the_decoder(frames):
    bus = Bus()
    for node in [1, 2, 3, 0x20]:
        bus.configure(node)
    bus.cycle(3)
    for identifier, data in frames:
        bus.rx(identifier, data)
    bus.cycle(3)


def test_the_recorded_frames_give_the_same_samples_again(bus):
    bus.cycle(30, without=(1,)).cycle(300, silent=(3,))
    bus.configure(3)
    bus.cycle(10)
    decoder = CanDecoder(EXPECTED, 500.0)
    again = [i for f in bus.frames for i in decoder.feed(f) if isinstance(i, np.ndarray)]
    assert np.concatenate(again).tobytes() == bus.samples.tobytes()
