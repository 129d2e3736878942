"""Sets up the demo in its own folder: a simulated arm, its calibration, a daemon."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Self

from armd.closing import Closing
from armd.errors import ArmdError

SIMULATOR = [sys.executable, "-P", "-m", "armd.simulator"]
#: -P: nothing is imported from the current folder.
ARMD = [sys.executable, "-P", "-m", "armd.daemon.cli"]
STOP_S = 5.0

CONFIG = """\
schema = "armd.daemon/1"
arm = "arm.toml"
{calibration}

[driver]
{driver}

[zenoh]
listen = ["{endpoint}"]

[limits]
temperature_rate_k_per_h = 1e5  # this arm warms up in seconds: sensors and links alike run fast

[health]
steady_k_per_h = 360.0

[measurement]
log = false  # a demonstration leaves nothing behind
"""


@dataclass(frozen=True)
class DemoWire:
    """The connection of the simulated arm."""

    name: str  # for a person
    simulator: tuple[str, ...]  # its options
    driver: (
        str  # [driver] of armd.toml, with what the simulator prints in {place} or {host}, {port}
    )
    rate_hz: int


def make_servo_wire(family: str, joints: int) -> DemoWire:
    """Return the wire of a printed arm on a servo bus, with its gripper's servo as button."""
    driver = (
        f'kind = "{family}"\nport = "{{place}}"\nids = {list(range(1, joints + 1))}\n'
        f"temperature_ids = {list(range(2, joints + 2))}\n"
        f"trigger = {{{{ id = {joints + 1}, pressed_below = 1900 }}}}"
    )
    return DemoWire(f"its {family} bus", ("--servo", family), driver, 500)


SERIAL = DemoWire("its pty", ("--serial",), 'kind = "serial"\nport = "{place}"', 1000)
CAN = DemoWire(
    "CAN",
    ("--can", "socketcand"),
    'kind = "can"\ninterface = "socketcand"\nchannel = "can0"\nrate_hz = 500\n'
    'host = "{host}"\nport = {port}',
    500,
)


class Stage(Closing):
    """A context that provides the demo's folder; `start` starts its processes.

    Leaving it stops the processes and removes the folder.
    """

    def __init__(
        self,
        wire: DemoWire,
        seed: int,
        warm_up_k: float,
        warm_up_s: float,
        joints: int | None = None,
    ) -> None:
        """Prepare a stage; *joints* is their number if it is not the wire's usual one."""
        self._wire = wire
        self._seed = str(seed)
        self._simulation = [
            *(*wire.simulator, "--rate", str(wire.rate_hz), "--seed", self._seed),
            *("--warm-up-k", str(warm_up_k), "--warm-up-s", str(warm_up_s)),
            *(() if joints is None else ("--joints", str(joints))),
        ]
        self._stack, self._processes = ExitStack(), ExitStack()

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            self.folder = Path(stack.enter_context(TemporaryDirectory(prefix="armd-demo-")))
            self.truth = self.folder / "truth.bin"
            self.endpoint = f"tcp/127.0.0.1:{_find_free_port()}"
            stack.enter_context(self._processes)
            self._stack = stack.pop_all()
        return self

    def close(self) -> None:
        self._stack.close()

    def calibrate(self) -> None:
        """Measure the simulated arm at five temperatures, and identify it from the sessions."""
        sessions = self.folder / "sessions"
        _run_command([*SIMULATOR, "--session", "demo", "--seed", self._seed, "-o", str(sessions)])
        measured = sorted(str(path.parent) for path in sessions.glob("*/session.toml"))
        arm, calibration = str(sessions / "arm.toml"), str(self.folder / "calibration.json")
        _run_command(
            [*ARMD, "calibrate", *measured, "--arm", arm, "-o", calibration, "--thermal", "1"]
        )

    def start(self) -> None:
        """Start the arm on its wire, then the daemon, and wait until it is ready."""
        output_options = ["--arm-out", str(self.folder / "arm.toml"), "--truth", str(self.truth)]
        log = ["--fault-log", str(self.folder / "simulator.jsonl")]
        place = self._start([*SIMULATOR, *self._simulation, *output_options, *log], "simulator.log")
        config = self.folder / "armd.toml"
        host, _, port = place.rpartition(":")
        driver = self._wire.driver.format(place=place, host=host, port=port)
        calibrated = (self.folder / "calibration.json").exists()
        calibration = 'calibration = "calibration.json"' if calibrated else ""
        text = CONFIG.format(calibration=calibration, driver=driver, endpoint=self.endpoint)
        config.write_text(text, encoding="utf-8")
        self._start([*ARMD, "run", str(config)], "daemon.log")

    def stop(self) -> None:
        """Stop arm and daemon; their files stay until the stage is left."""
        self._processes.close()

    def _start(self, command: list[str], log_name: str) -> str:
        """Start a process that lives as long as the stage; return its first line of output."""
        log = self._processes.enter_context((self.folder / log_name).open("w+", encoding="utf-8"))
        # Ctrl-C reaches only the demo, which then stops the others in order.
        process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=log, text=True, start_new_session=True,
            env=os.environ | {"STATE_DIRECTORY": str(self.folder / "state")},
        )  # fmt: skip
        self._processes.callback(_stop, process)
        assert process.stdout is not None
        line = process.stdout.readline().strip()
        if not line:
            raise ArmdError(f"{command[2]} did not start: {_read_last_line(log)}")
        return line


def _run_command(command: list[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        raise ArmdError(f"{' '.join(command[1:4])} failed: {done.stderr.strip()}")


def _stop(process: subprocess.Popen[str]) -> None:
    process.terminate()
    try:
        process.wait(STOP_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
    if process.stdout is not None:
        process.stdout.close()


def _read_last_line(log: IO[str]) -> str:
    log.seek(0)
    return (log.read().strip().splitlines() or ["it said nothing"])[-1]


def _find_free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])
