"""The servo driver over a pty: servos written from the manuals alone, and everything that goes
wrong with them, injected on the wire."""

import time
from contextlib import closing

import numpy as np
import pytest
from fake_servos import Dynamixel, FakeServos, Feetech

from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.sample import Event, Temperatures
from armd.drivers.table import open_driver

BOTH = pytest.mark.parametrize("family", [Feetech, Dynamixel], ids=lambda family: family.kind)
S = 1_000_000_000


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))


def expected(n=3, sensors=3):
    return Expectation("SERVO-1", n, sensors, (4096,) * n)


def config(servos, ids=(1, 2, 3), **more):
    return ServoConfig(
        kind=servos.family.kind, port=str(servos.link), baud=1_000_000, ids=list(ids), **more
    )


class Taken:
    """What a driver has said so far."""

    def __init__(self, driver):
        self.driver = driver
        self.items = []
        self.frames = []

    def take(self, seconds=10.0, until=lambda: False):
        end = time.monotonic() + seconds
        while time.monotonic() < end and not until():
            self.items += self.driver.read(0.02)
            self.frames += self.driver.take_raw()
        return self

    def rows(self, n):
        """Until there are *n* more."""
        before = len(self.samples)
        self.take(20.0, lambda: len(self.samples) >= before + n)
        assert len(self.samples) >= before + n, self.events
        return self.samples[before:]

    @property
    def samples(self):
        arrays = [item for item in self.items if isinstance(item, np.ndarray)]
        return np.concatenate(arrays) if arrays else np.zeros(0)

    @property
    def temperatures(self):
        return [item for item in self.items if isinstance(item, Temperatures)]

    @property
    def events(self):
        return [item for item in self.items if isinstance(item, Event)]

    def told(self, kind):
        return [event for event in self.events if event.kind == kind]


@BOTH
def test_positions_temperatures_and_numbers(tmp_path, family):
    with FakeServos(family, tmp_path) as servos:
        servos.registers[3][family.temperature] = 41
        for servo, position in ((1, 0), (2, 2048), (3, 4095)):
            servos.move(servo, position)
        with closing(open_driver(config(servos), expected())) as driver:
            taken = Taken(driver)
            rows = taken.rows(200)
    assert (rows["joint_invalid"] == 0).all() and rows["clock_mapped"].all()
    assert (rows["count"] == [-2048, 0, 2047]).all()
    assert rows["seq"][0] == 0 and (np.diff(rows["seq"].astype(int)) == 1).all()
    assert (np.diff(rows["monotonic_ns"]) > 0).all()
    assert taken.temperatures[0].celsius.tolist() == [25, 25, 41]
    assert driver.counters["samples"] == len(taken.samples)
    assert driver.counters["lost"] == driver.counters["missed"] == 0
    assert not servos.writes
    assert [event.kind for event in taken.events] == ["servo", "servo", "servo", "identified"]
