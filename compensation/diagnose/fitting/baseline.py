"""The model under test, and what of it is known only so well or free to absorb."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.compensation.diagnose.fitting.problem import Linear, ModelState
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import basis_values
from armd.compensation.model.calibration import ArtefactCorrection, Calibration
from armd.compensation.model.terms import Term

F64 = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Baseline:
    """A calibration as the diagnosis sees it.

    Held (given by the user): its constants and terms stay, known as well as its covariance says.
    Otherwise (made of the same sessions): whatever it identified absorbs freely.
    """

    model: ModelState
    calibration: Calibration
    held: bool
    parameters: tuple[int, ...]  # identified constants, by index
    terms: tuple[int, ...]  # identified terms, by index
    root: F64  # (identified, r): root of their covariance, parameters first; held only

    def columns(self, linear: Linear, arm: Arm) -> F64:
        """Columns (N, identified) of the identified constants and terms."""
        chosen = [self.model.terms[i] for i in self.terms]
        states = linear.rests.observations.states
        probes = [term.model_copy(update={"coefficient": 1.0}) for term in chosen]
        values = basis_values(probes, states, arm, self.model.reference_c, self.model.constants)
        constants = [linear.jacobian[i] for i in self.parameters]
        slopes = [
            linear.signature(arm.layout.index(term.parameter), value)
            for term, value in zip(chosen, values.T, strict=True)
        ]
        size = len(linear.residual)
        columns: F64 = np.array([*constants, *slopes]).reshape(-1, size).T
        return columns


def from_calibration(calibration: Calibration, arm: Arm, held: bool) -> Baseline:
    """The baseline of a calibration; one without covariance is taken as exact when held."""
    names = arm.layout.names
    constants = [i for i, name in enumerate(names) if name in calibration.covariance_of]
    terms = [i for i in range(len(calibration.terms)) if f"term {i}" in calibration.covariance_of]
    order = [calibration.covariance_of.index(names[i]) for i in constants]
    order += [calibration.covariance_of.index(f"term {i}") for i in terms]
    covariance = np.array(calibration.covariance).reshape(len(order), len(order))
    covariance = covariance[np.ix_(order, order)]
    return Baseline(
        ModelState(
            calibration.vector(arm.n_joints),
            tuple(calibration.terms),
            calibration.reference_temperature_c,
            calibration.artefact or ArtefactCorrection(),
        ),
        calibration,
        held,
        tuple(constants),
        tuple(terms),
        _root(covariance),
    )


def _root(covariance: F64) -> F64:
    """R (n, r) with R Rᵀ the covariance; tiny negative eigenvalues of rounding are dropped."""
    if covariance.size == 0:
        return np.zeros((len(covariance), 0))
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    kept = values > 1e-12
    root: F64 = size[:, None] * vectors[:, kept] * np.sqrt(values[kept])
    return root


def moved(model: ModelState, baseline: Baseline, step: F64) -> ModelState:
    """The model with the identified constants and terms moved by *step* (identified,)."""
    constants = model.constants.copy()
    constants[list(baseline.parameters)] += step[: len(baseline.parameters)]
    terms = list(model.terms)
    for i, change in zip(baseline.terms, step[len(baseline.parameters) :], strict=True):
        coefficient = terms[i].coefficient + float(change)
        terms[i] = terms[i].model_copy(update={"coefficient": coefficient})
    return ModelState(constants, tuple(terms), model.reference_c, model.artefact)


def scaled(terms: tuple[Term, ...], amplitude: float) -> list[Term]:
    """A column's tie of terms at an amplitude."""
    return [term.model_copy(update={"coefficient": term.coefficient * amplitude}) for term in terms]
