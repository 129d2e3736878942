"""A session: a folder of measured data, read strictly.

`session.toml` says which arm and which artefact, `readings.csv` (or `readings.parquet`) has one
row per reading. Whatever does not fit is refused with file, row, column, found and expected.
"""

from __future__ import annotations

import hashlib
import math
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from armd.compensation.data.readings import Readings, load_readings
from armd.compensation.data.session_format import AngleUnit, Artefact, SessionFile
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import joint_jacobian
from armd.compensation.model.state import States
from armd.errors import BadInput
from armd.inputs import open_input
from armd.schema import load_toml
from armd.suggest import hint

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

READINGS = ("readings.csv", "readings.parquet")
APPROACH = ["approach_x", "approach_y", "approach_z"]
TRUTH = ["x_mm", "y_mm", "z_mm"]

# Beyond these a number is taken for one in another unit, not for a measurement.
MOST_TURNS = 10.0
MOST_SECONDS = 10 * 365 * 86400.0
LEAST_C, MOST_C = -60.0, 150.0
MOST_RATE_RAD_S = 100.0
MOST_MM = 1e6
#: Rows whose Jacobians are held in memory at once.
CHUNK = 1 << 16


@dataclass(frozen=True)
class Session:
    """Readings of one arm on one artefact, checked; arrays have one row per reading."""

    path: Path
    name: str
    arm: str
    started_unix_s: float
    artefact: Artefact
    states: States
    placement: I64  # (n,) index into placement_names
    placement_names: list[str]
    target: I64  # (n,) index into artefact.targets
    truth_mm: F64  # (n, 3) in the placement's frame; NaN where the target's position counts
    artefact_c: F64  # (n,) °C, NaN missing
    unused_columns: list[str]
    row: I64  # (n,) of the table, from 0
    lost: tuple[str, ...] = ()  # sensors that show nothing; their values are what the others tell
    lost_links: tuple[int, ...] = ()  # links (from 1) that such a sensor spoke for
    operator: str | None = None

    @property
    def n(self) -> int:
        return len(self.target)

    def rows(self, kept: npt.NDArray[np.bool_] | I64) -> Session:
        """The chosen rows only."""
        return replace(
            self,
            states=self.states.rows(kept),
            placement=self.placement[kept],
            target=self.target[kept],
            truth_mm=self.truth_mm[kept],
            artefact_c=self.artefact_c[kept],
            row=self.row[kept],
        )

    def fingerprint(self) -> str:
        """SHA-256 over session.toml and the readings, as they stand on disk now."""
        digest = hashlib.sha256()
        for name in ("session.toml", *READINGS):
            file = self.path / name
            if file.exists():
                digest.update(f"{name}\0{file.stat().st_size}\0".encode())
                with open_input(file) as content:
                    while block := content.read(1 << 20):
                        digest.update(block)
        return digest.hexdigest()


def load_sessions(
    paths: Sequence[str | Path], arm: Arm, besides: Sequence[Session] = ()
) -> list[Session]:
    """Read session folders, each of them once and none of those *besides*.

    Readings that count twice look better known than they are, and held-out ones that were fitted
    prove nothing. Raises `BadInput`.
    """
    seen = {os.path.realpath(session.path) for session in besides}
    for path in map(Path, paths):
        real = os.path.realpath(path)  # of a link that leads back to itself, too
        if real in seen:
            raise BadInput(path, "the session", "given twice", "every session once")
        seen.add(real)
    return [load_session(path, arm) for path in paths]


def load_session(path: str | Path, arm: Arm) -> Session:
    """Read the session folder *path*, measured with *arm*.

    Raises `BadInput` naming file, row, column, found and expected.
    """
    folder = Path(path)
    check_is_session(folder)
    file = load_toml(folder / "session.toml", SessionFile)
    if file.arm != arm.serial_number:
        expected = f"{arm.serial_number!r}, as in arm.toml"
        raise BadInput(folder / "session.toml", "arm", repr(file.arm), expected)
    numbers = number_columns(arm)
    readings = load_readings(_readings_path(folder), numbers, ["placement", "target"])
    placement, placement_names = readings.names("placement")
    time_s = times(readings)
    q = angles(readings, arm, file.angle_unit)
    rate = rates(readings, arm.n_joints)
    return Session(
        path=folder,
        name=folder.resolve().name,
        arm=file.arm,
        started_unix_s=file.started.timestamp(),
        artefact=file.artefact,
        states=States(
            q=q,
            rate=rate,
            temperature_c=temperatures(readings, arm.sensors),
            time_s=file.started.timestamp() + time_s,
            approach=approaches(readings, arm, q, rate),
            series=np.zeros(readings.n, dtype=np.int64),
        ),
        placement=placement,
        placement_names=placement_names,
        target=_targets(readings, file.artefact),
        truth_mm=_truth(readings),
        artefact_c=temperatures(readings, ["artefact_c"])[:, 0],
        unused_columns=[
            name for name in readings.header if name not in (*numbers, "placement", "target")
        ],
        row=np.arange(readings.n),
        operator=file.operator,
    )


def check_is_session(folder: Path) -> None:
    """Raises `BadInput` for what is no session's folder, and says where one is nearby."""
    expected = "a folder with session.toml and readings.csv"
    if not folder.is_dir():
        found = "a file" if folder.exists() else "nothing"
        if folder.is_file() and (folder.parent / "session.toml").is_file():
            found, expected = "a file of a session", f"its folder, {folder.parent}"
        raise BadInput(folder, "the session", found, expected)
    if (folder / "session.toml").exists():
        return
    below = sorted(path.parent.name for path in folder.glob("*/session.toml"))
    if below:
        found = f"a folder of {len(below)} session{'' if len(below) == 1 else 's'}"
        expected = f"sessions, as {' '.join(str(folder / name) for name in below[:2])}"
        raise BadInput(folder, "the session", found, expected + " …" * (len(below) > 2))
    if (folder.parent / "session.toml").is_file():
        found = "a folder within a session"
        raise BadInput(folder, "the session", found, f"the session, {folder.parent}")


def angles(readings: Readings, arm: Arm, unit: AngleUnit, *, missing_allowed: bool = False) -> F64:
    """Encoder angles (n, N) in rad, signed as they stand; counts by `direction` and turn."""
    q = np.empty((readings.n, arm.n_joints))
    for k, joint in enumerate(arm.joint):
        name = f"q{k + 1}"
        values = readings.number(name) if missing_allowed else readings.required(name)
        if unit == "count":
            if joint.counts_per_turn is None:
                raise BadInput(
                    "arm.toml", f"joint[{k + 1}].counts_per_turn", "nothing", "counts per turn"
                )
            turn = float(joint.counts_per_turn)
            scale = joint.direction * math.tau / turn
        else:
            turn, scale = (math.tau, 1.0) if unit == "rad" else (360.0, math.radians(1.0))
        q[:, k] = scale * values
        # Unwrapped counts may stand a turn or two off; more than that is another unit.
        low, high = joint.min_deg, joint.max_deg
        low = -360.0 * MOST_TURNS if low is None else low - 720.0
        high = 360.0 * MOST_TURNS if high is None else high + 720.0
        absurd = (q[:, k] < math.radians(low)) | (q[:, k] > math.radians(high))
        expected = f"an angle in {unit} ({turn:.10g} a turn), {low:g}° to {high:g}°"
        readings.refuse(absurd, name, values, expected)
    whole = q[np.isfinite(q).all(axis=1)]
    if unit != "rad" and len(whole) >= 10 and _looks_like_rad(whole, arm, unit):
        expected = f"angles in {unit}: all of them lie within 2π, like radians"
        raise readings.fault(0, "q1", f"{readings.number('q1')[0]:g}", expected)
    return q


def temperatures(readings: Readings, sensors: list[str]) -> F64:
    """Columns of °C (n, S); NaN where a value or the whole column is missing."""
    columns = np.empty((readings.n, len(sensors)))
    for s, name in enumerate(sensors):
        columns[:, s] = values = readings.optional(name)
        absurd = (values < LEAST_C) | (values > MOST_C)
        readings.refuse(absurd, name, values, f"a temperature in °C, {LEAST_C:g} to {MOST_C:g}")
    return columns


def times(readings: Readings) -> F64:
    """Seconds since `started` (n,); all NaN where the whole column is empty: nobody knows when."""
    time_s = readings.number("time_s")
    if not np.isnan(time_s).all():
        time_s = readings.required("time_s")
    expected = "seconds since `started`"
    readings.refuse(np.abs(time_s) > MOST_SECONDS, "time_s", time_s, expected)
    return time_s


def number_columns(arm: Arm) -> list[str]:
    """The columns of numbers that readings of this arm may have."""
    joints = range(1, arm.n_joints + 1)
    angle_and_rate = [f"{letter}{k}" for letter in "qw" for k in joints]
    return ["time_s", *angle_and_rate, *arm.sensors, "artefact_c", *APPROACH, *TRUTH]


def _readings_path(folder: Path) -> Path:
    present = [folder / name for name in READINGS if (folder / name).exists()]
    if len(present) != 1:
        found = "both" if present else "neither"
        raise BadInput(folder, " or ".join(READINGS), found, "one of them")
    return present[0]


def _looks_like_rad(q: F64, arm: Arm, unit: AngleUnit) -> bool:
    """Whether every value as written lies within 2π, though it should be in deg or counts."""
    for k, joint in enumerate(arm.joint):
        turn = 360.0 if unit == "deg" else float(joint.counts_per_turn or 1)
        if turn < 300 or np.abs(q[:, k]).max() * turn / math.tau > math.tau:
            return False
    return True


def rates(readings: Readings, n_joints: int) -> F64:
    """Joint rates (n, N) in rad/s; NaN where a value or the whole column is missing."""
    rate = np.empty((readings.n, n_joints))
    for k in range(n_joints):
        name = f"w{k + 1}"
        rate[:, k] = values = readings.optional(name)
        readings.refuse(np.abs(values) > MOST_RATE_RAD_S, name, values, "a joint rate in rad/s")
    return rate


def approaches(readings: Readings, arm: Arm, q: F64, rate: F64) -> F64:
    """Unit vectors (n, 3): as given, otherwise the tip's direction of motion, otherwise NaN."""
    given = _three(readings, APPROACH)
    length = np.linalg.norm(given, axis=1)
    readings.refuse(np.abs(length - 1) > 0.01, APPROACH[0], length, "a vector of length 1")
    approach: F64 = given / length[:, None]
    moved = np.flatnonzero(
        np.isnan(length) & np.isfinite(rate).all(axis=1) & (rate != 0).any(axis=1)
    )
    for first in range(0, len(moved), CHUNK):
        rows = moved[first : first + CHUNK]
        velocity = np.einsum("nij,nj->ni", joint_jacobian(q[rows], arm.nominal()), rate[rows])
        speed = np.linalg.norm(velocity, axis=1, keepdims=True)
        approach[rows] = np.divide(
            velocity, speed, out=np.full_like(velocity, np.nan), where=speed > 0
        )
    return approach


def _targets(readings: Readings, artefact: Artefact) -> I64:
    codes, names = readings.names("target")
    known = {name: i for i, name in enumerate(artefact.target_names)}
    for code, name in enumerate(names):
        if name not in known:
            row = int(np.argmax(codes == code))
            expected = f"a target of session.toml{hint(name, known)}"
            raise readings.fault(row, "target", repr(name), expected)
    return np.array([known[name] for name in names], dtype=np.int64)[codes]


def _truth(readings: Readings) -> F64:
    truth = _three(readings, TRUTH)
    for i, name in enumerate(TRUTH):
        values = truth[:, i]
        readings.refuse(np.abs(values) > MOST_MM, name, values, "a position in mm")
    return truth


def _three(readings: Readings, names: list[str]) -> F64:
    """Three columns that are all there or all absent, row by row and as columns; NaN absent."""
    if not any(readings.has(name) for name in names):
        return np.full((readings.n, 3), np.nan)
    values = np.column_stack([readings.number(name) for name in names])
    missing = np.isnan(values)
    for i, name in enumerate(names):
        partly = missing[:, i] & ~missing.all(axis=1)
        readings.refuse(partly, name, values[:, i], "a number, as in the other two columns")
    return values
