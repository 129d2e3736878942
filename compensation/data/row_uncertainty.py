"""Standard uncertainties of readings corrected offline, each at its own temperatures.

The live path folds the same sum into one factor per temperature (`uncertainty`); a table may
change its temperatures from row to row, so here it is taken row by row: u² = diag(J Σ J') with Σ
of the identified parameters and coefficients, the encoders and the sensors (GUM, law of
propagation).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import basis_values, parameter_rows
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import jacobian
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term

ROWS_AT_ONCE = 4096


def row_uncertainties(arm: Arm, calibration: Calibration, states: States) -> F64:
    """Standard uncertainty (n, 3) in mm of the tip's coordinates at *states*; NaN if none is known.

    Lags are followed within *states* only, from their first row: a weight of an uncertainty needs
    no more.
    """
    noise = calibration.noise
    known = noise.reading_mm or noise.temperature_c or any(noise.encoder_rad)
    if not (known or calibration.covariance_of):
        return np.full((states.n, 3), np.nan)
    pieces = [
        _piece(arm, calibration, _rows(states, slice(start, start + ROWS_AT_ONCE)))
        for start in range(0, states.n, ROWS_AT_ONCE)
    ]
    return np.vstack(pieces)


def _piece(arm: Arm, calibration: Calibration, states: States) -> F64:
    layout = arm.layout
    terms, noise = calibration.terms, calibration.noise
    constants = calibration.vector(arm.n_joints)
    reference_c = calibration.reference_temperature_c
    values = basis_values(terms, states, arm, reference_c, constants)
    _, moved = jacobian(states.q, parameter_rows(constants, terms, values))
    # A coefficient moves the tip as its parameter does, times the term's basis.
    of_term = layout.indices(term.parameter for term in terms)
    by_term = moved[:, :, of_term] * values[:, None, :]

    columns = [
        moved[:, :, layout.index(name)]
        if name in layout
        else by_term[:, :, int(name.removeprefix("term "))]
        for name in calibration.covariance_of
    ]
    variance = np.zeros((states.n, 3))
    if columns:
        each = np.stack(columns, axis=-1).reshape(-1, len(columns))  # one product, not one a row
        variance += (each @ np.array(calibration.covariance) * each).sum(axis=1).reshape(-1, 3)
    angles = moved[:, :, layout.angles][:, :, : len(noise.encoder_rad)]
    variance += ((angles * noise.encoder_rad) ** 2).sum(axis=2)
    variance += noise.reading_mm**2  # what the encoders do not explain
    if noise.temperature_c:
        thermal = [i for i, term in enumerate(terms) if _thermal(term)]
        for one_sensor in noise.temperature_c * np.eye(len(arm.sensors)):
            warmer = replace(states, temperature_c=states.temperature_c + one_sensor)
            change = basis_values([terms[i] for i in thermal], warmer, arm, reference_c, constants)
            change = (change - values[:, thermal]) * [terms[i].coefficient for i in thermal]
            along = moved[:, :, [of_term[i] for i in thermal]]
            variance += np.einsum("nat,nt->na", along, change) ** 2
    deviations: F64 = np.sqrt(np.maximum(variance, 0.0))
    return deviations


def _thermal(term: Term) -> bool:
    return any(isinstance(factor, Temperature) for factor in term.basis)


def _rows(states: States, rows: slice) -> States:
    return States(
        states.q[rows],
        states.rate[rows],
        states.temperature_c[rows],
        states.time_s[rows],
        states.approach[rows],
        states.series[rows],
    )
