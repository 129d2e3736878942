"""`Model`: position and orientation of a calibrated arm's tip, and their uncertainty."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from armd.arrays import F64
from armd.compensation.inverse.compensate import compensate
from armd.compensation.kernel.model import Model as Kernel
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.kinematics import compute_frames, compute_jacobian
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term
from armd.offline.arm_model import ArmModel, PathText, resolve_arm
from armd.offline.calibration import Calibration, resolve_calibration
from armd.offline.results.display import Displayed, Facts

#: An instant in the year 2200, after the identification of every term that depends on time: such
#: terms keep their last value.
AFTER_ALL_UNIX_S = 7_258_118_400.0
#: Rows processed at once.
CHUNK = 1 << 15
#: Step of an angle in rad for derivatives of a term's basis.
STEP_RAD = 1e-5


def skip_lag(_name: str, value: F64, _time_s: F64, _lag_s: float) -> F64:
    """Return temperatures without lag: in each row the arm has settled."""
    return value


class Model(Displayed):
    """An arm and its calibration as functions of joint angles and temperatures.

    *arm* is an `ArmModel` or the path of an arm.toml, *calibration* a `Calibration`, the path of
    one, or None for the nominal geometry. Raises `armd.BadInput` where they do not fit together.

    All methods take angles *q* (n, N) in rad, signed as in a session, and *temperatures* (n,
    sensors) or (sensors,) in °C, in the order of `ArmModel.sensors`; None means the reference
    temperature. Each row is a settled state: lags have passed, and terms that depend on time keep
    their last value. Joint rates and the direction of approach are unknown: terms that depend on
    them have no effect. NaN gives NaN in its row. Raises `ValueError` for arrays of other shapes.

    >>> model = armd.Model("measured/arm.toml", "calibration.json")
    >>> model.position(np.zeros((5, 6))).shape
    (5, 3)
    """

    def __init__(
        self, arm: ArmModel | PathText, calibration: Calibration | PathText | None = None
    ) -> None:
        self._arm = resolve_arm(arm)
        loaded = resolve_calibration(calibration, self._arm)
        content = loaded.content if loaded else None
        self._loaded = loaded
        self._kernel = Kernel(self._arm.content, loaded)
        self._terms: list[Term] = content.terms if content else []
        self._reference_c = (content or self._arm.content).reference_temperature_c
        self._source = str(loaded.path) if loaded else "none: nominal geometry"

    def position(self, q: npt.ArrayLike, temperatures: npt.ArrayLike | None = None) -> F64:
        """Return the tip's centre (n, 3) in mm, base frame, as `armd correct` writes it.

        NaN in a row that lacks an angle or overflows.
        """
        states = self._states(q, temperatures)
        position = self._kernel.correct_rows(states, self._slow(states))[0]
        position[~np.isfinite(position).all(axis=1)] = np.nan
        return position

    def orientation(self, q: npt.ArrayLike, temperatures: npt.ArrayLike | None = None) -> F64:
        """Return the last frame's orientation (n, 4): unit quaternions x y z w, w ≥ 0."""
        states = self._states(q, temperatures)
        quaternion = np.full((states.n, 4), np.nan)
        for rows in _chunks(states.n):
            part = states.rows(rows)
            parameters = self._parameters(part)
            turned = compute_frames(part.q, parameters)[1][:, -1]
            has_values = np.isfinite(part.q).all(axis=1) & np.isfinite(parameters).all(axis=1)
            if has_values.any():
                quaternion[rows][has_values] = Rotation.from_matrix(turned[has_values]).as_quat(
                    canonical=True
                )
        return quaternion

    def jacobian(self, q: npt.ArrayLike, temperatures: npt.ArrayLike | None = None) -> F64:
        """Return the derivatives (n, 3, N) of the position by the joint angles, in mm/rad.

        Geometry is differentiated analytically. The part of terms that depend on the pose comes
        from central differences of their basis functions.
        """
        states = self._states(q, temperatures)
        derivatives = np.empty((states.n, 3, states.q.shape[1]))
        for rows in _chunks(states.n):
            derivatives[rows] = self._joint_jacobian(states.rows(rows))
        return derivatives

    def covariance(self, q: npt.ArrayLike, temperatures: npt.ArrayLike | None = None) -> F64:
        """Return the covariance (n, 3, 3) of the position in mm², base frame.

        It comes from the covariance of the identified quantities, the encoders' noise, the
        sensors' noise and the repeatability of a reading (GUM, law of propagation). NaN where the
        calibration states none of them, and in a row that overflows.
        """
        states = self._states(q, temperatures)
        six = self._kernel.covariance_rows(states, self._slow(states))
        six[~np.isfinite(six).all(axis=1)] = np.nan
        xx, xy, xz, yy, yz, zz = six.T
        return np.stack([xx, xy, xz, xy, yy, yz, xz, yz, zz], axis=1).reshape(-1, 3, 3)

    def compensate(
        self,
        q: npt.ArrayLike,
        wanted_mm: npt.ArrayLike | None = None,
        temperatures: npt.ArrayLike | None = None,
    ) -> F64:
        """Return the joint angles (n, N) in rad to command so that the tip is at the wanted
        position.

        *q* (n, N) is a nominal solution, *wanted_mm* (n, 3) the wanted tip in the base frame. None
        or a row of NaN: the tip of arm.toml's arm at *q*. With six joints or more, the orientation
        of arm.toml's arm there is kept; with fewer, the angles change least. NaN in a row that
        cannot be reached, is near a singularity or beyond a limit: `armd compensate` reports which.
        """
        states = self._states(q, temperatures)
        targets_mm = None
        if wanted_mm is not None:
            targets_mm = _numbers("wanted_mm", wanted_mm)
            if targets_mm.shape != (states.n, 3):
                raise ValueError(
                    f"wanted_mm has shape {targets_mm.shape}, expected ({states.n}, 3)"
                )
        settled = replace(states, series=np.arange(states.n))  # no row depends on an earlier one
        return compensate(self._arm.content, self._loaded, settled, targets_mm).q

    def _states(self, q: npt.ArrayLike, temperatures: npt.ArrayLike | None) -> States:
        """Check shapes; return one settled state a row."""
        arm = self._arm.content
        angles = np.ascontiguousarray(_numbers("q", q))
        if angles.ndim != 2 or angles.shape[1] != arm.n_joints:
            raise ValueError(f"q has shape {angles.shape}, expected (n, {arm.n_joints})")
        n, sensors = len(angles), len(arm.sensors)
        if temperatures is None:
            celsius = np.full((n, sensors), self._reference_c)
        else:
            array = _numbers("temperatures", temperatures)
            if array.shape not in ((sensors,), (1, sensors), (n, sensors)):
                raise ValueError(
                    f"temperatures have shape {array.shape}, expected ({n}, {sensors}): a column"
                    f" for each sensor ({', '.join(arm.sensors) or 'the arm has none'})"
                )
            celsius = np.ascontiguousarray(np.broadcast_to(array, (n, sensors)))
        return States(
            q=angles,
            rate=np.full(angles.shape, np.nan),
            temperature_c=celsius,
            time_s=np.full(n, AFTER_ALL_UNIX_S),
            approach=np.full((n, 3), np.nan),
            series=np.zeros(n, np.int64),
        )

    def _slow(self, states: States) -> F64:
        return self._kernel.slow_values(states, delay=skip_lag)

    def _parameters(self, states: States) -> F64:
        """Return all parameters (n, P) of each row, its terms included."""
        constants = self._kernel.constants
        values = compute_basis_values(
            self._terms, states, self._arm.content, self._reference_c, constants, skip_lag
        )
        return compute_parameter_rows(constants, self._terms, values)

    def _joint_jacobian(self, states: States) -> F64:
        layout = self._arm.content.layout
        parameters = self._parameters(states)
        by_parameter = compute_jacobian(states.q, parameters)[1]
        derivatives: F64 = np.ascontiguousarray(by_parameter[:, :, layout.angles])
        derivatives[~np.isfinite(parameters).all(axis=1)] = np.nan
        if all(term.slow for term in self._terms):
            return derivatives
        for k in range(states.q.shape[1]):
            step = np.zeros(states.q.shape[1])
            step[k] = STEP_RAD
            ahead, behind = (self._parameters(_turned(states, sign * step)) for sign in (1.0, -1.0))
            change = (ahead - behind) / (2 * STEP_RAD)
            derivatives[:, :, k] += np.einsum("nip,np->ni", by_parameter, change)
        return derivatives

    def _describe(self) -> tuple[str, Facts]:
        facts = [
            ("calibration", self._source),
            ("joints", str(self._arm.n_joints)),
            ("temperature sensors", ", ".join(self._arm.sensors) or "none"),
            ("terms", str(len(self._terms))),
        ]
        return f"Model of arm {self._arm.serial_number}", facts


def _numbers(name: str, values: npt.ArrayLike) -> F64:
    """Return *values* as doubles; an integer too large for one is a `ValueError` too."""
    try:
        return np.asarray(values, dtype=np.float64)
    except OverflowError as error:
        raise ValueError(f"{name}: {error}") from error


def _chunks(n: int) -> list[slice]:
    return [slice(first, min(first + CHUNK, n)) for first in range(0, n, CHUNK)]


def _turned(states: States, step: F64) -> States:
    return States(
        states.q + step, states.rate, states.temperature_c, states.time_s, states.approach,
        states.series,
    )  # fmt: skip
