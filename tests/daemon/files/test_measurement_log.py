"""The measurement log: synced lines, files that follow one another, disks that refuse."""

from __future__ import annotations

import errno
import json
import os
import signal
import time
from pathlib import Path

import pytest

from armd.daemon.files import measurement_log
from armd.daemon.files.measurement_log import MeasurementLog, list_log_files
from support.running_daemon import running_daemon
from support.simulated_arm import simulated_arm
from support.waiting import wait_until


def lines(folder: Path) -> list[str]:
    return [line for path in list_log_files(folder) for line in path.read_text().splitlines()]


def wait_for_lines(folder: Path, n: int) -> list[str]:
    wait_until(lambda: len(lines(folder)) >= n)
    return lines(folder)


def test_lines_are_on_disk_without_a_close(tmp_path: Path) -> None:
    log = MeasurementLog(tmp_path / "a" / "b")
    for k in range(100):
        log.add(f'{{"seq": {k}}}')
    found = wait_for_lines(tmp_path / "a" / "b", 100)
    assert [json.loads(line)["seq"] for line in found] == list(range(100))
    log.close()
    assert log.take_events() == []


def test_a_long_file_is_followed_by_another(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measurement_log, "MOST_BYTES", 50)
    for _ in range(6):  # a daemon that restarts each time
        log = MeasurementLog(tmp_path)
        log.add("x" * 29)
        log.close()
    assert [path.name for path in list_log_files(tmp_path)] == [
        "000001.jsonl", "000002.jsonl", "000003.jsonl",
    ]  # fmt: skip
    assert len(lines(tmp_path)) == 6


def test_a_torn_line_stands_alone(tmp_path: Path) -> None:
    (tmp_path / "000001.jsonl").write_text('{"seq": 1}\n{"seq": 2, "posi')
    log = MeasurementLog(tmp_path)
    log.add('{"seq": 3}')
    log.close()
    assert lines(tmp_path) == ['{"seq": 1}', '{"seq": 2, "posi', '{"seq": 3}']


def test_a_full_disk_is_told_once_and_nothing_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(measurement_log, "RETRY_S", 0.05)
    real, full = os.write, True

    def write(handle: int, data: bytes) -> int:
        if not full:
            return real(handle, data)
        real(handle, bytes(data[:7]))  # half of a line found room
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(measurement_log.os, "write", write)
    log = MeasurementLog(tmp_path)
    told = []
    for k in range(5):
        log.add(f'{{"seq": {k}}}')
        time.sleep(0.1)
        told += log.take_events()
    told += [] if told else wait_until(log.take_events)
    assert [event.kind for event in told] == ["log_failed"]
    assert "No space left" in told[0].text and told[0].severity == "error"
    assert lines(tmp_path) == []
    full = False
    found = wait_for_lines(tmp_path, 5)
    assert [json.loads(line)["seq"] for line in found] == list(range(5))
    log.close()
    assert [event.kind for event in log.take_events()] == ["log_back"]


def test_more_than_waits_is_lost_and_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measurement_log, "RETRY_S", 0.05)
    monkeypatch.setattr(measurement_log, "MOST_WAITING", 3)
    (tmp_path / "log").write_text("a file where the folder should be")
    log = MeasurementLog(tmp_path / "log")
    for k in range(5):
        log.add(str(k))
    (failed,) = wait_until(log.take_events)
    (tmp_path / "log").unlink()
    assert wait_for_lines(tmp_path / "log", 3) == ["2", "3", "4"]
    log.close()
    (back,) = log.take_events()
    assert (failed.kind, back.kind) == ("log_failed", "log_back")
    assert "2 were lost" in back.text


@pytest.mark.slow
def test_a_killed_daemon_has_lost_no_measurement(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    state = tmp_path / "state"
    monkeypatch.setenv("STATE_DIRECTORY", str(state))
    folder = state / "measurements" / "SIM-0001"
    with simulated_arm(tmp_path, seconds=60) as arm:
        published = []
        for _ in range(2):
            with running_daemon(tmp_path, arm.port) as daemon, daemon.listen() as heard:
                heard.wait_for(lambda heard=heard: heard.json("measurement"))
                published += [m["stamp_ns"] for m in heard.json("measurement")]
                time.sleep(0.2)
                daemon.process.send_signal(signal.SIGKILL)
                daemon.process.wait()
    logged = [json.loads(line)["stamp_ns"] for line in lines(folder)]
    assert set(published) <= set(logged)
    assert len(logged) == len(set(logged))
