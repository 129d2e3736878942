"""What is said of several servos at once, and what is asked of one that is back."""

import pytest

from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.poll.decoder import ServoDecoder
from armd.drivers.poll.plan import RequestPlan
from armd.drivers.poll.protocol.families import FAMILIES
from armd.drivers.poll.protocol.family import Servo

S = 1_000_000_000
BOTH = pytest.mark.parametrize("kind", ["feetech", "dynamixel"])


def decoder_of(kind):
    config = ServoConfig(kind=kind, port="/dev/null", ids=[1, 2, 3])
    return ServoDecoder(config, Expectation("S", 3, 3, (4096,) * 3))


def servo(torque=False):
    return Servo(1060, "45", 0, False, 3, torque, 0)


@BOTH
def test_everything_that_is_in_the_way_is_named_not_the_first_alone(kind):
    roster = decoder_of(kind).roster
    for each, torque in ((1, False), (2, True)):
        roster.identify(each, servo(torque), 10 * S)
    assert roster.hindrance(10 * S + 1) == (
        "servo 3 (joint 3) does not answer; servo 2 (joint 2): its torque is on"
    )


@BOTH
def test_of_a_servo_that_is_back_the_temperature_is_asked_at_once(kind):
    decoder = decoder_of(kind)
    plan, warm_bytes = RequestPlan(decoder, 0), FAMILIES[kind].warm_bytes
    plan.restart(0)
    for each in (1, 2, 3):
        decoder.roster.identify(each, servo(), 0)

    def asks_warmth(now_ns):
        request = plan.cycle(now_ns)
        plan.note_sent(request, now_ns)
        return request.length >= warm_bytes

    assert asks_warmth(0)
    assert not asks_warmth(S // 100)
    decoder.roster.ask_anew(2)
    assert not asks_warmth(S // 50)
    decoder.roster.identify(2, servo(), S // 40)
    assert asks_warmth(S // 30) and not asks_warmth(S // 20)
