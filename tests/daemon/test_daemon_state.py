"""The state and its reason, the log that does not flood, the words for systemd."""

from __future__ import annotations

import os
import socket

import pytest

from armd import Flag
from armd.daemon.host.journal import BURST, Journal
from armd.daemon.host.systemd import Systemd
from armd.daemon.state import Observation, State, judge_state
from armd.drivers.sample import Event

FINE = {"silent_s": 0.01, "points": 1000}


@pytest.mark.parametrize(
    ("seen", "state", "reason"),
    [
        ({}, State.READY, "measuring"),
        ({"flags": int(Flag.NOT_CALIBRATED)}, State.READY, "nominal geometry"),
        ({"drift": "t1 drifts by +9.0 K/h"}, State.WARMING, "t1 drifts"),
        ({"outside_sensors": ("t1",)}, State.INACCURATE, "outside the identified"),
        ({"flags": int(Flag.TEMPERATURE_RATE), "drift": "t1"}, State.INACCURATE, "too fast"),
        ({"missing_sensors": ("t2",)}, State.DEGRADED, "temperature missing: t2"),
        ({"flags": int(Flag.CLOCK)}, State.DEGRADED, "clock"),
        ({"lossy": True}, State.DEGRADED, "lost"),
        ({"late_s": 3.2}, State.DEGRADED, "3.2 s late"),
        ({"late_s": 0.1}, State.READY, "measuring"),
        ({"held_period": "from A to B"}, State.INACCURATE, "identified from A to B"),
        ({"changed": "slip of joint 3"}, State.INACCURATE, "slip"),
        ({"interim_due": "31 h old"}, State.INACCURATE, "31 h"),
        ({"warning_joints": (4,)}, State.DEGRADED, "joint 4"),
        ({"invalid": 10, "invalid_joints": (3,)}, State.DEGRADED, "joint 3"),
        ({"invalid": 1000, "invalid_joints": (3,)}, State.NOT_READY, "joint 3"),
        ({"invalid": 1000, "missing_sensors": ("t2",)}, State.NOT_READY, "t2 missing"),
        # held under 5 s:
        ({"invalid": 1000}, State.NOT_READY, "a temperature missing for too long"),
        ({"silent_s": 0.6, "trouble": "unplugged"}, State.NOT_READY, "0.6 s: unplugged"),
        ({"silent_s": None, "points": 0}, State.NOT_READY, "no sample yet"),
    ],
)
def test_the_worst_reason_wins(seen, state, reason):
    found, why = judge_state(Observation(**(FINE | seen)))
    assert found is state
    assert reason in why


def test_a_flood_of_events_is_counted_not_written(tmp_path):
    now_s = [0.0]
    with (tmp_path / "stderr").open("w+") as stream:
        log = Journal(stream, lambda: now_s[0])
        for _ in range(100):
            log.write(Event("silence", "no sample", 0, "error", {"port": "x"}))
            log.write(Event("state", "NOT_READY", 0, "warning"))
        log.write(Event("button", "pressed", 0, "info"))
        log.tell_rest()  # nothing yet: it may go on
        now_s[0] = 11.0
        log.write(Event("silence", "no sample", 0, "error"))
        log.tell_rest()
        log.tell_rest()
        log.close()
        stream.seek(0)
        lines = stream.read().splitlines()
    assert len(lines) == 2 * BURST + 3
    assert lines[0] == 'armd: error: silence: no sample {"port": "x"}'
    assert lines[-2] == f"armd: error: silence: no sample ({100 - BURST} more before)"
    assert lines[-1] == f"armd: info: state: {100 - BURST} more in 11 s"


def test_of_every_sensor_and_joint_a_line_is_written(tmp_path):
    with (tmp_path / "stderr").open("w+") as stream:
        log = Journal(stream)
        for k in range(1, 17):
            log.write(Event("temperature_back", f"sensor t{k} is back", 0, "info"))
        log.close()
        stream.seek(0)
        assert "sensor t16 is back" in stream.read()


def test_the_journal_gets_fields(tmp_path, monkeypatch):
    with (
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as journal,
        (tmp_path / "stderr").open("w+") as stream,
    ):
        journal.bind(str(tmp_path / "journal"))
        journal.settimeout(5)
        status = os.fstat(stream.fileno())
        monkeypatch.setenv("JOURNAL_STREAM", f"{status.st_dev}:{status.st_ino}")
        log = Journal(stream, journal=str(tmp_path / "journal"))
        log.write(Event("silence", "no\nsample", 0, "warning", {"port": "x"}))
        fields = journal.recv(1000).decode()
        journal.close()  # as when it restarts: nothing is lost
        log.write(Event("button", "pressed", 0, "info"))
        log.close()
        stream.seek(0)
        assert stream.read() == "armd: info: button: pressed\n"
    assert fields == (
        'MESSAGE=silence: no\\nsample {"port": "x"}\nPRIORITY=4\nSYSLOG_IDENTIFIER=armd\n'
        'ARMD_KIND=silence\nARMD_DETAIL={"port": "x"}\n'
    )


def test_standard_error_that_is_not_the_journals_stays_in_use(tmp_path, monkeypatch):
    monkeypatch.setenv("JOURNAL_STREAM", "1:2")
    with (tmp_path / "stderr").open("w+") as stream:
        log = Journal(stream)
        log.write(Event("button", "pressed", 0, "info"))
        log.close()
        stream.seek(0)
        assert stream.read() == "armd: info: button: pressed\n"


def test_systemd_hears_ready_status_and_the_watchdog(tmp_path, monkeypatch):
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as inbox:
        inbox.bind(str(tmp_path / "notify"))
        inbox.settimeout(5)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "3000000")
        systemd = Systemd()
        systemd.ready()
        for now_s in (10.0, 10.5, 11.1):
            systemd.feed_watchdog(now_s)
        systemd.status("READY: measuring")
        systemd.status("READY: measuring")
        systemd.stopping()
        systemd.close()
        heard = [inbox.recv(1000).decode() for _ in range(5)]
    assert heard == ["READY=1", "WATCHDOG=1", "WATCHDOG=1", "STATUS=READY: measuring", "STOPPING=1"]


def test_nobody_hears_it_elsewhere(monkeypatch):
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    systemd = Systemd()
    systemd.ready()
    systemd.feed_watchdog(1.0)
    systemd.close()
