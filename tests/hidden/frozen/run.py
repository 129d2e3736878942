"""One case under one revision: its commands, and what came of them."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hidden.frozen.case import Truth, read_truth, sessions
from hidden.frozen.revision import Revision

MOST_S = 1800
ARM = ("--arm", "arm.toml")
#: Runs one command of armd in a case's folder; processor seconds, or raises `Refused`.
RunCommand = Callable[..., float]


@dataclass(frozen=True)
class Ran:
    """What the commands wrote, as far as it is judged."""

    findings: tuple[Mapping[str, Any], ...] = ()
    before_um: float | None = None
    after_um: float | None = None
    promised_um: tuple[float, float] | None = None  # held-out RMS without and with the findings
    later_gain_um: tuple[float, float] | None = None  # 95 % of the gain in another session
    set_probability: float | None = None  # of the findings as a whole
    seconds: float = 0.0  # of processor time, all commands
    diagnose_s: float = 0.0  # of the diagnosis alone
    refused: str = ""  # a command's message, where it ended with an error
    failed: bool = False  # a refusal by another exit code than 2, or none in time


class Refused(Exception):
    def __init__(self, message: str, failed: bool) -> None:
        super().__init__(message)
        self.failed = failed

    @classmethod
    def from_output(cls, command: str, folder: Path, code: int) -> Refused:
        """Of a command that ended with *code*, what it printed in output.txt."""
        output = (folder / "output.txt").read_text(errors="replace")
        return cls(f"armd {command}: {output[-1500:]}", code != 2)


class Commands:
    """Runs a revision's commands in a folder, and adds up their processor seconds."""

    def __init__(self, revision: Revision, folder: Path, cache: Path) -> None:
        self.revision, self.folder, self.cache = revision, folder, cache
        self.seconds = 0.0

    def run(self, *words: str) -> float:
        """Processor seconds of one command; raises `Refused` if it ends with an error."""
        with (self.folder / "output.txt").open("w") as out:
            process = subprocess.Popen(
                self.revision.command(*words), cwd=self.folder, stdout=out, stderr=out,
                stdin=subprocess.DEVNULL, env=self.revision.environment(self.cache),
            )  # fmt: skip
            # Processor time is bounded, not the clock's: other work may have the processors.
            with suppress(ProcessLookupError):
                resource.prlimit(process.pid, resource.RLIMIT_CPU, (MOST_S, MOST_S + 5))
            _, status, usage = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        spent = usage.ru_utime + usage.ru_stime
        self.seconds += spent
        if process.returncode:
            raise Refused.from_output(words[0], self.folder, process.returncode)
        return float(spent)


def run_case(revision: Revision, case: Path, cache: Path) -> Ran:
    """Calibrate, diagnose and evaluate a case by the revision's commands."""
    truth = read_truth(case)
    with copy_case(case) as folder:
        commands = Commands(revision, folder, cache)
        try:
            make_given(commands.run, folder, truth)
            ran = diagnose_and_evaluate(commands.run, folder, truth)
        except Refused as refused:
            return Ran(refused=str(refused), failed=refused.failed, seconds=commands.seconds)
        return replace(ran, seconds=commands.seconds)


@contextmanager
def copy_case(case: Path) -> Iterator[Path]:
    """A copy of a case without its truth."""
    with tempfile.TemporaryDirectory(prefix="armd-frozen-") as made:
        folder = Path(made) / "case"
        shutil.copytree(case, folder, ignore=shutil.ignore_patterns("truth.json"))
        yield folder


def make_given(run: RunCommand, folder: Path, truth: Truth) -> None:
    """Write given.json, the model under test, into a case's folder."""
    before, diagnosed = sessions(folder, "before"), sessions(folder, "session")
    if truth.given == "diagnose":
        run("diagnose", *before, *ARM, "--json", "first.json", "--extended", "given.json")
    else:
        run("calibrate", *(before or diagnosed), *ARM, "-o", "given.json")


def diagnose_and_evaluate(run: RunCommand, folder: Path, truth: Truth) -> Ran:
    """Diagnose a case whose given.json there is, and evaluate that and the extended model."""
    diagnosed, further = sessions(folder, "session"), sessions(folder, "further")
    given = ("--calibration", "given.json") if truth.given else ()
    holdout = ("--holdout", *further) if truth.holdout_given else ()
    spent = run("diagnose", *diagnosed, *ARM, *given, *holdout,
                "--json", "diagnosis.json", "--extended", "extended.json")  # fmt: skip
    for name in ("given", "extended"):
        if (folder / f"{name}.json").exists():
            run("evaluate", *further, *ARM, "--calibration", f"{name}.json",
                "--json", f"{name}-error.json")  # fmt: skip
    return read_answer(folder, spent)


def read_answer(folder: Path, diagnose_s: float) -> Ran:
    """What of the files of a diagnosis and of two evaluations is judged."""
    errors = []
    for name in ("given", "extended"):
        path = folder / f"{name}-error.json"
        errors.append(float(json.loads(path.read_text())["rms_um"]) if path.exists() else errors[0])
    report = json.loads((folder / "diagnosis.json").read_text())
    findings = tuple(_brief(finding) for finding in report["findings"])
    baseline = report["baseline"]
    return Ran(
        findings, *errors, _promised(baseline), baseline.get("later_gain_um"),
        next((causes["probability"] for causes in report.get("sets", ())), None),
        seconds=diagnose_s, diagnose_s=diagnose_s,
    )  # fmt: skip


def _promised(baseline: Mapping[str, Any]) -> tuple[float, float] | None:
    keys = ("heldout_rms_um", "heldout_rms_um_extended")
    before, after = (baseline.get(key) for key in keys)
    return None if before is None or after is None else (before, after)


def _brief(finding: Mapping[str, Any]) -> dict[str, Any]:
    """What of a finding is judged."""
    kept = (
        "cause", "location", "probability", "depends_on", "session", "placement",
        "parameters", "gain", "in_extended_calibration",
    )  # fmt: skip
    return {key: finding[key] for key in kept if key in finding} | {
        "alternatives": [[one["cause"], one["location"]] for one in finding["alternatives"]],
    }
