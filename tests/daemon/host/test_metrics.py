"""OpenMetrics on loopback."""

from __future__ import annotations

import socket
import threading
import time
import urllib.error
import urllib.request
from contextlib import closing, suppress

import pytest

from armd.daemon.host.metrics import MOST_OPEN, MetricsServer, render

HEALTH = {
    "serial": "SIM-1",
    "state": "READY",
    "points": {"published": 7, "flagged": {"CLOCK": 2}},
    "drops": {"bad_crc": 3},
    "latency": {"p50": 0.25},
    "temperatures": {"t1": 20.5, "t2": None},
}


def test_a_scrape():
    with closing(MetricsServer(0, lambda: [HEALTH])) as server:
        url = f"http://127.0.0.1:{server.port}/metrics"
        with urllib.request.urlopen(url, timeout=60) as reply:
            assert reply.headers["Content-Type"].startswith("application/openmetrics-text")
            lines = reply.read().decode().splitlines()
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(url[:-1], timeout=60)
        refused.value.close()
    assert refused.value.code == 404
    assert 'armd_state{serial="SIM-1",armd_state="READY"} 1' in lines
    assert 'armd_state{serial="SIM-1",armd_state="NOT_READY"} 0' in lines
    assert 'armd_points_total{serial="SIM-1"} 7' in lines
    assert 'armd_flagged_points_total{serial="SIM-1",flag="CLOCK"} 2' in lines
    assert 'armd_wire_total{serial="SIM-1",what="bad_crc"} 3' in lines
    assert 'armd_latency_seconds{serial="SIM-1",of="p50"} 0.00025' in lines
    assert 'armd_temperature_celsius{serial="SIM-1",sensor="t1"} 20.5' in lines
    assert not any('sensor="t2"' in line for line in lines)
    assert lines[-1] == "# EOF"


def scrape(server: MetricsServer) -> str:
    with urllib.request.urlopen(f"http://127.0.0.1:{server.port}/metrics", timeout=60) as reply:
        return reply.read().decode()


def test_a_name_with_quotes_stays_one_label():
    name = 'a"} 1\\\n'
    lines = render([HEALTH | {"temperatures": {name: 1.5}, "serial": name}]).splitlines()
    escaped = r"a\"} 1\\\n"
    assert f'armd_temperature_celsius{{serial="{escaped}",sensor="{escaped}"}} 1.5' in lines


def test_slow_and_many_clients_take_neither_threads_nor_the_answers_of_others(monkeypatch):
    monkeypatch.setattr("armd.daemon.host.metrics.PATIENCE_S", 0.3)
    with closing(MetricsServer(0, lambda: [HEALTH])) as server:
        threads = threading.active_count()
        slow = []
        for _ in range(20 * MOST_OPEN):
            slow.append(socket.create_connection(("127.0.0.1", server.port)))
            slow[-1].settimeout(60)
        slow[0].sendall(b"GET /metrics HTTP/1.1\r\n")  # and never the end of it
        assert threading.active_count() == threads
        for connection in slow:  # hung up on at once, or when its time is over
            with connection, suppress(ConnectionResetError):
                assert connection.recv(1) == b""
        assert scrape(server).endswith("# EOF\n")


def test_silent_connections_keep_no_scraper_out():
    with closing(MetricsServer(0, lambda: [HEALTH])) as server:
        silent = [
            socket.create_connection(("127.0.0.1", server.port)) for _ in range(5 * MOST_OPEN)
        ]
        began = time.monotonic()
        assert scrape(server).endswith("# EOF\n")
        assert time.monotonic() - began < 2.0  # less than their patience
        for connection in silent:
            connection.close()


def test_what_is_no_request_is_no_trouble():
    with closing(MetricsServer(0, lambda: [HEALTH])) as server:
        for request, status in (
            (b"\r\n\r\n", b"404"),
            (b"POST /metrics HTTP/1.1\r\n\r\n", b"405"),
            (b"\xff" * 20_000, b""),
            (b"GET /metrics?a=b HTTP/1.0\r\n\r\n", b"200"),
        ):
            with socket.create_connection(("127.0.0.1", server.port), 60) as connection:
                connection.sendall(request)
                try:
                    assert connection.recv(100)[9:12] == status
                except ConnectionResetError:
                    assert status == b""
        assert scrape(server).endswith("# EOF\n")
