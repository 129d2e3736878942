"""One client's dialogue: lines in, lines out, without network or clock."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from armd.daemon.bridges.ippdme.errors import DmeError
from armd.daemon.bridges.ippdme.grammar import (
    EVENT_TAG,
    Command,
    SyntaxFault,
    format_list,
    format_quoted,
    parse,
)
from armd.daemon.bridges.ippdme.machine import Machine
from armd.daemon.bridges.ippdme.report import (
    MoveReport,
    ReportedFields,
    format_error,
    format_fields,
)

#: Commands that may wait behind one that is not finished.
MOST_WAITING = 100
#: Commands that are carried out although an error is active.
IN_ERROR = ("GetErrStatusE", "GetXtdErrStatus", "ClearAllErrors", "AbortE")
WITHOUT_SESSION = ("StartSession", "EndSession")
EVENT = "E0000"


class Pending:
    """The answer of a method that cannot finish at once.

    It is settled once; later calls of `settle` do nothing.
    """

    def __init__(self) -> None:
        self._then: Callable[[list[str] | DmeError], None] | None = None
        self.settled = False

    def then(self, finish: Callable[[list[str] | DmeError], None]) -> None:
        self._then = finish

    def settle(self, outcome: list[str] | DmeError) -> None:
        if self.settled:
            return
        self.settled = True
        if self._then is not None:
            self._then(outcome)


Answer = Iterable[str] | Pending
Method = Callable[["Dialogue", Command], Answer]


class Dialogue:
    """The dialogue of one connection; at most one of all connections is in session.

    Two hosts that set coordinate systems and tools for each other would both measure wrongly.
    """

    def __init__(
        self,
        machine: Machine,
        methods: Mapping[str, Method],
        version: str,
        send: Callable[[str], None],
    ) -> None:
        """Begin a dialogue; *send* takes a line without its CR LF and never waits."""
        self.machine = machine
        self.methods = methods
        self.version = version
        self._send = send
        self.errors: list[tuple[DmeError, str]] = []
        self.report: tuple[str, ...] = ("X", "Y", "Z")
        self.move_report: MoveReport | None = None
        self.hit: Callable[[ReportedFields], None] | None = None
        """Takes the operator's next hit, for a PtMeas of the host's own."""
        self.user_enabled = False
        self._waiting: deque[Command] = deque()
        self._running: tuple[Command, Pending] | None = None
        self._own_keys: set[int] = set()

    @property
    def in_session(self) -> bool:
        return self.machine.in_session is self

    # --- what the client says ----------------------------------------------------------------

    def receive(self, line: str) -> None:
        """Handle a line of the client's, without its CR LF."""
        try:
            command = parse(line)
        except SyntaxFault as fault:
            self._refuse(fault)
            return
        if EVENT_TAG.fullmatch(command.tag) and not self._may_be_event(command.method):
            self._fail(EVENT, command.method, DmeError(1))
            return
        unfinished = len(self._waiting) + (self._running is not None)
        self._reply(command.tag, "&")
        if self._may_be_event(command.method):
            self._do(command)  # it does not wait for its turn
        elif unfinished >= MOST_WAITING:
            self._fail(command.tag, command.method, DmeError(0), "%")
        else:
            self._waiting.append(command)
            self._go_on()

    def end(self) -> None:
        """Handle a lost connection, which ends the session."""
        self._waiting.clear()
        self._running = self.hit = None
        self.end_session()

    def _may_be_event(self, method: str) -> bool:
        """Return whether the method may have an event tag.

        Its name ends with E; 2.5 also has its daemon without the E.
        """
        return method.endswith("E") or (method == "OnMoveReport" and method in self.methods)

    def _refuse(self, fault: SyntaxFault) -> None:
        error = DmeError(fault.number)
        if fault.tag is None:
            self._fail(EVENT, fault.method, error)
            return
        self._reply(fault.tag, "&")
        self._fail(fault.tag, fault.method, error, "%")

    def _go_on(self) -> None:
        while self._waiting and self._running is None:
            self._do(self._waiting.popleft())

    def _do(self, command: Command) -> None:
        try:
            answer = self._call(command)
            if isinstance(answer, Pending):
                self._running = command, answer
                answer.then(lambda outcome: self._finish(command, outcome))
                return
            for data in answer:
                self._reply(command.tag, f"# {data}")
        except DmeError as error:
            self._fail(command.tag, command.method, error, "%")
        else:
            self._reply(command.tag, "%")

    def _call(self, command: Command) -> Answer:
        if not self.in_session and command.method not in WITHOUT_SESSION:
            raise DmeError(507)
        if self.errors and command.method not in IN_ERROR:
            raise DmeError(514)
        method = self.methods.get(command.method)
        if method is None:
            raise DmeError(501)
        return method(self, command)

    def _finish(self, command: Command, outcome: list[str] | DmeError) -> None:
        """Answer a pending command that is done or has failed."""
        if self._running is None or self._running[0] is not command:
            return  # it was aborted, and answered then
        self._running = None
        if isinstance(outcome, DmeError):
            self._fail(command.tag, command.method, outcome, "%")
        else:
            for data in outcome:
                self._reply(command.tag, f"# {data}")
            self._reply(command.tag, "%")
        self._go_on()

    def _fail(self, tag: str, method: str, error: DmeError, then: str | None = None) -> None:
        """Report an error; a blocking one aborts all unfinished commands."""
        self._reply(tag, f"! {format_error(error, method)}")
        if then is not None:
            self._reply(tag, then)
        if error.blocking and self.in_session and error.number != 514:
            self.errors.append((error, method))
            self._abort_unfinished()

    def abort(self) -> None:
        """Carry out AbortE: daemons continue, other commands are refused until ClearAllErrors."""
        self._abort_unfinished()
        self.errors.append((DmeError(6), "AbortE"))

    def answer_errors(self, tag: str, lines: Iterable[str]) -> None:
        """Send data lines, then the active errors, as GetXtdErrStatus of 1.4.3 does."""
        for data in lines:
            self._reply(tag, f"# {data}")
        for error, method in self.errors:
            self._reply(tag, f"! {format_error(error, method)}")

    def _abort_unfinished(self) -> None:
        """Answer every unfinished command with 0006, in their order."""
        unfinished = [self._running[0]] if self._running is not None else []
        unfinished += self._waiting
        self._waiting.clear()
        self._running = self.hit = None
        for command in unfinished:
            self._reply(command.tag, f"! {format_error(DmeError(6), command.method)}")
            self._reply(command.tag, "%")

    def _reply(self, tag: str, text: str) -> None:
        self._send(f"{tag} {text}")

    def warn(self, command: Command, error: DmeError) -> None:
        """Report an error that blocks nothing, before the method's own data."""
        self._fail(command.tag, command.method, error)

    # --- sessions and states -----------------------------------------------------------------

    def start_session(self) -> None:
        """Start a session; raises `DmeError` if this or another client has one."""
        if self.machine.in_session is not None:
            raise DmeError(8)
        self.machine.in_session = self
        self.errors.clear()
        self.report = ("X", "Y", "Z")
        self.user_enabled = False
        if self.machine.systems.lost is not None:  # blocks until the host has cleared it
            self.machine.systems.lost = None
            self.take_error(DmeError(1013), "StartSession")

    def end_session(self) -> None:
        """End the session; without one, only clear the dialogue's state."""
        self.move_report = None
        self.user_enabled = False
        self.errors.clear()
        if self.in_session:
            self.machine.in_session = None

    # --- what the arm does -------------------------------------------------------------------

    def take_measurement(self, measurement: Mapping[str, Any]) -> None:
        """Report a press or a rest as a hit, if it has a position and the host wants it."""
        own_key = measurement["seq"] in self._own_keys
        self._own_keys.clear()
        if measurement["position_mm"] is None or own_key or not self.in_session:
            return
        if not self.machine.toolbox.current.measures:
            return
        fields = self.machine.hit(measurement)
        if self.hit is not None:
            self.hit(fields)
        elif self.user_enabled:
            self._tell(f"PtMeas({format_list(format_fields(self.report, fields))})")

    def take_key(self, key: str, seq: int) -> None:
        """Report a button that is a key of the host's; its measurement is not a hit."""
        self._own_keys.add(seq)
        if self.in_session and self.user_enabled:
            self._tell(f"KeyPress({format_quoted(key)})")

    def take_tool(self, name: str) -> None:
        """Report a tool that was changed at the arm."""
        if self.in_session:
            self._tell(f"ChangeTool({format_quoted(name)})")
            self.report_now()

    def take_error(self, error: DmeError, place: str) -> None:
        """Report a fault of the arm that no command caused."""
        if self.in_session:
            self._fail(EVENT, place, error)

    def tick(self, now_s: float) -> None:
        """Report motion if it is due; called several times a second."""
        report = self.move_report
        if report is None or not self.in_session:
            return
        try:
            position = self.machine.position()
        except DmeError:
            return  # an unknown position is not reported; the error is reported elsewhere
        if report.is_due(now_s, position):
            x, y, z = position.tolist()
            coordinates = {"X": (x,), "Y": (y,), "Z": (z,)}
            self._reply(report.tag, f"# {format_list(format_fields(report.fields, coordinates))}")

    def report_now(self) -> None:
        """Make the next motion report due: coordinate system or tool changed."""
        if self.move_report is not None:
            self.move_report.hurry()

    def _tell(self, data: str) -> None:
        self._reply(EVENT, f"# {data}")


def is_2_5(dialogue: Dialogue) -> bool:
    return dialogue.version == "2.5"
