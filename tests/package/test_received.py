"""What a subscriber believes, and what reaches a person's terminal."""

import json
import threading
import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

import armd
from armd import keys
from armd.daemon.commands.screen import Screen
from armd.printable import to_printable
from armd.received import KEPT_S, is_sound
from support.careless_network import EVENT, HEALTH, MEASUREMENT, careless_network, points

PATIENCE_S = 60.0


def put(session, what, *payloads):
    """Puts them once somebody is known to subscribe."""
    publisher = session.declare_publisher(f"armd/SIM-0001/{what}")
    end_s = time.monotonic() + PATIENCE_S
    while not publisher.matching_status.matching:
        assert time.monotonic() < end_s, "no subscriber is known"
        time.sleep(0.01)
    for payload in payloads:
        publisher.put(payload)
    publisher.undeclare()


def take_until(stream, enough):
    """The payloads that came until *enough* of them say so, and a moment longer."""
    payloads = []
    end_s = time.monotonic() + PATIENCE_S
    while not enough(payloads):
        assert time.monotonic() < end_s, payloads
        time.sleep(0.01)
        payloads += stream.take()
    time.sleep(0.1)
    return payloads + stream.take()


def take_seq(arm, stream, n=1):
    payloads = take_until(stream, lambda payloads: len(payloads) >= n)
    return list(arm.decode(payloads)["seq"])


BAD_POINTS = [b"", b"x", bytes(135), bytes(137), bytes(136 * 2)]
#: What a bridge or client fell over at some time, and what it could.
MALFORMED = [
    (keys.HEALTH, HEALTH, change)
    for change in (
        {"state": 3}, {"rates": {}}, {"rates": []}, {"temperatures": {"t1": "warm"}},
        {"stamp_ns": 1 << 70}, {"stamp_ns": 1.5}, {"tip": 7}, {"uptime_s": True},
        {"last_second": {"flagged": None}}, {"drops": None},
    )
] + [
    (keys.MEASUREMENT, MEASUREMENT, change)
    for change in (
        {"position_mm": [1, 2]}, {"position_mm": [1, 2, None]}, {"position_mm": [1e9, 0, 0]},
        {"position_mm": "near"}, {"orientation": None}, {"covariance_mm2": [1, 2, 3]},
        {"flags": -1}, {"seq": -1}, {"flag_names": "AT_REST"}, {"tip": ["x"]}, {"approach": 1},
        {"temperatures_c": {"t1": []}}, {"tip_offset_mm": [0, 0]},
        {"approach": [0, 0, 1e308]}, {"orientation": [0, 0, 0, 1e308]},
        {"standard_deviation_mm": [0.001, 0.001, 10**20 - 1]},
        {"standard_deviation_mm": [0.001, -0.001, 0.001]},
        {"covariance_mm2": [1e-4, 0, 0, 1e-4, 0, 10**20 - 1]},
    )
] + [
    (keys.EVENT, EVENT, change)
    for change in (
        {"stamp_ns": None}, {"text": 3}, {"detail": []}, {"detail": {"buttons": [-1]}},
        {"detail": {"buttons": "01"}}, {"detail": {"offset_mm": [1]}}, {"severity": None},
    )
]  # fmt: skip
BAD_MESSAGES = [
    b"", b"x", b"\xff\xfe", b"[1]", b"3", b"null", b"{", b"[" * 5000, b'{"state": 3}',
    b'{"text": null}', b'{"kind": []}', b'{"temperatures": "warm"}', b'{"seq": true}',
]  # fmt: skip


def test_what_is_malformed_is_passed_over_and_counted():
    with careless_network() as (publisher, _, arm):
        with arm.stream(keys.POINT) as stream, arm.stream(keys.HEALTH) as health:
            put(publisher, keys.POINT, *points(1), *BAD_POINTS, *points(2))
            publisher.delete("armd/SIM-0001/point")
            sound = json.dumps(HEALTH).encode()
            put(publisher, keys.HEALTH, *BAD_MESSAGES, sound)
            assert take_seq(arm, stream, 2) == [1, 2]
            assert take_until(health, bool) == [sound]
        assert arm.refused.malformed == len(BAD_POINTS) + 1 + len(BAD_MESSAGES)
        assert arm.lost.total == 0


@pytest.mark.slow
def test_a_stream_begins_whole_right_after_another_one_ended():
    """Fast points: of some hundred changes of subscription dozens fall between two of them."""
    ended = threading.Event()

    def publish(publisher):
        payload = np.zeros(1, armd.POINT)
        while not ended.is_set():
            publisher.put("armd/SIM-0001/point", payload.tobytes())
            payload["seq"] += 1
            time.sleep(100e-6)

    def answer(query):
        query.reply("armd/SIM-0001/health", b"{}")

    begun = 0
    with careless_network() as (publisher, _, arm):
        publisher.declare_queryable("armd/SIM-0001/health", answer)
        thread = threading.Thread(target=publish, args=(publisher,))
        thread.start()
        try:
            for _ in range(300):
                next(iter(arm.points()))
                with arm.stream(keys.POINT) as stream:
                    time.sleep(0.005)
                    arm.lost.begin()
                    begun += len(arm.decode(stream.take())) > 1
                assert arm.lost.total == 0
        finally:
            ended.set()
            thread.join()
    assert begun > 100


def test_a_client_keeps_to_the_publisher_it_met_first_until_that_is_silent():
    with careless_network() as (publisher, other, arm), arm.stream(keys.POINT) as stream:
        put(publisher, keys.POINT, *points(1))
        assert take_seq(arm, stream) == [1]
        put(other, keys.POINT, *points(100, 5))
        put(publisher, keys.POINT, *points(2))
        assert take_seq(arm, stream) == [2]
        assert take_until(stream, lambda _: arm.refused.foreign == 5) == []
        time.sleep(KEPT_S)  # as long as a daemon takes to start anew
        put(other, keys.POINT, *points(7))
        assert take_seq(arm, stream) == [7]


def test_a_pause_between_two_iterations_is_no_loss():
    over = threading.Event()

    def publish(publisher):
        seq = 0
        while not over.wait(0.002):
            seq += 1
            publisher.put("armd/SIM-0001/point", points(seq)[0])

    with careless_network() as (publisher, _, arm):
        thread = threading.Thread(target=publish, args=(publisher,))
        thread.start()
        try:
            last = []
            for _ in range(2):
                iteration = arm.points(10.0)
                last += [next(iteration).seq for _ in range(5)]
                iteration.close()
                time.sleep(0.3)
        finally:
            over.set()
            thread.join()
    assert last[5] - last[4] > 50  # there was a pause
    assert arm.lost.total == 0 and arm.lost.restarts == 0


@pytest.mark.parametrize("what, message", [
    (keys.HEALTH, HEALTH), (keys.MEASUREMENT, MEASUREMENT), (keys.EVENT, EVENT),
])  # fmt: skip
def test_each_message_needs_each_of_its_keys(what, message):
    optional = {"detail"}
    assert is_sound(what, json.dumps(message | {"something": [{"new": 1}]}).encode())
    for name in message.keys() - optional:
        rest = {key: value for key, value in message.items() if key != name}
        assert not is_sound(what, json.dumps(rest).encode()), name
    assert not is_sound(what, b"{}")


@pytest.mark.parametrize("what, message, change", MALFORMED)
def test_a_value_of_another_form_is_malformed(what, message, change):
    assert not is_sound(what, json.dumps(message | change).encode())


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", "9" * 5000])
def test_a_number_that_cannot_be_written_on_is_malformed(number):
    text = json.dumps(HEALTH | {"drift": "NUMBER"}).replace('"NUMBER"', number)
    assert not is_sound(keys.HEALTH, text.encode())


@given(st.binary(max_size=300), st.sampled_from([keys.EVENT, keys.HEALTH, keys.MEASUREMENT]))
def test_no_payload_makes_the_check_itself_fail(payload, what):
    is_sound(what, payload)
    is_sound(keys.POINT, payload)


@given(st.text())
def test_nothing_that_a_terminal_obeys_gets_through(text):
    assert to_printable(text).isprintable() or all(
        letter.isspace() or letter.isprintable() or not letter.isascii()
        for letter in to_printable(text)
    )
    assert "\x1b" not in to_printable(text) and "\n" not in to_printable(text)


@pytest.mark.parametrize("text", ["[/x]", "[bold", "\x1b[2J\x07", "a\nb", "\u202egnp", "\\[red]"])
def test_the_screen_shows_what_a_device_says_and_does_not_do_it(text):
    with careless_network() as (_, _, arm):
        arm.serial = f"SIM{text}"
        console = Console(record=True, width=90, force_terminal=False)
        with Screen(arm, console) as screen:
            screen._health = {"state": text, "reason": text, "temperatures": {"t1": "warm"}}
            screen._events = [text]
            screen.show(np.zeros(0, armd.POINT), 0.1)
        shown = console.export_text()
    assert to_printable(text) in shown and "\x1b[2J" not in shown and "\x07" not in shown
