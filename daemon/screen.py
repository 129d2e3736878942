"""How a person sees an arm in a terminal."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from rich.panel import Panel
from rich.table import Table

from armd import Flag, Point
from armd.daemon.state import State

COLOURS = {
    State.READY: "green",
    State.WARMING: "yellow",
    State.INACCURATE: "yellow",
    State.DEGRADED: "yellow",
    State.NOT_READY: "red",
}


@dataclass
class Reading:
    """The latest of everything."""

    point: Point | None = None
    health: dict[str, Any] = field(default_factory=dict)
    rate_hz: float = 0.0
    lost: int = 0
    latency_ms: float | None = None
    events: list[str] = field(default_factory=list)


def picture(serial: str, reading: Reading) -> Panel:
    """A panel that fits 80 columns."""
    table = Table.grid(padding=(0, 2))
    table.add_column(justify="right", style="dim")
    table.add_column()
    if reading.point is not None:
        x, y, z = reading.point.position_mm
        table.add_row("tip", f"[bold]{x:10.3f} {y:10.3f} {z:10.3f}[/] mm")
        dx, dy, dz = (1000 * value for value in reading.point.correction_mm)
        table.add_row("correction", f"{dx:10.1f} {dy:10.1f} {dz:10.1f} µm")
        names = " ".join(str(flag.name) for flag in Flag(reading.point.flags)) or "none"
        table.add_row("flags", names)
    health = reading.health
    if health:
        state = State(health["state"])
        table.add_row("state", f"[{COLOURS[state]}]{state}[/] {health['reason']}")
        temperatures = list(health["temperatures"].values())
        shown = "  ".join("  –  " if value is None else f"{value:.2f}" for value in temperatures)
        table.add_row("sensors", f"{shown} °C" if temperatures else "none")
    latency = "" if reading.latency_ms is None else f" · latency {reading.latency_ms:.2f} ms"
    table.add_row("stream", f"{reading.rate_hz:.0f} points/s · {reading.lost} lost{latency}")
    for event in reading.events[-3:]:
        table.add_row("event", event)
    return Panel(table, title=f"armd · {serial}", title_align="left", width=80)
