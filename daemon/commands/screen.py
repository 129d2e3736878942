"""The display of an arm in a terminal."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Iterator
from contextlib import ExitStack
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from armd import Arm, Flag, Point, keys
from armd.closing import Closing
from armd.daemon.state import State
from armd.printable import to_printable

COLOURS = {
    State.READY: "green",
    State.WARMING: "yellow",
    State.INACCURATE: "yellow",
    State.DEGRADED: "yellow",
    State.NOT_READY: "red",
}
EVENTS_SHOWN = 3
WIDTH = 80


class Screen(Closing):
    """A panel that exists within its `with` statement; `show` updates it."""

    def __init__(self, arm: Arm, console: Console) -> None:
        self._arm = arm
        self._console = console
        self._point: Point | None = None
        self._health: dict[str, Any] = {}
        self._events: list[str] = []

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self._health_stream = stack.enter_context(self._arm.stream(keys.HEALTH))
            self._event_stream = stack.enter_context(self._arm.stream(keys.EVENT))
            self._live = stack.enter_context(Live(console=self._console, auto_refresh=False))
            self._stack = stack.pop_all()
        return self

    def close(self) -> None:
        self._stack.close()

    def show(self, points: npt.NDArray[np.void], elapsed_s: float) -> None:
        """Update the panel with *points* (n,) of dtype `POINT` of the last *elapsed_s*."""
        if len(points):
            self._point = Point.from_array(points[-1:])[0]
        for payload in self._health_stream.take():
            self._health = json.loads(payload)
        self._events += [
            json.loads(payload).get("text", "") for payload in self._event_stream.take()
        ]
        del self._events[:-EVENTS_SHOWN]
        self.panel = self._panel(len(points) / elapsed_s)
        self._live.update(self.panel, refresh=True)

    def _panel(self, rate_hz: float) -> Panel:
        table = Table.grid(padding=(0, 2))
        table.add_column(justify="right", style="dim")
        table.add_column()
        if self._point is not None:
            x, y, z = self._point.position_mm
            table.add_row("tip", f"[bold]{x:10.3f} {y:10.3f} {z:10.3f}[/] mm")
            dx, dy, dz = (1000 * value for value in self._point.correction_mm)
            table.add_row("correction", f"{dx:10.1f} {dy:10.1f} {dz:10.1f} µm")
            table.add_row("uncertainty", format_uncertainty(self._point))
            table.add_row("flags", format_flags(self._point.flags) or "none")
        if self._health:
            state = self._health.get("state", "")
            line = Text(to_printable(state), COLOURS.get(state, ""))
            line.append(f" {to_printable(self._health.get('reason', ''))}", "default")
            table.add_row("state", line)
            table.add_row(
                "sensors", Text(to_printable(format_temperatures(self._health) or "none"))
            )
            table.add_row("in use", Text(to_printable(format_sources(self._health))))
        refused = self._arm.refused
        n_rejected = refused.malformed + refused.foreign
        stream = f"{rate_hz:.0f} points/s · {self._arm.lost.total} lost"
        table.add_row(
            "stream", stream + (f" · {n_rejected} of somebody else" if n_rejected else "")
        )
        for event in self._events:
            table.add_row("event", Text(to_printable(event)))  # "[/x]" in a text is not markup
        title = Text(f"armd · {to_printable(self._arm.serial)}")
        end = Text("Ctrl-C ends it", "dim")
        return Panel(
            table, title=title, title_align="left", width=WIDTH, subtitle=end,
            subtitle_align="right",
        )  # fmt: skip


def generate_refreshes(seconds: float | None, every_s: float) -> Iterator[float]:
    """Yield the time since the last refresh whenever the next is due.

    It ends after *seconds*, or never.
    """
    start_s = last_s = time.monotonic()
    while seconds is None or last_s - start_s < seconds:
        time.sleep(every_s)
        now_s = time.monotonic()
        yield now_s - last_s
        last_s = now_s


def format_flags(flags: int) -> str:
    return " ".join(str(flag.name) for flag in Flag(flags))


def format_temperatures(health: dict[str, Any]) -> str:
    """Format all sensors of a health message by name, in °C, with a dash for an invalid one."""
    cells = "  ".join(
        f"{name} {value:.2f}" if isinstance(value, int | float) else f"{name} –"
        for name, value in health.get("temperatures", {}).items()
    )
    return f"{cells} °C" if cells else ""


def format_uncertainty(point: Point) -> str:
    """Format the expanded uncertainty (k = 2) along each axis, in µm.

    It is from the point's covariance.
    """
    xx, _, _, yy, _, zz = point.covariance_mm2
    axes = [2e3 * math.sqrt(v) if v >= 0 else math.nan for v in (xx, yy, zz)]
    if any(map(math.isnan, axes)):
        return "not known"
    return " ".join(f"{u:10.1f}" for u in axes) + " µm (k = 2)"


def format_sources(health: dict[str, Any]) -> str:
    """Format tip, calibration, and the source of the samples."""
    name = health.get("tip") or "of the calibration"
    calibration = health.get("calibration") or "none"
    return f"tip {name} · calibration {calibration} · {health.get('source', 'live')}"
