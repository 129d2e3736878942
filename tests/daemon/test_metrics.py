"""OpenMetrics on loopback."""

from __future__ import annotations

import urllib.error
import urllib.request
from contextlib import closing

import pytest

from armd.daemon.metrics import MetricsServer

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
        with urllib.request.urlopen(url, timeout=10) as reply:
            assert reply.headers["Content-Type"].startswith("application/openmetrics-text")
            lines = reply.read().decode().splitlines()
        with pytest.raises(urllib.error.HTTPError) as refused:
            urllib.request.urlopen(url[:-1], timeout=10)
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
