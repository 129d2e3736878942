"""`armd check`: check files, and list everything that is wrong in each."""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console

from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.calibration import load_calibration
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.schema import decode_toml, load_json_data, load_toml
from armd.printable import to_printable
from armd.terminal.aside import make_aside
from armd.terminal.counted import format_count
from armd.terminal.suggest import suggest, suggest_path


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="arm.toml, armd.toml, a calibration, a session's folder, a scenario, MPE values; "
        "sessions and calibrations are held against their arm.toml, if that is among the files",
    )


def run(args: argparse.Namespace) -> int:
    for path in args.file:
        if not path.exists():
            raise BadInput(path, "the file", "nothing", f"an existing file{suggest_path(path)}")
    arms = _find_arms(args.file)
    wrong = False
    session_faults, doubts = _compare_sessions(args.file, arms, make_aside(args))
    for path in args.file:
        faults, remark = _check_file(path, arms)
        faults = [*faults, *session_faults.get(_get_folder(path), [])]
        for fault in faults:
            print(f"armd: {to_printable(fault)}", file=sys.stderr)
        if not faults:
            print(to_printable(f"{path}: ok{remark}"))
        wrong = wrong or bool(faults)
    for doubt in doubts:
        print(doubt)
    return 1 if wrong else 0


def _compare_sessions(
    paths: Sequence[Path], arms: Arms, console: Console
) -> tuple[dict[Path, list[BadInput]], list[str]]:
    """Compare sessions of the same arm; return faults by folder, and doubts.

    These faults show only in comparison with other sessions of the arm or with its nominal
    geometry.
    """
    folders = [
        _get_folder(path)
        for path in paths
        if path.is_dir() or path.name in (*READINGS, "session.toml")
    ]
    if not folders:
        return {}, []
    from armd.compensation.data.sessions.format import SessionFile
    from armd.compensation.data.sessions.session import Session, load_session, report_turns
    from armd.compensation.estimate.observations import collect_observations
    from armd.compensation.identify.admission.compare_sessions import compare_sessions

    of_arm: dict[str, list[Session]] = {}
    for path in dict.fromkeys(folders):
        try:
            serial = load_toml(path / "session.toml", SessionFile).arm
            session = load_session(path, arms[serial])
        except (BadInput, KeyError):
            continue  # not a session, or its own check reports the fault
        of_arm.setdefault(serial, []).append(session)
    faults: dict[Path, list[BadInput]] = {}
    doubts = []
    for serial, sessions in of_arm.items():
        read = report_turns(sessions, arms[serial])
        doubts += [remark for session in read for remark in session.remarks]
        with console.status("holding the sessions against each other …"):
            try:
                doubts.append(
                    compare_sessions(sessions, collect_observations(sessions, arms[serial]))
                )
            except BadInput as fault:
                for session_fault in (fault, *fault.more):
                    faults.setdefault(_get_folder(Path(session_fault.file)), []).append(
                        session_fault
                    )
    return faults, list(filter(None, doubts))


def _get_folder(path: Path) -> Path:
    """Return a session's folder, from itself or from a file in it."""
    return path if path.is_dir() else path.parent


#: by serial number
Arms = dict[str, Arm]


def _check_file(path: Path, arms: Arms) -> tuple[Sequence[BadInput | str], str]:
    """Return the faults of one file, and a remark if there are none."""
    try:
        return [], _choose_checker(path)(path, arms)
    except BadInput as fault:
        return [fault, *fault.more], ""
    except _ScenarioFaults as faults:
        return faults.lines, ""


def _choose_checker(path: Path) -> Checker:
    if path.is_dir() or (path.name in READINGS and (path.parent / "session.toml").exists()):
        return _check_session
    if path.suffix.lower() in (".csv", ".parquet", ".xlsx"):
        expected = "session.toml beside it: armd import makes a session of a table"
        raise BadInput(path, "the session", "a table alone", expected)
    schema = _read_schema(path)
    if schema not in CHECKERS:
        problem = repr(schema) if schema else "nothing"
        raise BadInput(path, "schema", problem, f"one of {', '.join(CHECKERS)}")
    return CHECKERS[schema]


def _read_schema(path: Path) -> str:
    """Return the schema that a TOML or JSON file states; empty if it states none."""
    content = read_input(path)
    data = load_json_data(path, content) if path.suffix == ".json" else decode_toml(path, content)
    if not isinstance(data, dict):
        return ""
    if "schema" not in data and "arm" not in data:  # two kinds of file may omit it
        return next((f"armd.{kind}/1" for kind in ("artefact", "mpe") if kind in data), "")
    return str(data.get("schema", ""))


def _find_arms(paths: Sequence[Path]) -> Arms:
    """Return the arms among the files, and those in or above their folders."""
    arms: Arms = {}
    arm_files = [
        folder / "arm.toml" for path in paths for folder in (path, *path.absolute().parents[:2])
    ]
    for path in (*arm_files, *paths):
        if path.suffix == ".toml" and path.is_file():
            try:
                arm = load_arm(path)
            except BadInput:
                continue  # not an arm.toml, or its own check reports the fault
            arms[arm.serial_number] = arm
    return arms


def _check_arm(path: Path, _: Arms) -> str:
    load_arm(path)
    return ""


def _check_calibration(path: Path, arms: Arms) -> str:
    serial = load_calibration(path).content.arm
    if serial not in arms:
        suggestion = suggest(serial, arms)
        return f" (on its own: the arm.toml of {serial!r} is not among the files{suggestion})"
    load_calibration(path, arms[serial])
    return ""


def _check_daemon(path: Path, _: Arms) -> str:
    from armd.daemon.config import load_config
    from armd.drivers.config import ReplayConfig

    config = load_config(path)
    if isinstance(config.driver, ReplayConfig) and not Path(config.driver.file).exists():
        file = config.driver.file
        raise BadInput(file, "the file", "nothing", f"an existing file{suggest_path(Path(file))}")
    if config.calibration is not None:
        load_calibration(config.calibration, config.arm)
    return ""


def _check_session(path: Path, arms: Arms) -> str:
    """Check a session; *path* is the folder or a file in it."""
    from armd.compensation.data.sessions.files import check_is_session
    from armd.compensation.data.sessions.format import SessionFile
    from armd.compensation.data.sessions.session import load_session

    folder = _get_folder(path)
    check_is_session(folder)
    serial = load_toml(folder / "session.toml", SessionFile).arm
    if serial not in arms:
        suggestion = suggest(serial, arms)
        return (
            f" (session.toml; the readings want the arm.toml of {serial!r} among the files"
            f"{suggestion})"
        )
    unused = load_session(folder, arms[serial]).unused_columns
    return f" (columns not used: {', '.join(unused)})" if unused else ""


def _check_artefact(path: Path, _: Arms) -> str:
    from armd.compensation.data.sessions.format import ArtefactFile

    artefact = load_toml(path, ArtefactFile).artefact
    unknown = sum(target.position_mm is None for target in artefact.targets)
    lengths = format_count(len(artefact.distances), "certified length")
    surfaces = f", {format_count(len(artefact.surfaces), 'surface')}" if artefact.surfaces else ""
    targets = f"{format_count(len(artefact.targets), 'target')}, {unknown} without position"
    return f" ({targets}{surfaces}; {lengths})"


def _check_mpe(path: Path, _: Arms) -> str:
    from armd.compensation.verify.limits import load_limits

    load_limits(path)
    return ""


def _check_about(path: Path, _: Arms) -> str:
    from armd.compensation.report.layout.about import load_about

    load_about(path)
    return ""


def _check_scenario(path: Path, _: Arms) -> str:
    """Check a scenario with the simulator, a separate program that reads its own files."""
    command = [sys.executable, "-P", "-m", "armd.simulator", "--check", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise _ScenarioFaults([line.removeprefix("armd: ") for line in done.stderr.splitlines()])
    return ""


class _ScenarioFaults(Exception):
    def __init__(self, lines: Sequence[str]) -> None:
        self.lines = lines


Checker = Callable[[Path, Arms], str]

#: schema → function that loads such a file; it raises `BadInput`, or returns a remark
CHECKERS: dict[str, Checker] = {
    "armd.arm/1": _check_arm,
    "armd.calibration/1": _check_calibration,
    "armd.daemon/1": _check_daemon,
    "armd.session/1": _check_session,
    "armd.artefact/1": _check_artefact,
    "armd.scenario/1": _check_scenario,
    "armd.operator/1": _check_scenario,
    "armd.mpe/1": _check_mpe,
    "armd.about/1": _check_about,
}
READINGS = ("readings.csv", "readings.parquet")
