"""The size of a finding and its uncertainty."""

from __future__ import annotations

import numpy as np

from armd.compensation.diagnose.constants import (
    LEAST_POSITIVE,
    SIZE_SIGMAS,
    SLOPE_STEP,
    UNDETERMINED_TIMES,
)
from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.diagnose.fitting.curves import list_orders
from armd.compensation.diagnose.problem.amplitudes import is_curve
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.signatures import make_finding_columns
from armd.compensation.model.arm import Arm


def is_size_known(diagnosis: Diagnosis, index: int) -> bool:
    """Whether a finding's amplitudes are larger than their uncertainty.

    A finding is significant as a whole. Where several of its amplitudes have the same effect, none
    of them needs to be known.
    """
    last = diagnosis.search.last
    prior_sd = np.array([column.prior_sd for column in last.findings[index].columns])
    size = last.amplitudes[index] / prior_sd
    covariance = last.covariances[index] / np.outer(prior_sd, prior_sd)
    squared_norm = float(size @ size)
    return squared_norm**2 > SIZE_SIGMAS**2 * float(size @ covariance @ size)


def list_parameters(diagnosis: Diagnosis, index: int) -> list[dict[str, str | float]]:
    """List amplitudes with standard uncertainties, then scanned values (order, instant, …)."""
    last = diagnosis.search.last
    candidate = last.findings[index]
    rows: list[dict[str, str | float]] = []
    if is_curve(candidate):
        rms, sigma, order = measure_curve(diagnosis, index)
        rows += [make_row("rms", rms, "rad", sigma), make_row("order", float(order), "1/turn", 0.0)]
    else:
        spread = np.sqrt(np.maximum(np.diag(last.covariances[index]), 0.0))
        rows += [
            make_row(column.name, float(value), column.unit, float(s))
            for column, value, s in zip(
                candidate.columns, last.amplitudes[index], spread, strict=True
            )
        ]
    sigma = compute_scanned_uncertainty(last, index, diagnosis.arm)
    rows += [make_row(name, value, unit, sigma) for name, value, unit in candidate.setting]
    return rows


def measure_curve(diagnosis: Diagnosis, index: int) -> tuple[float, float, int]:
    """Return a curve's RMS in rad about its mean, its standard uncertainty, and its strongest
    order.

    All are taken over the angles at which the joint stood: elsewhere nothing is known, and over
    less than a turn the amplitudes of single orders mean little.
    """
    last = diagnosis.search.last
    candidate = last.findings[index]
    joint = candidate.location.joint
    assert joint is not None  # a curve is a function of one joint's angle
    q = last.linear.rests.observations.states.q[:, joint - 1]
    angles = np.unique(np.round(np.degrees(q))) * np.pi / 180.0
    orders = list_orders(candidate)
    waves = np.array([wave(order * angles) for order in orders for wave in (np.sin, np.cos)])
    level = waves - waves.mean(axis=1, keepdims=True)
    curve = last.amplitudes[index] @ level
    rms = max(float(np.sqrt((curve**2).mean())), LEAST_POSITIVE)
    slope = level @ curve / (len(angles) * rms)
    sigma = float(np.sqrt(max(slope @ last.covariances[index] @ slope, 0.0)))
    squared_errors = []
    for pair in waves.reshape(len(orders), 2, -1):
        columns = np.vstack([pair, np.ones(len(angles))]).T
        fitted = columns @ np.linalg.lstsq(columns, curve, rcond=None)[0]
        squared_errors.append(float(((curve - fitted) ** 2).sum()))
    return rms, sigma, orders[int(np.argmin(squared_errors))]


def make_row(name: str, value: float, unit: str, sigma: float) -> dict[str, str | float]:
    return {"name": name, "value": value, "unit": unit, "standard_uncertainty": sigma}


def compute_tip_rms_um(diagnosis: Diagnosis, index: int) -> float:
    """Return how far an effect moves the tip in these readings, 3-D RMS in µm.

    What placements, constants and the other findings absorb is not counted.
    """
    last = diagnosis.search.last
    moves = last.net_signature(index)[last.noise.points]
    return 1e3 * float(np.sqrt((moves**2).sum() / max(len(moves), 1)))


def compute_scanned_uncertainty(last: Fit, index: int, arm: Arm) -> float:
    """Return the standard uncertainty of a value that was scanned, not fitted.

    Amplitudes and all else are fitted along with it. It is 0 where no uncertainty can be stated,
    and `UNDETERMINED_TIMES` times the value where the readings do not determine it.
    """
    candidate = last.findings[index]
    if candidate.elsewhere is None or not candidate.setting:
        return 0.0
    value = candidate.setting[0][1]
    shifted = [candidate.elsewhere(value * (1.0 + sign * SLOPE_STEP)) for sign in (1.0, -1.0)]
    raised, lowered = (
        block @ last.amplitudes[index] for block in make_finding_columns(last.linear, shifted, arm)
    )
    slope = (raised - lowered) / (2.0 * SLOPE_STEP * value)
    white, absorbed = last.noise.whiten(slope), last.problem.project(last.across(slope))
    cleared = float(white @ white - absorbed @ absorbed)
    return float(min(max(cleared, LEAST_POSITIVE) ** -0.5, UNDETERMINED_TIMES * value))
