"""How a person sees an arm in a terminal."""

from __future__ import annotations

import json
import time
from collections.abc import Iterator
from contextlib import ExitStack
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt
from rich.console import Console
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from armd import Arm, Flag, Point, keys
from armd.daemon.state import State
from armd.printable import printable

COLOURS = {
    State.READY: "green",
    State.WARMING: "yellow",
    State.INACCURATE: "yellow",
    State.DEGRADED: "yellow",
    State.NOT_READY: "red",
}
EVENTS_SHOWN = 3
WIDTH = 80


class Screen:
    """A panel that lives as long as its `with`; `show` brings it up to date."""

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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.close()

    def show(self, points: npt.NDArray[np.void], elapsed_s: float) -> None:
        """*points* (n,) of dtype `POINT` came during the last *elapsed_s*."""
        if len(points):
            self._point = Point.from_array(points[-1:])[0]
        for payload in self._health_stream.take():
            self._health = json.loads(payload)
        self._events += [
            json.loads(payload).get("text", "") for payload in self._event_stream.take()
        ]
        del self._events[:-EVENTS_SHOWN]
        self._live.update(self._panel(len(points) / elapsed_s), refresh=True)

    def _panel(self, rate_hz: float) -> Panel:
        table = Table.grid(padding=(0, 2))
        table.add_column(justify="right", style="dim")
        table.add_column()
        if self._point is not None:
            x, y, z = self._point.position_mm
            table.add_row("tip", f"[bold]{x:10.3f} {y:10.3f} {z:10.3f}[/] mm")
            dx, dy, dz = (1000 * value for value in self._point.correction_mm)
            table.add_row("correction", f"{dx:10.1f} {dy:10.1f} {dz:10.1f} µm")
            table.add_row("flags", flag_names(self._point.flags) or "none")
        if self._health:
            state = self._health.get("state", "")
            line = Text(printable(state), COLOURS.get(state, ""))
            line.append(f" {printable(self._health.get('reason', ''))}", "default")
            table.add_row("state", line)
            table.add_row("sensors", temperatures(self._health) or "none")
        refused = self._arm.refused
        odd = refused.malformed + refused.foreign
        stream = f"{rate_hz:.0f} points/s · {self._arm.lost.total} lost"
        table.add_row("stream", stream + (f" · {odd} of somebody else" if odd else ""))
        for event in self._events:
            table.add_row("event", Text(printable(event)))  # "[/x]" is no markup of ours
        title = Text(f"armd · {printable(self._arm.serial)}")
        return Panel(table, title=title, title_align="left", width=WIDTH)


def refreshes(seconds: float | None, every_s: float) -> Iterator[float]:
    """For ever or for *seconds*: the time since the last refresh, when the next is due."""
    start_s = last_s = time.monotonic()
    while seconds is None or last_s - start_s < seconds:
        time.sleep(every_s)
        now_s = time.monotonic()
        yield now_s - last_s
        last_s = now_s


def flag_names(flags: int) -> str:
    return " ".join(str(flag.name) for flag in Flag(flags))


def temperatures(health: dict[str, Any]) -> str:
    """All sensors of a health message in °C; a dash where one is invalid."""
    values = health.get("temperatures", {}).values()
    shown = "  ".join(
        f"{value:.2f}" if isinstance(value, int | float) else "  –  " for value in values
    )
    return f"{shown} °C" if shown else ""
