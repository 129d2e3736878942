"""`--session-like SESSION`: the readings that the twin would have had in a measured session.

The artefact is placed where the session's own angles put it under the twin. Then each row's joints
turn as little as possible until the twin's tip is at the row's target.
"""

from __future__ import annotations

import argparse
import sys
import zlib
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.errors import BadInput
from armd.files.inputs import read_input
from armd.files.outputs import SESSION, check_output_folder, check_same
from armd.files.writing import write_whole
from armd.simulator.twin.chain import Frames
from armd.simulator.twin.files import read_twin
from armd.simulator.twin.model import TwinModel, count_whole_turns
from armd.simulator.twin.noise import FoundNoise, draw_drift, number_rests, read_noise
from armd.simulator.twin.placing import TouchedRows, find_goals
from armd.simulator.twin.session_files import (
    SourceSession,
    draw_certificate_errors,
    draw_no_errors,
    list_touched,
    read_session,
)
from armd.terminal.counted import format_count

#: Tolerance of the tip, and number of steps; terms change a step by a thousandth.
CLOSE_MM, STEPS = 1e-10, 40
#: With a larger distance, a row's target is out of reach from its posture.
MISSED_MM = 1e-7
NOTE = b"# Simulated by armd simulate --session-like: no arm was measured.\n"


@dataclass(frozen=True)
class Copied:
    """The copy of a session."""

    table: bytes
    n: int
    n_unchanged: (
        int  # rows as measured, because they lack a temperature or time that the twin needs
    )


class TwinRows:
    """A session's rows under a twin: takes angles, returns frames."""

    def __init__(self, twin: TwinModel, session: SourceSession) -> None:
        arm = twin.arm
        self._twin = twin
        self.rate = session.side_by_side(*(f"w{k}" for k in range(1, arm.n_joints + 1)))
        approach = session.side_by_side("approach_x", "approach_y", "approach_z")
        self._approach = approach / np.linalg.norm(approach, axis=1, keepdims=True)
        self._moving = np.isfinite(self.rate).all(axis=1) & (self.rate != 0).any(axis=1)
        celsius = session.side_by_side(*arm.sensors) if arm.sensors else np.zeros((session.n, 0))
        self._amounts = twin.row_slow(celsius, session.unix_s())

    def stand(self, q: F64) -> Frames:
        """Return the frames at angles (n, N) rad.

        Where no approach is given, it is the direction in which the joints move the tip.
        """
        approach = self._approach
        open_rows = self._moving & np.isnan(approach[:, 0])
        if open_rows.any():
            moved = self._twin.direction_of_motion(q, self.rate)
            approach = np.where(open_rows[:, None], moved, approach)
        return self._twin.stand(q, self.rate, approach, self._amounts)


def copy_session(
    twin: TwinModel, session: SourceSession, noise: FoundNoise | None, seed: int
) -> Copied:
    """Return the session with the twin's readings; raises `BadInput` for a target out of reach.

    With *noise*, certified positions and lengths also have errors by their standard uncertainties,
    because a diagnosis includes them in its expected noise.
    """
    measured = session.angles(twin.arm)
    turns = count_whole_turns(measured, twin.arm.limits_rad)
    q = measured - 2 * np.pi * turns
    rows = TwinRows(twin, session)
    errors = draw_no_errors if noise is None else draw_certificate_errors(seed)
    touched, position_mm, lengths = list_touched(session, twin.calibration.artefact, errors)
    tip_mm = rows.stand(q).tip
    used = np.isfinite(tip_mm[:, 0])
    if not used.any():
        actual = "no row with every temperature and time that the calibration needs"
        raise BadInput(session.folder, session.table, actual, "at least one")
    goal_mm = find_goals(touched, position_mm, lengths, tip_mm)
    shift_mm, encoder_rad = np.zeros_like(goal_mm), np.zeros_like(q)
    if noise is not None:
        rng = np.random.default_rng([seed, 0x7417, zlib.crc32(session.folder.name.encode())])
        freedom = _freedom(touched, np.isnan(position_mm[:, 0]), int(used.sum()))
        shift_mm, encoder_rad = _drawn(noise, freedom, session, (q, touched), rng)
    turned = _turn_to(rows, session, q, np.where(used[:, None], goal_mm + shift_mm, tip_mm))
    turned += np.where(used[:, None], encoder_rad, 0.0)
    table = session.with_angles(turned + 2 * np.pi * turns, twin.arm)
    return Copied(table, session.n, int((~used).sum()))


def _turn_to(rows: TwinRows, session: SourceSession, q: F64, goal_mm: F64) -> F64:
    """Find angles (n, N) near *q* with the tip at *goal_mm* (n, 3); NaN: unchanged."""
    q = q.copy()
    for _ in range(STEPS):
        frames = rows.stand(q)
        difference_mm = np.nan_to_num(goal_mm - frames.tip)
        if np.abs(difference_mm).max() < CLOSE_MM:
            break
        jacobian = np.nan_to_num(frames.jacobian)
        squared = jacobian @ jacobian.transpose(0, 2, 1)
        size = np.trace(squared, axis1=1, axis2=2)[:, None, None]
        squared = squared + (1e-9 * size + 1e-12) * np.eye(3)
        step = jacobian.transpose(0, 2, 1) @ np.linalg.solve(squared, difference_mm[:, :, None])
        q += np.clip(step[:, :, 0], -0.3, 0.3)
    missed = np.linalg.norm(difference_mm, axis=1)
    worst = int(np.argmax(missed))
    if missed[worst] > MISSED_MM:
        location = f"{session.table} row {worst + 1}"
        actual = f"a target {missed[worst]:.3g} mm beyond what the twin reaches near that posture"
        raise BadInput(session.folder, location, actual, "one within reach")
    return q


def _drawn(
    noise: FoundNoise,
    freedom: float,
    session: SourceSession,
    q_and_touched: tuple[F64, TouchedRows],
    rng: np.random.Generator,
) -> tuple[F64, F64]:
    """Draw displacements of the tip (n, 3) mm and errors of the encoders (n, N) rad.

    The readings of one rest share them. They are larger by the share that fitting placements
    absorbs, so that the residuals have the size that the diagnosis found.
    """
    q, touched = q_and_touched
    rest = number_rests(q, touched.placement, touched.target)
    count = int(rest[-1]) + 1
    scale = 1.0 / np.sqrt(freedom)
    repeat = scale * noise.repeat_mm * rng.normal(size=(count, 3))
    encoders = scale * noise.encoder_rad * rng.normal(size=(count, q.shape[1]))
    return repeat[rest] + draw_drift(noise, session.unix_s(), rng), encoders[rest]


def _freedom(touched: TouchedRows, unknown: F64, n: int) -> float:
    """Return the share of 3 n coordinates not fitted by poses and unknown points, at least 0.2."""
    rows = np.bincount(touched.placement)
    fitted_coordinates = float(np.minimum(6, 3 * rows[rows > 0]).sum())
    fitted_coordinates += 3.0 * float(unknown[np.unique(touched.target)].sum())
    return max(1.0 - fitted_coordinates / (3.0 * n), 0.2)


def write_copy(options: argparse.Namespace, seed: int) -> int:
    """Write the twin's session as the command line requires; return 0.

    Raises `ArmdError`, with nothing written, where an input is invalid or a session exists there.
    """
    arm_path, source, output = options.arm, options.session_like, options.output
    check_output_folder(output)
    noise = None if options.noise_from is None else read_noise(options.noise_from)
    twin = TwinModel(*read_twin(arm_path, options.twin, source))
    session = read_session(source, twin.arm)
    copied = copy_session(twin, session, noise, seed)
    head = NOTE + read_input(source / "session.toml").removeprefix(b"\xef\xbb\xbf")
    files = {output / session.table: copied.table, output / "session.toml": head}
    if output.is_dir():
        for path, content in files.items():
            check_same(path, content, SESSION, options.force, [arm_path, options.twin, source])
    output.mkdir(parents=True, exist_ok=True)
    for path, content in files.items():
        write_whole(path, content)
    print(f"{format_count(copied.n, 'reading')} in {output}")
    if copied.n_unchanged:
        count = format_count(copied.n_unchanged, "reading")
        lack = "without a temperature or time that is needed"
        print(f"{count} {lack}: angles as measured", file=sys.stderr)
    return 0
