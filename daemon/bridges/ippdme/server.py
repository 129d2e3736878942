"""The network side: clients by TCP, the arm by Zenoh, both on one event loop.

Nothing on the loop blocks.
"""

from __future__ import annotations

import asyncio
import json
import math
import sys
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

import numpy as np

from armd import POINT, Arm, ArmdError, keys
from armd.daemon.bridges.ippdme.commands_2_5 import VERSIONS
from armd.daemon.bridges.ippdme.csy import CoordinateSystems, locate_state_file
from armd.daemon.bridges.ippdme.dialogue import Dialogue
from armd.daemon.bridges.ippdme.errors import DmeError
from armd.daemon.bridges.ippdme.grammar import LONGEST
from armd.daemon.bridges.ippdme.machine import Machine
from armd.daemon.bridges.ippdme.report import format_error
from armd.daemon.bridges.ippdme.tools import REF_TOOL, Toolbox
from armd.daemon.bridges.listening import Address, Client, open_listener
from armd.daemon.bridges.process import report_ready, run_in_thread
from armd.daemon.bridges.tips import CmmTip, Tips, parse_vector
from armd.errors import BadInput
from armd.printable import to_printable

TICK_S = 0.02
#: The arm's buttons (from 0) that act as keys of the host and make no hit.
KEYS = {1: "Done", 2: "Del"}
#: The daemon's events that are errors of a machine: kind → error number, and where it occurred.
FAULTS: dict[str, tuple[int, Callable[[Mapping[str, Any]], str]]] = {
    "joint_invalid": (2503, lambda event: f"encoder{event['detail'].get('joint', '')}"),
    "count_jump": (2502, lambda event: f"encoder{event['detail'].get('joint', '')}"),
}


class Connection(Client):
    """One client's socket, which converts between bytes and lines."""

    def __init__(self, machine: Machine, version: str, all_of_them: set[Connection]) -> None:
        super().__init__()
        self._all = all_of_them
        self._unread = b""
        self.dialogue = Dialogue(machine, VERSIONS[version], version, self._send_line)

    def begin(self) -> None:
        self._all.add(self)

    def end(self) -> None:
        self._all.discard(self)
        self.dialogue.end()

    def data_received(self, data: bytes) -> None:
        *lines, self._unread = (self._unread + data).split(b"\n")
        for line in lines:
            if not self.connected:
                return
            # A line that ends without CR keeps its LF, so that the grammar refuses it.
            text = line[:-1] if line.endswith(b"\r") else line + b"\n"
            if len(text) > LONGEST:
                self._too_long()
                return
            self.dialogue.receive(text.decode("latin-1"))
        if len(self._unread) > LONGEST:
            self._too_long()

    def _too_long(self) -> None:
        self._send_line(f"E0000 ! {format_error(DmeError(8), 'line')}")
        self._unread = b""
        self.close()

    def _send_line(self, line: str) -> None:
        self.send(f"{line}\r\n".encode("ascii"))


class DmeServer:
    """Serves one arm to inspection software."""

    def __init__(self, arm: Arm, version: str, aliases: Mapping[str, str]) -> None:
        self._arm = arm
        self._version = version
        self._aliases = aliases
        self._connections: set[Connection] = set()
        self._uptime_s = 0.0
        self._tasks: set[asyncio.Task[None]] = set()  # asyncio keeps only weak references

    async def serve(self, address: Address) -> None:
        """Serve clients at *address* until cancelled.

        Raises `BadInput` for an alias of an unknown tip.
        """
        info = await run_in_thread(self._arm.info)
        tips = Tips(info)
        for alias, tip in self._aliases.items():
            if tip not in (REF_TOOL, *tips.names):
                tip_names = ", ".join([REF_TOOL, *tips.names])
                expected = f"a tip: {tip_names}"
                raise BadInput("the command line", "--alias", f"{alias}={tip}", expected)
        toolbox = Toolbox(tips, self._aliases, info["tip"])
        systems = CoordinateSystems(locate_state_file(self._arm.serial))
        if systems.lost is not None:
            print(to_printable(f"armd: {systems.lost}"), file=sys.stderr, flush=True)
        self._machine = Machine(
            tips, toolbox, systems, self._select_tip, compute_reach_mm(info, tips)
        )
        loop = asyncio.get_running_loop()
        listeners: dict[str, Callable[[dict[str, Any]], None]] = {
            keys.MEASUREMENT: self._take_measurement,
            keys.EVENT: self._take_event,
            keys.HEALTH: self._take_health,
        }

        def on_loop(take: Callable[[dict[str, Any]], None]) -> Callable[[bytes], None]:
            def hand_over(data: bytes) -> None:  # in Zenoh's thread
                if not loop.is_closed():
                    loop.call_soon_threadsafe(lambda: take(json.loads(data)))

            return hand_over

        with ExitStack() as stack:
            for topic_key, take in listeners.items():
                stack.enter_context(self._arm.calling(topic_key, on_loop(take)))
            points = stack.enter_context(self._arm.stream(keys.POINT))
            server, endpoint = await open_listener(address, self._connection)
            async with server:
                report_ready("ippdme", endpoint)
                while True:
                    await asyncio.sleep(TICK_S)
                    self._tick(points.take())

    def _connection(self) -> Connection:
        return Connection(self._machine, self._version, self._connections)

    def _tick(self, payloads: list[bytes]) -> None:
        if payloads:
            self._machine.note_point(np.frombuffer(payloads[-1], POINT)[0])
        if self._machine.take_loss():
            self._tell(lambda dialogue: dialogue.take_error(DmeError(503), "armd"))
        now_s = time.monotonic()
        self._tell(lambda dialogue: dialogue.tick(now_s))

    def _tell(self, say: Callable[[Dialogue], None]) -> None:
        for connection in list(self._connections):
            say(connection.dialogue)

    def _take_measurement(self, measurement: dict[str, Any]) -> None:
        self._tell(lambda dialogue: dialogue.take_measurement(measurement))

    def _take_event(self, event: dict[str, Any]) -> None:
        kind, detail = event["kind"], event.get("detail") or {}
        if kind == "button":
            self._take_keys(name_keys(detail.get("buttons", [])), detail.get("seq", 0))
        elif kind == "tip" and "tip" in detail:
            if detail.get("offset_mm") is not None:  # it may have been calibrated again
                tip = CmmTip(parse_vector(detail["offset_mm"]), detail["radius_mm"])
                self._machine.toolbox.renew(detail["tip"], tip)
            self._note_tip(detail["tip"])
        elif kind in FAULTS:
            number, place = FAULTS[kind]
            self._tell(lambda dialogue: dialogue.take_error(DmeError(number), place(event)))

    def _take_keys(self, names: list[str], seq: int) -> None:
        def take(dialogue: Dialogue) -> None:
            for name in names:
                dialogue.take_key(name, seq)

        self._tell(take)

    def _take_health(self, health: dict[str, Any]) -> None:
        self._machine.temperatures_c = health["temperatures"]
        if health["uptime_s"] < self._uptime_s:  # a restarted daemon sends no event of its tip
            self._note_tip(health["tip"])
        self._uptime_s = health["uptime_s"]

    def _note_tip(self, tip_name: str | None) -> None:
        tool = self._machine.toolbox.note_tip(tip_name)
        if tool is not None:
            self._tell(lambda dialogue: dialogue.take_tool(tool.name))

    def _select_tip(self, name: str, settle: Callable[[bool], None]) -> None:
        async def ask() -> None:
            try:
                await run_in_thread(lambda: self._arm.command("tip", name=name))
            except ArmdError:
                settle(False)
            else:
                settle(True)

        task = asyncio.ensure_future(ask())
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)


def compute_reach_mm(info: Mapping[str, Any], tips: Tips) -> float:
    """Return the length of all links in one line with the longest tip.

    One per cent is added, for the changes that a calibration makes.
    """
    links = sum(abs(joint["a_mm"]) + abs(joint["d_mm"]) for joint in info["arm"]["joint"])
    longest = max(math.hypot(*tip.offset_mm) for tip in tips.by_name.values())
    return float(1.01 * (links + longest))


def name_keys(buttons: list[int]) -> list[str]:
    """Return the host's names of buttons that were pressed together.

    The list is empty if the first button is among them.
    """
    if not buttons or 0 in buttons:
        return []
    return [KEYS.get(button, f"F{button - len(KEYS)}") for button in buttons]
