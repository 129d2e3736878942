"""A bridge (`armd stream`, `armd ippdme`, …) in a process of its own, until it says it is ready.

with running_bridge("stream", "--endpoint", daemon.endpoint, "--listen", "127.0.0.1:0") as bridge:
    with bridge.connect() as connection: ...
"""

from __future__ import annotations

import signal
import socket
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from support.program import ARMD
from support.waiting import PATIENCE_S


@dataclass
class RunningBridge:
    process: subprocess.Popen[str]
    ready: str
    """The line that said so."""

    @property
    def where(self) -> str:
        return self.ready.rsplit(" on ", 1)[1]

    def connect(self) -> socket.socket:
        host, _, port = self.where.rpartition(":")
        return socket.create_connection((host, int(port)), PATIENCE_S)

    def stop(self, how: signal.Signals = signal.SIGTERM) -> int:
        self.process.send_signal(how)
        return self.process.wait(PATIENCE_S)


@contextmanager
def running_bridge(command: str, *options: str) -> Iterator[RunningBridge]:
    with subprocess.Popen([*ARMD, command, *options], stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            line = process.stdout.readline().strip()
            assert line.startswith(f"armd: ready {command} on "), line
            yield RunningBridge(process, line)
        finally:
            process.kill()
