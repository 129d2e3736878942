"""`armd ippdme` beside a live arm, spoken to over TCP as a host does."""

from __future__ import annotations

import re
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

import numpy as np
import pytest

import armd
from support.running_bridge import RunningBridge, running_bridge
from support.running_daemon import Daemon, running_daemon
from support.simulated_arm import simulated_arm
from support.waiting import PATIENCE_S

TIPS = """
[commands]
enabled = true
[tips.Ball3]
offset_mm = [0.0, 0.0, 120.0]
radius_mm = 1.5
"""
NUMBERS = re.compile(r"-?\d+\.\d+")


class Host:
    """Types a line, reads to its end."""

    def __init__(self, connection: socket.socket, file: IO[bytes]) -> None:
        connection.settimeout(PATIENCE_S)
        self.connection = connection
        self._file = file
        self.events: list[str] = []

    def line(self) -> str:
        line = self._file.readline().decode()
        assert line.endswith("\r\n"), line
        return line.removesuffix("\r\n")

    def do(self, command: str) -> list[str]:
        """Its answer, without acknowledgement and completion; events are put aside."""
        self.connection.sendall(f"{command}\r\n".encode())
        tag, said = command[:5], []
        while True:
            line = self.line()
            if not line.startswith(tag):
                self.events.append(line)
            elif line == f"{tag} %":
                assert said[0] == f"{tag} &"
                return said[1:]
            else:
                said.append(line)

    def event(self, pattern: str) -> str:
        """The next one that matches."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            line = self.events.pop(0) if self.events else self.line()
            if re.match(pattern, line):
                return line
        raise AssertionError(f"no {pattern}")


@contextmanager
def host(bridge: RunningBridge) -> Iterator[Host]:
    with bridge.connect() as connection, connection.makefile("rb") as file:
        yield Host(connection, file)


@pytest.fixture(scope="module")
def daemon(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Daemon]:
    folder = tmp_path_factory.mktemp("ippdme")
    with simulated_arm(folder) as arm, running_daemon(folder, arm.port, extra=TIPS) as daemon:
        yield daemon


@pytest.fixture
def bridge(
    daemon: Daemon, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[RunningBridge]:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    options = ["--endpoint", daemon.endpoint, "--listen", "127.0.0.1:0", "--alias", "TIP1=Ball3"]
    with running_bridge("ippdme", *options) as bridge:
        yield bridge
        assert bridge.stop() == 0


@pytest.mark.slow
def test_a_press_is_a_point(daemon: Daemon, bridge: RunningBridge) -> None:
    with daemon.listen() as heard, host(bridge) as client:
        assert client.do("00001 StartSession()") == []
        assert client.do("00002 OnPtMeasReport(X(),Y(),Z(),IJK(),ER(),Q())") == []
        # The arm presses all by itself: nothing is told before the user is enabled.
        heard.wait_for(lambda: heard.json("measurement"))
        assert client.do("00003 IsUserEnabled()") == ["00003 # IsUserEnabled(0)"]
        assert client.events == []
        since_ns = time.time_ns()
        assert client.do("00004 EnableUser()") == []
        values = [float(x) for x in NUMBERS.findall(client.event("E0000 # PtMeas"))]

        def matching() -> list[dict[str, Any]]:
            heard_all = heard.json("measurement")
            return [m for m in heard_all if np.allclose(m["position_mm"], values[:3], atol=1e-5)]

        heard.wait_for(matching)
        (measurement,) = matching()
        assert measurement["stamp_ns"] > since_ns - 0.5e9
        assert np.allclose(values[3:6], -np.array(measurement["approach"]), atol=1e-6)
        assert client.do("E0001 OnMoveReportE(Time(0.1), Dis(0.01), X(), Y(), Z())") == []
        times = []
        for _ in range(8):
            client.event(r"E0001 # X\(")
            times.append(time.monotonic())
        assert times[-1] - times[0] > 0.5  # seven gaps of at least a tenth of a second
        assert client.do("00005 EndSession()") == []


def test_tools_are_changed_from_both_sides(daemon: Daemon, bridge: RunningBridge) -> None:
    with host(bridge) as client, armd.connect(endpoint=daemon.endpoint) as arm:
        client.do("00001 StartSession()")
        names = ["RefTool", "NoTool", "Ball3", "TIP1"]
        assert client.do("00002 EnumTools()") == [f'00002 # "{name}"' for name in names]
        arm.command("tip", name="Ball3")
        assert client.event("E0000 #") == 'E0000 # ChangeTool("TIP1")'
        assert client.do("00003 GetProp(Tool.AvrRadius())") == ["00003 # Tool.AvrRadius(1.50000)"]
        assert client.do('00004 ChangeTool("RefTool")') == []
        assert arm.info()["tip"] is None
        assert client.do('00005 ChangeTool("Ball3")') == []
        assert arm.info()["tip"] == "Ball3"
        time.sleep(0.3)
        client.do("00006 IsHomed()")
        assert client.events == []  # its own changes are not told to the host
        arm.command("tip")
        assert client.event("E0000 #") == 'E0000 # ChangeTool("RefTool")'


@pytest.mark.slow
def test_hosts_that_misbehave_hold_up_nobody(daemon: Daemon, bridge: RunningBridge) -> None:
    with (
        armd.connect(endpoint=daemon.endpoint) as arm,
        arm.stream(armd.keys.POINT) as stream,
        host(bridge) as good,
    ):
        good.do("00001 StartSession()")
        with bridge.connect() as stalled:  # asks on and on, and never reads
            stalled.setblocking(False)
            end_s = time.monotonic() + PATIENCE_S
            asked = b"00002 IsHomed()\r\n" * 1000
            while time.monotonic() < end_s:
                try:
                    stalled.sendall(asked)
                except BlockingIOError:
                    time.sleep(0.01)
                except OSError:
                    break  # closed on us
            else:
                pytest.fail("a client that never reads was kept")
        with bridge.connect() as endless:
            endless.settimeout(PATIENCE_S)
            endless.sendall(b"x" * 70_000)
            said = endless.recv(1000)
            assert said.startswith(b'E0000 ! Error(3, 0008, "')
            assert said.endswith(b'"Protocol error")\r\n')
            assert endless.recv(1000) == b""
        with bridge.connect() as garbage:
            garbage.sendall(np.random.default_rng(1).bytes(20_000) + b"\r\n")
            garbage.settimeout(PATIENCE_S)
            assert garbage.recv(100).startswith(b"E0000 ! Error(")
        with host(bridge) as second:
            assert second.do("00001 StartSession()") == [
                '00001 ! Error(3, 0008, "StartSession", "Protocol error")'
            ]
        with bridge.connect() as vanishing:
            vanishing.sendall(b"00001 StartSess")
        assert good.do("00003 IsHomed()") == ["00003 # IsHomed(1)"]
        arm.decode(stream.take())
        assert arm.lost.here == 0


@pytest.mark.slow
def test_a_host_that_vanished_leaves_no_session(bridge: RunningBridge) -> None:
    with host(bridge) as first:
        first.do("00001 StartSession()")
        first.do("E0001 OnMoveReportE(Time(0.1), X())")
    with host(bridge) as second:
        end_s = time.monotonic() + 5
        while second.do("00001 StartSession()"):
            assert time.monotonic() < end_s
        assert second.do("00002 StopAllDaemons()") == [
            '00002 ! Error(1, 0512, "StopAllDaemons", "No daemons are active")'
        ]


@pytest.mark.slow
def test_an_arm_that_falls_silent_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    with simulated_arm(tmp_path) as arm, running_daemon(tmp_path, arm.port) as daemon:
        options = ["--endpoint", daemon.endpoint, "--listen", "127.0.0.1:0"]
        with running_bridge("ippdme", *options) as bridge, host(bridge) as client:
            client.do("00001 StartSession()")
            while client.do("00002 Get(X())")[0].startswith("00002 !"):
                client.do("00003 ClearAllErrors()")
            arm.process.kill()
            told = client.event("E0000 !")
            assert told == 'E0000 ! Error(9, 0503, "armd", "Controller communications failure")'
            client.do("00004 ClearAllErrors()")
            assert client.do("00005 Get(X())")[0].startswith("00005 ! Error(9, 0503,")
