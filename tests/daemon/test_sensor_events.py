"""A sensor that flickers is told once as missing and once as back; the state does not flicker."""

from types import SimpleNamespace

import pytest

from armd.daemon.supervisor import BACK_AFTER_NS, Supervisor
from armd.daemon.unexpected import Unexpected
from support.small_arm import small_arm

TICK_NS = 50_000_000


class Sensors:
    """What a pipeline's temperature watch says of them."""

    gone: tuple[str, ...] = ()
    impossible: dict[str, tuple[float, float]] = {}

    def stale_sensors(self, _):
        return self.gone

    def sensors_to_report(self, _):
        return self.gone


@pytest.fixture
def sensors():
    return Sensors()


@pytest.fixture
def supervisor(sensors):
    arm = SimpleNamespace(pipeline=SimpleNamespace(temperature=sensors))
    file = SimpleNamespace(interim=None)
    config = SimpleNamespace(driver=SimpleNamespace(kind="feetech"), file=file, arm=small_arm())
    return Supervisor(config, None, arm, 0, Unexpected())


def test_a_flickering_sensor_is_told_once(supervisor, sensors):
    told, n = [], 400
    for k in range(n):
        sensors.gone = ("t5",) if k % 7 < 2 else ()
        events = supervisor._hear_sensors(k * TICK_NS)
        told += [(event.kind, event.detail["sensor"]) for event in events]
        assert supervisor._stale == ("t5",)
    assert told == [("temperature_missing", "t5")]
    sensors.gone = ()
    back = [
        (event.kind, k * TICK_NS)
        for k in range(n, n + 40)
        for event in supervisor._hear_sensors(k * TICK_NS)
    ]
    assert [kind for kind, _ in back] == ["temperature_back"]
    assert back[0][1] <= n * TICK_NS + BACK_AFTER_NS and supervisor._stale == ()


def test_each_of_two_sensors_is_told(supervisor, sensors):
    told = []
    for k, sensors.gone in enumerate([("t1",), ("t1", "t2"), ("t2",), ("t2",), *[()] * 30]):
        told += [(e.kind, e.detail["sensor"]) for e in supervisor._hear_sensors(k * TICK_NS)]
    missing, back = "temperature_missing", "temperature_back"
    assert told == [(missing, "t1"), (missing, "t2"), (back, "t1"), (back, "t2")]
