"""Whatever is refused of a servo names servo, register, what was found and what was expected; of
several servos everything is named, and one that is back is asked at once."""

import pytest

from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.poll.decoder import ServoDecoder, encode_note
from armd.drivers.poll.plan import RequestPlan
from armd.drivers.poll.protocol.families import FAMILIES
from armd.drivers.poll.protocol.family import Servo, list_differences
from armd.drivers.sample import RawFrame

S = 1_000_000_000
BOTH = pytest.mark.parametrize("kind", ["feetech", "dynamixel"])
GOOD = {
    "feetech": Servo(777, "3.10", 0, False, 0, False, 100),
    "dynamixel": Servo(1060, "45", 0, False, 3, False, 0),
}


def as_found(kind, **registers):
    return Servo(**(GOOD[kind].as_json() | registers))


def feed(decoder, **fields):
    return decoder.feed(RawFrame(10**9, 10**18, "link", encode_note(**fields), "poll"))


def decoder_of(kind, *servos):
    config = ServoConfig(kind=kind, port="/dev/null", ids=[1, 2, 3])
    decoder = ServoDecoder(config, Expectation("ARM", 3, 3, (4096,) * 3))
    feed(decoder, note="up")
    events = []
    for servo, found in enumerate(servos, 1):
        events += decoder.roster.identify(servo, found, 10**9)
    return decoder, events


@BOTH
@pytest.mark.parametrize(
    ("name", "found", "told"),
    [
        ("homing_offset", -120, "found -120, expected 0"),
        ("reversed", True, "found True, expected False"),
        ("model", {"feetech": 2825, "dynamixel": 1020}, None),
    ],
)
def test_what_differs_from_the_remembered(kind, name, found, told):
    found = found[kind] if isinstance(found, dict) else found
    family, other = FAMILIES[kind], as_found(kind, **{name: found})
    (phrase,) = list_differences(other, GOOD[kind].geometry, family)
    if told is None:
        told = f"found {family.models[found]}, expected {family.models[GOOD[kind].model]}"
    assert phrase == f"{family.register(name)}: {told}"
    address = {
        "feetech": {"homing_offset": 31, "reversed": 18, "model": 3},
        "dynamixel": {"homing_offset": 20, "reversed": 10, "model": 0},
    }[kind][name]
    assert f"(register {address})" in phrase
    decoder, _ = decoder_of(kind, GOOD[kind], other, GOOD[kind])
    events = feed(decoder, note="verdict", changed={2: [phrase]})
    assert [event.severity for event in events] == ["error"]
    assert events[0].text.startswith(f"servo 2 (joint 2): {phrase}")
    assert phrase in decoder.roster.hindrance(10**9)
    assert decoder.roster.unusable == 0b010


@BOTH
def test_a_torque_that_is_on(kind):
    decoder, events = decoder_of(kind, GOOD[kind], GOOD[kind], as_found(kind, torque=True))
    (event,) = [event for event in events if event.kind == "torque_on"]
    address = {"feetech": 40, "dynamixel": 64}[kind]
    words = f"servo 3 (joint 3): torque (register {address}): found 1 (on, it holds the joint), "
    assert event.text.startswith(words + "expected 0")
    assert decoder.roster.hindrance(10**9) == "servo 3 (joint 3): its torque is on"


@BOTH
def test_an_id_that_does_not_answer(kind):
    decoder, _ = decoder_of(kind, GOOD[kind], GOOD[kind])
    (event,) = feed(decoder, note="missing", servos=[3])
    words = "servo 3 (joint 3): found no answer on /dev/null to id 3, expected one"
    assert event.text.startswith(words)
    decoder, _ = decoder_of(kind, GOOD[kind], GOOD[kind])
    decoder.roster.doubles.contradicted(3, 10**9)
    (event,) = feed(decoder, note="missing", servos=[3])
    assert "found two answers that differ on /dev/null to id 3, expected one" in event.text


@pytest.mark.parametrize("model", [0x0405, 0x0504], ids=["as it is read", "as it is meant"])
def test_servos_of_the_scs_series_are_refused(model):
    """Their words are big-endian, and what would be read of them is nonsense."""
    decoder, events = decoder_of("feetech", as_found("feetech", model=model), GOOD["feetech"])
    (event,) = [event for event in events if event.kind == "servo_refused"]
    words = f"servo 1 (joint 1): model (register 3): found {model}, a servo of the SCS series"
    assert event.text.startswith(words) and "expected one of the STS or SMS series" in event.text
    assert decoder.roster.hindrance(10**9).startswith(words)
    assert decoder.roster.unusable & 0b001
    kinds = [event.kind for event in decoder.roster.identify(1, GOOD["feetech"], 10**9)]
    assert "servo_refused" not in kinds
    assert not decoder.roster.unusable & 0b001


@pytest.mark.parametrize("model", [777, 2825, 11272])
def test_no_servo_of_the_other_series_is_refused(model):
    assert FAMILIES["feetech"].refusal(as_found("feetech", model=model)) == ""


@BOTH
def test_everything_that_is_in_the_way_is_named_not_the_first_alone(kind):
    roster = decoder_of(kind)[0].roster
    for each, torque in ((1, False), (2, True)):
        roster.identify(each, as_found(kind, torque=torque), 10 * S)
    assert roster.hindrance(10 * S + 1) == (
        "servo 3 (joint 3) does not answer; servo 2 (joint 2): its torque is on"
    )


@BOTH
def test_of_a_servo_that_is_back_the_temperature_is_asked_at_once(kind):
    decoder, _ = decoder_of(kind)
    plan, warm_bytes = RequestPlan(decoder, 0), FAMILIES[kind].warm_bytes
    plan.restart(0)
    for each in (1, 2, 3):
        decoder.roster.identify(each, GOOD[kind], 0)

    def asks_warmth(now_ns):
        request = plan.cycle(now_ns)
        plan.note_sent(request, now_ns)
        return request.length >= warm_bytes

    assert asks_warmth(0)
    assert not asks_warmth(S // 100)
    decoder.roster.ask_anew(2)
    assert not asks_warmth(S // 50)
    decoder.roster.identify(2, GOOD[kind], S // 40)
    assert asks_warmth(S // 30) and not asks_warmth(S // 20)
