"""Quantities of readings under a calibration: the tip, how causes move it, and its uncertainty."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import F64
from armd.compensation.effects.effect import Column
from armd.compensation.interim.checks.open_growth import OpenGrowth, compute_rises_k
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import (
    compute_basis_values,
    compute_parameter_rows,
    compute_tip_motion,
)
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import compute_jacobian
from armd.compensation.model.state import States

#: The noise of a reading, if the calibration states none; its scale is estimated from the checks.
USUAL_MM = 5e-3
LEAST_MM = 1e-6


class Signals:
    """Tip positions, derivatives and noise of the readings in *states*, each reading by itself."""

    def __init__(self, states: States, arm: Arm, calibration: Calibration) -> None:
        self.states, self.arm, self.calibration = states, arm, calibration
        self._constants = calibration.vector(arm.n_joints)
        values = compute_basis_values(
            calibration.terms, states, arm, calibration.reference_temperature_c, self._constants
        )
        #: (n,) whether the model has all that it needs
        self.complete = np.isfinite(values).all(axis=1)
        self._values = np.nan_to_num(values)
        parameters = compute_parameter_rows(self._constants, calibration.terms, self._values)
        #: (n, 3) mm, and (n, 3, P) per parameter
        self.position_mm, self._moved = compute_jacobian(states.q, parameters)

    def compute_motions(self, columns: Sequence[Column]) -> F64:
        """Return how far each of *columns* moves the tip (n, 3, p), mm per unit."""
        motions = np.zeros((self.states.n, 3, len(columns)))
        about = self.states, self.arm, self.calibration.reference_temperature_c, self._constants
        for j, column in enumerate(columns):
            motions[:, :, j] = compute_tip_motion(column.terms, *about, self._moved)
        return motions

    def compute_calibration_motions(self) -> F64:
        """Return how far the calibration's independent standard errors move the tip (n, 3,
        B), mm.
        """
        names, columns = self.arm.layout.names, []
        for name in self.calibration.covariance_of:
            if name in names:
                columns.append(self._moved[:, :, names.index(name)])
                continue
            i = int(name.removeprefix("term "))
            place = names.index(self.calibration.terms[i].parameter)
            columns.append(self._moved[:, :, place] * self._values[:, None, i])
        if not columns:
            return np.zeros((self.states.n, 3, 0))
        covariance = np.array(self.calibration.covariance).reshape((len(columns),) * 2)
        return np.stack(columns, axis=2) @ _compute_root(covariance)

    def compute_growth_motions(self, growth: Sequence[OpenGrowth]) -> F64:
        """Return how far each growth moves the tip (n, 3, m), mm per prior standard deviation."""
        places = self.arm.layout.indices(expansion.term.parameter for expansion in growth)
        rise = compute_rises_k(growth, self.states, self.arm, self.calibration)
        size = np.array([expansion.size for expansion in growth])
        moved: F64 = self._moved[:, :, places] * (rise * size)[:, None, :]
        return moved

    def compute_whitener(self) -> F64:
        """Return the whitening matrices (n, 3, 3) per mm, from the noise that the calibration
        states.
        """
        noise, n_joints = self.calibration.noise, self.arm.n_joints
        encoder = np.array([*noise.encoder_rad, *[0.0] * n_joints])[:n_joints]
        joints = self._moved[:, :, self.arm.layout.angles] * encoder
        has_noise = any(noise.encoder_rad) or noise.reading_mm
        reading = max(noise.reading_mm if has_noise else USUAL_MM, LEAST_MM)
        covariance = joints @ joints.transpose(0, 2, 1) + reading**2 * np.eye(3)
        whitener: F64 = np.linalg.inv(np.linalg.cholesky(covariance))
        return whitener


def _compute_root(covariance: F64) -> F64:
    """Return a matrix R (B, B) with R Rᵀ = *covariance*."""
    scale = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    value, vector = np.linalg.eigh(covariance / np.outer(scale, scale))
    root: F64 = scale[:, None] * vector * np.sqrt(np.maximum(value, 0.0))
    return root
