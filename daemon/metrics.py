"""Health as OpenMetrics over HTTP on loopback, for Prometheus and its like."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from armd.daemon.state import State

CONTENT_TYPE = "application/openmetrics-text; version=1.0.0; charset=utf-8"


Health = dict[str, Any]


class MetricsServer:
    """Answers `GET /metrics` in threads of its own, from the health messages last published."""

    def __init__(
        self, port: int, healths: Callable[[], Sequence[Health]], host: str = "127.0.0.1"
    ) -> None:
        """Raises `OSError` if the port is taken. 0 takes a free one."""

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if self.path != "/metrics":
                    self.send_error(404)
                    return
                body = render(healths()).encode()
                self.send_response(200)
                self.send_header("Content-Type", CONTENT_TYPE)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: Any) -> None:
                """A scrape is not worth a line."""

        self._server = ThreadingHTTPServer((host, port), Handler)
        self._server.daemon_threads = True
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, name="metrics")
        self._thread.start()

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


def render(healths: Sequence[Health]) -> str:
    """OpenMetrics text of the health messages of one arm or many."""
    return "\n".join([*_lines(healths), "# EOF", ""])


def _lines(healths: Sequence[Health]) -> Iterator[str]:
    """All samples of a family stand together, as the format wants it."""
    yield "# TYPE armd_state stateset"
    for serial, health in _by_label(healths):
        for state in State:
            yield f'armd_state{{{serial},armd_state="{state}"}} {int(health["state"] == state)}'
    yield "# TYPE armd_points counter"
    for serial, health in _by_label(healths):
        yield f"armd_points_total{{{serial}}} {health['points']['published']}"
    yield "# TYPE armd_flagged_points counter"
    for serial, health in _by_label(healths):
        for flag, count in health["points"]["flagged"].items():
            yield f'armd_flagged_points_total{{{serial},flag="{flag}"}} {count}'
    yield "# TYPE armd_wire counter"
    for serial, health in _by_label(healths):
        for what, count in health["drops"].items():
            yield f'armd_wire_total{{{serial},what="{what}"}} {count}'
    yield "# TYPE armd_latency_seconds gauge"
    yield "# UNIT armd_latency_seconds seconds"
    for serial, health in _by_label(healths):
        for name, value_ms in health["latency"].items():
            yield f'armd_latency_seconds{{{serial},of="{name}"}} {value_ms / 1000:g}'
    yield "# TYPE armd_temperature_celsius gauge"
    yield "# UNIT armd_temperature_celsius celsius"
    for serial, health in _by_label(healths):
        for sensor, value_c in health["temperatures"].items():
            if value_c is not None:
                yield f'armd_temperature_celsius{{{serial},sensor="{sensor}"}} {value_c}'


def _by_label(healths: Sequence[Health]) -> Iterator[tuple[str, Health]]:
    return ((f'serial="{health["serial"]}"', health) for health in healths)
