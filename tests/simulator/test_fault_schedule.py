"""Faults by name and time: parsing, the schedule, random ones from a seed."""

from __future__ import annotations

from itertools import pairwise

import pytest

from armd.errors import BadInput
from armd.simulator.live.faults import (
    FAULTS,
    Fault,
    Schedule,
    check_wire,
    draw_faults,
    parse_fault,
)


def test_a_jump_of_the_usual_size_is_no_whole_turn_on_any_wire() -> None:
    """Of a servo, a MicroScribe's joint, an encoder of 20 or 23 bits: far beyond what a millisecond
    allows."""
    for bits in (12, 14, 20, 23):
        off = FAULTS["count_jump"].amount % (1 << bits) / (1 << bits) * 360
        assert min(off, 360 - off) > 10


def test_name_at_seconds_and_duration() -> None:
    fault = parse_fault("silence@2.5:0.8")
    assert (fault.name, fault.at_s, fault.seconds) == ("silence", 2.5, 0.8)
    assert parse_fault("unplug@1").seconds == FAULTS["unplug"].duration_s
    assert parse_fault("temperature_step@1").size == 5.0


@pytest.mark.parametrize("text", ["silence", "silence@", "silence@x", "silence@1:x", "silence@-1"])
def test_half_a_fault_is_refused(text: str) -> None:
    with pytest.raises(BadInput):
        parse_fault(text)


def test_a_fault_of_no_length_covers_one_latch() -> None:
    assert Fault(name="corrupted_byte", at_s=1.0).latches(1000) == range(1000, 1001)
    assert Fault(name="silence", at_s=1.0, duration_s=0.5).latches(200) == range(200, 300)


def test_the_schedule_tells_begin_and_end_once() -> None:
    schedule = Schedule(
        [
            Fault(name="silence", at_s=0.010, duration_s=0.020),
            Fault(name="corrupted_byte", at_s=0.015),
            Fault(name="silence", at_s=0.015, duration_s=0.002),
        ],
        1000,
    )
    seen: list[tuple[int, str, str]] = []
    for latch in range(50):
        if latch >= schedule.next_change:
            ended, begun = schedule.advance(latch)
            seen += [(latch, "end", fault.name) for fault in ended]
            seen += [(latch, "begin", fault.name) for fault in begun]
        assert schedule.is_on("silence") == (10 <= latch < 30)
    assert seen == [
        (10, "begin", "silence"),
        (15, "begin", "corrupted_byte"),
        (15, "begin", "silence"),
        (16, "end", "corrupted_byte"),
        (17, "end", "silence"),
        (30, "end", "silence"),
    ]


def test_random_faults_are_of_their_seed_their_wire_and_apart() -> None:
    faults = draw_faults(7, 12.0, 600.0, "can", 6)
    assert faults == draw_faults(7, 12.0, 600.0, "can", 6)
    assert faults != draw_faults(8, 12.0, 600.0, "can", 6)
    assert 60 < len(faults) < 180
    assert {fault.name for fault in faults} == {
        name for name, kind in FAULTS.items() if "can" in kind.wires
    }
    check_wire(faults, "can", 6)
    for one, next_one in pairwise(faults):
        assert next_one.at_s >= one.at_s + one.seconds + 1.99


def test_a_wire_has_its_own_faults() -> None:
    with pytest.raises(BadInput, match="unplug"):
        check_wire([Fault(name="unplug", at_s=1.0)], "can", 6)


def test_a_fault_is_of_a_joint_that_the_arm_has() -> None:
    seventh = Fault(name="missing_answer", at_s=1.0, joint=9)
    check_wire([seventh], "servo", 10)
    with pytest.raises(BadInput, match="fault missing_answer: joint: found 9, expected 1 to 6"):
        check_wire([seventh], "servo", 6)
    fourth = Fault(name="sensor_open", at_s=1.0, channel=4)
    with pytest.raises(BadInput, match="fault sensor_open: channel: found 4, expected 1 to 3"):
        check_wire([fourth], "serial", 3)
    few, many = (draw_faults(7, 12.0, 600.0, "serial", n) for n in (3, 9))
    assert {fault.joint for fault in few} == {1, 2, 3}
    assert {fault.joint for fault in many} == set(range(1, 10))
