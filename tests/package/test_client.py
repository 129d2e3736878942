"""The client: iterators that end, snapshots, callbacks, and errors without foreign paths."""

from __future__ import annotations

import asyncio
import json
import threading
import time
from contextlib import contextmanager

import pytest

import armd
from support.careless_network import EVENT, HEALTH, MEASUREMENT, careless_network, points
from support.running_daemon import free_endpoint


@contextmanager
def repeated(session, **payloads):
    """Puts each payload again and again: whoever subscribes late hears it too."""
    stop = threading.Event()

    def publish():
        while not stop.wait(0.02):
            for what, payload in payloads.items():
                session.put(f"armd/SIM-0001/{what}", payload)

    thread = threading.Thread(target=publish)
    thread.start()
    yield
    stop.set()
    thread.join()


@contextmanager
def answering(session, payload):
    """Answers what asks for health."""
    key = "armd/SIM-0001/health"
    queryable = session.declare_queryable(key, lambda query: query.reply(key, payload))
    yield
    queryable.undeclare()


def state_at_last(arm):
    """Once the network has carried that somebody answers."""
    end_s = time.monotonic() + 60.0
    while True:
        try:
            return arm.state()
        except armd.NoAnswer:
            assert time.monotonic() < end_s
            time.sleep(0.05)


def test_the_latest_point_and_that_none_comes():
    with careless_network() as (publisher, _, arm):
        with pytest.raises(armd.NoAnswer, match=r"SIM-0001: no point within 0.1 s") as raised:
            arm.latest(0.1)
        assert isinstance(raised.value, TimeoutError) and isinstance(raised.value, armd.ArmdError)
        with repeated(publisher, point=points(7)[0]):
            assert arm.latest(60.0).seq == 7


def test_the_state_is_the_last_health_message():
    with careless_network() as (publisher, _, arm):
        with pytest.raises(armd.NoAnswer, match="no answer; is the daemon running"):
            arm.state()
        with answering(publisher, json.dumps(HEALTH).encode()):
            assert state_at_last(arm) == HEALTH


def test_a_malformed_answer_is_an_error_with_its_key():
    found = "armd/SIM-0001/health: found .*state.*expected armd's message"
    with (
        careless_network() as (publisher, _, arm),
        answering(publisher, b'{"state": 3}'),
        pytest.raises(armd.ArmdError, match=found),
    ):
        state_at_last(arm)


def test_callbacks_get_what_comes_until_their_handle_is_closed():
    heard: dict[str, list[dict]] = {"measurement": [], "event": []}
    with careless_network() as (publisher, _, arm):
        handles = [
            arm.on_measurement(heard["measurement"].append),
            arm.on_event(heard["event"].append, past=True),
        ]
        messages = {"measurement": MEASUREMENT, "event": EVENT}
        with repeated(publisher, **{w: json.dumps(m).encode() for w, m in messages.items()}):
            end_s = time.monotonic() + 60
            while not all(heard.values()) and time.monotonic() < end_s:
                time.sleep(0.01)
            for handle in handles:
                handle.close()
            assert heard["measurement"][0] == MEASUREMENT and heard["event"][0] == EVENT
            time.sleep(0.1)  # what was under way
            n = len(heard["measurement"])
            time.sleep(0.2)
            assert len(heard["measurement"]) == n


def test_async_points():
    async def read(arm):
        seen = []
        async for point in arm.points_async():
            seen.append(point.seq)
            if len(seen) == 3:
                break
        return seen

    with careless_network() as (publisher, _, arm), repeated(publisher, point=points(7)[0]):
        assert asyncio.run(asyncio.wait_for(read(arm), 60.0)) == [7, 7, 7]


@pytest.mark.parametrize("seconds", [None, 1000.0])
def test_a_loop_ends_when_another_thread_closes_the_arm(seconds):
    ended = threading.Event()

    def read(arm):
        for _ in arm.points(seconds):
            pass
        ended.set()

    with careless_network() as (_, _, arm):
        thread = threading.Thread(target=read, args=(arm,), daemon=True)
        thread.start()
        time.sleep(0.3)
        arm.close()
        assert ended.wait(60.0)
        with pytest.raises(armd.ArmdError, match="is closed"):
            arm.state()


def test_a_wrong_endpoint_is_one_error_without_paths_of_zenoh():
    with pytest.raises(armd.NoAnswer, match=r"no daemon answers within 0\.5 s") as raised:
        armd.connect(endpoint=free_endpoint(), timeout_s=0.5)
    assert raised.value.__suppress_context__ and ".rs" not in str(raised.value)


def test_a_missing_configuration_names_its_file(tmp_path):
    path = tmp_path / "missing.json5"
    with pytest.raises(armd.BadInput, match=r"missing.json5: the file: found nothing"):
        armd.connect(endpoint=str(path))
    path.write_text("{ no json5")
    with pytest.raises(armd.BadInput, match=r"missing.json5: the file"):
        armd.connect(endpoint=str(path))


def used(arm, name, *arguments):
    """What a call leaves when all that it gives is taken."""
    found = getattr(arm, name)(*arguments)
    if name == "points_async":

        async def read():
            return [point async for point in found]

        return asyncio.run(read())
    return list(found) if hasattr(found, "__next__") else found


@pytest.mark.parametrize(
    ("name", "arguments"),
    [
        ("points", ()), ("points", (1.0,)), ("batches", ()), ("points_async", ()),
        ("measurements", ()), ("events", ()), ("health", ()), ("latest", (0.1,)), ("state", ()),
        ("health_now", ()), ("info", ()), ("calibration_file", ()), ("past", ("event",)),
        ("on_measurement", (print,)), ("on_event", (print, True)), ("command", ("reload",)),
        ("preamble", ()), ("stream", ("point",)),
    ],
)  # fmt: skip
def test_whatever_is_called_on_a_closed_arm_says_so(closed_arm, name, arguments):
    with pytest.raises(armd.Closed, match=r"^the connection to the arm is closed$"):
        used(closed_arm, name, *arguments)
    assert repr(closed_arm) == "<armd.Arm SIM-0001, closed>"


@pytest.fixture(scope="module")
def closed_arm():
    with careless_network() as (_, _, arm):
        arm.close()
        arm.close()  # a second time is no fault
        yield arm


@pytest.mark.parametrize(
    ("name", "arguments", "said"),
    [
        ("command", ("re#load",), "SIM-0001/command/re#load: Zenoh refuses it: Invalid Key Expr"),
        ("past", ("points",), "past: found 'points', expected 'measurement' or 'event'"),
    ],
)
def test_what_zenoh_refuses_is_an_error_of_armds(name, arguments, said):
    with careless_network() as (_, _, arm), pytest.raises(armd.ArmdError, match=said) as raised:
        used(arm, name, *arguments)
    assert ".rs" not in str(raised.value) and raised.value.__suppress_context__ == (name != "past")


def test_async_points_leave_others_their_turn_and_end_after_their_seconds():
    async def both(arm):
        turns = 0

        async def other():
            nonlocal turns
            while True:
                turns += 1
                await asyncio.sleep(0.01)

        task = asyncio.create_task(other())
        seen = [point async for point in arm.points_async(0.2)]
        task.cancel()
        return seen, turns

    with careless_network() as (_, _, arm):
        seen, turns = asyncio.run(both(arm))
    assert seen == [] and turns > 2


def test_async_points_end_when_another_thread_closes_the_arm():
    async def read(arm):
        asyncio.get_running_loop().call_later(0.3, arm.close)
        return [point async for point in arm.points_async()]

    with careless_network() as (_, _, arm):
        assert asyncio.run(asyncio.wait_for(read(arm), 60.0)) == []


def test_a_callback_that_raises_or_asks_gets_the_next_one_too():
    heard = []

    def call(message):
        heard.append(message)
        with pytest.raises(armd.NoAnswer):
            arm.state()  # a question within a callback
        raise ValueError("the caller's own")

    with careless_network() as (publisher, _, arm):
        arm.on_measurement(call)
        with repeated(publisher, measurement=json.dumps(MEASUREMENT).encode()):
            end_s = time.monotonic() + 60
            while len(heard) < 2 and time.monotonic() < end_s:
                time.sleep(0.01)
    assert len(heard) >= 2


def test_an_arm_is_closed_while_threads_ask_it():
    """Whoever asks is told; to close is never refused ("Already borrowed", as Zenoh's `with`)."""
    told = []

    def ask(arm):
        while True:
            try:
                arm.state()
            except armd.NoAnswer:
                pass
            except armd.Closed as closed:
                told.append(closed)
                return

    with careless_network() as (_, _, arm):
        threads = [threading.Thread(target=ask, args=(arm,), daemon=True) for _ in range(3)]
        for thread in threads:
            thread.start()
        time.sleep(0.05)
        with arm:
            pass
        for thread in threads:
            thread.join(60.0)
        assert len(told) == 3


def test_every_public_name_is_listed():
    assert {*armd.__all__} <= {*dir(armd)}
