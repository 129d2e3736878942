"""Run the commands at the end of a session, exactly as a person would type them."""

from __future__ import annotations

import shlex
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from armd.daemon.measure.in_use import ARM, CALIBRATION, MeasuredWith
from armd.daemon.measure.plan.stations import Plan, PlanKind
from armd.errors import BadInput

Then = Literal["calibrate", "diagnose", "verify", "interim", "tip", "repeatability", "none"]

#: The commands of a kind with an active calibration, and without one.
_USUAL: dict[PlanKind, tuple[tuple[Then, ...], tuple[Then, ...]]] = {
    "seats": (("diagnose",), ("calibrate",)),
    "artefact": (("calibrate", "diagnose"), ("calibrate",)),
    "poses": (("diagnose",), ("calibrate",)),
    "verify": (("verify",), ("verify",)),
    "tip": (("tip",), ("tip",)),
    "interim": (("interim",), ("interim",)),
    "repeatability": (("repeatability",), ("repeatability",)),
}


@dataclass(frozen=True)
class EndOptions:
    """The user's options for the end."""

    then: Sequence[Then] | None = None  # None: the kind's own
    earlier_sessions: Sequence[Path] = ()  # earlier sessions to include
    mpe: Path | None = None  # of verify
    history: Path | None = None  # of interim
    tip_name: str | None = None  # of tip: its name in the history
    apply_at: str | None = None  # of tip: endpoint of the daemon that activates it


def list_commands(
    folder: Path, plan: Plan, in_use: MeasuredWith, options: EndOptions
) -> list[list[str]]:
    """Return the arguments of `armd` for each command.

    Their outputs go into the session's folder. Raises `BadInput` if a command lacks an input.
    """
    calibrated = in_use.calibration is not None
    then = options.then
    if then is None:
        then = _USUAL[plan.kind][0 if calibrated else 1]
    sessions = [*map(str, options.earlier_sessions), str(folder)]
    arm = ["--arm", str(folder / ARM)]
    in_force = ["--calibration", str(folder / CALIBRATION)] if calibrated else []
    argument_lists: list[list[str]] = []
    for name in then:
        match name:
            case "calibrate":
                outputs = ["-o", str(folder / "calibration.json")]
                outputs += _list_results(folder, "calibrate")
                argument_lists.append(["calibrate", *sessions, *arm, *outputs])
            case "diagnose":
                outputs = [*_list_results(folder, "diagnose")]
                outputs += ["--extended", str(folder / "extended.json")]
                argument_lists.append(["diagnose", *sessions, *arm, *in_force, *outputs])
            case "verify":
                limits = [] if options.mpe is None else ["--mpe", str(options.mpe)]
                outputs = _list_results(folder, "verify")
                argument_lists.append(["verify", str(folder), *arm, *in_force, *limits, *outputs])
            case "repeatability":
                outputs = _list_results(folder, "repeatability")
                argument_lists.append(
                    ["feature", "repeatability", str(folder), *arm, *in_force, *outputs]
                )
            case "tip":
                label = [] if options.tip_name is None else ["--name", options.tip_name]
                if options.apply_at is not None:
                    label += ["--apply", "--endpoint", options.apply_at]
                argument_lists.append(["tip", "calibrate", str(folder), *label])
            case "interim":
                if options.history is None:
                    continue  # only the session was requested
                if not calibrated:
                    problem, expected = (
                        "no calibration in force",
                        "one that the checks are held against",
                    )
                    raise BadInput("armd interim", "--calibration", problem, expected)
                history = ["--history", str(options.history)]
                argument_lists.append(["interim", "add", str(folder), *arm, *in_force, *history])
            case "none":
                pass
    return argument_lists


@dataclass(frozen=True)
class Done:
    """A finished command."""

    command: str  # as typed in a shell
    code: int
    output: str
    error: str


def run(command: Sequence[str]) -> Done:
    """Run a command in a separate process.

    `code` is the command's: 0, 1 (the answer is no) or 2.
    """
    done = subprocess.run(
        [sys.executable, "-P", "-m", "armd.daemon.cli", *command],
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
    )
    command_line = shlex.join(["armd", *command])
    return Done(command_line, done.returncode, done.stdout, done.stderr)


def _list_results(folder: Path, name: str) -> list[str]:
    return ["--json", str(folder / f"{name}.json"), "--report", str(folder / f"{name}.html")]
