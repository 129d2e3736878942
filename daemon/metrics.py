"""Health as OpenMetrics over HTTP on loopback, for Prometheus and its like."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from armd.daemon.state import State

CONTENT_TYPE = "application/openmetrics-text; version=1.0.0; charset=utf-8"


class MetricsServer:
    """Answers `GET /metrics` in threads of its own, from the health message last published."""

    def __init__(self, port: int, health: Callable[[], dict[str, Any]]) -> None:
        """Raises `OSError` if the port is taken. 0 takes a free one."""

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                if self.path != "/metrics":
                    self.send_error(404)
                    return
                body = render(health()).encode()
                self.send_response(200)
                self.send_header("Content-Type", CONTENT_TYPE)
                self.send_header("Content-Length", str(len(body)))
                self.end_headers()
                self.wfile.write(body)

            def log_message(self, format: str, *args: Any) -> None:
                """A scrape is not worth a line."""

        self._server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
        self._server.daemon_threads = True
        self.port: int = self._server.server_address[1]
        self._thread = threading.Thread(target=self._server.serve_forever, name="metrics")
        self._thread.start()

    def close(self) -> None:
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()


def render(health: dict[str, Any]) -> str:
    """OpenMetrics text of a health message."""
    return "\n".join([*_lines(health), "# EOF", ""])


def _lines(health: dict[str, Any]) -> Iterator[str]:
    serial = f'serial="{health["serial"]}"'
    yield "# TYPE armd_state stateset"
    for state in State:
        yield f'armd_state{{{serial},armd_state="{state}"}} {int(health["state"] == state)}'
    yield "# TYPE armd_points counter"
    yield f"armd_points_total{{{serial}}} {health['points']['published']}"
    yield "# TYPE armd_flagged_points counter"
    for flag, count in health["points"]["flagged"].items():
        yield f'armd_flagged_points_total{{{serial},flag="{flag}"}} {count}'
    yield "# TYPE armd_wire counter"
    for what, count in health["drops"].items():
        yield f'armd_wire_total{{{serial},what="{what}"}} {count}'
    yield "# TYPE armd_latency_seconds gauge"
    yield "# UNIT armd_latency_seconds seconds"
    for name, value_ms in health["latency"].items():
        yield f'armd_latency_seconds{{{serial},of="{name}"}} {value_ms / 1000:g}'
    yield "# TYPE armd_temperature_celsius gauge"
    yield "# UNIT armd_temperature_celsius celsius"
    for sensor, value_c in health["temperatures"].items():
        if value_c is not None:
            yield f'armd_temperature_celsius{{{serial},sensor="{sensor}"}} {value_c}'
