"""One hidden case: made by the simulator, diagnosed, and judged against the truth kept apart."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import beta

from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.whitening import RestNoise
from armd.compensation.estimate.linear.linear_model import LinearModel
from armd.simulator.campaigns.hidden import NOISE, Design
from armd.simulator.measured.noise import Noise
from armd.simulator.plants.plant import Plant
from support.made_case import MadeCase, make_case
from support.planting import ARC_SECOND, rms_um

#: Causes that only a calibration from before can show.
HELD = {"geometry_shift", "sensor_offset", "sensor_swapped", "link_expansion"}
NOISES = {
    "gaussian": NOISE,
    "heavy tails": replace(NOISE, tails="heavy"),
    "slow drift": replace(NOISE, wander_um=3.0),
    "tails that last": replace(NOISE, tails="t3", correlation=0.6),
}
#: Truth of a single amplitude in the finding's unit, per unit of the plant's size.
AMPLITUDE = {
    "encoder_eccentricity": 1e-3 / 25.0,
    "encoder_ellipticity": ARC_SECOND,
    "encoder_scale": ARC_SECOND,
    "encoder_slip": ARC_SECOND,
    "joint_backlash": ARC_SECOND,
    "joint_compliance": 1e-6,
    "link_bending": 1e-6,
    "time_skew": 1e-6,
    "link_expansion": 1e-6,
    "artefact_expansion": 1e-6,
    "sensor_offset": 1.0,
}


@dataclass(frozen=True)
class Judged:
    """What came of one case."""

    plants: tuple[Plant, ...]
    snr: tuple[float, ...]  # projected, of each plant
    diagnosis: Diagnosis
    named: tuple[bool, ...]  # each plant: cause and place found
    among: tuple[bool, ...]  # each plant: in a finding or its alternatives
    false_causes: int
    unknown: tuple[tuple[str, ...], ...]  # variables of each unknown finding
    errors: tuple[float, ...]  # of amplitudes, in their standard uncertainties
    before_um: float  # on the held-out sessions, by `evaluate`
    after_um: float
    oracle_um: float
    seconds: float


def run_case(
    seed: int,
    plants: Sequence[Plant],
    noise: Noise = NOISE,
    held: bool | None = None,
    design: Design | None = None,
) -> Judged:
    """Make, diagnose and judge a case; *held*: under a calibration from before the trouble."""
    if held is None:
        held = any(plant.cause in HELD for plant in plants)
    design = design or Design()
    if held:
        design = replace(design, before=6)
    made = make_case(seed, plants, design, noise)
    calibration = made.calibrate_before()
    started = time.perf_counter()
    diagnosis = diagnose(made.sessions, made.arm, calibration)
    return _judged(made, tuple(plants), diagnosis, time.perf_counter() - started)


def _judged(
    made: MadeCase, plants: tuple[Plant, ...], diagnosis: Diagnosis, seconds: float
) -> Judged:
    places = [found.candidate.place for found in diagnosis.findings]
    if diagnosis.outliers:
        places.append(("outliers", "rows"))
    rivals = [r.candidate.place for found in diagnosis.findings for r in found.rivals]
    truths = [(plant.cause, plant.location) for plant in plants]
    wrong = [p for p in places if p[0] != "unknown" and p not in truths]
    return Judged(
        plants,
        tuple(
            projected_snr(diagnosis.search.first, error_mm, diagnosis.search.last.noise)
            for error_mm in made.errors_mm()
        ),
        diagnosis,
        tuple(truth in places for truth in truths),
        tuple(truth in places or truth in rivals for truth in truths),
        len(wrong),
        tuple(
            found.candidate.depends_on
            for found in diagnosis.findings
            if found.candidate.cause == "unknown"
        ),
        tuple(_amplitude_errors(plants, diagnosis)),
        rms_um(made.holdout, made.arm, diagnosis.baseline.calibration),
        rms_um(made.holdout, made.arm, diagnosis.extended),
        made.case.oracle_rms_um(made.case.holdout),
        seconds,
    )


def at_most(count: int, of: int) -> str:
    """A count, and the share that it stays below with 95 % (Clopper and Pearson's upper bound)."""
    bound = beta.ppf(0.95, count + 1, of - count) if count < of else 1.0
    return f"{count} of {of} (< {bound:.2f})"


def projected_snr(
    first: Fit, error_mm: np.ndarray, noise: RestNoise, beside: Sequence[np.ndarray] = ()
) -> float:
    """Norm of an effect's error (readings, 3) in noise units, clear of what absorbs, and of what
    the errors *beside* it do.

    The *noise* is that of the last fit: in the first one's the effect itself may be counted.
    """
    signal, *others = (noise.whiten(at_rests(first, one)) for one in (error_mm, *beside))
    return clear_of(first, signal, noise, np.column_stack([np.empty((len(signal), 0)), *others]))


def clear_of(first: Fit, signal: np.ndarray, noise: RestNoise, others: np.ndarray) -> float:
    """Norm of a whitened *signal* (N,), clear of what absorbs in a fit and of *others* (N, m)."""
    columns = np.hstack([noise.whiten(first.nuisance.columns.to_dense()), others])
    variance = np.concatenate([first.nuisance.variance, np.full(others.shape[1], np.inf)])
    model = LinearModel.from_rows([("all that absorbs", columns, variance)])
    towards = model.project(columns.T @ signal)
    return float(np.sqrt(max(signal @ signal - towards @ towards, 0.0)))


def at_rests(first: Fit, error_mm: np.ndarray) -> np.ndarray:
    """The mean of an error at each rest, as long as a residual."""
    rest_of = first.linear.rests.rest_of
    counts = np.bincount(rest_of)[:, None]
    mean = np.stack([np.bincount(rest_of, column) for column in error_mm.T], axis=1) / counts
    flat = np.zeros(len(first.residual))
    flat[: mean.size] = mean.ravel()
    return flat


def _amplitude_errors(plants: tuple[Plant, ...], diagnosis: Diagnosis) -> list[float]:
    """Found minus planted size of what was found in its place, in standard uncertainties."""
    errors = []
    for i, found in enumerate(diagnosis.findings):
        for plant in plants:
            if found.candidate.place != (plant.cause, plant.location):
                continue
            if plant.cause not in AMPLITUDE or "distortion" in plant.detail:
                continue
            values = diagnosis.search.last.amplitudes[i]
            covariance = diagnosis.search.last.covariances[i]
            size = float(np.linalg.norm(values))
            direction = values / size
            sigma = float(np.sqrt(direction @ covariance @ direction))
            truth = abs(plant.size) * AMPLITUDE[plant.cause]
            errors.append((size - truth) / sigma)
    return errors
