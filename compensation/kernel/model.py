"""An arm and its calibration, ready to correct: live in the daemon and offline in `correct`."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from armd.arrays import F64, I64
from armd.compensation.kernel import kernel
from armd.compensation.kernel.covariance import Uncertainty
from armd.compensation.kernel.memory import Amounts, fold
from armd.compensation.kernel.points import fill
from armd.compensation.kernel.program import compile_terms, order_by_parameter, pack_program
from armd.compensation.kernel.row_variances import compute_row_variances
from armd.compensation.kernel.slow_factors import SlowFactors
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.model.instants import Delay
from armd.compensation.model.kinematics import clear_partial_positions
from armd.compensation.model.slow_factors import Dated, Period, SlowFactor
from armd.compensation.model.state import States
from armd.compensation.model.terms import Term


class Model:
    """Corrects angles of one arm; without a calibration by the nominal geometry of arm.toml.

    "Uncorrected" everywhere means the position by the calibration's constants alone, without any of
    its terms. The correction is the effect of the terms.
    """

    def __init__(self, arm: Arm, calibration: LoadedCalibration | None) -> None:
        content = calibration.content if calibration else None
        n = arm.n_joints
        self.arm = arm
        self.constants = arm.nominal() if content is None else content.vector(n)
        self._reference_c = (
            arm.reference_temperature_c if content is None else content.reference_temperature_c
        )
        terms = [] if content is None else content.terms
        slow = [term for term in terms if term.slow]
        pose = order_by_parameter([term for term in terms if not term.slow], n)
        self._slow_parts = [_slow_part(term) for term in (*slow, *pose)]
        self._slow = SlowFactors([*slow, *pose], arm, self._reference_c)
        self._amounts = Amounts(
            slow_parameter=np.array(
                arm.layout.indices(term.parameter for term in slow), dtype=np.int64
            ),
            slow=np.array([term.coefficient for term in slow]),
            pose=np.array([term.coefficient for term in pose]),
        )
        #: (since, until) Unix seconds: the periods in which terms that follow time were identified
        self.periods_unix_s = sorted(
            {
                factor.ends_unix_s
                for term in terms
                for factor in term.basis
                if isinstance(factor, Period)
            }
        )
        #: Whether a term depends on the date, so that the model must be folded as time passes.
        self.dated = any(isinstance(factor, Dated) for t in terms for factor in t.basis)
        self.flat = pack_program(compile_terms(pose, arm), self.constants)
        self._uncertainty = Uncertainty(arm, content, slow, pose)
        now_s = math.nan if self.dated else 0.0  # positions are NaN until the date is known
        self.fold(np.full(len(arm.sensors), self._reference_c), now_s)
        self.forget()

    def fold(self, celsius: F64, unix_s: float) -> None:
        """Correct later samples for these temperatures (S,) °C at this time.

        Call it at the rate of the temperatures, in ascending time: lags are followed from call to
        call. A sensor that a term uses must have a value.
        """
        deviation_c = self._uncertainty.temperature_c
        values, changes = self._slow.values(celsius, unix_s, deviation_c)
        fold(values, self._amounts, self.flat)
        if np.isfinite(values).all():  # else positions are NaN and need no covariance
            self._uncertainty.fold(values, changes)

    def follow(self, celsius: F64, unix_s: float) -> None:
        """Update only the lags, for past temperatures without points to correct; see `fold`."""
        self._slow.values(celsius, unix_s)

    def forget(self) -> None:
        """Restart the lags, settled at the next temperatures."""
        self._slow.forget()

    def outside_period(self, unix_s: float) -> tuple[float, float] | None:
        """Return the first period that does not contain *unix_s*; its terms then keep their value.

        None if there is no such period.
        """
        for since, until in self.periods_unix_s:
            if not since <= unix_s <= until:
                return since, until
        return None

    @property
    def states_uncertainty(self) -> bool:
        """Whether the calibration states an uncertainty."""
        return not math.isnan(self._uncertainty.floor)

    @property
    def covariance(self) -> tuple[F64, I64, float]:
        """The factor, the numbers of its rows, and the floor, as `points.fill` takes them."""
        return self._uncertainty.factor, self._uncertainty.rows, self._uncertainty.floor

    def correct(self, q: F64, rate: F64, approach: F64, points: npt.NDArray[np.void]) -> None:
        """Fill position, orientation, covariance and correction of *points* (n,), dtype `POINT`.

        *q* (n, N) rad; *rate* (n, N) rad/s, its sign the side of approach; *approach* (n, 3) unit
        vectors, base frame; NaN where unknown, which leaves the terms concerned without effect.
        """
        fill(
            np.ascontiguousarray(q),
            np.ascontiguousarray(rate),
            np.ascontiguousarray(approach),
            self.flat,
            *self.covariance,
            points,
        )

    def correct_states(self, states: States, *, onwards: bool = False) -> tuple[F64, F64]:
        """Correct each row at its own temperatures and time.

        Return positions (n, 3) mm and corrections (n, 3) mm. A row without a temperature that moves
        the tip is NaN in all coordinates. Lags are followed within each series of *states*; with
        *onwards* from call to call, as in `fold`.
        """
        return self.correct_rows(states, self.slow_values(states, onwards=onwards))

    def slow_values(
        self, states: States, *, onwards: bool = False, delay: Delay | None = None
    ) -> F64:
        """Compute slow factors' values (n, L+T) of slow terms, then pose terms.

        Lags are followed as in `correct_states`, or by a *delay* of the caller's.
        """
        delay = self._slow.delay if onwards else delay
        return compute_basis_values(
            self._slow_parts, states, self.arm, self._reference_c, self.constants, delay
        )

    def correct_rows(self, states: States, slow_values: F64) -> tuple[F64, F64]:
        """Correct rows with known values of the slow factors; may run in any thread.

        See `correct_states`.
        """
        position, correction = np.empty((2, states.n, 3))
        self._correct_runs(states, slow_values, position, correction)
        return position, correction

    def position_rows(self, states: States, slow_values: F64) -> F64:
        """Return the positions of `correct_rows` alone, in two thirds of the time; any thread."""
        position = np.empty((states.n, 3))
        self._correct_runs(states, slow_values, position, np.empty((0, 3)))
        return position

    def _correct_runs(
        self, states: States, slow_values: F64, position: F64, correction: F64
    ) -> None:
        kernel.correct_runs(
            np.ascontiguousarray(slow_values),
            self._amounts,
            np.ascontiguousarray(states.q),
            np.ascontiguousarray(states.rate),
            np.ascontiguousarray(states.approach),
            self.flat.for_batches(),
            position,
            correction,
        )
        clear_partial_positions(position)
        clear_partial_positions(correction)

    def uncertainty_rows(self, states: States, slow_values: F64) -> F64:
        """Compute standard uncertainties (n, 3) mm of the rows' coordinates.

        NaN where nothing is known or the number overflows. May run in any thread, as
        `correct_rows`.
        """
        variance = self.covariance_rows(states, slow_values)[:, [0, 3, 5]]
        variance[np.isinf(variance)] = np.nan
        deviation: F64 = np.sqrt(np.maximum(variance, 0.0))
        return deviation

    def covariance_rows(self, states: States, slow_values: F64) -> F64:
        """Compute covariances (n, 6) mm² of the rows' coordinates: xx xy xz yy yz zz.

        NaN where nothing is known; may run in any thread.
        """
        covariance = np.full((states.n, 6), np.nan)
        if self.states_uncertainty:
            compute_row_variances(
                np.ascontiguousarray(slow_values),
                # writeable, as in the ready library: another type would be compiled for 10 s
                np.require(states.temperature_c, requirements=["C", "W"]),
                states.time_s if self.dated else np.zeros(states.n),
                self._uncertainty.temperature_c,
                self._slow.copy_program(),
                self._amounts,
                np.ascontiguousarray(states.q),
                np.ascontiguousarray(states.rate),
                np.ascontiguousarray(states.approach),
                self.flat.for_batches(),
                self._uncertainty.parts,
                self._uncertainty.rows,
                self._uncertainty.floor,
                covariance,
            )
        return covariance


def _slow_part(term: Term) -> Term:
    """Return the term without its pose factors."""
    factors = [factor for factor in term.basis if isinstance(factor, SlowFactor)]
    return term.model_copy(update={"basis": factors})
