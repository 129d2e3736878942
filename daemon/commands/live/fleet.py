"""`armd fleet`: list all arms at one endpoint, usually a plant's router."""

from __future__ import annotations

import argparse
import json
import threading
from contextlib import ExitStack, closing
from pathlib import Path

import zenoh
from rich.live import Live
from rich.table import Table
from rich.text import Text

import armd
from armd.daemon.bridges import process
from armd.daemon.bridges.fleet import Fleet, Listening, show_repeatedly
from armd.daemon.bridges.listening import parse_address
from armd.daemon.commands.screen import COLOURS, format_temperatures
from armd.daemon.host.metrics import MetricsServer
from armd.errors import BadInput
from armd.printable import to_printable
from armd.terminal.plain import make_moving_console
from armd.zenoh_session import open_session

EVERY_S = 1.0
EVENTS_SHOWN = 5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("serial", nargs="?", help="only this arm (all of them)")
    endpoint_group = parser.add_mutually_exclusive_group()
    endpoint_group.add_argument(
        "--endpoint", default=armd.ENDPOINT, help=f"of a router or a daemon ({armd.ENDPOINT})"
    )
    endpoint_group.add_argument(
        "--router",
        type=Path,
        metavar="FILE",
        help="be the router oneself, with this Zenoh configuration (plant-router.json5)",
    )
    parser.add_argument("--json", action="store_true", help="a line per arm and second")
    parser.add_argument("--seconds", type=float, metavar="S", help="stop by itself (at Ctrl-C)")
    parser.add_argument(
        "--metrics",
        type=parse_address,
        metavar="HOST:PORT",
        help="serve OpenMetrics of all arms there",
    )


def run(args: argparse.Namespace) -> int:
    return process.serve_alone(lambda: _watch(args))


async def _watch(args: argparse.Namespace) -> None:
    session = await process.wait_for_connection(lambda: _open(args), args.endpoint)
    with ExitStack() as stack:
        stack.callback(_close, session)
        fleet = Fleet()
        listening = await process.run_in_thread(lambda: Listening(session, fleet, args.serial))
        stack.enter_context(closing(listening))
        if args.metrics is not None:
            _serve_metrics(args, fleet, stack)
        elif not args.json and args.router is not None:
            process.report_ready("fleet", str(args.router))
        show = _print if args.json else stack.enter_context(_Screen()).show
        await show_repeatedly(fleet, show, EVERY_S, args.seconds)


def _open(args: argparse.Namespace) -> zenoh.Session:
    if args.router is None:
        return open_session(args.endpoint, process.WAIT_S)
    try:
        return zenoh.open(zenoh.Config.from_file(str(args.router)))
    except zenoh.ZError as error:
        problem = str(error).split(" at /")[0]
        raise BadInput(args.router, "the file", problem, "a router's configuration") from error


def _close(session: zenoh.Session) -> None:
    closing = threading.Thread(target=session.close, daemon=True)
    closing.start()
    closing.join(process.CLOSE_S)


def _serve_metrics(args: argparse.Namespace, fleet: Fleet, stack: ExitStack) -> None:
    host, port = args.metrics
    try:
        server = stack.enter_context(closing(MetricsServer(port, fleet.healths, host)))
    except OSError as error:
        problem = f"{host}:{port}: {error.strerror}"
        raise BadInput(
            "the command line", "--metrics", problem, "an address to listen on"
        ) from error
    if not args.json:
        process.report_ready("fleet", f"{host}:{server.port}")


def _print(fleet: Fleet) -> None:
    for row in fleet.rows():
        print(json.dumps(row), flush=True)


class _Screen(Live):
    """A table in the terminal."""

    def __init__(self) -> None:
        super().__init__(console=make_moving_console(), auto_refresh=False)

    def show(self, fleet: Fleet) -> None:
        self.update(make_table(fleet), refresh=True)


def make_table(fleet: Fleet) -> Table:
    """Return a table of the arms; their texts are shown without markup and control codes."""
    table = Table("arm", "state", "points/s", "lost", "temperatures", "calibration")
    for row in fleet.rows():
        state = Text(to_printable(row["state"]), COLOURS.get(row["state"], ""))
        state.append(f" {to_printable(row['reason'])}", "default")
        cells = (
            f"{row['points_hz']:.0f}",
            row["lost"],
            format_temperatures(row) or "none",
            (row["calibration"] or "none")[:8],
        )
        table.add_row(_as_text(row["serial"]), state, *map(_as_text, cells))
    for serial, text in list(fleet.events)[-EVENTS_SHOWN:]:
        table.add_row(_as_text(serial), Text(to_printable(text), "dim"))
    return table


def _as_text(cell: object) -> Text:
    return Text(to_printable(cell))
