"""`armd run` in a process of its own, and a plain Zenoh subscriber to all it publishes.

with simulated_arm(tmp_path) as arm, running_daemon(arm) as daemon, daemon.listen() as heard:
    heard.wait_for(lambda: len(heard.points()) > 100)
"""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import zenoh

from armd import POINT, POINT_ENCODING
from support.waiting import PATIENCE_S


class Heard:
    """What a subscriber to `armd/<serial>/**` has heard so far, and when (CLOCK_MONOTONIC)."""

    def __init__(self) -> None:
        self.payloads: defaultdict[str, list[bytes]] = defaultdict(list)
        self.arrived_ns: defaultdict[str, list[int]] = defaultdict(list)

    def take(self, sample: zenoh.Sample) -> None:
        now_ns = time.monotonic_ns()
        what = str(sample.key_expr).split("/", 2)[2]
        if what == "point":
            assert str(sample.encoding) == POINT_ENCODING
        self.arrived_ns[what].append(now_ns)
        self.payloads[what].append(sample.payload.to_bytes())

    def points(self) -> np.ndarray:
        payloads = list(self.payloads["point"])
        assert all(len(payload) == 136 for payload in payloads)
        return np.frombuffer(b"".join(payloads), POINT)

    def json(self, what: str) -> list[dict[str, Any]]:
        return [json.loads(payload) for payload in list(self.payloads[what])]

    def events(self, kind: str) -> list[dict[str, Any]]:
        return [event for event in self.json("event") if event["kind"] == kind]

    def reason(self) -> str:
        """The newest state and its reason; empty before any."""
        told = self.json("health")
        return f"{told[-1]['state']}: {told[-1]['reason']}" if told else ""

    def wait_for(self, condition: Callable[[], object], patience_s: float = PATIENCE_S) -> None:
        end_s = time.monotonic() + patience_s
        while not condition():
            heard = {what: len(payloads) for what, payloads in self.payloads.items()}
            assert time.monotonic() < end_s, f"not within {patience_s} s; heard {heard}"
            time.sleep(0.02)


@dataclass
class Daemon:
    process: subprocess.Popen[str]
    endpoint: str
    serial: str
    log: Path

    def session(self) -> zenoh.Session:
        return session_with(self.endpoint)

    @contextmanager
    def listen(self) -> Iterator[Heard]:
        heard = Heard()
        with self.session() as session:
            session.declare_subscriber(f"armd/{self.serial}/**", heard.take)
            heard.wait_for(lambda: heard.payloads)  # health comes every second
            yield heard

    def get(self, what: str) -> tuple[bool, Any]:
        """(True, the reply) or (False, the error) of a query."""
        with self.session() as session:
            time.sleep(0.1)  # for the declarations of the other side
            for reply in session.get(f"armd/{self.serial}/{what}", timeout=PATIENCE_S):
                if reply.ok is not None:
                    return True, json.loads(reply.ok.payload.to_bytes())
                return False, reply.err.payload.to_string()
        pytest.fail(f"no reply from {what}")

    def stop(self, how: signal.Signals = signal.SIGTERM) -> tuple[int, float]:
        """Exit code, and how many seconds it took."""
        start_s = time.monotonic()
        self.process.send_signal(how)
        return self.process.wait(PATIENCE_S), time.monotonic() - start_s


def session_with(endpoint: str) -> zenoh.Session:
    """With whoever listens there, and nobody else; to be closed."""
    config = zenoh.Config()
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    config.insert_json5("scouting/multicast/enabled", "false")
    config.insert_json5("listen/endpoints", "[]")
    return zenoh.open(config)


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def write_config(
    folder: Path,
    port: str,
    endpoint: str,
    extra: str = "",
    top: str = "",
    driver: str = "",
    kind: str = "serial",
) -> Path:
    """An armd.toml beside an arm.toml."""
    path = folder / "armd.toml"
    path.write_text(
        f'schema = "armd.daemon/1"\narm = "arm.toml"\n{top}\n'
        f'[driver]\nkind = "{kind}"\nport = "{port}"\n{driver}\n'
        f'[zenoh]\nlisten = ["{endpoint}"]\n{extra}\n'
    )
    return path


@contextmanager
def running_daemon(
    folder: Path,
    port: str,
    extra: str = "",
    top: str = "",
    serial: str = "SIM-0001",
    environment: dict[str, str] | None = None,
    endpoint: str | None = None,
    driver: str = "",
    kind: str = "serial",
    through: Sequence[str] = (),
) -> Iterator[Daemon]:
    """Started, by the program *through* if given, and ready; killed at the end if it still runs."""
    endpoint = endpoint or free_endpoint()
    config = write_config(folder, port, endpoint, extra, top, driver, kind)
    log = folder / "daemon.log"
    with (
        log.open("w") as errors,
        subprocess.Popen(
            [*through, sys.executable, "-m", "armd.daemon.cli", "run", str(config)],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env=os.environ | (environment or {}),
        ) as process,
    ):
        try:
            assert process.stdout is not None
            line = process.stdout.readline()
            assert line.startswith("armd: ready "), (line, log.read_text())
            yield Daemon(process, endpoint, serial, log)
        finally:
            process.kill()
