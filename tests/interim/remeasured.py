"""Measurements since a change under mended calibrations, against the simulator's own tips."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from bench import Bench
from drawn_changes import Case
from oracle import true_change

from armd.arrays import F64
from armd.compensation.estimate.placements.poses import make_rigid_columns
from armd.compensation.interim.changes.change import Change
from armd.compensation.interim.checks.signals import Signals
from armd.compensation.interim.report.amend import Amplitudes, extend_calibration, fit
from armd.compensation.interim.report.judgement import Epoch
from armd.compensation.model.calibration import Calibration
from armd.simulator.campaigns import interim
from armd.simulator.measured.plan import MOUNTED
from armd.simulator.truth import nominal
from armd.simulator.truth.effects.effect import Conditions
from support.readings import states_of

#: Measured again by each mended calibration, at so many moments.
MEASURED, MOMENTS = 300, 12


def by_the_oracle(
    case: Case, bench: Bench, epoch: Epoch, right: int, first: int, onset: float
) -> Calibration:
    """The calibration of somebody who knows what changed when, and not how far."""
    of = epoch.stack
    truth = true_change(case, of, right, first)
    amplitudes = fit(of, epoch.causes, (truth,), case.bad_checks)
    return _mended(bench, epoch, (truth,), [onset], amplitudes)


def as_told(bench: Bench, epoch: Epoch) -> Calibration:
    """The calibration that `armd interim` writes with all changes."""
    mended = [told.calibration for told in epoch.reported_changes if told.calibration is not None]
    return mended[-1] if mended else bench.calibration


def _mended(
    bench: Bench,
    epoch: Epoch,
    changes: tuple[Change, ...],
    instants: list[float],
    amplitudes: Amplitudes,
) -> Calibration:
    begun = epoch.checks[0].reduced.mean_unix_s
    last = epoch.checks[-1].reduced.last_unix_s
    return extend_calibration(
        bench.calibration, begun, epoch.causes, changes, instants, amplitudes, last, {}
    )


def errors_um(
    case: Case, bench: Bench, onset: float, last: float, calibrations: Sequence[Calibration]
) -> tuple[list[float], float]:
    """RMS of measurements from the *onset* to the *last* check under each calibration, and what the
    first of them states."""
    rng = np.random.default_rng([case.seed, 0xE44])
    start = (onset - MOUNTED.timestamp()) / 86400.0
    end = (last - MOUNTED.timestamp()) / 86400.0
    squares = np.zeros(len(calibrations) + 1)
    for day in rng.uniform(start, end, MOMENTS):
        squares += _measured(case, bench, day, calibrations, rng)
    *errors, stated = (float(v) for v in 1e3 * np.sqrt(squares / MOMENTS))
    return errors, stated


def _measured(
    case: Case,
    bench: Bench,
    mounted_d: float,
    calibrations: Sequence[Calibration],
    rng: np.random.Generator,
) -> F64:
    """Mean square error (mm²) of measurements at one moment under each calibration, and the one
    that the first states; a rigid motion of all of them removed, which the base of an arm is known
    to only."""
    day = (mounted_d * 24.0 - interim.FIRST_H) / 24.0 + 1.0
    arm = bench.arm_at(case, day)
    low, high = nominal.get_limits_rad()
    n = MEASURED // MOMENTS
    phi = rng.uniform(low, high, (n, len(low)))
    conditions = Conditions.at_rest(n, len(low))
    rate = 0.003 * rng.normal(size=phi.shape)
    conditions = replace(conditions, rate=rate)
    shown, tip = arm.encoder_angles(phi, conditions), arm.tip(phi, conditions)
    states = states_of(
        shown,
        rate=rate,
        temperature_c=np.full((n, len(bench.arm.sensors)), 20.0),
        time_s=np.full(n, MOUNTED.timestamp() + mounted_d * 86400.0),
        approach=conditions.approach,
    )

    def square(off: F64, rigid: F64) -> float:
        """Of columns (3 n, m) clear of a rigid motion, for each reading."""
        left = off - rigid @ np.linalg.lstsq(rigid, off, rcond=None)[0]
        return float((left**2).sum()) / n

    found, stated = [], 0.0
    for number, calibration in enumerate(calibrations):
        seen = Signals(states, bench.arm, calibration)
        rigid = make_rigid_columns(seen.position_mm - seen.position_mm.mean(axis=0)).reshape(-1, 6)
        found.append(square((seen.position_mm - tip).reshape(-1, 1), rigid))
        if number == 0:
            stated = square(seen.compute_calibration_motions().reshape(3 * n, -1), rigid)
    return np.array([*found, stated])
