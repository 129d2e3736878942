"""Servos that answer plain reads and no sync read, on the wire: they are read one by one, and no
answer is taken for another cycle's."""

import re
import time
from contextlib import closing

import numpy as np
import pytest
from test_servo_instants import PacedLine

from armd.drivers.config import Trigger
from armd.drivers.poll.decoder import encode_note
from armd.drivers.table import open_driver
from support.driven_servos import (
    BOTH,
    Taken,
    assert_replayed,
    config,
    driven,
    expected,
    state,
)
from support.fake_servos import Dynamixel, FakeServos, Feetech
from support.selection import parametrize_default

__all__ = ["state"]  # the fixture: what is remembered of servos is each test's own
EITHER = pytest.mark.parametrize("family", [Feetech, Dynamixel], ids=lambda family: family.kind)
READ, SYNC_READ = 0x02, 0x82


def take_valid(taken, n, invalid=0):
    """Until *n* more rows have these joints invalid and no others."""
    before = len(taken.samples)

    def found():
        return (taken.samples["joint_invalid"][before:] == invalid).sum() >= n

    taken.take(30.0, lambda: len(taken.samples) > before and found())
    rows = taken.samples[before:]
    assert found(), rows["joint_invalid"]
    return rows


@pytest.mark.slow
@EITHER
def test_they_are_read_one_by_one_and_an_event_tells_the_rate(tmp_path, family):
    with driven(family, tmp_path, no_sync=(1, 2, 3)) as (servos, taken):
        servos.registers[3][family.temperature] = 41
        for servo, position in ((1, 0), (2, 2048), (3, 4095)):
            servos.move(servo, position)
        taken.take(30.0, lambda: taken.told("no_sync_read"))
        rows = take_valid(taken, 100)
        hindrance, connected = taken.driver.hindrance, taken.driver.connected
        first = len(servos.requests)
        taken.rows(20)
        asked = {instruction for instruction, _, _ in servos.requests[first:]}
    assert connected and not hindrance and asked == {READ}
    good = rows["joint_invalid"] == 0
    assert (rows["count"][good] == [-2048, 0, 2047]).all()
    assert (np.diff(taken.samples["seq"].astype(int)) > 0).all()
    assert (np.diff(taken.samples["monotonic_ns"]) > 0).all()
    assert any(each.celsius.tolist() == [25, 25, 41] for each in taken.temperatures)
    (event,) = taken.told("no_sync_read")
    assert event.text.startswith("servos 1, 2, 3 answer when asked alone, and no sync read (not")
    rate = re.fullmatch(r".* one by one, (\d+) cycles a second", event.text)
    assert rate is not None, event.text
    # The text has whole cycles, the detail tenths of one, each rounded by itself
    assert abs(int(rate[1]) - event.detail["rate_hz"]) <= 0.55
    assert event.severity == "warning" and event.detail["servos"] == [1, 2, 3]
    assert [event.kind for event in taken.events][:4] == ["servo", "servo", "servo", "identified"]
    assert not taken.told("servo_missing") and not servos.writes


@pytest.mark.slow
@BOTH
def test_one_such_servo_among_others_is_read_too(tmp_path, family):
    with driven(family, tmp_path, no_sync=(2,)) as (_, taken):
        taken.take(30.0, lambda: taken.told("no_sync_read"))
        take_valid(taken, 50)
    assert taken.told("no_sync_read")[0].text.startswith("servo 2 answers when asked alone")


@BOTH
def test_servos_that_know_sync_reads_are_never_read_one_by_one(tmp_path, family):
    """The first is switched on right after a sync read has gone unanswered, and is asked alone."""
    with driven(family, tmp_path) as (servos, taken):
        servos.silent |= {1, 2, 3}

        asked_alone = []

        def switch_on(instruction, servo):
            if instruction == READ:
                asked_alone.append(servo)
                servos.silent.discard(servo)

        servos.before_request = switch_on
        taken.take(10.0, lambda: asked_alone)
        servos.silent.clear()
        take_valid(taken, 50)
        assert asked_alone
        asked = {code for code, _, _ in servos.requests[-30:]}
    assert READ not in asked and SYNC_READ in asked and not taken.told("no_sync_read")


@EITHER
def test_a_servo_that_falls_silent_marks_its_own_joint(tmp_path, family):
    with driven(family, tmp_path, no_sync=(1, 2, 3)) as (servos, taken):
        taken.rows(50)
        servos.silent.add(2)
        taken.rows(2)
        rows = take_valid(taken, 50, 0b010)  # the others' answers are not touched
        missed = taken.driver.counters["servo_2_missed"]
        taken.take(10.0, lambda: "servo 2 (joint 2) does not answer" in taken.driver.hindrance)
        hindrance = taken.driver.hindrance
        servos.silent.clear()
        taken.take(10.0, lambda: taken.samples["joint_invalid"][-1] == 0)
        take_valid(taken, 20)
    assert (rows["joint_invalid"] & 0b010 != 0).all() and missed >= 40
    assert "servo 2 (joint 2) does not answer" in hindrance


@pytest.mark.slow
@EITHER
@parametrize_default("late_by", ["a request", "a cycle"])
def test_a_late_answer_is_never_taken_for_the_next_cycles(tmp_path, family, late_by):
    """Now and then servo 2's answer comes while another servo is asked, or right before or after
    its own next answer. Its position is off by less than a jump."""
    kept = []
    with driven(family, tmp_path, no_sync=(1, 2, 3)) as (servos, taken):
        taken.rows(50)

        def answer(servo, status):
            cycle = len(servos.cycles)
            if servo == 2 and cycle % 10 == 3:
                stale = bytearray(servos.registers[2])
                family.put_position(stale, 2048 + 45)
                address, length, _ = family.span(servos.requests[-1][2])
                kept.append(family.status(2, 0, stale[address : address + length]))
                return []
            if kept and servo == (3 if late_by == "a request" else 2):
                return [kept.pop(), status] if cycle % 20 < 10 else [status, kept.pop()]
            return [status]

        servos.before_answer = answer
        rows = taken.rows(300)
        servos.before_answer = None
        counters = taken.driver.counters
    valid = rows[rows["joint_invalid"] == 0]
    assert len(valid) > 100 and counters["late"] >= 10
    assert (valid["count"] == 0).all()
    assert not taken.told("duplicate_id")


@BOTH
def test_two_servos_of_one_id_are_told(tmp_path, family):
    """The second answers while the next servo is asked."""
    with driven(family, tmp_path, no_sync=(1, 2, 3)) as (servos, taken):
        taken.rows(20)

        def answer(servo, status):
            if servo != 2:
                return [status]
            other = bytearray(servos.registers[2])
            family.put_position(other, 2050 + len(servos.cycles) % 7)
            _, length, _ = family.span(servos.requests[-1][2])
            at = family.position
            return [status, family.status(2, 0, other[at : at + length])]

        servos.before_answer = answer
        taken.rows(20)
        rows = take_valid(taken, 100, 0b010)
        servos.before_answer = None
    assert (rows["joint_invalid"] & 0b010 != 0).all()
    assert len(taken.told("duplicate_id")) == 1


class LineOfSingleReads(PacedLine):
    """The same line, read one by one; the host may pause before the fourth servo's request, the
    adapter before its answer."""

    def exchange(self, address, length, host_ns=0, adapter_ns=0):
        kind = self.decoder.family
        if address == 0:
            self.feed("link", encode_note(note="one_by_one"))
        for servo in self.ids:
            self.now_ns += host_ns if servo == 4 else 0
            request = kind.read(servo, address, length)
            self.feed("tx", request)
            self.now_ns += round(len(request) * self.byte_ns + self.gap_ns)
            table = self.tables[servo]
            self.family.put_position(table, 2048 + round(self.true(self.now_ns)))
            status = self.family.status(servo, 0, table[address : address + length])
            self.now_ns += round(len(status) * self.byte_ns)
            self.now_ns += adapter_ns if servo == 4 else 0
            self.feed("rx", status)
        self.feed("link", b'{"note": "over"}')


@EITHER
def test_a_row_is_one_instant_though_its_servos_are_read_at_six(family):
    """At 57 600 baud the last servo is read 20 ms after the first: 10 counts at 500 a second."""
    line = LineOfSingleReads(family, 500.0)
    line.cycles(20)
    assert line.rows()["seq"].tolist() == list(range(20))
    assert line.apart().shape == (20, 6) and line.apart().max() <= 1.5  # two roundings


@EITHER
@pytest.mark.parametrize("speed", [500.0, 0.0], ids=["in-motion", "at-rest"])
@pytest.mark.parametrize("who", ["host_ns", "adapter_ns"])
def test_a_cycle_in_which_somebody_stands_still_is_left_out_in_motion(family, speed, who):
    line = LineOfSingleReads(family, speed)
    line.cycles(20)
    line.cycles(1, **{who: 30_000_000})
    line.cycles(20)
    left_out = [20] if speed else []
    assert line.rows()["seq"].tolist() == [k for k in range(41) if k not in left_out]
    assert line.decoder.counters["untimed"] == len(left_out)
    assert line.apart().max() <= 1.5


@BOTH
def test_the_trigger_and_other_thermometers_are_asked_too(tmp_path, family):
    with FakeServos(family, tmp_path, (1, 2, 3, 6), no_sync=(1, 2, 3, 6)) as servos:
        servos.registers[6][family.temperature] = 52
        more = {"temperature_ids": [2, 3, 6], "trigger": Trigger(id=6, pressed_below=1900)}
        with closing(open_driver(config(servos, **more), expected())) as driver:
            taken = Taken(driver)
            assert (taken.rows(30)["buttons"] == 0).all()
            servos.move(6, 1200)
            taken.rows(10)
            assert (taken.rows(10)["buttons"] == 1).all()
            taken.take(10.0, lambda: taken.temperatures[-1].celsius.tolist() == [25, 25, 52])
            servos.silent.add(6)  # a button is no joint
            taken.take(10.0, lambda: "servo 6 does not answer" in driver.hindrance)
            take_valid(taken, 20)


@pytest.mark.slow
@BOTH
def test_after_another_connection_they_are_read_again(tmp_path, family):
    with driven(family, tmp_path, no_sync=(1, 2, 3)) as (servos, taken):
        taken.take(30.0, lambda: taken.told("no_sync_read"))
        servos.unplug()
        taken.take(10.0, lambda: taken.told("unplugged"))
        servos.plug()
        take_valid(taken, 50)
        taken.take(1.5)
    assert len(taken.told("no_sync_read")) == 1


@pytest.mark.slow
@BOTH
def test_a_replay_of_the_frames_is_bit_identical(tmp_path, family):
    with driven(family, tmp_path, no_sync=(1, 2, 3)) as (servos, taken):
        servos.before_reading = lambda cycle: servos.move(2, 2048 + 2 * cycle)
        taken.rows(50)

        def answer(servo, status):
            return [] if servo == 3 and len(servos.cycles) % 9 == 0 else [status]

        servos.before_answer = answer
        taken.rows(50)
        # In the middle of a cycle: one of its servos has answered, another has been asked.
        deadline = time.monotonic() + 20.0
        driver, middle_of_cycle = taken.driver, ["link", "tx", "rx", "tx"]
        while [frame.direction for frame in driver.preamble()][:4] != middle_of_cycle:
            assert time.monotonic() < deadline
            taken.items += taken.driver.read(0.0)
        preamble, began = taken.driver.preamble(), len(taken.items)
        taken.frames += taken.driver.take_raw()
        middle = len(taken.frames)
        taken.rows(100)
        servos.before_answer = None
    assert_replayed(servos, taken.frames, taken.items)
    assert_replayed(servos, [*preamble, *taken.frames[middle:]], taken.items[began:], len(preamble))
