"""Questions: the measuring thread answers a few on a tick, whoever asks however often."""

from __future__ import annotations

import json
import threading
import time
from contextlib import contextmanager

import zenoh

from armd.daemon.network.publisher import Publisher
from armd.daemon.network.queries import AT_ONCE, RING, Queries
from armd.daemon.unexpected import Unexpected
from support.running_daemon import free_endpoint, session_with


def wait_for_all_before(ours: zenoh.Session, theirs: zenoh.Session) -> None:
    """Until *ours* has what *theirs* has sent: a question of the same priority comes after it."""
    asked = threading.Event()
    with ours.declare_queryable("armd/T/last", lambda _: asked.set()):
        end_s = time.monotonic() + 60
        while not asked.is_set():
            assert time.monotonic() < end_s
            theirs.get("armd/T/last", lambda _: None, timeout=60.0)
            asked.wait(0.3)


@contextmanager
def two_sessions():
    """One that listens, as a daemon's does, and one that connects to it."""
    endpoint = free_endpoint()
    settings = zenoh.Config()
    for key, value in {
        "listen/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
    }.items():
        settings.insert_json5(key, json.dumps(value))
    with zenoh.open(settings) as ours, session_with(endpoint) as theirs:
        yield ours, theirs


def test_the_measuring_thread_answers_a_few_on_a_tick_and_the_past_is_told_elsewhere():
    begun: list[str] = []
    replies: list[zenoh.Reply] = []

    def dance(parameters, answer):
        begun.append(str(parameters))
        answer("danced", True)

    with two_sessions() as (ours, theirs):
        publisher = Publisher(ours, "T")
        for i in range(200):
            publisher.events.put({"i": i})
        queries = Queries(ours, "T", publisher, {}, list, {"dance": dance}, Unexpected())
        wait_for_all_before(ours, theirs)
        for _ in range(3 * RING):
            theirs.get("armd/T/command/dance", lambda _: None, timeout=60.0)
        for _ in range(RING // 4):
            whole = zenoh.ConsolidationMode.NONE
            theirs.get("armd/T/event", replies.append, timeout=60.0, consolidation=whole)
        wait_for_all_before(ours, theirs)
        for tick in range(1, 4):
            queries.answer()
            assert len(begun) == tick * AT_ONCE
        for _ in range(100):
            queries.answer()
        assert len(begun) == RING  # the oldest of more were dropped by Zenoh
        end_s = time.monotonic() + 60
        while len(replies) < RING // 4 * 200 and time.monotonic() < end_s:
            time.sleep(0.05)  # no tick of the measuring thread: another tells the past
        assert len(replies) == RING // 4 * 200
        queries.close()
        publisher.close()


def test_a_question_that_raises_does_not_end_the_answers_to_others():
    unexpected = Unexpected()
    broken = {"now": True}

    def info():
        if broken["now"]:
            raise RuntimeError("nobody expected this")
        return "{}"

    def dance(parameters, answer):
        raise KeyError("dance")

    with two_sessions() as (ours, theirs):
        publisher = Publisher(ours, "T")
        queries = Queries(ours, "T", publisher, {"info": info}, list, {"dance": dance}, unexpected)
        time.sleep(0.3)  # for the declarations
        assert not [r for r in theirs.get("armd/T/info", timeout=1.0) if r.ok]
        theirs.get("armd/T/command/dance", lambda _: None, timeout=1.0)
        end_s = time.monotonic() + 10.0
        while unexpected.as_json() != {"questions": 2} and time.monotonic() < end_s:
            queries.answer()
            time.sleep(0.02)
        broken["now"] = False
        replies = [r for r in theirs.get("armd/T/info", timeout=10.0) if r.ok]
        queries.close()
        publisher.close()
    assert len(replies) == 1
    assert unexpected.as_json() == {"questions": 2}
    texts = [event.text for event in unexpected.take_events()]
    assert [text.split(";")[0] for text in texts] == [
        "questions: RuntimeError: nobody expected this",
        "questions: KeyError: 'dance'",
    ]
