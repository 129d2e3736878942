"""What a servo's thermometer says that cannot be, on bytes and on the wire: it is missing, with its
reason, never a number."""

import math

import numpy as np
import pytest

from armd.drivers.poll.decoder import ServoDecoder
from armd.drivers.poll.protocol.families import FAMILIES
from armd.drivers.poll.servos.warmth import Warmth
from armd.drivers.sample import Event, Temperatures
from support.driven_servos import BOTH, config, driven, expected, state
from support.fake_servos import Dynamixel
from support.selection import parametrize_default

__all__ = ["state"]  # the fixture: what is remembered of servos is each test's own
S = 1_000_000_000
REGISTER = {"feetech": 63, "dynamixel": 146}


@BOTH
def test_a_byte_is_a_temperature_from_0_to_100(family):
    """Neither maker's library takes it for signed (`readByte`; the `.model` tables' sign types),
    and both limit registers go from 0 to 100."""
    believed, events = {}, {}
    for byte in range(256):
        data = bytearray(15)
        data[{"feetech": 7, "dynamixel": 14}[family.kind]] = byte
        warmth = Warmth([4], lambda servo: f"servo {servo}", "temperature")
        warmth.hear(4, FAMILIES[family.kind].celsius_of(bytes(data)))
        *told, temperatures = warmth.reading((), (), 1 * S, 0)
        (celsius,) = temperatures.celsius.tolist()
        (events if math.isnan(celsius) else believed)[byte] = told if told else celsius
    assert believed == {byte: byte for byte in range(101)}
    assert sorted(events) == [*range(101, 256)] and all(map(len, events.values()))


def test_it_is_told_once_and_again_after_five_good_seconds():
    warmth = Warmth([4], lambda servo: f"servo {servo}", "temperature (register 63)")
    told = []
    for at_s, celsius in ((1, 255), (2, 30), (3, 255), (7, 30), (9, 30), (10, 200)):
        warmth.hear(4, celsius)
        items = warmth.reading((), (), at_s * S, 0)
        told += [(at_s, item.text) for item in items if isinstance(item, Event)]
    words = (
        "servo 4: temperature (register 63): found {}, expected 0 to 100 °C; it counts as missing"
    )
    assert told == [(1, words.format(255)), (10, words.format(200))]


@BOTH
@pytest.mark.parametrize("fast", [False, True], ids=["sync", "fast"])
@parametrize_default("byte", [255, 128, 101])
def test_a_broken_thermometer_is_missing_at_once_and_says_why(tmp_path, family, byte, fast):
    def heard(of):
        return lambda: of(taken.temperatures[-1].celsius)

    with driven(family, tmp_path, knows_fast=fast and family is Dynamixel) as (servos, taken):
        taken.rows(20).tolist()
        taken.take(2.0, lambda: bool(taken.temperatures))
        assert taken.temperatures[-1].celsius.tolist() == [25, 25, 25]
        servos.registers[2][family.temperature] = byte
        taken.take(3.0, heard(lambda celsius: math.isnan(celsius[1])))
        broken = taken.temperatures[-1].celsius
        servos.registers[2][family.temperature] = 26
        taken.take(3.0, heard(lambda celsius: celsius[1] == 26))
        rows = taken.samples
    assert broken[[0, 2]].tolist() == [25, 25] and math.isnan(broken[1])
    (event,) = taken.told("temperature_absurd")
    words = f"servo 2 (joint 2): temperature (register {REGISTER[family.kind]}): found {byte}"
    assert event.text == f"{words}, expected 0 to 100 °C; it counts as missing"
    assert {value for t in taken.temperatures for value in t.celsius if value == value} == {25, 26}
    assert (rows["joint_invalid"] == 0).all()  # its position has nothing to do with it

    again = ServoDecoder(config(servos), expected())  # what was recorded tells the same
    items = [item for frame in taken.frames for item in again.feed(frame)]
    told = [item.celsius for item in items if isinstance(item, Temperatures)]
    assert np.array_equal(told, [t.celsius for t in taken.temperatures], equal_nan=True)
    assert [i.text for i in items if isinstance(i, Event)] == [e.text for e in taken.events]
