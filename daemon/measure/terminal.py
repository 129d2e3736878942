"""Guided measuring in the terminal: lines for a person, or JSON for a program."""

from __future__ import annotations

import json
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any

from rich.console import Console
from rich.live import Live
from rich.text import Text

from armd import keys
from armd.client import Arm
from armd.daemon.measure.ending import Done
from armd.daemon.measure.hearing import SILENT_S, Hearing
from armd.daemon.measure.measuring import Measuring
from armd.daemon.measure.so_far.estimate import identify_so_far
from armd.daemon.measure.waiting import Waiting
from armd.drivers.waiting import has_bytes
from armd.errors import ArmdError
from armd.printable import to_printable
from armd.terminal.counted import format_count

POLL_S = 0.02
REFRESH_S = 0.1
#: After this many readings the calibration is estimated again.
ESTIMATE_EVERY = 10
KEYS = "Enter after: d delete the last · a once more · s leave out · f finish · q stop for now"


class Terminal:
    """The face in the terminal; it runs until everything is measured, or it is ended."""

    def __init__(self, arm: Arm, measuring: Measuring, trigger: str, as_json: bool) -> None:
        """Prepare the face; only measurements with this *trigger* ("button" or "rest") count."""
        self._arm = arm
        self._measuring = measuring
        self._trigger = trigger
        self._waiting = Waiting(trigger)
        self._json = as_json
        self._heard: deque[bytes] = deque()
        self._typed = b""
        self._stdin_open = True
        self._finish = self._stop = False
        self._console = Console()
        self._estimating: threading.Thread | None = None

    def stop(self) -> None:
        """Stop and leave everything unchanged; called from a signal handler."""
        self._stop = True

    def run(self, seconds: float | None) -> bool:
        """Measure; return whether the measurement is to be finished, or False if interrupted."""
        end_s = time.monotonic() + (seconds or float("inf"))
        hearing = Hearing(self._arm)
        with ExitStack() as opened:
            opened.enter_context(hearing.listening())
            # New measurements only; past ones do not belong to the session.
            opened.enter_context(self._arm.calling(keys.MEASUREMENT, self._heard.append))
            show = self._live(opened)
            points = opened.enter_context(self._arm.stream(keys.POINT)) if show else None
            self._begin()
            shown_s = 0.0
            while not self._over() and time.monotonic() < end_s:
                while self._heard and not self._over():
                    self._take(self._heard.popleft(), hearing)
                if hearing.changed():
                    self._waiting.restart()
                    self._tell_of(hearing)
                if not hearing.silent and (text := self._waiting.take_reminder()):
                    self._say({"event": "waiting", "text": text})
                for word in self._words():
                    self._obey(word)
                now_s = time.monotonic()
                if show and points and now_s - shown_s >= REFRESH_S:
                    shown_s = now_s
                    if payloads := points.take():
                        show(self._line(self._arm.decode(payloads)["position_mm"][-1].tolist()))
                time.sleep(POLL_S)
        return self._finish or self._measuring.complete

    def report_command(self, done: Done) -> None:
        """Print the output of a command at the end."""
        if self._json:
            self._put({"event": "result", **done.__dict__})
            return
        print()
        print(to_printable(f"armd: {done.command}"))
        for text, stream in ((done.output, sys.stdout), (done.error, sys.stderr)):
            for line in text.splitlines():
                print(to_printable(line), file=stream)
        sys.stdout.flush()

    def close(self, finished: bool) -> None:
        """Print the last line."""
        state = self._measuring.state()
        counts = {name: state[name] for name in ("taken", "done", "wanted", "left_out")}
        if self._json:
            self._put({"event": "end", "finished": finished, **counts, "session": state["session"]})
            return
        text = f"{state['session']}: {format_count(state['taken'], 'reading')}"
        if not finished:
            text += (
                f", {state['done']} of {state['wanted']} done; the same command goes on from here"
            )
        print(to_printable(f"armd: {text}"), flush=True)

    # --- what comes in ----------------------------------------------------------------------

    def _over(self) -> bool:
        return self._stop or self._finish or self._measuring.complete

    def _take(self, payload: bytes, hearing: Hearing) -> None:
        try:
            measurement = json.loads(payload)
        except (ValueError, RecursionError):
            return
        if isinstance(measurement, dict) and not hearing.is_known(measurement):
            self._offer(measurement)
            hearing.note_received(measurement)

    def _tell_of(self, hearing: Hearing) -> None:
        """Report that the arm is silent, or is received again with missed measurements."""
        if hearing.silent:
            text = f"nothing heard of the arm for {SILENT_S:g} s: is armd running, is it reachable?"
            self._say({"event": "silent", "text": text})
            return
        missed = hearing.missed()
        text = f"the arm is heard again; {format_count(len(missed), 'measurement')} meanwhile"
        self._say({"event": "heard", "missed": len(missed), "text": text})
        for measurement in missed:
            if not self._over():
                self._offer(measurement)

    def _offer(self, measurement: Mapping[str, Any]) -> None:
        if measurement.get("trigger") != self._trigger:
            return  # a press during a rest that is a reading already
        self._waiting.restart()
        outcome = self._measuring.offer(measurement)
        self._say(outcome)
        if outcome["event"] == "reading" and outcome["taken"] % ESTIMATE_EVERY == 0:
            self._estimate()

    def _words(self) -> list[str]:
        """Return the whole lines that were typed; never blocks."""
        if not self._stdin_open:
            return []
        try:
            while has_bytes(sys.stdin.fileno(), 0):
                piece = os.read(sys.stdin.fileno(), 4096)
                if not piece:
                    self._stdin_open = False
                    break
                self._typed += piece
        except (OSError, ValueError):  # closed or missing
            self._stdin_open = False
        *lines, self._typed = self._typed.split(b"\n")
        return [line.decode("utf-8", "replace").strip().lower() for line in lines]

    def _obey(self, word: str) -> None:
        doing: dict[str, Callable[[], dict[str, Any]]] = {
            "d": self._measuring.delete_last,
            "a": self._measuring.again,
            "s": self._measuring.skip,
        }
        if word[:1] in doing:
            self._say(doing[word[:1]]())
        elif word[:1] == "f":
            self._finish = True
        elif word[:1] == "q":
            self._stop = True
        elif word:
            self._say({"event": "unknown", "text": f"found {word!r}, expected one of d a s f q"})

    # --- what goes out ----------------------------------------------------------------------

    def _begin(self) -> None:
        state = self._measuring.state()
        if self._json:
            self._put({"event": "begin", **state})
            return
        print(to_printable(f"armd: {state['serial']}, {state['kind']}, to {state['session']}"))
        if state["taken"]:
            print(f"armd: taken up again, {state['done']} of {state['wanted']} done")
        if self._console.is_terminal:
            print(KEYS)
        self._print_next(state["next"])

    def _say(self, outcome: Mapping[str, Any]) -> None:
        if self._json:
            self._put(outcome)
            return
        match outcome["event"]:
            case "reading":
                count = f"{outcome['done']:4d}/{outcome['wanted']}"
                text = f"{count}  {outcome['text']}; {outcome['estimate']}"
            case "refused":
                text = f"   refused, {outcome['reason'].replace('_', ' ')}: {outcome['text']}"
            case _:
                text = f"   {outcome['text']}"
        print(to_printable(text), flush=True)
        if not self._measuring.complete and outcome["event"] not in (
            "refused",
            "silent",
            "waiting",
        ):
            self._print_next(self._measuring.state()["next"])

    def _print_next(self, following: Mapping[str, Any] | None) -> None:
        if following is None:
            return
        if following["new_placement"]:
            place = f": {following['place']}" if following["place"] else ""
            print(to_printable(f"      placement {following['placement']}{place}"))
        why = f" ({following['why']})" if following["why"] else ""
        print(
            to_printable(f"      next {following['target']}: {following['how']}{why}"), flush=True
        )

    def _live(self, opened: ExitStack) -> Callable[[str], None] | None:
        """Return a function that overwrites one line; None without a terminal."""
        if self._json or not self._console.is_terminal:
            return None
        live = opened.enter_context(Live(console=self._console, auto_refresh=False))
        return lambda text: live.update(Text(text), refresh=True)

    def _line(self, tip_mm: list[float]) -> str:
        away_mm = self._measuring.distance_mm(tip_mm)
        following = self._measuring.state()["next"]
        if following is None:
            return ""
        away = "its place is not known yet" if away_mm is None else f"{away_mm:8.1f} mm away"
        return f"{following['target']} in {following['placement']}: {away}"

    def _estimate(self) -> None:
        """Estimate the result of `armd calibrate` in a thread.

        It takes seconds, and no press may wait for it.
        """
        kind = self._measuring.plan.kind
        busy = self._estimating is not None and self._estimating.is_alive()
        if self._json or busy or kind not in ("seats", "artefact", "poses"):
            return
        self._estimating = threading.Thread(target=self._tell_estimate, daemon=True)
        self._estimating.start()

    def _tell_estimate(self) -> None:
        try:
            estimate = identify_so_far(self._measuring.folder, self._measuring.in_use.arm)
        except (ArmdError, ArithmeticError, OSError, ValueError) as error:
            estimate = {"text": f"nothing can be said of it yet: {error}"}
        print(to_printable(f"      so far: {estimate['text']}"), flush=True)

    def _put(self, line: Mapping[str, Any]) -> None:
        print(json.dumps(line, allow_nan=False), flush=True)
