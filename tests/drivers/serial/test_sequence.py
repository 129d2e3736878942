"""Sequence numbers: extended over wraps and reboots, each sample once, repeats told apart."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from armd.drivers.serial import wire
from armd.drivers.serial.sequence import SequenceExtender

WRAP = 2**32
MS = 1_000_000  # ns


def rows(*pairs):
    """(seq, t_us) pairs as the codec delivers them."""
    out = np.zeros(len(pairs), wire.make_sample_layout(1))
    out["seq"] = [seq % WRAP for seq, _ in pairs]
    out["t_us"] = [t for _, t in pairs]
    return out


class Feed:
    """Pushes samples a millisecond apart and remembers what was accepted."""

    def __init__(self):
        self.extender = SequenceExtender()
        self.accepted: list[int] = []
        self.reboots = 0
        self.now_ns = 10**12

    def push(self, *pairs, after_ns=MS):
        self.now_ns += after_ns
        return self._take(self.extender.push(rows(*pairs), self.now_ns))

    def clock(self, t_us, round_trip_ns=MS):
        """A PONG has come."""
        sent_ns, self.now_ns = self.now_ns, self.now_ns + round_trip_ns
        return self._take(self.extender.clock_read(t_us, sent_ns))

    def _take(self, runs):
        for run in runs:
            self.accepted += [run.epoch << 32 | int(seq) for seq in run.rows["seq"]]
            self.reboots += run.rebooted
        return self


def stream(feed, first, n, t0_us):
    for i in range(n):
        feed.push((first + i, t0_us + 1000 * i))


def test_a_wrap_within_one_read():
    feed = Feed().push((WRAP - 2, 1000), (WRAP - 1, 2000), (0, 3000), (1, 4000))
    assert feed.accepted == [WRAP - 2, WRAP - 1, WRAP, WRAP + 1]


def test_losses_over_a_wrap_are_losses():
    feed = Feed().push((WRAP - 2, 1000)).push((5, 8000))
    assert feed.accepted == [WRAP - 2, WRAP + 5] and feed.extender.lost == 6


def test_a_big_jump_forward_is_lost_samples():
    feed = Feed().push((10, 1000)).push((3_000_000_000, 2000))
    assert feed.accepted == [10, 3_000_000_000]
    assert feed.extender.lost == 3_000_000_000 - 11


def test_repeats_are_dropped_and_counted():
    feed = Feed()
    stream(feed, 5000, 10, 5_000_000)
    feed.push((5009, 5_009_000)).push((5009, 5_009_000))  # the last one again
    feed.push((5007, 5_007_000)).push((5008, 5_008_000))  # two older ones
    stream(feed, 5010, 10, 5_010_000)
    assert feed.accepted == list(range(5000, 5020))
    assert feed.extender.repeated == 4 and feed.extender.lost == 0 and feed.reboots == 0


def test_a_late_packet_around_the_wrap_is_no_reboot():
    feed = Feed()
    stream(feed, WRAP - 3, 5, 50_000_000)
    feed.push((WRAP - 1, 50_002_000))
    feed.push((2, 50_005_000))
    assert feed.accepted[-2:] == [WRAP + 1, WRAP + 2]
    assert feed.extender.repeated == 1 and feed.reboots == 0


def test_the_counter_going_on_over_a_clock_running_backwards_is_a_reboot():
    feed = Feed().push((10, 5_000_000)).push((11, 3000)).push((12, 4000))
    assert feed.accepted == [10, WRAP + 11, WRAP + 12] and feed.reboots == 1


def test_a_past_that_simply_goes_on_is_a_reboot_and_nothing_of_it_is_lost():
    feed = Feed()
    stream(feed, 5000, 10, 5_000_000)
    stream(feed, 100, 100, 4_000_000)  # that clock cannot be right, but it runs on
    assert feed.accepted[10:] == [WRAP + 100 + i for i in range(100)]


def test_old_packets_between_new_ones_are_repetitions_without_asking_anybody():
    feed = Feed()
    stream(feed, 0, 100, 0)
    for i in range(60):
        feed.push((i, 1000 * i), (i + 1, 1000 * i + 1000), (100 + i, 100_000 + 1000 * i))
    assert feed.accepted == list(range(160)) and feed.extender.repeated == 120


def test_a_reboot_at_times_already_seen_is_told_by_the_clock_and_nothing_of_it_is_lost():
    feed = Feed()
    stream(feed, 0, 20_000, 0)
    feed.push((0, 0), after_ns=200 * MS)
    stream(feed, 1, 20, 1000)
    assert len(feed.accepted) == 20_000 and feed.extender.wants_clock
    feed.clock(21_000)
    stream(feed, 21, 20, 21_000)
    assert feed.accepted[20_000:] == [WRAP + i for i in range(41)]
    assert feed.reboots == 1 and feed.extender.repeated == 0


@given(
    ran_ms=st.integers(101, 20_000),
    down_ms=st.integers(1, 2000),
    told_after=st.integers(0, 100),
    under_way_ms=st.integers(0, 50),
)
def test_a_clock_that_is_behind_has_booted(ran_ms, down_ms, told_after, under_way_ms):
    """The PONG may come at any sample of the new boot, and late."""
    feed = Feed().push((0, 0)).push((ran_ms, 1000 * ran_ms), after_ns=ran_ms * MS)
    feed.extender.memory[0]["since_us"] = 0  # without a gap, as if all between had come
    feed.push((0, 0), after_ns=down_ms * MS)
    sent = range(1, told_after + 1)
    for seq in sent:
        feed.push((seq, 1000 * seq))
    feed.clock(1000 * len(sent), under_way_ms * MS)
    told = feed.accepted[2:]
    feed.push((len(sent) + 1, 1000 * len(sent) + 1000))
    assert told == [WRAP + seq for seq in range(len(sent) + 1)] and feed.reboots == 1


@given(
    first=st.integers(0, 399),
    n=st.integers(1, 400),
    pace_ms=st.sampled_from([0, 1]),
    silent_ms=st.integers(0, 900),
    under_way_ms=st.integers(0, 200),
)
def test_a_clock_that_has_run_on_has_not_booted(first, n, pace_ms, silent_ms, under_way_ms):
    """A block of old packets, at once or at their pace; the PONG may have been under way long."""
    feed = Feed()
    stream(feed, 0, 400, 0)
    now_us, again = 399_000, range(first, min(first + n, 400))
    for i, seq in enumerate(again):
        feed.push((seq, 1000 * seq), after_ns=(silent_ms if i == 0 else pace_ms) * MS)
    passed_ms = silent_ms + pace_ms * (len(again) - 1)
    feed.clock(now_us + 1000 * passed_ms, under_way_ms * MS)  # stamped as the PING came
    assert not feed.extender.wants_clock
    now_us += 1000 * (passed_ms + under_way_ms + 1)
    feed.push((500, now_us))
    feed.push((501, now_us + 1000))
    assert feed.accepted == [*range(400), 500, 501] and feed.reboots == 0
    assert feed.extender.repeated == len(again)


def test_a_reboot_of_an_arm_that_never_says_so_is_believed_after_a_second():
    feed = Feed()
    stream(feed, 0, 3000, 0)
    stream(feed, 0, 1500, 0)
    assert feed.accepted[3000:] == [WRAP + i for i in range(1500)] and feed.reboots == 1


def test_a_packet_out_of_the_future_does_not_make_the_present_a_repetition():
    feed = Feed()
    stream(feed, 0, 100, 0)
    feed.push((9000, 3_600_000_000))  # of another boot, say
    stream(feed, 100, 100, 100_000)
    assert [seq % WRAP for seq in feed.accepted[101:]] == list(range(100, 200))


@given(st.lists(st.sampled_from(["next", "next", "lose", "wrap", "reboot", "repeat"]), max_size=60))
def test_whatever_happens_numbers_rise_and_their_low_half_is_the_devices(story):
    feed, device_seq, t_us = Feed(), WRAP - 20, 10_000_000
    sent = []
    for word in story:
        if word == "repeat" and sent and sent[-1][1] > 200_000:
            feed.push(sent[-1])
            continue
        if word == "reboot":
            feed.extender.new_boot()
            device_seq, t_us = 0, 0
        if word == "lose":
            device_seq = (device_seq + 7) % WRAP
            t_us += 7000
        if word == "wrap" and device_seq < WRAP - 5:
            t_us += (WRAP - 5 - device_seq) * 1000
            device_seq = WRAP - 5
        sent.append((device_seq, t_us))
        feed.push(sent[-1])
        device_seq = (device_seq + 1) % WRAP
        t_us += 1000
    assert [seq % WRAP for seq in feed.accepted] == [seq for seq, _ in sent]
    assert feed.accepted == sorted(set(feed.accepted))
