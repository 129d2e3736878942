"""`armd run CONFIG`: run the daemon in the foreground, for systemd or a terminal."""

from __future__ import annotations

import argparse
import gc
import logging
import signal
import termios  # noqa: F401  # where it is missing, so are an arm's wires: said before all else
from contextlib import ExitStack, closing
from pathlib import Path
from typing import TYPE_CHECKING

from armd.compiled.rehearsal import run_rehearsal
from armd.daemon.config import Config, load_config
from armd.daemon.host.journal import keep_standard_streams_open, print_line
from armd.daemon.host.priority import raise_priority
from armd.daemon.host.root import refuse_root_service
from armd.daemon.live.arm_in_use import ArmInUse
from armd.daemon.network.session import open_zenoh_session
from armd.daemon.service import Service
from armd.drivers.table import open_driver
from armd.errors import BadInput

if TYPE_CHECKING:
    from armd.daemon.host.metrics import MetricsServer


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("config", metavar="CONFIG", type=Path, help="armd.toml")
    parser.add_argument("--allow-root", action="store_true", help="as a service too")


def run(args: argparse.Namespace) -> int:
    keep_standard_streams_open()
    refuse_root_service(args.allow_root)
    return serve(load_config(args.config))


def serve(config: Config) -> int:
    """Publish until a signal ends it, or until a replay has ended."""
    # From here on signals are noted, and carried out as soon as there is a service.
    signals = SignalRequests()
    arm = ArmInUse(config)
    run_rehearsal(config, arm)  # compiles all functions of the stream before it is ready
    driver = open_driver(config.driver, config.expectation)
    with ExitStack() as stack:
        session = stack.enter_context(open_zenoh_session(config))
        stack.enter_context(closing(driver))
        service = stack.enter_context(closing(Service(config, driver, session, arm)))
        if config.file.metrics is not None:
            stack.enter_context(closing(_serve_metrics(config, service)))
        signals.start_serving(service)
        gc.freeze()  # objects of the start-up stay: skip them in later collections
        print_line(_ready(config, arm))
        if config.driver.kind != "replay":  # a replay may run as fast as it can
            raise_priority()
        # From here on the journal reports, which never blocks on its reader.
        logging.getLogger("armd").setLevel(logging.WARNING)
        service.run()
    return 0


class SignalRequests:
    """Requests by signals to end or to reload; they also work before there is a service.

    SIGTERM and SIGINT end the process at once then; a reload is kept for the service.
    """

    def __init__(self) -> None:
        self._service: Service | None = None
        self._reload = False
        signal.signal(signal.SIGHUP, self._hang_up)

    def start_serving(self, service: Service) -> None:
        """Pass signals to the service from now on."""
        self._service = service
        signal.signal(signal.SIGTERM, lambda *_: service.stop())
        signal.signal(signal.SIGINT, lambda *_: service.stop())
        if self._reload:
            service.ask_reload()

    def _hang_up(self, *_: object) -> None:
        self._reload = True
        if self._service is not None:
            self._service.ask_reload()


def _serve_metrics(config: Config, service: Service) -> MetricsServer:
    from armd.daemon.host.metrics import MetricsServer  # asyncio and TLS take 3 MB

    assert config.file.metrics is not None
    port = config.file.metrics.port
    try:
        return MetricsServer(port, lambda: [service.health()])
    except OSError as error:
        problem = f"{port}: {error.strerror}"
        raise BadInput(config.path, "metrics.port", problem, "a free port") from error


def _ready(config: Config, arm: ArmInUse) -> str:
    endpoints = ", ".join(config.file.zenoh.listen) or "no listener"
    if config.file.zenoh.config is not None:
        endpoints = config.file.zenoh.config
    calibration = arm.calibration
    made_with = "nominal geometry" if calibration is None else calibration.sha256[:16]
    line = f"armd: ready {config.arm.serial_number} on {endpoints}, {made_with}"
    if config.driver.kind == "replay":
        return line
    # Subscribers may connect now; the state shows when the arm itself is there.
    source = getattr(config.driver, "port", None) or getattr(config.driver, "interface", "")
    return f"{line}; waiting for the arm on {source}"
