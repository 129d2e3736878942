"""What looks like a position and is none, on the wire: refusals with data, a servo that comes back
as another. No such row is valid."""

import time
from contextlib import closing

import pytest

from armd.drivers.poll.protocol.families import FAMILIES
from armd.drivers.poll.protocol.family import Servo, list_differences
from armd.drivers.table import open_driver
from support.driven_servos import BOTH, Taken, config, driven, expected, state
from support.fake_servos import Dynamixel, FakeServos, Feetech

__all__ = ["state"]  # the fixture: what is remembered of servos is each test's own


def put_off(family, registers, counts):
    """As another tool would: the offset register, and from then on every position."""
    family.put_homing(registers, -counts if family is Feetech else counts)
    family.put_position(registers, 2048 + counts)


@pytest.mark.slow
@pytest.mark.parametrize("fast", [False, True], ids=["sync", "fast"])
def test_data_that_come_with_a_refusal_are_no_position(tmp_path, fast):
    """e-Manual, status packet: the low seven bits tell that the instruction was not done."""
    with driven(Dynamixel, tmp_path, knows_fast=fast) as (servos, taken):
        taken.rows(50)
        servos.errors[2] = 0x04  # data range; the alert's bit is not set
        servos.move(2, 2048 + 12)  # less than a jump
        rows = taken.rows(200)
        counters = taken.driver.counters
        servos.errors[2] = 0x80  # an alert: its data hold
        warned = taken.rows(100)
    refused = rows[10:]
    assert (refused["joint_invalid"] & 0b010).all() and counters["refused"] > 0
    read = warned[(warned["joint_invalid"] & 0b010) == 0][10:]  # a starved bus may lack some
    assert len(read) and (read["count"][:, 1] == 12).all()
    assert (read["joint_warning"] == 0b010).all()


@pytest.mark.serial
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


@pytest.mark.serial
@BOTH
def test_a_servo_that_was_away_shortly_is_soon_valid_again(tmp_path, family, punctuality):
    with driven(family, tmp_path) as (servos, taken):
        taken.rows(50)
        servos.silent.add(2)
        taken.take(0.25)
        servos.silent.clear()
        back_ns = time.monotonic_ns()
        with punctuality.watch() as machine:
            taken.take(60.0, lambda: taken.samples["joint_invalid"][-1] == 0)
        took_ns = int(taken.samples["monotonic_ns"][-1]) - back_ns
    assert taken.samples["joint_invalid"][-1] == 0
    machine.judge(took_ns * 1e-9, 0.2, "a servo that was away is valid again")
    assert not taken.told("offsets_changed")


def test_a_mode_that_ignores_the_offset_is_another_geometry():
    """e-Manual, Homing Offset(20): in position mode values beyond ±1024 are ignored."""
    family = FAMILIES["dynamixel"]

    def found(homing: int, mode: int) -> Servo:
        table = Dynamixel.table(1, homing=homing)
        table[11] = mode
        return family.identity(bytes(table[: family.identity_bytes]))

    remembered = found(-1500, 4).geometry
    (phrase,) = list_differences(found(-1500, 3), remembered, family)
    assert phrase == "offset in force (register 11): found False, expected True"
    assert not list_differences(found(-1500, 5), remembered, family)
    assert found(1024, 3).geometry == found(1024, 4).geometry
    older = {name: value for name, value in remembered.items() if name != "offset_in_force"}
    assert not list_differences(found(-1500, 3), older, family)  # as written before it was asked


def test_a_silent_line_says_what_came_in_place_of_answers(tmp_path):
    with driven(Feetech, tmp_path) as (servos, taken):
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
        servos.deaf = False
        taken.rows(20)
        servos.deaf = servos.echo = True  # the supply is off, and the adapter is not
        taken.take(2.0, lambda: len(taken.told("silence")) > 2)
    nothing, something, itself = [event.text for event in taken.told("silence")]
    at = f"nothing heard for 0.5 s on {servos.link} at 1000000 baud: found "
    answers = ", expected answers of feetech servos 1, 2, 3"
    assert nothing == f"{at}nothing{answers}"
    assert something == f"{at}18 bytes that are no answer (another device, or rate?){answers}"
    what = "what was asked, which the adapter hears (are the servos switched on?)"
    assert itself == f"{at}{what}{answers}"
