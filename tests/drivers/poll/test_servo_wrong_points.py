"""What looks like a position and is none, on the wire: refusals with data, two servos of one id, a
servo that comes back as another, and the first cycle after a pause. No such row is valid."""

import time
from contextlib import closing

import numpy as np
import pytest
from test_servo_driver import Taken, config, expected, state

from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.poll.decoder import ServoDecoder, note
from armd.drivers.poll.protocol.family import FAMILIES, Servo, differences
from armd.drivers.sample import Event, RawFrame
from armd.drivers.table import open_driver
from support.fake_servos import Dynamixel, FakeServos, Feetech

__all__ = ["state"]  # the fixture: what is remembered of servos is each test's own
BOTH = pytest.mark.parametrize("family", [Feetech, Dynamixel], ids=lambda family: family.kind)


def put_off(family, registers, counts):
    """As another tool would: the offset register, and from then on every position."""
    family.put_homing(registers, -counts if family is Feetech else counts)
    family.put_position(registers, 2048 + counts)


@pytest.mark.parametrize("fast", [False, True], ids=["sync", "fast"])
def test_data_that_come_with_a_refusal_are_no_position(tmp_path, fast):
    """e-Manual, status packet: the low seven bits tell that the instruction was not done."""
    with (
        FakeServos(Dynamixel, tmp_path, knows_fast=fast) as servos,
        closing(open_driver(config(servos), expected())) as driver,
    ):
        taken = Taken(driver)
        taken.rows(50)
        servos.errors[2] = 0x04  # data range; the alert's bit is not set
        servos.move(2, 2048 + 12)  # less than a jump
        rows = taken.rows(200)
        counters = driver.counters
        servos.errors[2] = 0x80  # an alert: its data hold
        warned = taken.rows(100)
    refused = rows[10:]
    assert (refused["joint_invalid"] == 0b010).all() and counters["refused"] >= 190
    assert (warned["joint_invalid"][-20:] == 0).all() and (warned["count"][-20:, 1] == 12).all()
    assert (warned["joint_warning"][-20:] == 0b010).all()


@BOTH
def test_two_servos_of_one_id_are_told_and_none_of_them_is_believed(tmp_path, family):
    """Their second answer comes in time, or when the next request is already under way."""
    with (
        FakeServos(family, tmp_path) as servos,
        closing(open_driver(config(servos), expected())) as driver,
    ):
        taken = Taken(driver)
        taken.rows(20)
        late = []

        def twice(cycle, statuses):
            other = bytearray(servos.registers[3])
            family.put_position(other, 2050 + cycle % 7)
            _, length, _ = family.span(servos.requests[-1][2])
            second = family.status(3, 0, other[family.position : family.position + length])
            before, late[:] = list(late), [second] if cycle % 10 == 9 else []
            return [*before, *statuses, *([] if late else [second])]

        servos.knows_fast = False
        servos.before_answers = twice
        begun = time.monotonic_ns()
        rows = taken.rows(300)
        hindrance = driver.hindrance
        servos.before_answers = None
        rows_after = taken.take(0.8).rows(20)
    rows = rows[rows["monotonic_ns"] > begun + 50_000_000]
    assert len(rows) > 100 and (rows["joint_invalid"] == 0b100).all()
    register = {"feetech": 5, "dynamixel": 7}[family.kind]
    words = f"servo 3 (joint 3): id (register {register}): found two answers that differ, expected"
    assert [event.text.startswith(words) for event in taken.told("duplicate_id")] == [True]
    assert hindrance.startswith(words)
    assert (rows_after["joint_invalid"] == 0).all()


@BOTH
@pytest.mark.parametrize("away_s", [0.25, 0.0], ids=["a-short-restart", "no-silence"])
def test_a_servo_that_comes_back_with_another_offset_is_never_believed(tmp_path, family, away_s):
    """Shorter than any silence that is told; or another tool on the line, which shows as a jump."""
    with (
        FakeServos(family, tmp_path, ids=(1, 2, 3, 4, 5, 6)) as servos,
        closing(open_driver(config(servos, servos.registers), expected(6, 6))) as driver,
    ):
        taken = Taken(driver)
        taken.rows(50)
        if away_s:
            servos.silent.add(2)
            taken.take(away_s)
        put_off(family, servos.registers[2], 200)
        servos.silent.clear()
        taken.take(2.0, lambda: taken.told("offsets_changed"))
        rows = taken.rows(50)
    assert "servo 2 (joint 2): homing offset" in taken.told("offsets_changed")[0].text
    valid = taken.samples[taken.samples["joint_invalid"] & 0b10 == 0]
    assert (valid["count"][:, 1] == 0).all()
    assert (rows["joint_invalid"] & 0b10 != 0).all()


@BOTH
def test_a_servo_that_was_away_shortly_is_soon_valid_again(tmp_path, family):
    with (
        FakeServos(family, tmp_path) as servos,
        closing(open_driver(config(servos), expected())) as driver,
    ):
        taken = Taken(driver)
        taken.rows(50)
        servos.silent.add(2)
        taken.take(0.25)
        servos.silent.clear()
        back_ns = time.monotonic_ns()
        taken.take(2.0, lambda: taken.samples["joint_invalid"][-1] == 0)
        took_ns = int(taken.samples["monotonic_ns"][-1]) - back_ns
    assert taken.samples["joint_invalid"][-1] == 0 and took_ns < 200_000_000
    assert not taken.told("offsets_changed")


def test_a_mode_that_ignores_the_offset_is_another_geometry():
    """e-Manual, Homing Offset(20): in position mode values beyond ±1024 are ignored."""
    family = FAMILIES["dynamixel"]

    def found(homing: int, mode: int) -> Servo:
        table = Dynamixel.table(1, homing=homing)
        table[11] = mode
        return family.identity(bytes(table[: family.identity_bytes]))

    remembered = found(-1500, 4).geometry
    (phrase,) = differences(found(-1500, 3), remembered, family)
    assert phrase == "offset in force (register 11): found False, expected True"
    assert not differences(found(-1500, 5), remembered, family)
    assert found(1024, 3).geometry == found(1024, 4).geometry
    older = {name: value for name, value in remembered.items() if name != "offset_in_force"}
    assert not differences(found(-1500, 3), older, family)  # as written before it was asked


def test_a_silent_line_says_what_came_in_place_of_answers(tmp_path):
    with (
        FakeServos(Feetech, tmp_path) as servos,
        closing(open_driver(config(servos), expected())) as driver,
    ):
        taken = Taken(driver)
        taken.rows(50)
        servos.deaf = True
        taken.take(2.0, lambda: taken.told("silence"))
        servos.deaf = False
        taken.rows(20)
        servos.deaf = True
        # What they said before has been read once they are asked again.
        asked = len(servos.requests)
        taken.take(2.0, lambda: len(servos.requests) > asked + 3)
        servos.say(b"$GPGGA,123519*47\r\n")
        taken.take(2.0, lambda: len(taken.told("silence")) > 1)
    nothing, something = [event.text for event in taken.told("silence")]
    at = f"nothing heard for 0.5 s on {servos.link} at 1000000 baud: found "
    answers = ", expected answers of feetech servos 1, 2, 3"
    assert nothing == f"{at}nothing{answers}"
    assert something == f"{at}18 bytes that are no answer (another device, or rate?){answers}"


class PacedLine:
    """A servo line at 57 600 baud without a clock but its own: every joint turns steadily, each
    servo is read when its answer begins."""

    def __init__(self, family, counts_per_s):
        self.family, self.speed = family, counts_per_s
        self.ids = [1, 2, 3, 4, 5, 6]
        given = ServoConfig(kind=family.kind, port="/dev/null", baud=57_600, ids=self.ids)
        self.decoder = ServoDecoder(given, Expectation("SERVO-1", 6, 6, (4096,) * 6))
        self.now_ns, self.items = 1_000_000_000_000, []
        self.tables = {servo: family.table(servo) for servo in self.ids}
        for table in self.tables.values():
            table[family.delay] = 0
        self.feed("link", note(note="up"))
        kind = self.decoder.family
        self.exchange(0, kind.identity_bytes)
        self.feed("link", note(note="verdict", changed={}))

    def feed(self, direction, data):
        frame = RawFrame(self.now_ns, self.now_ns, direction, bytes(data), "poll")
        self.items += self.decoder.feed(frame)

    def true(self, at_ns):
        return self.speed * (at_ns - 1_000_000_000_000) / 1e9

    def exchange(self, address, length, stall_ns=0):
        kind = self.decoder.family
        request = kind.sync_read(self.ids, address, length)
        self.feed("tx", request)
        self.now_ns += round(len(request) * self.decoder.byte_ns)
        for servo in self.ids:
            self.now_ns += kind.return_delay_least_us * 1000
            table = self.tables[servo]
            self.family.put_position(table, 2048 + round(self.true(self.now_ns)))
            status = self.family.status(servo, 0, table[address : address + length])
            self.now_ns += round(len(status) * self.decoder.byte_ns)
            self.feed("rx", status)  # as it comes, but for a host that stood still before it
            self.now_ns += stall_ns if servo == 3 else 0
        self.feed("link", b'{"note": "over"}')

    def rows(self):
        return np.concatenate([item for item in self.items if isinstance(item, np.ndarray)])


@BOTH
@pytest.mark.parametrize("pause_s", [0.0, 0.6], ids=["first", "after-a-silence"])
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
