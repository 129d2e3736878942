"""A covariance with every point: what the identification, encoders and sensors leave uncertain.

All of it is folded, when a temperature arrives, into one low-rank factor L over the parameters
(and the pose terms' coefficients); a sample pays for its Jacobian J and for the product J·L, in
`points`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from armd.compensation import parameters
from armd.compensation.arm import Arm
from armd.compensation.calibration import Calibration
from armd.compensation.terms import Term

F64 = npt.NDArray[np.float64]

#: Share of the variance that may be left out of the low-rank factor.
NEGLECTED = 1e-6


class Uncertainty:
    """What one model knows of its uncertainty; nothing, if its calibration states none."""

    def __init__(
        self, arm: Arm, calibration: Calibration | None, slow: Sequence[Term], pose: Sequence[Term]
    ) -> None:
        n = arm.n_joints
        names = parameters.names(n)
        self._count = len(names)
        self._pose_parameter = np.array([names.index(term.parameter) for term in pose], np.int64)
        self._slow_parameter = np.array([names.index(term.parameter) for term in slow], np.int64)
        self._slow_coefficient = np.array([term.coefficient for term in slow])
        self._pose_coefficient = np.array([term.coefficient for term in pose])
        #: mm at the tip per unit of each row, roughly: what the low-rank factor is judged by
        lengths = np.hypot(arm.nominal()[1 : 5 * n : 5], arm.nominal()[2 : 5 * n : 5])
        reach_mm = float(lengths.sum() + np.linalg.norm(arm.tip.offset_mm)) or 1.0
        scale = np.array([1.0 if parameters.unit(name) == "mm" else reach_mm for name in names])
        self._scale = np.concatenate([scale, scale[self._pose_parameter]])[:, None]
        #: (P+T, r) L L' is the covariance of parameters and pose terms' coefficients
        self.factor = np.zeros((len(self._scale), 0))
        #: mm², along each axis, of what has no Jacobian; NaN if nothing is known
        self.floor = np.nan
        self.temperature_c = 0.0  # standard deviation of a sensor
        self.known = False
        if calibration is not None:
            self._take(calibration, slow, pose, names)

    def _take(
        self,
        calibration: Calibration,
        slow: Sequence[Term],
        pose: Sequence[Term],
        names: list[str],
    ) -> None:
        noise = calibration.noise
        self.temperature_c = noise.temperature_c
        self.known = bool(
            calibration.covariance_of
            or any(noise.encoder_rad)
            or noise.reading_mm
            or noise.temperature_c
        )
        if self.known:  # the encoders' part of a reading's noise is counted with their Jacobian
            self.floor = 0.0 if noise.encoder_rad else noise.reading_mm**2
        values, vectors = np.linalg.eigh(
            np.array(calibration.covariance, dtype=float).reshape(
                (len(calibration.covariance_of),) * 2
            )
        )
        #: (K, K) square root of the identified covariance
        self._root = vectors * np.sqrt(np.maximum(values, 0.0))
        # Where identified quantity i acts: its row, and the slow factor that scales it (or none).
        self._rows = np.zeros(len(values), np.int64)
        self._scaled_by = np.full(len(values), -1, np.int64)
        order = [*slow, *pose]
        for i, name in enumerate(calibration.covariance_of):
            if name in names:
                self._rows[i] = names.index(name)
                continue
            term = calibration.terms[int(name.removeprefix("term "))]
            at = next(j for j, other in enumerate(order) if other is term)
            self._scaled_by[i] = at
            pose_at = at - len(slow)
            self._rows[i] = self._slow_parameter[at] if pose_at < 0 else self._count + pose_at
        encoder = np.zeros((len(self._scale), len(noise.encoder_rad)))
        for k, deviation in enumerate(noise.encoder_rad):
            encoder[5 * k, k] = deviation
        self._encoder = encoder

    def fold(self, values: F64, changes: F64) -> None:
        """Take over the slow factors' values (L+T,).

        *changes* (S, L+T): what one standard deviation of each sensor adds to them.
        """
        identified = np.zeros((len(self._scale), len(self._root)))
        weight = np.where(self._scaled_by < 0, 1.0, values[self._scaled_by] if len(values) else 1.0)
        np.add.at(identified, self._rows, weight[:, None] * self._root)
        split = len(self._slow_coefficient)
        sensors = np.zeros((len(self._scale), len(changes)))
        np.add.at(
            sensors, self._slow_parameter, self._slow_coefficient[:, None] * changes[:, :split].T
        )
        sensors[self._count :] = self._pose_coefficient[:, None] * changes[:, split:].T
        whole = np.hstack([identified, self._encoder, sensors]) * self._scale
        variances, directions = np.linalg.eigh(whole @ whole.T)
        left_out = np.cumsum(np.maximum(variances, 0.0)) <= NEGLECTED * variances.sum()
        kept = directions[:, ~left_out] * np.sqrt(variances[~left_out])
        self.factor = np.ascontiguousarray(kept / self._scale)
