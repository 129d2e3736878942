"""Descriptors over 1023, and lines that take nothing more: what no driver may trip over."""

import contextlib
import os
import resource
import time
from contextlib import closing, contextmanager

import can
import numpy as np
import pytest
from pydantic import TypeAdapter

from armd.drivers.can.bus import open_bus
from armd.drivers.can.descriptors import wait
from armd.drivers.config import CanConfig, DriverConfig
from armd.drivers.identity import Expectation
from armd.drivers.sample import Event
from armd.drivers.table import open_driver
from armd.drivers.waiting import has_bytes
from support.fake_servos import Dynamixel, FakeServos, Feetech
from support.pty_link import open_line

EXPECTED = Expectation("SERVO-1", 3, 3, (4096,) * 3)


def open_kind(kind, port, **more):
    config = TypeAdapter(DriverConfig).validate_python({"kind": kind, "port": port, **more})
    return open_driver(config, EXPECTED)


@pytest.fixture(autouse=True)
def state(tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))


@contextmanager
def many_open_files():
    """Whatever is opened next has a number over 1023."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    if hard != resource.RLIM_INFINITY and hard < 1400:
        pytest.skip("this machine lets nobody have more than 1024 files open")
    resource.setrlimit(resource.RLIMIT_NOFILE, (1400, hard))
    taken = []
    try:
        while not taken or taken[-1] < 1100:
            taken.append(os.open(os.devnull, os.O_RDONLY))
        yield
    finally:
        for descriptor in taken:
            os.close(descriptor)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))


@pytest.mark.parametrize("family", [Feetech, Dynamixel], ids=lambda family: family.kind)
def test_servos_are_read_on_a_descriptor_over_1023(tmp_path, family):
    with (
        FakeServos(family, tmp_path) as servos,
        many_open_files(),
        closing(open_kind(family.kind, str(servos.link), ids=[1, 2, 3])) as driver,
    ):
        items, end_s = [], time.monotonic() + 60.0
        while time.monotonic() < end_s and not any(isinstance(i, np.ndarray) for i in items):
            items += driver.read(0.05)
    assert any(isinstance(item, np.ndarray) for item in items)
    assert "unplugged" not in [item.kind for item in items if isinstance(item, Event)]


def test_a_microscribe_is_waited_for_on_a_descriptor_over_1023():
    with (
        open_line() as (master, _, port),
        many_open_files(),
        closing(open_kind("microscribe", port, baud=115200)) as driver,
    ):
        driver.read(0.2)
        assert os.read(master, 100)


def test_waiting_ends_when_bytes_come_or_the_time_is_over():
    reading, writing = os.pipe()
    began = time.monotonic()
    assert not has_bytes(reading, 0.0024)
    assert time.monotonic() - began >= 0.0024
    os.write(writing, b"x")
    assert has_bytes(reading, 5.0)
    os.read(reading, 1)
    os.close(writing)
    assert has_bytes(reading, 5.0)  # its end is something to be read
    os.close(reading)


def drain(descriptor):
    while has_bytes(descriptor, 0.01):
        os.read(descriptor, 1 << 16)


def fill(slave: int) -> None:
    """Until the line takes nothing more, also after its kernel thread has run."""
    while True:
        taken = 0
        with contextlib.suppress(BlockingIOError):
            while True:
                taken += os.write(slave, b"\0")
        if not taken:
            return
        time.sleep(0.05)


@pytest.mark.parametrize("kind", ["serial", "feetech", "dynamixel", "microscribe"])
def test_what_the_line_does_not_take_is_not_recorded_as_sent(kind):
    """Nobody reads the other end until it is full; then somebody does."""
    more = {"serial": {}, "microscribe": {"baud": 115200}}.get(kind, {"ids": [1, 2, 3]})
    with open_line() as (master, slave, port), closing(open_kind(kind, port, **more)) as driver:
        driver.read(0.05)
        os.set_blocking(slave, False)
        fill(slave)
        driver.take_raw()
        end_s = time.monotonic() + 0.3
        while time.monotonic() < end_s:
            driver.read(0.05)
        sent = [frame for frame in driver.take_raw() if frame.direction == "tx"]
        assert not sent and driver.counters["unsent"] > 0
        drain(master)
        heard, end_s = b"", time.monotonic() + 5.0
        while not sent and time.monotonic() < end_s:
            driver.read(0.05)
            sent = [frame for frame in driver.take_raw() if frame.direction == "tx"]
            while has_bytes(master, 0.0):
                heard += os.read(master, 1 << 16)
        assert sent and b"".join(frame.data for frame in sent) in heard


def test_a_can_bus_is_read_on_a_descriptor_over_1023():
    channel = {"channel": "239.74.163.7", "port": 43127, "interface": "udp_multicast"}
    with many_open_files():
        config = CanConfig(kind="can", **channel)
        with open_bus(config) as bus, can.Bus(**channel, hop_limit=0) as other:
            frame = can.Message(arbitration_id=0x181, data=b"x", is_extended_id=False)
            found, end_s = None, time.monotonic() + 60.0
            while found is None and time.monotonic() < end_s:
                other.send(frame)
                found = bus.recv(0.2)
    assert found is not None and (found.arbitration_id, bytes(found.data)) == (0x181, b"x")


def test_waiting_for_any_descriptor_is_as_select_waits():
    near, far = os.pipe()
    with many_open_files():
        high = os.dup(near), os.dup(far)
        try:
            assert wait([high[0]], [high[1]], [], 0.0) == ([], [high[1]], [])
            os.write(far, b"x")
            assert wait([high[0]], [], [high[0]], 1.0) == ([high[0]], [], [])
            assert wait([near], [], [], 0.0) == ([near], [], [])
        finally:
            for descriptor in high:
                os.close(descriptor)
        with pytest.raises(OSError, match="closed"):
            wait([high[0]], [], [], 0.0)
    for descriptor in (near, far):
        os.close(descriptor)
