"""The model under test as a calibration gives it, moved by a step, or with more terms."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.compensation.diagnose.constants import LEAST_POSITIVE, LEAST_SQUARE
from armd.compensation.diagnose.problem.linear import Baseline, ModelState
from armd.compensation.effects.effect import Candidate
from armd.compensation.identify.reflectors import FoundReflector
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import ArtefactCorrection, Calibration

#: Key in a calibration's provenance: how findings that it lacks would move the identified values.
LEFT_OPEN = "left_open"


def from_calibration(
    calibration: Calibration,
    arm: Arm,
    is_given: bool,
    reflectors: Sequence[FoundReflector] = (),
) -> Baseline:
    """Make the baseline of a calibration; a given one without covariance is taken as exact.

    *reflectors*: where they sit under this calibration.
    """
    names = arm.layout.names
    constants = [i for i, name in enumerate(names) if name in calibration.covariance_of]
    terms = [i for i in range(len(calibration.terms)) if f"term {i}" in calibration.covariance_of]
    order = [calibration.covariance_of.index(names[i]) for i in constants]
    order += [calibration.covariance_of.index(f"term {i}") for i in terms]
    covariance = np.array(calibration.covariance).reshape(len(order), len(order))
    covariance = covariance[np.ix_(order, order)]
    for moves in _left_open(calibration) if is_given else []:
        covariance = covariance + np.outer(moves[order], moves[order])
    vector = calibration.vector(arm.n_joints)
    return Baseline(
        ModelState(
            vector,
            tuple(calibration.terms),
            calibration.reference_temperature_c,
            calibration.artefact or ArtefactCorrection(),
            {
                reflector.name: reflector.offset_mm - vector[arm.layout.tip]
                for reflector in reflectors
            },
        ),
        calibration,
        is_given,
        tuple(constants),
        tuple(terms),
        compute_root(covariance),
    )


def keep_size(baseline: Baseline, arm: Arm) -> Baseline:
    """Condition a given baseline's covariance on the arm keeping its size (all lengths together).

    On surfaces of which nothing is certified, an arm that may shrink would have smaller residuals.
    """
    lengths = np.where(arm.layout.are_lengths, baseline.model.constants, 0.0)
    lengths[arm.layout.base] = 0.0
    grows = lengths[list(baseline.parameters)] @ baseline.root[: len(baseline.parameters)]
    squared_norm = float(grows @ grows)
    if not squared_norm > 0.0:
        return baseline
    return replace(
        baseline, root=baseline.root - np.outer(baseline.root @ grows, grows) / squared_norm
    )


def collect_identified(calibration: Calibration, names: Sequence[str]) -> F64:
    """Return constants and coefficients (n,) by the *names* that a covariance has for them."""
    terms = {f"term {i}": term.coefficient for i, term in enumerate(calibration.terms)}
    values = {**calibration.constants, **terms}
    return np.array([values[name] for name in names])


def _left_open(calibration: Calibration) -> list[F64]:
    """Return moves of identified values by findings left open, by one standard uncertainty."""
    directions = calibration.provenance.get("diagnosis", {}).get(LEFT_OPEN, [])
    return [
        np.array([direction["moves"].get(n, 0.0) for n in calibration.covariance_of])
        for direction in directions
    ]


def compute_root(covariance: F64) -> F64:
    """Return R (n, r) with R Rᵀ the covariance; negative eigenvalues of rounding are dropped."""
    if covariance.size == 0:
        return np.zeros((len(covariance), 0))
    size = np.sqrt(np.maximum(np.diag(covariance), LEAST_POSITIVE))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    positive = values > LEAST_SQUARE
    root: F64 = size[:, None] * vectors[:, positive] * np.sqrt(values[positive])
    return root


def apply_step(model: ModelState, baseline: Baseline, step: F64) -> ModelState:
    """Return the model with the identified constants and terms moved by *step* (identified,)."""
    constants = model.constants.copy()
    constants[list(baseline.parameters)] += step[: len(baseline.parameters)]
    terms = list(model.terms)
    for i, change in zip(baseline.terms, step[len(baseline.parameters) :], strict=True):
        coefficient = terms[i].coefficient + float(change)
        terms[i] = terms[i].model_copy(update={"coefficient": coefficient})
    return replace(model, constants=constants, terms=tuple(terms))


def add_findings(
    model: ModelState, findings: Sequence[Candidate], amplitudes: Sequence[F64]
) -> ModelState:
    """Return the model with the findings' terms appended."""
    terms = [
        term
        for candidate, values in zip(findings, amplitudes, strict=True)
        for column, value in zip(candidate.columns, values, strict=True)
        for term in column.make_terms(float(value))
    ]
    return replace(model, terms=(*model.terms, *terms))
