"""The servo driver over a pty: servos written from the manuals alone, and everything that goes
wrong with them, injected on the wire."""

import os
import time
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from armd.drivers import shell
from armd.drivers.config import Trigger
from armd.drivers.poll.protocol.families import FAMILIES
from armd.drivers.poll.sampler import ServoSampler
from armd.drivers.poll.servos.memory import Memory
from armd.drivers.ports import is_pseudo
from armd.drivers.table import open_driver
from support.driven_servos import BOTH, Taken, assert_replayed, config, driven, expected, state
from support.fake_servos import Dynamixel, FakeServos, Feetech

S = 1_000_000_000


__all__ = ["state"]  # the fixture: what is remembered of servos is each test's own


@BOTH
def test_positions_temperatures_and_numbers(tmp_path, family):
    with FakeServos(family, tmp_path) as servos:
        servos.registers[3][family.temperature] = 41
        for servo, position in ((1, 0), (2, 2048), (3, 4095)):
            servos.move(servo, position)
        with closing(open_driver(config(servos), expected())) as driver:
            taken = Taken(driver)
            rows = taken.rows(200)
    assert (rows["joint_invalid"] == 0).all() and rows["clock_mapped"].all()
    assert (rows["count"] == [-2048, 0, 2047]).all()
    assert rows["seq"][0] == 0 and (np.diff(rows["seq"].astype(int)) == 1).all()
    assert (np.diff(rows["monotonic_ns"]) > 0).all()
    assert taken.temperatures[0].celsius.tolist() == [25, 25, 41]
    assert driver.counters["samples"] == len(taken.samples)
    assert driver.counters["lost"] == driver.counters["missed"] == 0
    assert not servos.writes
    assert [event.kind for event in taken.events] == ["servo", "servo", "servo", "identified"]


@BOTH
def test_a_silent_servo_marks_its_own_joint_for_that_cycle(tmp_path, punctuality, family):
    with punctuality.watch() as machine, driven(family, tmp_path) as (servos, taken):
        taken.rows(50)
        quiet = []

        def leave_out(cycle, statuses):
            if cycle % 20 == 7:
                quiet.append(cycle)
                return [statuses[0], *statuses[2:]]
            return statuses

        servos.before_answers = leave_out
        servos.knows_fast = False
        rows = taken.rows(200)
        servos.before_answers = None
    missed = rows["joint_invalid"] != 0
    assert missed.sum() >= 5 and (rows["joint_invalid"][missed] == 0b010).all()
    assert set(rows["seq"][missed].tolist()) <= set(quiet)
    machine.judge_lost(int(rows["lost_before"].sum()), "cycles beside a silent servo")
    good = rows[~missed]
    assert (good["count"] == 0).all()
    told = len(taken.told("joint_invalid"))
    assert told
    machine.judge_lost(told - 1, "an event however it flickers")
    assert "servo 2" in taken.told("joint_invalid")[0].text
    assert taken.driver.counters["servo_2_missed"] == taken.driver.counters["missed"] == len(quiet)
    blank = [t for t in taken.temperatures if np.isnan(t.celsius[1])]
    assert blank and all(np.isfinite(t.celsius[[0, 2]]).all() for t in blank)


@pytest.mark.slow
@BOTH
def test_an_answer_late_by_a_cycle_is_never_taken_for_the_next(tmp_path, family):
    """Servo 2's answers come one cycle late now and then: before, or after, its next one."""
    with driven(family, tmp_path) as (servos, taken):
        taken.rows(20)
        kept = []
        truth = {}

        def move(cycle):
            servos.move(2, 2048 + cycle % 900)  # every cycle another position

        def late(cycle, statuses):
            truth[cycle] = cycle % 900
            if cycle % 10 == 3:
                kept.append(statuses[1])
                return [statuses[0], statuses[2]]
            if kept:
                stale = kept.pop()
                where = 1 if cycle % 20 < 10 else 2
                return [*statuses[:where], stale, *statuses[where:]]
            return statuses

        servos.before_reading, servos.before_answers = move, late
        rows = taken.rows(300)
        counters = taken.driver.counters
        servos.before_answers = None
    begun = rows[rows["seq"] > min(truth) + 1]  # it starts with a jerk
    valid = begun[begun["joint_invalid"] == 0]
    assert len(valid) > 200
    # 1200 °/s allow no more than 13 counts a cycle at 1 kHz: a count of motion is moved by < 1.
    apart = [abs(row["count"][1] - truth[int(row["seq"])]) for row in valid if row["seq"] in truth]
    assert max(apart) < 1.0
    assert counters["late"] > 10


@pytest.mark.slow
@BOTH
def test_stale_bytes_echo_and_noise_are_no_answers(tmp_path, family):
    with driven(family, tmp_path) as (servos, taken):
        servos.echo = True
        taken.rows(20)

        def dirty(cycle, statuses):
            if cycle % 5 == 1:  # noise that looks like a header, claims much, or is cut
                return [b"\xff\xff\xff", statuses[0], b"\xff\xff\xfd\x00\x01\xff", *statuses[1:]]
            if cycle % 5 == 3:  # one bit, with the length as it was
                spoilt = bytearray(statuses[1])
                spoilt[-3] ^= 0x10
                return [statuses[0], bytes(spoilt), statuses[2]]
            return statuses

        servos.before_answers = dirty
        rows = taken.rows(200)
        counters = taken.driver.counters
        servos.before_answers = None
    bad = rows["joint_invalid"] != 0
    assert (rows["joint_invalid"][bad] == 0b010).all()
    assert 0.1 < bad.mean() < 0.3
    assert (rows["count"][~bad] == 0).all()
    assert counters["echoes"] > 200 and counters["bad_sum"] > 20 and counters["junk"] > 0


class StandingStill:
    """`os`, for a host that stops before the twelfth of each *every* writes."""

    writes = 0

    def __init__(self, every, seconds):
        self.every, self.seconds = every, seconds

    def __getattr__(self, name):
        return getattr(os, name)

    def write(self, *arguments):
        self.writes += 1
        if self.writes % self.every == 12:
            time.sleep(self.seconds)
        return os.write(*arguments)


@pytest.mark.parametrize("where", ["before the request is out", "before the answers are read"])
def test_a_stall_costs_samples_and_neither_jumps_nor_passes_at_a_wrong_instant(
    tmp_path, monkeypatch, punctuality, where
):
    """All joints move at 260°/s; every 25th cycle the host stands still for 30 ms: unnoticed, the
    next cycle would seem to jump, and this one's instant would be wrong by 30 ms. It costs those
    rows in which a joint has leapt, until its servo has said who it is."""
    counts_per_s, stall_s = 3000.0, 0.03

    def true_count(at_ns):
        turn = (at_ns - began_ns) * 1e-9 * counts_per_s
        return turn[:, None] * [1, 1, -1]

    with driven(Feetech, tmp_path) as (servos, taken), punctuality.watch() as machine:
        taken.rows(40)  # what is usual
        began_ns = time.monotonic_ns()

        def turn(cycle):
            (counts,) = true_count(np.array([time.monotonic_ns()]))
            for servo, count in enumerate(counts, 1):
                servos.move(servo, round(2048 + count) % 4096)

        def late(cycle, statuses):
            if cycle % 25 == 12:
                time.sleep(stall_s)
            return statuses

        servos.before_reading = turn
        if where == "before the request is out":
            monkeypatch.setattr(shell, "os", StandingStill(25, stall_s))
        else:
            servos.before_answers = late
        rows = taken.rows(200)[20:]  # it starts with a jerk
        servos.before_reading = servos.before_answers = None
        counters = taken.driver.counters
    valid = rows[rows["joint_invalid"] == 0]
    apart = valid["count"] - true_count(valid["monotonic_ns"])
    apart = np.abs((apart + 2048) % 4096 - 2048)  # nobody can tell turns made in a long stall
    machine.judge_lost(max(0, 101 - len(valid)), "valid rows of joints that leap in a stall")
    assert apart.max() < 0.6 * stall_s * counts_per_s
    # 72 counts over a gap may be another offset (decision 12): only there is a joint invalid
    doubted = np.flatnonzero(rows["joint_invalid"] != 0)
    first = doubted[(doubted > 0) & (rows["joint_invalid"][doubted - 1] == 0)]
    assert (rows["monotonic_ns"][first] - rows["monotonic_ns"][first - 1] > 5_000_000).all()
    assert not taken.told("count_jump") and not taken.told("offsets_changed")
    assert 5 <= counters["untimed"] <= counters["lost"]
    (told,) = taken.told("untimed")  # once a minute at the most
    assert "its instant is in doubt by" in told.text and told.severity == "warning"
    assert rows["lost_before"].sum() >= 5


@pytest.mark.parametrize(("step", "comes"), [(1, True), (60, False), (1500, True)])
def test_a_cycle_in_doubt_is_left_out_for_a_motion_not_for_a_jump(step, comes):
    """1500 counts in 15 ms are no motion: that joint is invalid, whenever it was."""
    sampler = ServoSampler([1, 2, 3], 1200.0)
    rows = []
    for number, at_s in enumerate((0.0, 0.01, 0.02, 0.03)):
        raw = 2100 + (step if number == 3 else 0)
        late_ns = 7_000_000 if number == 3 else 0  # beyond an adapter's 2 ms
        items = sampler.sample(number, [raw, 7, 7], [at_s * S] * 3, late_ns, 0, 0, 0, None)
        rows += [item for item in items if isinstance(item, np.ndarray)]
    assert len(rows) == 3 + comes and sampler.untimed == (not comes)
    assert rows[-1]["joint_invalid"][0] == (step == 1500)


def test_a_joint_that_is_silent_right_after_a_pause_has_not_leapt():
    """1000 counts from the middle of a turn, where a count that is missing must not seem to be."""
    sampler = ServoSampler([1, 2, 3], 1200.0)
    rows = []
    for number, at_s in enumerate((0.0, 0.01, 0.02, 0.32, 0.33)):
        raw = [3048, None if number == 3 else 3048, 3048]
        items = sampler.sample(number, raw, [at_s * S] * 3, 0, 0, 0, 0, None)
        rows += [item for item in items if isinstance(item, np.ndarray)]
    assert [int(row["joint_invalid"][0]) for row in rows] == [0, 0, 0, 0b10, 0]


def test_a_cycle_in_which_nobody_answers_was_never_there(tmp_path):
    with driven(Feetech, tmp_path) as (servos, taken):
        taken.rows(20)
        empty = []

        def nothing(cycle, statuses):
            if cycle % 25 == 10:
                empty.append(cycle)
                return []
            return statuses

        servos.before_answers = nothing
        rows = taken.rows(100)
        servos.before_answers = None
        counters = taken.driver.counters
    assert empty and not set(rows["seq"].tolist()) & set(empty)
    after = rows[np.isin(rows["seq"], np.array(empty) + 1)]
    assert after["lost_before"].all() and rows["lost_before"].sum() == len(after)
    assert counters["lost"] == len(set(range(int(rows["seq"][-1]))) & set(empty))


def test_fast_sync_read_is_used_and_fallen_back_from(tmp_path):
    with driven(Dynamixel, tmp_path, knows_fast=True) as (servos, taken):
        rows = taken.rows(100)
        asked = [instruction for instruction, _, _ in servos.requests]
        assert asked.count(0x8A) >= 100 and asked.count(0x82) < 10
        servos.break_chain_at = 2  # from now on the chain ends with servo 1
        servos.requests.clear()
        rows = taken.rows(100)
        asked = [instruction for instruction, _, _ in servos.requests]
    # A broken chain takes nobody's answer away: the same cycle is asked once more, in the old way.
    # A machine that stands still loses a cycle; chains would lose a hundred.
    assert (rows["joint_invalid"] == 0).all() and rows["lost_before"].sum() < 5
    assert (np.diff(rows["seq"].astype(int)) == 1).mean() > 0.95
    assert asked.count(0x8A) <= 3  # and then no more


def test_of_a_fast_answer_each_servo_is_held_to_its_own_checksum(tmp_path):
    """A block that is damaged before the later servos answer: their checksums, and so the whole
    packet's, hold over what is wrong."""
    with driven(Dynamixel, tmp_path, knows_fast=True) as (servos, taken):
        taken.rows(50)
        servos.spoils = {2: 0x40}
        taken.rows(2)
        servos.spoils = {}
        taken.rows(50)
        rows = taken.samples[50:]
    spoilt = rows["joint_invalid"] != 0
    assert (rows["joint_invalid"][spoilt] == 0b010).all() and 1 <= spoilt.sum() < 50
    assert (rows["count"][~spoilt] == 0).all() and (rows["count"][:, [0, 2]] == 0).all()


@pytest.mark.serial
@BOTH
def test_silence_reboot_and_replug(tmp_path, family, punctuality):
    with driven(family, tmp_path) as (servos, taken):
        taken.rows(50)
        servos.deaf = True
        taken.take(0.8)
        assert taken.told("silence") and not taken.driver.connected
        servos.deaf = False
        back_ns = time.monotonic_ns()
        with punctuality.watch() as machine:
            rows = taken.rows(5)
        assert rows["lost_before"][0]
        machine.judge((rows["monotonic_ns"][0] - back_ns) / S, 1.0, "servos recover from silence")
        assert taken.told("recovered")
        servos.unplug()
        taken.take(0.3)
        assert taken.told("unplugged")
        servos.plug()
        back_ns = time.monotonic_ns()
        with punctuality.watch() as machine:
            rows = taken.rows(5)
        machine.judge((rows["monotonic_ns"][0] - back_ns) / S, 2.0, "servos recover, plugged again")
        assert (rows["joint_invalid"] == 0).all() and taken.driver.connected
        # One servo starts anew, silent for a while: whoever comes back must say who he is.
        servos.silent.add(2)
        taken.take(0.7)
        family.put_homing(servos.registers[2], 33)
        servos.silent.clear()
        taken.take(2.0, lambda: taken.told("offsets_changed"))
        assert "servo 2 (joint 2)" in taken.told("offsets_changed")[0].text
        rows = taken.rows(20)
    during = taken.samples[taken.samples["monotonic_ns"] > back_ns]
    assert (rows["joint_invalid"] == 0b010).all()
    came_back = np.flatnonzero(during["joint_invalid"] == 0)[-1]
    assert (during["joint_invalid"][came_back + 1 :] == 0b010).all()  # never valid in between


@BOTH
def test_only_what_the_configuration_names_is_written(tmp_path, family):
    with FakeServos(family, tmp_path) as servos:
        servos.registers[1][family.torque] = servos.registers[3][family.torque] = 1
        servos.registers[2][family.delay] = 250
        wanted = {"torque_off": True, "return_delay_us": 0}
        with closing(open_driver(config(servos, **wanted), expected())) as driver:
            taken = Taken(driver)
            taken.take(5.0, lambda: len(taken.told("torque_off")) == 2)
            taken.rows(50)
            assert driver.hindrance == ""
    assert {(s, a) for s, a, _ in servos.writes} >= {(1, family.torque), (3, family.torque)}
    assert {a for _, a, _ in servos.writes} == {family.torque, family.delay}
    assert all(data == b"\0" for _, _, data in servos.writes)
    assert len(servos.writes) == len(set(servos.writes))


@BOTH
def test_a_write_that_is_not_kept_is_told_once(tmp_path, family):
    with FakeServos(family, tmp_path) as servos:
        servos.registers[2][family.delay] = 250
        servos.refuses.add(family.delay)
        with closing(open_driver(config(servos, return_delay_us=0), expected())) as driver:
            taken = Taken(driver)
            of_servo_2 = "servo 2 (joint 2)"
            taken.take(5.0, lambda: any(of_servo_2 in e.text for e in taken.told("write_refused")))
            taken.rows(50)
    (event,) = [event for event in taken.told("write_refused") if of_servo_2 in event.text]
    words = f"servo 2 (joint 2): return delay (register {family.delay}): found 500, expected 0"
    assert event.text.startswith(words)
    assert len([write for write in servos.writes if write[0] == 2]) == 1  # and not tried for ever


@pytest.mark.serial
@BOTH
def test_button_and_temperatures_of_other_servos(tmp_path, family, punctuality):
    with FakeServos(family, tmp_path, (1, 2, 3, 6)) as servos:
        servos.registers[6][family.temperature] = 52
        more = {
            "temperature_ids": [2, 3, 6],
            "trigger": Trigger(id=6, pressed_below=1900),
        }
        with closing(open_driver(config(servos, **more), expected())) as driver:
            taken = Taken(driver)
            assert (taken.rows(50)["buttons"] == 0).all()
            assert taken.temperatures[-1].celsius.tolist() == [25, 25, 52]
            servos.move(6, 1200)
            taken.rows(10)
            assert (taken.rows(10)["buttons"] == 1).all()
            servos.silent.add(6)  # a button is no joint
            rows = taken.rows(20)
            assert (rows["joint_invalid"] == 0).all()
            taken.take(1.5)
            assert "servo 6 does not answer" in driver.hindrance
            servos.registers[2][family.temperature] = 26
            servos.silent.clear()
            with punctuality.limit(1.3, "a servo's temperature is read again"):
                taken.take(60.0, lambda: taken.temperatures[-1].celsius.tolist() == [26, 25, 52])


def test_a_pseudo_terminal_is_told_from_a_port(tmp_path):
    """On the former the driver pauses after a request, for the kernel thread that carries it."""
    master, slave = os.openpty()
    with (tmp_path / "file").open("w") as file, Path("/dev/null").open() as null:
        assert is_pseudo(slave)
        assert not is_pseudo(file.fileno()) and not is_pseudo(null.fileno())
    os.close(master)
    os.close(slave)


@pytest.mark.slow
@BOTH
def test_a_replay_of_the_frames_is_bit_identical(tmp_path, family):
    with driven(family, tmp_path, knows_fast=True) as (servos, taken):
        servos.before_reading = lambda cycle: servos.move(2, 2048 + 2 * cycle)
        taken.rows(50)
        servos.before_answers = lambda cycle, statuses: statuses[: 2 + (cycle % 9 > 0)]
        taken.rows(50)
        preamble, began = taken.driver.preamble(), len(taken.items)
        taken.frames += taken.driver.take_raw()
        middle = len(taken.frames)
        taken.rows(100)
        servos.before_answers = None
    assert_replayed(servos, taken.frames, taken.items)
    assert_replayed(servos, [*preamble, *taken.frames[middle:]], taken.items[began:], len(preamble))


def test_a_foreign_adapter_is_nobodys_arm(tmp_path):
    with (
        FakeServos(Feetech, tmp_path) as servos,
        closing(open_driver(config(servos, adapter_serial="A1B2"), expected())) as driver,
    ):
        rows = Taken(driver).rows(20)
        assert (rows["joint_invalid"] == 0b111).all()
        assert "serial number: found none, expected A1B2" in driver.hindrance


def test_a_damaged_memory_is_told_and_nothing_is_valid(tmp_path):
    memory = Memory("SERVO-1", FAMILIES["feetech"])
    memory.path.parent.mkdir()
    memory.path.write_text("{")
    with driven(Feetech, tmp_path) as (_, taken):
        rows = taken.rows(20)
        assert (rows["joint_invalid"] == 0b111).all()
        assert str(memory.path) in taken.driver.hindrance
    assert memory.path.read_text() == "{"
