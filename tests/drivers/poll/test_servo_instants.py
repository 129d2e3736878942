"""When a servo was read: within a cycle, and where the host or the adapter takes its time."""

import numpy as np
import pytest

from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.poll.decoder import ServoDecoder, encode_note
from armd.drivers.poll.exchange import compute_instants
from armd.drivers.sample import Event, RawFrame
from support.fake_servos import Dynamixel, Feetech
from support.sampled import rows_of

BOTH = pytest.mark.parametrize("family", [Feetech, Dynamixel], ids=lambda family: family.kind)
MS = 1_000_000


class PacedLine:
    """A servo line at 57 600 baud without a clock but its own: every joint turns steadily, each
    servo is read when its answer begins."""

    def __init__(self, family, counts_per_s):
        self.family, self.speed = family, counts_per_s
        self.ids = [1, 2, 3, 4, 5, 6]
        self.shift = dict.fromkeys(self.ids, 0)  # counts that a servo tells beside the truth
        given = ServoConfig(kind=family.kind, port="/dev/null", baud=57_600, ids=self.ids)
        self.decoder = ServoDecoder(given, Expectation("SERVO-1", 6, 6, (4096,) * 6))
        self.now_ns, self.items = 1_000_000_000_000, []
        self.tables = {servo: family.table(servo) for servo in self.ids}
        for table in self.tables.values():
            table[family.delay] = 0
        self.feed("link", encode_note(note="up"))
        kind = self.decoder.family
        self.byte_ns, self.gap_ns = self.decoder.byte_ns, kind.return_delay_least_us * 1e3
        self.exchange(0, kind.identity_bytes)
        self.feed("link", encode_note(note="verdict", changed={}))

    def feed(self, direction, data):
        frame = RawFrame(self.now_ns, self.now_ns, direction, bytes(data), "poll")
        self.items += self.decoder.feed(frame)

    def true(self, at_ns):
        return self.speed * (at_ns - 1_000_000_000_000) / 1e9

    def exchange(self, address, length, stall_ns=0, before_ns=0, behind_ns=0):
        """*before_ns* passes until the request is out, *behind_ns* until the answers are here;
        *stall_ns* once three of them are."""
        kind = self.decoder.family
        request = kind.sync_read(self.ids, address, length)
        self.feed("tx", request)
        self.now_ns += before_ns + round(len(request) * self.byte_ns)
        answers = b""
        for servo in self.ids:
            self.now_ns += round(self.gap_ns)
            table = self.tables[servo]
            self.family.put_position(
                table, 2048 + round(self.true(self.now_ns)) + self.shift[servo]
            )
            status = self.family.status(servo, 0, table[address : address + length])
            self.now_ns += round(len(status) * self.byte_ns)
            answers += status
            if not behind_ns:
                self.feed("rx", status)  # as it comes, but for a host that stood still before it
            self.now_ns += stall_ns if servo == 3 else 0
        self.now_ns += behind_ns
        if behind_ns:
            self.feed("rx", answers)
        self.feed("link", b'{"note": "over"}')

    def cycles(self, n, **delays):
        kind = self.decoder.family
        for k in range(n):
            self.exchange(kind.position, kind.position_bytes + k % 2, **delays)

    def apart(self):
        """(m, N) counts that the valid rows are off at their own instants."""
        rows = self.rows()
        rows = rows[rows["joint_invalid"] == 0]
        return np.abs([row["count"] - self.true(int(row["monotonic_ns"])) for row in rows])

    def rows(self):
        return rows_of(self.items)


@BOTH
@pytest.mark.parametrize("pause_s", [0.0, 0.13], ids=["first", "after-a-silence"])
def test_the_first_row_is_one_instant_too(family, pause_s):
    """At 57 600 baud the last servo is read 20 ms after the first: 10 counts at 500 a second."""
    line = PacedLine(family, 500.0)
    address = line.decoder.family.position
    for k in range(6):
        line.exchange(address, line.decoder.family.position_bytes + k % 2)
        if k == 2 and pause_s:
            line.speed = -line.speed  # nobody is heard while the arm turns round
            line.now_ns += round(pause_s * 1e9)
    rows = line.rows()
    assert rows["seq"].tolist() == list(range(6))
    assert (rows["joint_invalid"] == 0).all()
    for row in rows:
        apart = row["count"] - line.true(int(row["monotonic_ns"]))
        if line.speed > 0 or row["seq"] > 2:
            assert np.abs(apart).max() <= 1.5  # two roundings, one of them stretched


@BOTH
def test_a_first_cycle_in_which_the_host_stood_still_is_left_out_for_a_motion(family):
    for speed, left_out in ((500.0, 1), (0.0, 0)):
        line = PacedLine(family, speed)
        address = line.decoder.family.position
        line.exchange(address, line.decoder.family.position_bytes, stall_ns=80_000_000)
        for k in range(1, 5):
            line.exchange(address, line.decoder.family.position_bytes + k % 2)
        assert line.rows()["seq"].tolist() == list(range(left_out, 5))
        told = [i for i in line.items if isinstance(i, Event) and i.kind == "untimed"]
        assert len(told) == left_out == line.decoder.counters["untimed"]


def test_an_instant_is_the_middle_of_what_request_and_answers_allow():
    """By hand: sent at 0, 10 for the request, answers of 20 after pauses of 5. The second servo is
    silent; the third's answer is here at 160, 100 later than the line needs."""
    found = compute_instants(0, 10, [36, None, 160], 20, [5, 5, 5])
    assert found[0] == (15 + 16) / 2  # its own answer was here 1 later than the line needs
    assert found[2] == (10 + 5 + 20 + 5 + 140) / 2
    # All in one piece: the last one's arrival bounds the first.
    assert compute_instants(0, 10, [160, 160, 160], 20, [5, 5, 5]) == [
        15 + 37.5,
        40 + 37.5,
        65 + 37.5,
    ]


@BOTH
@pytest.mark.parametrize(
    ("before_ms", "behind_ms"), [(3.5, 0.1), (0, 3.6), (1.8, 1.8)], ids=["before", "behind", "both"]
)
def test_a_delay_of_few_milliseconds_costs_no_row_and_half_of_it(family, before_ms, behind_ms):
    """Wherever it passes: at 1000 counts a second 1.8 ms are 1.8 counts."""
    line = PacedLine(family, 1000.0)
    line.cycles(10)
    line.cycles(5, before_ns=round(before_ms * MS), behind_ns=round(behind_ms * MS))
    line.cycles(10)
    assert line.rows()["seq"].tolist() == list(range(25)) and line.decoder.counters["untimed"] == 0
    apart = line.apart()
    assert len(apart) == 25 and apart.max() < 1.8 + 1.5  # two roundings, one of them stretched


@BOTH
def test_an_adapter_that_always_holds_answers_back_gives_no_wrong_instant(family):
    """16 ms in each cycle, as an FTDI adapter whose latency timer was not set: what is usual may
    pass before the servos or behind them, and is 16 counts here. At rest it does not matter."""
    line = PacedLine(family, 1000.0)
    line.cycles(60, behind_ns=16 * MS)
    assert line.decoder.counters["untimed"] == 60
    assert not [item for item in line.items if isinstance(item, np.ndarray)]
    (told,) = [i for i in line.items if isinstance(i, Event) and i.kind == "untimed"]
    assert "in doubt by 8." in told.text
    rest = PacedLine(family, 0.0)
    rest.cycles(60, behind_ns=16 * MS)
    assert rest.rows()["seq"].tolist() == list(range(60)) and rest.apart().max() == 0


@BOTH
@pytest.mark.parametrize("where", ["before_ns", "behind_ns"])
def test_where_bytes_take_no_time_the_lines_own_time_bounds_nothing(family, where):
    """A pseudo-terminal at 57 600 baud: what is 20 ms late is here when a line's would be."""
    line = PacedLine(family, 1000.0)
    line.byte_ns, line.gap_ns = 0.0, 50_000.0
    line.cycles(30)
    line.cycles(5, **{where: 20 * MS})
    line.cycles(1)  # every joint has gone 100 counts since, and is asked who it is
    assert (line.rows()["joint_invalid"][-1:] == 0b111111).all()
    line.exchange(0, line.decoder.family.identity_bytes)
    line.cycles(10)
    assert line.decoder.counters["untimed"] == 5
    assert len(line.apart()) == 40 and line.apart().max() < 1.5


@BOTH
def test_a_step_that_only_a_gap_makes_possible_is_asked_about(family):
    """Another tool moves a homing offset while the host stands still for 60 ms, in which a joint
    may turn by 72 degrees: its servo does not count until it has said who it is."""
    line = PacedLine(family, 0.0)
    line.cycles(10)
    line.now_ns += 60 * MS
    line.shift[2] = 700
    line.cycles(3)
    assert line.rows()["joint_invalid"].tolist() == [0] * 10 + [0b10] * 3
    assert 2 in line.decoder.roster.strangers
    kind = line.decoder.family
    line.exchange(0, kind.identity_bytes)
    line.cycles(3)  # as its offset is the same, it was a motion
    assert line.rows()["joint_invalid"].tolist()[-3:] == [0] * 3
    assert line.rows()["count"][-1].tolist() == [0, 700, 0, 0, 0, 0]


@BOTH
@pytest.mark.parametrize("stalls_ms", [(60, 120), (150,), (60, 150)], ids=str)
def test_a_step_in_a_second_stall_or_a_pause_is_asked_about(family, stalls_ms):
    """The cycle before was a stall too, or nobody was asked for so long that nothing before says
    how fast a joint moves: another offset that came with it does not count either."""
    line = PacedLine(family, 0.0)
    line.cycles(10)
    for stall_ms in stalls_ms[:-1]:
        line.now_ns += stall_ms * MS
        line.cycles(1)
    line.now_ns += stalls_ms[-1] * MS
    line.shift[2] = 700
    line.cycles(3)
    assert (line.rows()["joint_invalid"][-3:] == 0b10).all() and 2 in line.decoder.roster.strangers
    before = line.rows()[:-3]
    assert (before["joint_invalid"] == 0).all() and (before["count"] == 0).all()
    line.exchange(0, line.decoder.family.identity_bytes)
    line.cycles(3)  # the first of them waits for the second: all six were asked, for over 0.1 s
    assert line.rows()["count"][-1].tolist() == [0, 700, 0, 0, 0, 0]
    assert line.rows()["joint_invalid"][-1] == 0


@BOTH
def test_a_step_is_asked_about_on_a_host_that_is_busy_for_seconds(family):
    """Where each of the last cycles was late, none of them says what is usual."""
    line = PacedLine(family, 0.0)
    line.cycles(10)
    for _ in range(12):
        line.now_ns += 80 * MS
        line.cycles(1)
    assert (line.rows()["joint_invalid"] == 0).all() and len(line.rows()) == 22
    line.now_ns += 80 * MS
    line.shift[2] = 700  # 61 degrees in 95 ms: a hand can do that
    line.cycles(1)
    assert line.rows()["joint_invalid"][-1] == 0b10 and 2 in line.decoder.roster.strangers


@BOTH
def test_who_leapt_over_a_pause_is_asked_even_if_the_second_cycle_has_no_instant(family):
    line = PacedLine(family, 2000.0)
    line.cycles(10)
    line.now_ns += 150 * MS
    line.shift[2] = 700
    line.cycles(1)
    line.cycles(1, stall_ns=80 * MS)
    assert line.decoder.counters["untimed"] and 2 in line.decoder.roster.strangers
    line.cycles(3)
    assert (line.rows()["joint_invalid"][10:] & 0b10).all()


@BOTH
def test_stalls_in_a_motion_cost_no_row(family):
    line = PacedLine(family, 2000.0)
    for stall_ms in (0, 60, 30, 45, 60, 10):
        line.now_ns += stall_ms * MS
        line.cycles(2)
    assert (line.rows()["joint_invalid"] == 0).all() and len(line.rows()) == 12
