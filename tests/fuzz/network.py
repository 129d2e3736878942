"""What comes over a network beside messages: answers, commands, binary keys, readers, scrapes."""

from __future__ import annotations

import asyncio
import base64
import io
import json
import logging
import queue
import socket
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import zenoh
from fuzz.doors import Door, Fault, check_message, check_printed
from fuzz.files import DAEMON
from fuzz.messages import fleet_of, received, ros2
from fuzz.offline import SEALED, asked
from rich.console import Console

from armd import POINT, Point, keys
from armd.client import Arm
from armd.daemon.bridges import lines
from armd.daemon.bridges.fleet import Fleet
from armd.daemon.bridges.listening import open_listener
from armd.daemon.bridges.ros2 import urdf
from armd.daemon.bridges.stream import Reader
from armd.daemon.bridges.tips import Tips
from armd.daemon.bridges.view import page_messages
from armd.daemon.bridges.view.feed import describe_arm
from armd.daemon.commands.live.fleet import make_table
from armd.daemon.commands.screen import Screen
from armd.daemon.config import load_config
from armd.daemon.files.recorder import Recorder
from armd.daemon.host.metrics import MetricsServer, render
from armd.daemon.info import describe
from armd.daemon.live.arm_in_use import ArmInUse
from armd.daemon.live.changes import Changes
from armd.daemon.measure.in_use import get_in_use
from armd.daemon.network.queries import Queries
from armd.daemon.service import Service
from armd.daemon.unexpected import Unexpected
from armd.drivers.replay import raw
from armd.drivers.sample import RawFrame
from armd.files.toml_text import format_toml
from armd.received import is_sound
from support.careless_network import EVENT, HEALTH
from support.small_arm_toml import ARM

LISTENING = DAEMON + "[commands]\nenabled = true\n"
WHOLE_HEALTH = HEALTH | {
    "serial": "S", "points": {"published": 7, "flagged": {"CLOCK": 2}}, "latency": {"p50": 0.25},
}  # fmt: skip


class Answering:
    """A session of which every question is answered by the same bytes."""

    def __init__(self, data: bytes, refuses: bool = False) -> None:
        answer = SimpleNamespace(payload=zenoh.ZBytes(data))
        self._reply = SimpleNamespace(
            ok=None if refuses else answer, err=answer if refuses else None
        )

    def is_closed(self) -> bool:
        return False

    def get(self, key: str, **options: object) -> list[SimpleNamespace]:
        return [self._reply]


def arm_answering(data: bytes, refuses: bool = False) -> Arm:
    return Arm(Answering(data, refuses), "S")  # type: ignore[arg-type]


def answers(folder: Path, info: bytes) -> Iterator[Door]:
    """A daemon's answers, into the hands of those who ask."""
    calibration = SEALED
    frames = [base64.b64encode(raw.pack(3, RawFrame(1, 2, "rx", b"xyz", "tty"))).decode()]
    preamble = json.dumps({"next": 4, "frames": frames}).encode()
    own = arm_answering(info).info()

    def describe_everywhere(arm: Arm, text: str | None) -> None:
        """As the page, the recorder, `armd ros2 --urdf` and guided measuring describe it."""
        given = arm.info()
        Recorder(io.BytesIO(), given, text).close()
        describe_arm(arm, HEALTH, {})
        urdf.write(given, text, "arm", "arm_base")

    class Both(Arm):
        """`info` of one answer, the calibration of another."""

        def __init__(self, first: bytes, second: bytes) -> None:
            super().__init__(Answering(first), "S")  # type: ignore[arg-type]
            self._second = Answering(second)

        def _ask_bytes(self, what: str, parameters: str = "") -> bytes:
            if what == keys.CALIBRATION:
                return bytes(self._second.get(what)[0].ok.payload.to_bytes())
            return super()._ask_bytes(what, parameters)

    def info_door(data: bytes) -> None:
        arm = Both(data, calibration)
        get_in_use(arm)  # type: ignore[arg-type]
        describe_everywhere(arm, calibration.decode())

    def calibration_door(data: bytes) -> None:
        arm = Both(info, data)
        describe_everywhere(arm, arm.calibration_file())

    def preamble_door(data: bytes) -> None:
        recorder = Recorder(io.BytesIO(), own, None)
        recorder.begin(*arm_answering(data).preamble())
        recorder.close()

    def past(data: bytes) -> None:
        for measurement in arm_answering(data).past(keys.MEASUREMENT):
            ros2()._as_pose(measurement)

    def refusal(data: bytes) -> None:
        arm_answering(data, refuses=True).command("tip", name="ruby")

    yield asked("answer info", [info], info_door)
    yield asked("answer calibration", [calibration, b"null"], calibration_door)
    yield asked("answer raw", [preamble], preamble_door)
    yield asked(
        "answer state", [json.dumps(HEALTH).encode()], lambda data: arm_answering(data).state()
    )
    yield asked("answer command", [b'{"done": "x"}'], lambda data: arm_answering(data).command("x"))
    yield asked("answer past", [json.dumps(EVENT).encode()], past)
    yield asked("refusal", [b"refused: too many changes"], refusal)


def shown(what: object) -> None:
    """As a terminal has it."""
    console = Console(file=io.StringIO(), width=200, force_terminal=False)
    console.print(what)
    assert isinstance(console.file, io.StringIO)
    check_printed(console.file.getvalue())


def show_health(content: dict[str, Any]) -> None:
    """In `armd fleet`, for Prometheus and in `armd watch`."""
    fleet = fleet_of(content)
    shown(make_table(fleet))
    render(fleet.healths()).encode()
    screen = Screen(arm_answering(b""), Console(file=io.StringIO()))
    screen._health = content
    shown(screen._panel(1.0))


def show_event(content: dict[str, Any]) -> None:
    fleet = Fleet()
    fleet.note_event("S", content)
    shown(make_table(fleet))
    screen = Screen(arm_answering(b""), Console(file=io.StringIO()))
    screen._events = [content["text"]]
    shown(screen._panel(1.0))


def screens() -> Iterator[Door]:
    """What terminals and Prometheus show of health and events."""
    yield received("screen of health", keys.HEALTH, [WHOLE_HEALTH], show_health)
    yield received("screen of events", keys.EVENT, [EVENT | {"severity": "error"}], show_event)


def binary() -> Iterator[Door]:
    """Points and raw frames, as a client, a recorder and the bridges take them."""
    info = {"arm": {"tip": {"offset_mm": [0.0, 0.0, 9.0], "radius_mm": 3.0}},
            "configuration": {"tips": {}}}  # fmt: skip
    tips = Tips(info)

    def points(data: bytes) -> None:
        payloads = [data[k : k + POINT.itemsize] for k in range(0, len(data), POINT.itemsize)]
        payloads = [payload for payload in payloads if is_sound(keys.POINT, payload)]
        arm = arm_answering(b"")
        array = arm.decode(payloads)
        Point.from_array(array)
        for row in array:
            fields = lines.convert_point(row, tips, None, "S")
            for form in lines.PRESETS.values() if fields is not None else ():
                form(fields or {}).encode()
            json.loads(page_messages.format_live(row, [0.1]))
        ros2()._tell_points(array)
        recorder = Recorder(io.BytesIO(), info, None)
        recorder.take_points(payloads)
        recorder.close()
        screen = Screen(arm, Console(file=io.StringIO()))
        screen._point = Point.from_array(array[-1:])[0] if len(array) else None
        screen._panel(1.0)

    def frames(data: bytes) -> None:
        recorder = Recorder(io.BytesIO(), info, None)
        recorder.take_frames([data] if is_sound(keys.RAW, data) else [])
        recorder.close()

    seed = np.zeros(3, POINT)
    seed["seq"], seed["stamp_ns"], seed["orientation"][:, 3] = range(3), 10**18, 1.0
    frame = raw.pack(3, RawFrame(1, 2, "rx", b"xyz", "tty"))
    yield Door("points", [seed.tobytes()], points)
    yield Door("raw frames", [frame], frames)


class _Declared:
    """A queryable that a test fills."""

    def __init__(self) -> None:
        self.waiting: queue.SimpleQueue[Any] = queue.SimpleQueue()

    def try_recv(self) -> Any:
        return None if self.waiting.empty() else self.waiting.get()


class _Question:
    """One question, and what it was told."""

    def __init__(self, key: str, parameters: str) -> None:
        self.key_expr = key
        self.parameters = zenoh.Parameters(parameters)
        self.told: list[str] = []

    def __enter__(self) -> _Question:
        return self

    def __exit__(self, *raised: object) -> None:
        pass

    def reply(self, key: str, text: str, **options: object) -> None:
        self.told.append(str(json.loads(text)["done"]))

    def reply_err(self, text: str) -> None:
        self.told.append(text)


def commands(folder: Path) -> Door:
    """Commands as anybody on the network asks for them, to their answer."""
    arm = ArmInUse(load_config(folder / "armd.toml"))
    changes = Changes(arm, lambda *said, **more: None)
    declared: dict[str, _Declared] = {}
    session = SimpleNamespace(
        declare_queryable=lambda key, _: declared.setdefault(key, _Declared())
    )
    silent = SimpleNamespace(key="armd/S/x", past=[])
    publisher = SimpleNamespace(health_text=lambda: "{}", measurements=silent, events=silent)
    unexpected = Unexpected()
    service = SimpleNamespace(_changes=changes)
    obeyed = {
        "reload": lambda _, answer: changes.reload(answer),
        "tip": lambda asked, answer: changes.select_tip(asked.get("name") or "", answer),
        "keep_tip": lambda asked, answer: Service._keep_tip(service, asked, answer),  # type: ignore[arg-type]
    }
    queries = Queries(session, "S", publisher, {}, list, obeyed, unexpected)  # type: ignore[arg-type]
    queries.close()

    def enter(data: bytes) -> None:
        name, _, parameters = data.decode("utf-8", "replace").partition("?")
        question = _Question(f"armd/S/command/{name}", parameters)
        declared["armd/S/command/**"].waiting.put(question)
        queries.answer()
        end_s = time.monotonic() + 20.0
        while not question.told and not unexpected.as_json() and time.monotonic() < end_s:
            changes.take()
            time.sleep(0.0005)
        if unexpected.as_json() or not question.told:
            events = [event.text for event in unexpected.take_events()]
            unexpected._counted.clear()
            unexpected._noted.clear()
            raise Fault(f"a command has no answer: {events}")
        check_message(question.told[0])
        if question.told[0].split(":")[0].endswith(("Error", "Exception")):
            raise Fault(question.told[0])

    words = (
        b"reload",
        b"tip?name=ruby",
        b"tip?name=",
        b"keep_tip?name=new;offset_mm=1,2,3;radius_mm=2",
    )
    return Door("commands", list(words), enter)


def listeners() -> Iterator[Door]:
    """Ports that armd listens on, beside the page's and I++'s."""
    faults: list[str] = []

    class Keep(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            faults.append(self.format(record))

    log = logging.getLogger("armd.daemon.host.metrics")
    log.addHandler(Keep())
    log.propagate = False
    server = MetricsServer(0, lambda: [WHOLE_HEALTH])

    def scrape(data: bytes) -> None:
        with socket.create_connection(("127.0.0.1", server.port), 10.0) as connection:
            try:
                connection.sendall(data)
                connection.shutdown(socket.SHUT_WR)
                while connection.recv(1 << 16):
                    pass
            except (ConnectionError, BrokenPipeError):
                pass  # hung up on
        if faults:
            text = faults.pop()
            faults.clear()
            raise Fault(text[-1500:])

    async def read(data: bytes) -> None:
        readers: set[Reader] = set()
        broken: list[str] = []
        loop = asyncio.get_running_loop()
        loop.set_exception_handler(lambda _, context: broken.append(repr(context)))
        listening, where = await open_listener(("127.0.0.1", 0), lambda: Reader(readers, "header"))
        async with listening:
            reader, writer = await asyncio.open_connection(
                "127.0.0.1", int(where.rpartition(":")[2])
            )
            writer.write(data)
            async with asyncio.timeout(10.0):
                if await reader.readline() != b"header\n":
                    raise Fault("the header did not come")
                for each in list(readers):
                    each.send(b"line\n")
                if await reader.readline() != b"line\n":
                    raise Fault("a reader that sent something has no line")
            writer.close()
            for each in list(readers):
                each.close()
            while readers:  # until the loop knows
                await asyncio.sleep(0.001)
        if broken:
            raise Fault("; ".join(broken))

    get = b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n"
    yield Door("metrics", [get, b"HEAD /x?y HTTP/1.0\r\n\r\n"], scrape)
    yield Door("reader of a stream", [b"hello\n"], lambda data: asyncio.run(read(data)))


def network_doors(folder: Path) -> Iterator[Door]:
    folder.mkdir(parents=True)
    for name, text in (
        ("arm.toml", format_toml(ARM)), ("armd.toml", LISTENING), ("cal.json", SEALED.decode()),
    ):  # fmt: skip
        (folder / name).write_text(text)
    config = load_config(folder / "armd.toml")
    in_use = ArmInUse(config).in_use
    yield from answers(folder, json.dumps(describe(config, *in_use)).encode())
    yield from screens()
    yield from binary()
    yield commands(folder)
    yield from listeners()
