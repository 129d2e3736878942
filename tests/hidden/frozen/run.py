"""One case under one revision: its commands, and what came of them."""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hidden.frozen.case import Truth, read_truth, sessions
from hidden.frozen.revision import Revision

MOST_S = 1800


@dataclass(frozen=True)
class Ran:
    """What the commands wrote, as far as it is judged."""

    findings: tuple[Mapping[str, Any], ...] = ()
    before_um: float | None = None
    after_um: float | None = None
    promised_um: tuple[float, float] | None = None  # held-out RMS without and with the findings
    later_gain_um: tuple[float, float] | None = None  # 95 % of the gain in another session
    seconds: float = 0.0  # of processor time, all commands
    diagnose_s: float = 0.0  # of the diagnosis alone
    refused: str = ""  # a command's message, where it ended with an error
    failed: bool = False  # a refusal by another exit code than 2, or none in time


class Refused(Exception):
    def __init__(self, message: str, failed: bool) -> None:
        super().__init__(message)
        self.failed = failed


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
            said = (self.folder / "output.txt").read_text(errors="replace")
            raise Refused(f"armd {words[0]}: {said[-1500:]}", process.returncode != 2)
        return float(spent)


def run_case(revision: Revision, case: Path, cache: Path) -> Ran:
    """Calibrate, diagnose and evaluate a case by the revision's commands."""
    truth = read_truth(case)
    with tempfile.TemporaryDirectory(prefix="armd-frozen-") as made:
        folder = Path(made) / "case"
        shutil.copytree(case, folder, ignore=shutil.ignore_patterns("truth.json"))
        commands = Commands(revision, folder, cache)
        try:
            return _run(commands, truth)
        except Refused as refused:
            return Ran(refused=str(refused), failed=refused.failed, seconds=commands.seconds)


def _run(commands: Commands, truth: Truth) -> Ran:
    folder = commands.folder
    before, further = sessions(folder, "before"), sessions(folder, "further")
    diagnosed = sessions(folder, "session")
    arm = ("--arm", "arm.toml")
    if truth.given == "diagnose":
        commands.run("diagnose", *before, *arm, "--json", "first.json", "--extended", "given.json")
    else:
        commands.run("calibrate", *(before or diagnosed), *arm, "-o", "given.json")
    given = ("--calibration", "given.json") if truth.given else ()
    holdout = ("--holdout", *further)
    spent = commands.run(
        "diagnose", *diagnosed, *arm, *given, *(holdout if truth.holdout_given else ()),
        "--json", "diagnosis.json", "--extended", "extended.json",
    )  # fmt: skip
    for name in ("given", "extended"):
        if (folder / f"{name}.json").exists():
            commands.run("evaluate", *further, *arm, "--calibration", f"{name}.json",
                         "--json", f"{name}-error.json")  # fmt: skip
    return replace(read_answer(folder, spent), seconds=commands.seconds)


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
