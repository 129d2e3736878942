"""Two servos of one id, on the wire: both are told, and nothing of either is believed, whenever the
second of them answers."""

import time
from contextlib import closing

import numpy as np
import pytest

from armd.drivers.poll.servos.doubles import Doubles
from armd.drivers.table import open_driver
from support.driven_servos import BOTH, Taken, config, driven, expected, state
from support.fake_servos import FakeServos
from support.selection import parametrize_default

__all__ = ["state"]  # the fixture: what is remembered of servos is each test's own
#: Which second answers are too late for their own cycle.
WHEN = parametrize_default(
    "is_late",
    [lambda cycle: False, lambda cycle: True, lambda cycle: cycle % 10 == 9],
    default=(1,),
    ids=["in-time", "late", "now-and-then-late"],
)
MS = 1_000_000


class Second:
    """Another servo *id* on the line of *servos*, which answers cycles after the first."""

    def __init__(self, servos, servo, is_late, celsius=25):
        self.servos, self.id, self.is_late, self.celsius = servos, servo, is_late, celsius
        self.late = []
        servos.knows_fast = False
        servos.before_answers = self.answers

    def answers(self, cycle, statuses):
        family = self.servos.family
        _, length, ids = family.span(self.servos.requests[-1][2])
        late, self.late = self.late, []
        if self.id not in ids:
            return [*late, *statuses]
        other = bytearray(self.servos.registers[self.id])
        family.put_position(other, 2050 + cycle % 7)
        other[family.temperature] = self.celsius
        second = family.status(self.id, 0, other[family.position : family.position + length])
        if self.is_late(cycle):
            self.late = [second]
            return [*late, *statuses]
        return [*late, *statuses, second]


def assert_told_once(taken, hindrance, words, machine):
    told = [event.text.startswith(words) for event in taken.told("duplicate_id")]
    assert told and all(told) and hindrance.startswith(words)
    machine.judge_lost(len(told) - 1, "one event of a double")


@pytest.mark.slow
@BOTH
@WHEN
@parametrize_default("servo", [1, 3], ids=["first", "last"])
def test_two_servos_of_one_id_are_told_and_none_of_them_is_believed(
    tmp_path, punctuality, family, is_late, servo
):
    with punctuality.watch() as machine, driven(family, tmp_path) as (servos, taken):
        taken.rows(20)
        Second(servos, servo, is_late)
        begun = time.monotonic_ns()
        rows = taken.rows(300)
        hindrance = taken.driver.hindrance
        warm = [t for t in taken.temperatures if t.monotonic_ns > begun + 50 * MS]
        servos.before_answers = None
        rows_after = taken.take(0.8).rows(20)
    rows = rows[rows["monotonic_ns"] > begun + 50 * MS]
    doubled = 1 << (servo - 1)
    assert len(rows) > 100 and (rows["joint_invalid"] & doubled != 0).all()
    machine.judge_lost(int((rows["joint_invalid"] != doubled).sum()), "rows of the other joints")
    register = {"feetech": 5, "dynamixel": 7}[family.kind]
    words = f"servo {servo} (joint {servo}): id (register {register}): found two answers that"
    assert_told_once(taken, hindrance, words, machine)
    assert all(np.isnan(each.celsius[servo - 1]) for each in warm)
    machine.judge_lost(int((rows_after["joint_invalid"] != 0).sum()), "rows after the double")
    assert np.isfinite(taken.temperatures[-1].celsius).all()


@pytest.mark.slow
@BOTH
@WHEN
def test_a_thermometer_of_which_there_are_two_has_no_temperature(
    tmp_path, punctuality, family, is_late
):
    """It is asked twice a second alone; its first answer is never told, as the second may be late.
    The joints are not touched."""
    with (
        punctuality.watch() as machine,
        FakeServos(family, tmp_path, (1, 2, 3, 6)) as servos,
        closing(open_driver(config(servos, temperature_ids=[2, 3, 6]), expected())) as driver,
    ):
        taken = Taken(driver)
        taken.take(0.7)
        Second(servos, 6, is_late, celsius=60)
        servos.registers[6][family.temperature] = 35
        begun = len(taken.temperatures)
        taken.take(4.0)
        read_c = np.array([each.celsius for each in taken.temperatures[begun:]])
        hindrance = driver.hindrance
        servos.before_answers = None
        taken.take(4.0, lambda: taken.temperatures[-1].celsius.tolist() == [25, 25, 35])
    ours = read_c[:, 2]
    assert np.isnan(ours[2:]).all() and not np.isin(ours, [35, 60]).any()
    assert (read_c[:, :2] == 25).all()
    machine.judge_lost(int((taken.samples["joint_invalid"] != 0).sum()), "rows of all joints")
    register = {"feetech": 5, "dynamixel": 7}[family.kind]
    words = f"servo 6: id (register {register}): found two answers that differ, expected one"
    assert_told_once(taken, hindrance, words, machine)
    assert taken.temperatures[-1].celsius.tolist() == [25, 25, 35]


@BOTH
def test_one_stray_answer_costs_a_tenth_of_a_second(tmp_path, family, punctuality):
    with punctuality.watch() as machine, driven(family, tmp_path) as (servos, taken):
        taken.rows(20)
        first = len(servos.cycles)
        Second(servos, 2, lambda cycle: cycle == first + 2)
        taken.take(5.0, lambda: len(servos.cycles) > first)
        servos.before_answers = None
        begun = time.monotonic_ns()
        taken.take(0.6)
    rows = taken.samples
    invalid = rows["joint_invalid"] != 0
    assert invalid.any() and not taken.told("duplicate_id")
    later = rows["monotonic_ns"] > begun + 250 * MS
    machine.judge_lost(int(invalid[later].sum()), "rows long after the stray answer")


def test_how_long_a_doubt_lasts():
    doubles = Doubles(often=[1, 2])
    assert not doubles.contradicted(1, 0) and not doubles.contradicted(6, 0)
    doubles.heard(1, 99 * MS)
    assert 1 in doubles and 6 in doubles and 2 not in doubles
    doubles.heard(1, 101 * MS)
    assert 1 not in doubles
    assert [doubles.contradicted(1, k * MS) for k in (200, 300, 400, 500)] == [0, 0, 1, 0]
    assert not doubles.contradicted(6, 500 * MS) and doubles.contradicted(6, 1000 * MS)
    assert doubles.certain == [6, 1]
    doubles.heard(1, 1000 * MS)
    assert doubles.certain == [6, 1]
    other = Doubles(often=[1, 2])
    other.restore(doubles.state())
    for each in (doubles, other):
        each.heard(1, 1001 * MS)
        assert each.certain == [6]
        each.heard(6, 2500 * MS)
        assert 6 in each
        each.heard(6, 2601 * MS)
        assert 6 not in each and not each.certain
