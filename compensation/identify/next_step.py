"""Choose what to do next after a refused certificate: one sentence with the command to type."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum, auto
from pathlib import Path

import numpy as np

from armd.compensation.estimate.observations import Observations
from armd.compensation.identify.admission.reading_counts import (
    CERTIFICATE_TIMES,
    LEAST_PLACEMENTS,
    count_least_readings,
)
from armd.compensation.identify.admission.requirements import count_artefact_unknowns
from armd.terminal.counted import format_count


class Why(Enum):
    """The reasons for which a certificate is refused, causes before their consequences.

    Of several reasons, the first one decides the next step.
    """

    TEMPERATURES = auto()
    ODD_SESSION = auto()
    OTHER_TIP = auto()
    OTHER_PLACE = auto()
    OUTLIERS = auto()
    LENGTH = auto()
    PLACEMENTS = auto()
    READINGS = auto()
    POSTURES = auto()
    FAR = auto()
    NO_HELP = auto()
    UNSETTLED = auto()


@dataclass(frozen=True)
class Objection:
    """A reason in words, and the session, targets or rows that it concerns."""

    why: Why
    words: str
    session: str = ""
    targets: tuple[str, ...] = ()
    rows: str = ""  # of sessions that are only partly wrong, as a person finds them
    folders: tuple[str, ...] = ()  # of sessions that are wrong as a whole


@dataclass(frozen=True)
class CalibratedFiles:
    """The calibrated files, as a user types them."""

    sessions: tuple[Path, ...]
    arm: str = "arm.toml"

    def command(self, name: str, *options: str, without: Sequence[str] = ()) -> str:
        """Return the command `armd NAME` of all sessions, or of all but the folders *without*."""
        folders = [folder for folder in map(str, self.sessions) if folder not in without]
        return shlex.join(["armd", name, *folders, "--arm", self.arm, *options])

    @property
    def another(self) -> str:
        """The folder for another session, beside the last one."""
        names = {path.name for path in self.sessions}
        free = next(name for k in range(len(names) + 1) if (name := f"more{k or ''}") not in names)
        return str(self.sessions[-1].parent / free)


def choose_next_step(
    faults: Sequence[Objection],
    observations: Observations,
    files: CalibratedFiles,
    far_off: Sequence[str] = (),
) -> str:
    """Choose the one thing to do next, with the command in backquotes; "" without a fault.

    *far_off* are the parameters that arm.toml has far off.
    """
    if not faults:
        return ""
    fault = min(faults, key=lambda objection: objection.why.value)
    elsewhere = "" if observations.has_truth.all() else " in another place"  # a tracker needs none
    again = files.command("calibrate", "-o", "calibration.json")
    match fault.why:
        case Why.TEMPERATURES:
            return (
                f"write the temperatures of session {fault.session} in °C, or empty cells where a"
                f" sensor failed, and calibrate again: `{again}`"
            )
        case Why.ODD_SESSION:
            without = files.command("calibrate", "-o", "calibration.json", without=[fault.session])
            return f"calibrate without session {fault.session}: `{without}`"
        case Why.OTHER_TIP if not fault.rows:
            without = files.command("calibrate", "-o", "calibration.json", without=fault.folders)
            return (
                f"one calibration holds one tip, calibrate each tip's sessions alone: `{without}`"
            )
        case Why.OTHER_TIP:
            return (
                f"one calibration holds one tip, delete {fault.rows} or put them into a session of"
                f" their own, and calibrate the rest: `{again}`"
            )
        case Why.OTHER_PLACE:
            return (
                f"give {fault.rows} another name in column placement of readings.csv, and calibrate"
                f" again: `{again}`"
            )
        case Why.OUTLIERS:
            return (
                "these readings are far off, delete them from the session or measure them again,"
                f" and calibrate again: `{again}`"
            )
        case Why.LENGTH:
            return (
                f"put the length of {' to '.join(fault.targets)} right in session.toml if its"
                f" certificate says another one, else clean and seat both ends and measure again:"
                f" {_write_measure_command(observations, files, 1, fault.targets)}"
            )
        case Why.PLACEMENTS:
            places = LEAST_PLACEMENTS - len(np.unique(observations.placement))
            return (
                f"measure the artefact in {format_count(places, 'more place')}:"
                f" {_write_measure_command(observations, files, places)}"
            )
        case Why.READINGS:
            n_missing = _count_missing(observations, 1)
            return (
                f"take at least {format_count(n_missing, 'more reading')} in postures of their own"
                f"{elsewhere}: {_write_measure_command(observations, files, 1)}"
            )
        case Why.POSTURES:
            joint, moved_deg = _find_least_moved(observations)
            return (
                f"turn joint {joint} farther, which moved least ({moved_deg:.0f}°), and measure"
                f" again{elsewhere}: {_write_measure_command(observations, files, 1)}"
            )
        case Why.UNSETTLED if far_off:  # the fit began at these values
            return (
                f"put {', '.join(far_off)} right in {files.arm}, as drawn or as fitted, and"
                f" calibrate again: `{again}`"
            )
        case Why.FAR | Why.NO_HELP | Why.UNSETTLED:
            return f"look for what the model lacks: `{files.command('diagnose')}`"


def _write_measure_command(
    observations: Observations, files: CalibratedFiles, places: int, targets: Sequence[str] = ()
) -> str:
    """Return the command that adds a session, with as many rounds as are still needed."""
    if observations.has_truth.all():
        words = ["armd", "import", "readings.csv", "--arm", files.arm, "-o", files.another]
        return f"`{shlex.join(words)}` (readings.csv: the tracker's table)"
    if observations.on_surface.any():
        return "a session more with the same surfaces (docs/how-to/calibrate.md)"
    first = len(np.unique(observations.placement)) + 1
    names = ",".join(f"P{k}" for k in range(first, first + places))
    words = ["armd", "measure", "artefact", "--artefact", "artefact.toml", "-o", files.another]
    words += ["--placements", names]
    touched = len(targets) or len(_list_artefact_targets(observations))
    if targets:
        words += ["--targets", ",".join(targets)]
    elif (missing := _count_missing(observations, places)) > 0:
        words += ["--repeats", str(-(-missing // (places * touched)))]
    words += ["--with", *map(str, files.sessions)]
    return f"`{shlex.join(words)}` (artefact.toml: the artefact's table)"


def _count_missing(observations: Observations, places: int) -> int:
    """Count the postures that a session in *places* more places must add.

    Each place has unknowns of its own, and so has each seat that is touched again.
    """
    again = int(observations.unknown[_list_artefact_targets(observations)].sum())
    free = count_artefact_unknowns(observations) + 6 * places + 3 * again
    equations_per_reading = float(observations.freedom.mean())
    needed = CERTIFICATE_TIMES * count_least_readings(
        observations.arm.n_joints, free, equations_per_reading
    )
    return needed - observations.n_postures


def _list_artefact_targets(observations: Observations) -> list[int]:
    """List the targets touched in the last session that has an artefact."""
    on_artefact = ~observations.has_truth
    if not on_artefact.any():
        return []
    last = observations.session[on_artefact].max()
    touched: list[int] = np.unique(
        observations.target[on_artefact & (observations.session == last)]
    ).tolist()
    return touched


def _find_least_moved(observations: Observations) -> tuple[int, float]:
    """Return the joint (from 1) that moved through the smallest angle, and the angle in degrees."""
    q = observations.states.q
    moved_deg = np.degrees(np.nanmax(q, axis=0) - np.nanmin(q, axis=0))
    joint = int(np.argmin(moved_deg))
    return joint + 1, float(moved_deg[joint])
