"""The servo driver follows its table of states: every transition on a line that is not there."""

import inspect
import random

import pytest

from armd.drivers.poll import driver as poll_driver
from armd.drivers.poll.states import TRANSITIONS, LineEvent, LineState
from support.driven_servos import state
from support.fake_servos import Feetech
from support.sampled import rows_of
from support.virtual_servo_line import VirtualServoLine

__all__ = ["state"]  # the fixture: what is remembered of servos is each test's own


class Followed(dict):
    """The table, and which rows a driver has followed."""

    def __init__(self):
        super().__init__(TRANSITIONS)
        self.path = []

    def __getitem__(self, row):
        self.path.append(row)
        return super().__getitem__(row)


@pytest.fixture
def followed(monkeypatch):
    table = Followed()
    monkeypatch.setattr(poll_driver, "TRANSITIONS", table)
    return table


@pytest.fixture
def line(monkeypatch):
    return VirtualServoLine(monkeypatch)


def rows(path):
    """*path*, states and events in turns, as rows of the table."""
    names = path.split()
    states = [LineState[name] for name in names[::2]]
    return list(zip(states, [LineEvent[name] for name in names[1::2]], strict=False))


def when(number, **knobs):
    """These *knobs* are turned as that request goes out: 0 is the identity, cycles follow. One that
    is a method is called."""

    def prepare(line):
        line.on_request = lambda n: turn(line, knobs) if n == number else None

    return prepare


def turn(line, knobs):
    for name, value in knobs.items():
        if callable(knob := getattr(line, name)):
            knob(*value)
        else:
            setattr(line, name, value)


def from_the_start(**knobs):
    return lambda line: turn(line, knobs)


def hold_a_joint(line):
    line.registers[2][Feetech.torque] = 1


def hold_a_joint_and_break(line):
    hold_a_joint(line)
    when(1, break_off=(2,))(line)


CYCLE = "ASKED BYTES ANSWERING COMPLETE ANSWERED"

#: What is done to the line, options of the driver, and the way through the table that it takes.
WAYS = {
    "identified, then cycles": (
        from_the_start(),
        {},
        f"CLOSED OPENED IDLE SENT {CYCLE} OVER IDLE SENT {CYCLE} SENT {CYCLE} SENT ASKED",
    ),
    "a cycle from time to time": (
        from_the_start(),
        {"rate_hz": 50},
        f"{CYCLE} OVER IDLE SENT {CYCLE} OVER IDLE",
    ),
    "cycles that are late": (from_the_start(), {"rate_hz": 2000}, f"{CYCLE} SENT {CYCLE} SENT"),
    "an answer in pieces": (
        from_the_start(pieces=3),
        {},
        "ASKED BYTES ANSWERING BYTES ANSWERING BYTES ANSWERING COMPLETE ANSWERED",
    ),
    "nobody answers": (when(3, silent={1, 2, 3}), {}, "ASKED OVER IDLE SENT ASKED OVER IDLE"),
    "half an answer": (when(3, answer_bytes=9), {}, "ASKED BYTES ANSWERING OVER IDLE SENT ASKED"),
    "a write": (
        hold_a_joint,
        {"torque_off": True},
        "IDLE PAUSED BLOCKED BYTES BLOCKED RELEASED IDLE SENT ASKED",
    ),
    "an identity that the line does not take": (
        from_the_start(refusals=1),
        {},
        "CLOSED OPENED IDLE PAUSED BLOCKED RELEASED IDLE SENT ASKED",
    ),
    "a cycle that the line does not take": (
        when(3, refusals=1),
        {},
        f"{CYCLE} PAUSED BLOCKED OVER BLOCKED RELEASED IDLE SENT ASKED",
    ),
    "bytes that nobody asked for": (
        when(3, say=(b"?", 5)),
        {"rate_hz": 50},
        f"{CYCLE} OVER IDLE BYTES IDLE SENT ASKED",
    ),
    "the port breaks while idle": (
        when(3, break_off=(5,)),
        {"rate_hz": 50},
        f"{CYCLE} OVER IDLE LOST CLOSED OPENED IDLE SENT {CYCLE}",
    ),
    "the port breaks after a write": (
        hold_a_joint_and_break,
        {"torque_off": True},
        "IDLE PAUSED BLOCKED BYTES BLOCKED LOST CLOSED OPENED IDLE SENT ASKED",
    ),
    "the port breaks before an answer": (
        when(3, break_off=(0.5,)),
        {},
        "ASKED LOST CLOSED OPENED IDLE SENT ASKED",
    ),
    "the port breaks within an answer": (
        when(3, answer_bytes=9, break_off=(2,)),
        {},
        "ASKED BYTES ANSWERING LOST CLOSED OPENED IDLE SENT ASKED",
    ),
}
#: These end with an error of the decoder, or before the driver has begun; see below.
CLOSINGS = ["CLOSED LOST CLOSED", "ANSWERED LOST CLOSED"]
ALL_WAYS = [way for _, _, way in WAYS.values()] + CLOSINGS


@pytest.mark.parametrize("name", WAYS)
def test_the_driver_takes_this_way(line, followed, name):
    prepare, options, way = WAYS[name]
    prepare(line)
    driver = line.driver(**options)
    for _ in range(100):
        driver.read(0.02)
    expected = rows(way)
    n = len(expected)
    taken = (followed.path[k : k + n] for k in range(len(followed.path) - n + 1))
    assert expected in taken, followed.path


def test_a_request_chosen_ahead_goes_out_before_the_answers_are_decoded(line, followed):
    """Unless the line takes a part of it only: then nothing follows that part at once."""
    driver = line.driver()
    noted_last, sent_ns = [], []

    def note_last_frame(number):
        noted_last.extend(frame.direction for frame in driver.take_raw()[-1:])
        sent_ns.append(line.now_ns)
        line.refusals = number == 5

    line.on_request = note_last_frame
    while line.n_requests < 10:
        driver.read(0.02)
    assert noted_last == ["link", "link", "tx", "tx", "tx", "tx", "link", "tx", "tx", "tx"]
    assert sent_ns[6] - sent_ns[5] > poll_driver.WRITE_NS > 3 * (sent_ns[5] - sent_ns[4])
    assert driver.counters["unsent"] == 1 and driver.counters["lost"] == 0
    row = LineState.ANSWERED, LineEvent.SENT
    assert followed.path.count(row) == 7


def test_bytes_of_a_closed_connection_are_not_among_the_next_one_s(line, followed):
    when(3, answer_bytes=9)(line)
    driver = line.driver()
    for _ in range(1000):
        if line.n_requests == 4 and driver._answers._bytes:
            break
        driver.read(0.0005)
    assert driver._answers._bytes
    driver.close()
    assert driver._answers.take() == []


def test_closed_before_it_was_opened(line, followed):
    line.driver().close()
    assert followed.path == rows(CLOSINGS[0])


def test_closed_after_an_error_in_the_middle(line, followed):
    """A decoder that fails leaves the exchange open; closing the driver still works."""
    driver = line.driver(rate_hz=2000)

    def fail(number):
        if number == 3:
            raise RuntimeError

    line.on_request = fail
    with pytest.raises(RuntimeError):
        for _ in range(100):
            driver.read(0.02)
    driver.close()
    assert followed.path[-1:] == rows(CLOSINGS[1])


def test_every_transition_is_on_a_way():
    """So the tests above follow each row of the table, and no row that it lacks."""
    assert {row for way in ALL_WAYS for row in rows(way)} == TRANSITIONS.keys()


def test_a_way_goes_from_state_to_state_as_the_table_says():
    for way in ALL_WAYS:
        states = [LineState[name] for name in way.split()[::2]]
        assert [TRANSITIONS[row] for row in rows(way)][: len(states) - 1] == states[1:]


def test_the_driver_changes_its_state_by_the_table_alone():
    changes = inspect.getsource(poll_driver).split("self._state = ")[1:]
    assert [change.split("\n")[0] for change in changes] == [
        "LineState.CLOSED",
        "TRANSITIONS[self._state, event]",
    ]


@pytest.mark.parametrize("seed", range(8))
def test_no_fault_brings_an_event_that_the_table_lacks(line, followed, seed):
    """Random faults at random requests: a row that is missing raises KeyError. Afterwards the
    driver delivers as before."""
    drawn = random.Random(seed)
    faults = [
        {"silent": {1, 2, 3}},
        {"silent": {2}},
        {"answer_bytes": 9},
        {"pieces": 4},
        {"refusals": 1},
        {"refusals": 3},
        {"say": (b"\xff\xff?", 0.5)},
        {"say": (b"?", 7)},
        {"break_off": (0.5,)},
        {"break_off": (8,)},
        {"silent": set(), "answer_bytes": None, "pieces": 1},
    ]
    healthy = faults[-1]

    def spoil(number):
        turn(line, drawn.choice(faults) if drawn.random() < 0.3 else healthy)

    for registers in line.registers.values():
        registers[Feetech.torque] = drawn.random() < 0.5
    line.on_request = spoil
    driver = line.driver(torque_off=True, rate_hz=drawn.choice([None, 50, 2000]))
    for _ in range(600):
        driver.read(drawn.choice([0, 0.001, 0.02]))
    assert len(set(followed.path)) > len(TRANSITIONS) / 2
    line.on_request = lambda number: turn(line, healthy)
    end_ns = line.now_ns + 3_000_000_000
    items = []
    while line.now_ns < end_ns:
        items = driver.read(0.02) or items
    assert driver.connected
    last = rows_of(items)[-1]
    assert last["joint_invalid"] == 0 and (last["count"] == 0).all()
