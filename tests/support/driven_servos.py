"""The servo driver on servos of a pty, and what it has said so far.

with driven(Feetech, tmp_path) as (servos, taken):
    rows = taken.rows(20)
"""

import time
from contextlib import closing, contextmanager

import pytest

from armd.drivers.config import ServoConfig
from armd.drivers.identity import Expectation
from armd.drivers.poll.decoder import ServoDecoder
from armd.drivers.sample import Event, Temperatures
from armd.drivers.table import open_driver
from support.fake_servos import Dynamixel, FakeServos, Feetech
from support.sampled import rows_of
from support.selection import parametrize_default

BOTH = parametrize_default("family", [Feetech, Dynamixel], ids=lambda family: family.kind)


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    """What is remembered of servos is each test's own."""
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))


def expected(n=3, sensors=3):
    return Expectation("SERVO-1", n, sensors, (4096,) * n)


def config(servos, ids=(1, 2, 3), **more):
    return ServoConfig(
        kind=servos.family.kind, port=str(servos.link), baud=1_000_000, ids=list(ids), **more
    )


@contextmanager
def driven(family, folder, ids=(1, 2, 3), **of_servos):
    """Servos of a *family*, joints 1 to 3 among them, and what their driver says, `Taken`."""
    with (
        FakeServos(family, folder, ids, **of_servos) as servos,
        closing(open_driver(config(servos), expected())) as driver,
    ):
        yield servos, Taken(driver)


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
        return rows_of(self.items)

    @property
    def temperatures(self):
        return [item for item in self.items if isinstance(item, Temperatures)]

    @property
    def events(self):
        return [item for item in self.items if isinstance(item, Event)]

    def told(self, kind):
        return [event for event in self.events if event.kind == kind]


def assert_replayed(servos, frames, live, unheard=0):
    """Decoding *frames* gives the rows of *live* bit by bit; the first ones give none of them."""
    decoder = ServoDecoder(config(servos), expected())
    decoded = [decoder.feed(frame) for frame in frames][unheard:]
    again = rows_of([item for items in decoded for item in items])
    rows = rows_of(live)
    assert again.tobytes()[: rows.nbytes] == rows.tobytes()
