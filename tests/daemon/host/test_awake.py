"""Processors are kept awake while an arm sends, and never without the right to it."""

from __future__ import annotations

import os
import struct
from pathlib import Path

import pytest

from armd.daemon.host.awake import DEVICE, LIGHT_SLEEP_US, NO_SLEEP_US, Awake
from support.running_daemon import running_daemon
from support.simulated_arm import simulated_arm
from support.waiting import wait_until


@pytest.fixture
def device(tmp_path: Path) -> Path:
    device = tmp_path / "cpu_dma_latency"
    device.touch()
    return device


def asked_us(device: Path) -> int:
    (asked,) = struct.unpack("=i", device.read_bytes())
    return int(asked)


def is_open(device: Path, pid: int | str = "self") -> bool:
    links = Path(f"/proc/{pid}/fd").iterdir()
    return any(os.path.realpath(link) == str(device) for link in links)


@pytest.mark.parametrize(
    ("idle_driver", "latency_us"), [("haltpoll", NO_SLEEP_US), ("intel_idle", LIGHT_SLEEP_US)]
)
def test_it_asks_once_and_gives_up(
    device: Path, tmp_path: Path, idle_driver: str, latency_us: int
) -> None:
    (tmp_path / "driver").write_text(f"{idle_driver}\n")
    awake = Awake(device, tmp_path / "driver")
    assert not is_open(device)
    awake.keep(True)
    awake.keep(True)
    assert (asked_us(device), is_open(device)) == (latency_us, True)
    awake.keep(False)
    assert not is_open(device)
    awake.keep(False)


def test_without_the_right_or_the_device_nothing_happens(tmp_path: Path) -> None:
    awake = Awake(tmp_path / "none", tmp_path / "driver")
    awake.keep(True)
    awake.keep(False)
    assert not (tmp_path / "none").exists()


@pytest.mark.slow
@pytest.mark.skipif(
    not os.access(DEVICE, os.W_OK), reason="this machine does not let us keep it awake"
)
def test_the_daemon_asks_while_an_arm_sends(tmp_path: Path) -> None:
    with (
        simulated_arm(tmp_path, "--fault", "silence@6:20", seconds=30) as arm,
        running_daemon(tmp_path, arm.port) as daemon,
    ):
        pid = daemon.process.pid
        for wanted in (True, False):
            wait_until(lambda wanted=wanted: is_open(DEVICE, pid) is wanted, f"never {wanted}")
