"""Guided measuring on the page: the engine of `armd measure`, with buttons for its letters."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from functools import partial
from http import HTTPStatus
from pathlib import Path
from typing import Any, cast

from armd.compensation.data.sessions.format import ArtefactFile
from armd.daemon.bridges.process import run_in_thread
from armd.daemon.bridges.view.board import Board
from armd.daemon.bridges.view.feed import Feed
from armd.daemon.bridges.view.http import NotServed, Request
from armd.daemon.bridges.view.sessions import A_NAME, list_results
from armd.daemon.measure.ending import EndOptions, list_commands, run
from armd.daemon.measure.in_use import get_in_use
from armd.daemon.measure.log import NAME
from armd.daemon.measure.measuring import Measuring
from armd.daemon.measure.plan.kinds import make_plan
from armd.daemon.measure.plan.stations import KINDS, MOST_STATIONS, PlanKind, Wishes
from armd.daemon.measure.so_far.estimate import identify_so_far
from armd.daemon.measure.waiting import Waiting
from armd.errors import ArmdError, BadInput
from armd.files.schema import load_toml

TOPIC = "guided"
#: After this many readings the calibration is estimated again.
ESTIMATE_EVERY = 10
#: Period of the check whether a person has waited for long.
LOOK_S = 1.0
#: Kinds of measurement that give a calibration.
IDENTIFYING = ("seats", "artefact", "poses")


#: The folder, among the sessions, with the history of the page's interim checks.
HISTORY = "interim-history"


class Guided:
    """The guided measurement of the page: at most one at a time, the same for all browsers."""

    def __init__(self, board: Board, folder: Path, feed: Feed) -> None:
        """Prepare measurements in *folder*.

        Sessions are its subfolders; artefacts are its files `*.toml`, poses its files `*.csv`.
        """
        self._board = board
        self._folder = folder
        self._feed = feed
        feed.measured = self._queue_measurement
        self._measuring: Measuring | None = None
        self._options = EndOptions()
        self._trigger = ""
        self._patience = Waiting("")
        self._since_ns = 0
        self._waiting: asyncio.Queue[dict[str, Any]] = asyncio.Queue()
        self._outcome: dict[str, Any] | None = None
        self._so_far: str | None = None
        self._estimating: asyncio.Task[None] | None = None
        self._phase = "none"  # "measuring", "ending", "ended"
        self._results: list[dict[str, Any]] = []
        self._tell()

    async def run(self) -> None:
        """Pass arriving measurements to the guided measurement one after another, for ever."""
        while True:
            coming = asyncio.ensure_future(self._waiting.get())
            try:
                while not (await asyncio.wait({coming}, timeout=LOOK_S))[0]:
                    self._tell_waiting()
            finally:
                coming.cancel()  # without effect if it is done
            try:
                await self._offer(coming.result())
            finally:
                self._waiting.task_done()

    def _tell_waiting(self) -> None:
        if self._phase == "measuring" and (text := self._patience.take_reminder()):
            self._became({"event": "waiting", "text": text})

    async def _offer(self, measurement: dict[str, Any]) -> None:
        measuring = self._measuring
        if measuring is None or self._phase != "measuring":
            return
        outcome = await run_in_thread(partial(_guarded, partial(measuring.offer, measurement)))
        self._became(outcome)
        if outcome["event"] == "reading" and outcome["taken"] % ESTIMATE_EVERY == 0:
            self._estimate(measuring)

    def _queue_measurement(self, measurement: dict[str, Any]) -> None:
        """Queue a measurement that arrived; one from before the beginning does not count."""
        is_triggered = measurement.get("trigger") == self._trigger
        if self._phase == "measuring" and is_triggered and measurement["stamp_ns"] > self._since_ns:
            self._patience.restart()
            self._waiting.put_nowait(measurement)

    def choices(self) -> dict[str, Any]:
        """Return the choices for a new measurement, and the sessions that can be resumed."""
        paths = sorted(self._folder.iterdir()) if self._folder.is_dir() else []
        return {
            "folder": str(self._folder),
            "kinds": list(KINDS),
            "artefacts": [path.name for path in paths if path.suffix == ".toml"],
            "poses": [path.name for path in paths if path.suffix == ".csv"],
            "sessions": [
                {"name": path.name, "results": list_results(path)}
                for path in paths
                if (path / NAME).is_file()
            ],
        }

    async def do(self, request: Request) -> dict[str, Any]:
        """Carry out `/guided/NAME`.

        NAME is begin, resume, delete, again, skip, artefact, finish, stop or close. Raises
        `ArmdError` and `NotServed`.
        """
        name = request.path.removeprefix("/guided/")
        content = request.json()
        if name in ("begin", "resume"):
            return await self._begin(name, content)
        measuring = self._measuring
        if name == "close" and self._phase == "ended":
            self._phase, self._measuring = "none", None
            self._tell()
            return {"done": "closed"}
        if measuring is None or self._phase != "measuring":
            raise ArmdError("there is no guided measurement")
        match name:
            case "delete" | "again" | "skip":
                deeds = {
                    "delete": measuring.delete_last,
                    "again": measuring.again,
                    "skip": measuring.skip,
                }
                self._became(await run_in_thread(partial(_guarded, deeds[name])))
            case "artefact":
                deed = partial(measuring.set_artefact_c, _number(content, "artefact_c"))
                self._became(await run_in_thread(partial(_guarded, deed)))
            case "finish":
                await run_in_thread(measuring.finish)
                final_commands = list_commands(
                    measuring.folder, measuring.plan, measuring.in_use, self._options
                )
                self._phase = "ending"
                self._tell()
                self._ending = asyncio.ensure_future(self._make(measuring, final_commands))
            case "stop":
                self._phase, self._measuring = "none", None
                await run_in_thread(measuring.close)
                self._tell()
            case _:
                raise NotServed(HTTPStatus.NOT_FOUND, f"found {name[:40]!r}")
        return {"done": name}

    def close(self) -> None:
        if self._measuring is not None:
            self._measuring.close()

    async def _begin(self, how: str, content: Mapping[str, Any]) -> dict[str, Any]:
        arm = self._feed.arm
        if arm is None:
            raise ArmdError("the daemon is not there")
        if self._measuring is not None and self._phase != "ended":
            raise ArmdError(f"{self._measuring.folder.name} is being measured: stop it first")
        since_ns = self._feed.stamp_ns
        folder = self._folder / _name(content, "name")
        wishes = _wishes(content, self._folder) if how == "begin" else None
        kind = content.get("kind")
        artefact = content.get("artefact") or None
        if how == "begin" and kind not in KINDS:
            raise BadInput("the page", "kind", repr(kind), f"one of {', '.join(KINDS)}")
        mpe = content.get("mpe") or None
        options = EndOptions(
            mpe=None if mpe is None else self._folder / _name(content, "mpe"),
            tip_name=str(content["tip"]) if content.get("tip") else None,
        )
        if artefact is not None:
            artefact = self._folder / _name(content, "artefact")

        def begun() -> tuple[Measuring, str]:
            self._folder.mkdir(parents=True, exist_ok=True)
            trigger = str(arm.info()["configuration"]["measurement"]["trigger"])
            in_use = get_in_use(arm)
            if wishes is None:
                return Measuring.resume(folder, in_use), trigger
            artefact_content = (
                None if artefact is None else load_toml(artefact, ArtefactFile).artefact
            )
            plan = make_plan(cast(PlanKind, kind), in_use.arm, artefact_content, wishes)
            return Measuring(folder, plan, in_use), trigger

        measuring, self._trigger = await run_in_thread(begun)
        self._patience = Waiting(self._trigger)
        if measuring.plan.kind == "interim" and measuring.in_use.calibration is not None:
            options = replace(options, history=self._folder / HISTORY)
        try:
            # checked now, so that it is not refused at the end
            list_commands(measuring.folder, measuring.plan, measuring.in_use, options)
        except ArmdError:
            measuring.close()
            raise
        self._measuring, self._options = measuring, options
        self._since_ns = since_ns
        self._phase, self._results, self._outcome, self._so_far = "measuring", [], None, None
        self._tell()
        return {"done": f"begun: {folder}"}

    async def _make(self, measuring: Measuring, final_commands: list[list[str]]) -> None:
        """Run the commands at the end, one after another."""
        for command in final_commands:
            done = await run_in_thread(partial(run, command))
            self._results.append(asdict(done))
            self._tell()
        await run_in_thread(measuring.close)
        self._phase = "ended"
        self._tell()

    def _became(self, outcome: dict[str, Any]) -> None:
        self._outcome = {name: outcome.get(name) for name in ("event", "reason", "text", "number")}
        self._tell()

    def _estimate(self, measuring: Measuring) -> None:
        """Estimate the result of `armd calibrate` in a thread.

        It takes seconds, and no press may wait for it.
        """
        busy = self._estimating is not None and not self._estimating.done()
        if busy or measuring.plan.kind not in IDENTIFYING:
            return

        async def ask() -> None:
            try:
                estimate = await run_in_thread(
                    lambda: identify_so_far(measuring.folder, measuring.in_use.arm)
                )
                self._so_far = str(estimate["text"])
            except (ArmdError, ArithmeticError, OSError, ValueError) as error:
                self._so_far = f"nothing can be said of it yet: {error}"
            self._tell()

        self._estimating = asyncio.ensure_future(ask())

    def _tell(self) -> None:
        measuring = self._measuring
        state = None if measuring is None else measuring.state()
        content = {
            "phase": self._phase,
            "state": state,
            "outcome": self._outcome,
            "so_far": self._so_far,
            "results": self._results,
            "files": list_results(measuring.folder) if measuring and self._results else [],
        }
        self._board.put(TOPIC, json.dumps(content))


def _guarded(deed: Callable[[], dict[str, Any]]) -> dict[str, Any]:
    """Carry out an action; return an error, such as a full disk, as its outcome."""
    try:
        return deed()
    except (ArmdError, OSError) as error:
        return {"event": "failed", "text": str(error)}


def _name(content: Mapping[str, Any], key: str) -> str:
    """Return the name of a file or folder directly in our folder; raises `BadInput`.

    The allowed characters cannot lead to another folder.
    """
    name = content.get(key)
    if not isinstance(name, str) or not A_NAME.fullmatch(name):
        expected = "a name of letters, digits, space, . _ + -, beginning with one of the first two"
        raise BadInput("the page", key, repr(name)[:60], expected)
    return name


def _number(content: Mapping[str, Any], key: str) -> float | None:
    value = content.get(key)
    if value is None or value == "":
        return None
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise BadInput("the page", key, repr(value)[:60], "a number")
    return float(value)


def _positive(content: Mapping[str, Any], key: str) -> float | None:
    value = _number(content, key)
    if value is not None and not 0 < value < math.inf:
        raise BadInput("the page", key, f"{value:g}", "a number above 0")
    return value


def _wishes(content: Mapping[str, Any], folder: Path) -> Wishes:
    def names(key: str) -> list[str] | None:
        parts = [part.strip() for part in str(content.get(key) or "").split(",")]
        return [part for part in parts if part] or None

    repeats = _number(content, "repeats")
    if repeats is not None and repeats not in range(1, MOST_STATIONS + 1):
        expected = f"a whole number from 1 to {MOST_STATIONS}"
        raise BadInput("the page", "repeats", f"{repeats:g}", expected)
    return Wishes(
        targets=names("targets"),
        placements=names("placements"),
        repeats=None if repeats is None else int(repeats),
        poses=folder / _name(content, "poses") if content.get("poses") else None,
        tests=names("tests"),
        near_mm=_positive(content, "near_mm"),
        sphere_mm=_positive(content, "sphere_mm"),
    )
