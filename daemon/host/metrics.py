"""Health as OpenMetrics over HTTP on loopback, for Prometheus and similar programs.

One thread serves all, a few at a time and each for a limited time. So clients, however many and
however slow, take only that thread's time from the stream. (prometheus_client's own server has a
thread for each connection and waits for each without limit.)
"""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from armd.daemon.state import State

CONTENT_TYPE = "application/openmetrics-text; version=1.0.0; charset=utf-8"
#: Connections served together; for a further one the longest silent one is closed. A scraper
#: needs one.
MOST_OPEN = 8
#: Time limit from connecting to the last byte of the answer.
PATIENCE_S = 3.0
MOST_REQUEST_BYTES = 8192

#: Errors of a request that only the other side causes.
BROKEN_OFF = (OSError, TimeoutError, asyncio.IncompleteReadError, asyncio.LimitOverrunError)
_log = logging.getLogger(__name__)

HealthRecord = dict[str, Any]


class MetricsServer:
    """Answers `GET /metrics` from the last health messages, in a separate thread."""

    def __init__(
        self, port: int, healths: Callable[[], Sequence[HealthRecord]], host: str = "127.0.0.1"
    ) -> None:
        """Start the server; raises `OSError` if *port* is taken. 0 takes a free port."""
        self._healths = healths
        self._open = 0
        self._silent: dict[asyncio.StreamWriter, None] = {}  # no request yet, oldest first
        listener = socket.create_server((host, port), backlog=MOST_OPEN)
        self.port: int = listener.getsockname()[1]
        self._loop = asyncio.new_event_loop()
        self._closed = asyncio.Event()
        self._thread = threading.Thread(
            target=self._serve, args=(listener,), name="metrics", daemon=True
        )
        self._thread.start()

    def close(self) -> None:
        self._loop.call_soon_threadsafe(self._closed.set)
        self._thread.join(PATIENCE_S)

    def _serve(self, listener: socket.socket) -> None:
        with asyncio.Runner(loop_factory=lambda: self._loop) as runner:  # cancels open connections
            runner.run(self._until_closed(listener))

    async def _until_closed(self, listener: socket.socket) -> None:
        server = await asyncio.start_server(self._answer, sock=listener, limit=MOST_REQUEST_BYTES)
        await self._closed.wait()
        server.close()

    async def _answer(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._open >= MOST_OPEN:
            if not self._silent:
                writer.transport.abort()
                return
            oldest = next(iter(self._silent))
            del self._silent[oldest]
            oldest.transport.abort()
        self._open += 1
        self._silent[writer] = None
        try:
            async with asyncio.timeout(PATIENCE_S):
                request = await reader.readuntil(b"\r\n\r\n")
                self._silent.pop(writer, None)
                writer.write(self._reply(request))
                await writer.drain()
                writer.close()
                await writer.wait_closed()
        except Exception as error:
            if not isinstance(error, BROKEN_OFF):
                _log.exception("metrics")
            writer.transport.abort()
        finally:
            self._open -= 1
            self._silent.pop(writer, None)

    def _reply(self, request: bytes) -> bytes:
        method, path, *_ = [*request.split(b"\r\n", 1)[0].split(b" "), b"", b""]
        if path.partition(b"?")[0] != b"/metrics":
            status, kind, body = "404 Not Found", "text/plain", b"only /metrics\n"
        elif method != b"GET":
            status, kind, body = "405 Method Not Allowed", "text/plain", b"only GET\n"
        else:
            status, kind, body = "200 OK", CONTENT_TYPE, render(self._healths()).encode()
        head = (
            f"HTTP/1.1 {status}\r\nContent-Type: {kind}\r\nContent-Length: {len(body)}\r\n"
            "Connection: close\r\n\r\n"
        )
        return head.encode() + body


def render(healths: Sequence[HealthRecord]) -> str:
    """Return the OpenMetrics text of the health messages of one arm or many."""
    return "\n".join([*_write_lines(healths), "# EOF", ""])


def _write_lines(healths: Sequence[HealthRecord]) -> Iterator[str]:
    """Yield the lines, with all samples of a family together, as the format requires.

    A value that a message lacks has no sample: an arm of another version must not remove all
    values.
    """
    yield "# TYPE armd_state stateset"
    for serial, health in _label_healths(healths):
        for state in State:
            yield f'armd_state{{{serial},armd_state="{state}"}} {int(health["state"] == state)}'
    yield "# TYPE armd_points counter"
    for serial, health in _label_healths(healths):
        if "points" in health:
            yield f"armd_points_total{{{serial}}} {health['points']['published']}"
    yield "# TYPE armd_flagged_points counter"
    for serial, health in _label_healths(healths):
        for flag, count in health.get("points", {}).get("flagged", {}).items():
            yield f'armd_flagged_points_total{{{serial},flag="{_escape(flag)}"}} {count}'
    yield "# TYPE armd_wire counter"
    for serial, health in _label_healths(healths):
        for counter, count in health["drops"].items():
            yield f'armd_wire_total{{{serial},what="{_escape(counter)}"}} {count}'
    yield "# TYPE armd_latency_seconds gauge"
    yield "# UNIT armd_latency_seconds seconds"
    for serial, health in _label_healths(healths):
        for name, value_ms in health.get("latency", {}).items():
            yield f'armd_latency_seconds{{{serial},of="{_escape(name)}"}} {value_ms / 1000:g}'
    yield "# TYPE armd_temperature_celsius gauge"
    yield "# UNIT armd_temperature_celsius celsius"
    for serial, health in _label_healths(healths):
        for sensor, value_c in health["temperatures"].items():
            if value_c is not None:
                yield f'armd_temperature_celsius{{{serial},sensor="{_escape(sensor)}"}} {value_c}'


def _label_healths(healths: Sequence[HealthRecord]) -> Iterator[tuple[str, HealthRecord]]:
    return ((f'serial="{_escape(health["serial"])}"', health) for health in healths)


def _escape(label: str) -> str:
    """Escape a label's value for OpenMetrics, where it is between quotation marks."""
    return label.replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
