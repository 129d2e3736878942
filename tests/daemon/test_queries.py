"""Questions: the measuring thread answers a few on a tick, whoever asks however often."""

from __future__ import annotations

import json
import time

import zenoh

from armd.daemon.network.publisher import Publisher
from armd.daemon.network.queries import AT_ONCE, RING, Queries
from support.running_daemon import free_endpoint, session_with


def test_the_measuring_thread_answers_a_few_on_a_tick_and_the_past_is_told_elsewhere():
    endpoint = free_endpoint()
    settings = zenoh.Config()
    for key, value in {
        "listen/endpoints": [endpoint],
        "scouting/multicast/enabled": False,
        "timestamping/enabled": True,
    }.items():
        settings.insert_json5(key, json.dumps(value))
    begun: list[str] = []
    replies: list[zenoh.Reply] = []

    def dance(parameters, answer):
        begun.append(str(parameters))
        answer("danced", True)

    with zenoh.open(settings) as ours, session_with(endpoint) as theirs:
        publisher = Publisher(ours, "T")
        for i in range(200):
            publisher.events.put({"i": i})
        queries = Queries(ours, "T", publisher, {}, list, {"dance": dance})
        time.sleep(0.3)  # for the declarations
        for _ in range(3 * RING):
            theirs.get("armd/T/command/dance", lambda _: None, timeout=20.0)
        for _ in range(RING // 4):
            whole = zenoh.ConsolidationMode.NONE
            theirs.get("armd/T/event", replies.append, timeout=20.0, consolidation=whole)
        time.sleep(0.5)
        for tick in range(1, 4):
            queries.answer()
            assert len(begun) == tick * AT_ONCE
        for _ in range(100):
            queries.answer()
        assert len(begun) == RING  # the oldest of more were dropped by Zenoh
        end_s = time.monotonic() + 30
        while len(replies) < RING // 4 * 200 and time.monotonic() < end_s:
            time.sleep(0.05)  # no tick of the measuring thread: another tells the past
        assert len(replies) == RING // 4 * 200
        queries.close()
        publisher.close()
