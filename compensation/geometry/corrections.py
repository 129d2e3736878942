"""A geometry as Denavit–Hartenberg parameters with the nominal ones, in both conventions.

Standard is arm.toml's A = Rz(θ)·Tz(d)·Tx(a)·Rx(α)·Ry(β). Modified is Rx(α)·Tx(a)·Ry(β)·Rz(θ)·Tz(d)
(Craig 1986): row k has α, a and β of the joint before, θ and d of its own joint. Tx(a) and Rx(α)
commute, and Rz(θ) and Tz(d) do, so both conventions give one product. A row N + 1 has what follows
the last joint.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64
from armd.compensation.geometry.geometry import Geometry
from armd.compensation.geometry.postures import make_states
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.parameters import BASE_PARAMETERS, TIP_PARAMETERS, find_unit

STANDARD = ("theta", "d", "a", "alpha", "beta")
MODIFIED = ("alpha", "a", "beta", "theta", "d")
OF_JOINT_BEFORE = ("alpha", "a", "beta")
#: mm² and rad²: the rounding error in the covariance of a fixed parameter.
ROUNDING = 1e-24


@dataclass(frozen=True)
class Correction:
    """One parameter: nominal, calibrated, and its uncertainty; degrees or mm."""

    convention: str  # "standard", "modified"; "both" of the tip and the base
    joint: int | str
    parameter: str
    nominal: float
    value: float
    difference: float
    standard_uncertainty: float | None


def list_corrections(
    arm: Arm, calibration: Calibration | None, geometry: Geometry
) -> list[Correction]:
    """List all rows: standard, modified, then the tip's and the base's."""
    table = _CorrectionRows(
        arm, geometry.parameters, _deviations(arm, calibration, geometry.celsius)
    )
    joints = range(1, arm.n_joints + 1)
    rows = [table.row("standard", k, name, f"{name}_{k}") for k in joints for name in STANDARD]
    rows += list(table.modified(arm.n_joints))
    rows += [table.row("both", "tip", name.removeprefix("tip_"), name) for name in TIP_PARAMETERS]
    rows += [
        table.row("both", "base", name.removeprefix("base_"), name) for name in BASE_PARAMETERS
    ]
    return rows


@dataclass(frozen=True)
class _CorrectionRows:
    arm: Arm
    values: F64
    deviations: dict[str, float]

    def modified(self, n_joints: int) -> Iterator[Correction]:
        for k in range(1, n_joints + 2):
            for name in MODIFIED:
                source_joint = k - 1 if name in OF_JOINT_BEFORE else k
                source = f"{name}_{source_joint}" if 1 <= source_joint <= n_joints else None
                yield self.row("modified", k, name, source)

    def row(self, convention: str, joint: int | str, name: str, source: str | None) -> Correction:
        """Return one row; *source* is the parameter's name in the model, or None if it is 0 by
        convention.
        """
        named = f"{name}_{'deg' if find_unit(source or f'{name}_1') == 'rad' else 'mm'}"
        if source is None:
            return Correction(convention, joint, named, 0.0, 0.0, 0.0, None)
        scale = math.degrees(1.0) if find_unit(source) == "rad" else 1.0
        index = self.arm.layout.index(source)
        nominal = _as_drawn(self.arm, source, scale * float(self.arm.nominal()[index]))
        moved = scale * float(self.values[index] - self.arm.nominal()[index])
        deviation = self.deviations.get(source)
        return Correction(
            convention, joint, named, nominal, nominal + moved, moved,
            None if deviation is None else scale * deviation,
        )  # fmt: skip


def _as_drawn(arm: Arm, source: str, value: float) -> float:
    """Return degrees as arm.toml writes them, because conversion through radians rounds."""
    name, _, number = source.partition("_")
    if name in ("theta", "alpha", "beta"):
        return float(getattr(arm.joint[int(number) - 1], f"{name}_deg"))
    return value


def _deviations(arm: Arm, calibration: Calibration | None, celsius: float) -> dict[str, float]:
    """Return standard uncertainties by parameter, mm and rad, at *celsius*.

    They are of the constant and its terms of temperature, and only of parameters in the
    calibration's covariance.
    """
    if calibration is None or not calibration.covariance_of:
        return {}
    covariance = np.array(calibration.covariance)
    weights: dict[str, F64] = {}
    state = make_states(np.zeros((1, arm.n_joints)), arm, celsius, calibration, 0)
    reference_c = calibration.reference_temperature_c
    values = compute_basis_values(
        calibration.terms, state, arm, reference_c, calibration.vector(arm.n_joints)
    )[0]
    for i, name in enumerate(calibration.covariance_of):
        weight = 1.0
        if name.startswith("term "):
            number = int(name.removeprefix("term "))
            term = calibration.terms[number]
            if not term.slow:
                continue
            name, weight = term.parameter, float(values[number])
        weights.setdefault(name, np.zeros(len(covariance)))[i] += weight
    variances = {name: float(row @ covariance @ row) for name, row in weights.items()}
    return {name: math.sqrt(v) if v > ROUNDING else 0.0 for name, v in variances.items()}
