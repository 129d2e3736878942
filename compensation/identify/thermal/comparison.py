"""Compare thermal models (eqs. 12–15): which terms to try, and which the readings confirm.

Each length that matters may depend on the temperature of its joint: d, a and the tip's offset as
polynomials of ΔT, all coefficients fitted at once to all sessions. The held-out error decides the
order, and whether angles depend on temperature, too. Whole temperatures are held out in turn, and
parts of the lowest and the highest. Before that, the first link's expansion joins every model if a
ramp within a placement shows it. The paper's method (identify at each temperature, then regress),
temperature zones and principal components of the sensors are tried on the same data, for comparison
or by choice.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.estimate.linear.solution import Solution
from armd.compensation.identify.fit import Identification
from armd.compensation.identify.heldout import Errors, HeldOut
from armd.compensation.identify.thermal.per_temperature import fit_regression, make_regression
from armd.compensation.identify.thermal.temperatures import validate_by_temperature
from armd.compensation.identify.thermal.terms import (
    GROWTH_KNOWN,
    make_angle_terms,
    make_component_terms,
    make_growth_terms,
    make_length_terms,
    make_zone_terms,
)
from armd.compensation.model import parameters
from armd.compensation.model.basis import compute_basis_values
from armd.compensation.model.terms import Term
from armd.errors import ArmdError
from armd.terminal.counted import format_count

MOST_ORDER = 4
#: A larger model must lower the held-out error to this share to be accepted.
WORTH = 0.99


@dataclass(frozen=True)
class Trial:
    """One thermal model, tested on held-out readings."""

    name: str
    terms: list[Term]
    errors: Errors

    @property
    def heldout_rms_um(self) -> float:
        """The RMS over all held-out readings.

        Models are compared without the down-weighted readings.
        """
        return self.errors.rms_um


class Comparison:
    """Compares thermal models by held-out errors, around one fit."""

    def __init__(self, fit: Identification, groups: list[tuple[float, Mask]]) -> None:
        observations, arm = fit.observations, fit.observations.arm
        self.fit = fit
        self.groups = groups
        self.most_order = min(MOST_ORDER, len(groups) - 1)
        orders = range(1, self.most_order + 1)
        inner = len(groups) // 2
        edges = [groups[0][0] - 5.0, groups[inner][0], groups[-1][0] + 5.0]
        self._without_growth = {
            f"all at once, order {m}": make_length_terms(arm, orders[:m]) for m in orders
        }
        if len(groups) > 2:
            self._without_growth["two zones"] = make_zone_terms(arm, edges)
        self._without_growth["principal components"] = make_component_terms(arm, observations)
        best = make_length_terms(arm, orders)
        self.extensions = {
            "θ with temperature": make_angle_terms(arm, "theta"),
            "α with temperature": make_angle_terms(arm, "alpha"),
        }
        everything = [*best, *self._without_growth.get("two zones", [])]
        everything += self._without_growth["principal components"]
        everything += [term for terms in self.extensions.values() for term in terms]
        everything += make_growth_terms(arm)
        self._place = {term.model_dump_json(): i for i, term in enumerate(everything)}
        self._n_constants = len(fit.unknowns.constants)
        basis = compute_basis_values(
            everything, observations.states, arm, fit.reference_c, fit.constants
        )
        names = [*fit.unknowns.constants, *(term.parameter for term in everything)]
        # Built at once: a second array beside the whole would need much memory.
        columns = fit.linearisation.make_constant_columns(names)
        columns[:, :, self._n_constants :] *= basis[:, None, :]
        fitted = fit.linearisation.make_term_columns(fit.terms, fit.linearisation.basis)
        coefficients = np.array([term.coefficient for term in fit.terms])
        self._residual = fit.linearisation.residual_mm - fitted @ coefficients
        self._columns = columns
        self._pull = np.zeros(columns.shape[2])
        self._pull[: self._n_constants] = -fit.departure[: self._n_constants]
        typical = np.sqrt(np.mean(basis**2, axis=0))
        sizes = [
            0.1 * (1.0 if parameters.find_unit(t.parameter) == "mm" else 0.002) for t in everything
        ]
        scale = np.concatenate(
            [fit.solution.scale[: self._n_constants], sizes / np.maximum(typical, 1e-12)]
        )
        self._out = validate_by_temperature(observations, groups)
        folds = [left_out.rows for left_out in self._out]
        self._heldout = HeldOut(fit, columns, scale, self._residual, self._pull, folds)

    @cached_property
    def growth(self) -> list[Term]:
        """The term of the first link's expansion, if a ramp shows it: part of every model."""
        return make_growth_terms(self.fit.observations.arm) if self._shows_growth() else []

    @cached_property
    def models(self) -> dict[str, list[Term]]:
        """The terms of each thermal model, by its name."""
        return {name: [*terms, *self.growth] for name, terms in self._without_growth.items()}

    def errors(self, terms: Sequence[Term]) -> Errors:
        """Return the held-out errors of a model, all coefficients fitted at once."""
        return self._heldout.errors(self._chosen(terms))

    def trials(self) -> list[Trial]:
        """Try every model on the same data, the one without temperature first."""
        rows = [Trial("no thermal model", [], self.errors([]))]
        rows += [Trial(n, terms, self.errors(terms)) for n, terms in self.models.items()]
        rows += [
            Trial(_name_regression(m, offset), [], self._regression_errors(m, offset))
            for offset in (False, True)
            for m in self._regression_orders
        ]
        return rows

    def best_order(self, trials: Sequence[Trial]) -> int:
        """Return the lowest order that no higher order clearly beats."""
        by_name = {trial.name: trial.errors.without_down_weighted_um for trial in trials}
        best, chosen = by_name["no thermal model"], 0
        for m in range(1, self.most_order + 1):
            error = by_name[f"all at once, order {m}"]
            if error < WORTH * best:
                best, chosen = error, m
        return chosen

    def shows_expansion(self) -> bool:
        """Return whether the linear model clearly beats the one without temperature."""
        arm = self.fit.observations.arm
        base_errors, grown_errors = (
            self.errors(make_length_terms(arm, orders)) for orders in ([], [1])
        )
        return grown_errors.without_down_weighted_um < WORTH * base_errors.without_down_weighted_um

    def _shows_growth(self) -> bool:
        """Return whether the readings show the first link's expansion.

        It must be significant in addition to a linear thermal model, and held-out errors must not
        rise. It is one physical term, which every ramp has, so it need not lower the whole error by
        a hundredth.
        """
        arm = self.fit.observations.arm
        linear, growth = make_length_terms(arm, [1]), make_growth_terms(arm)
        if not growth:
            return False
        solution = self._heldout.solve_all(self._chosen([*linear, *growth]))
        sigma = float(np.linalg.norm(solution.root[-1]))
        if abs(float(solution.step[-1])) < GROWTH_KNOWN * sigma:
            return False
        grown_errors, base_errors = self.errors([*linear, *growth]), self.errors(linear)
        return grown_errors.without_down_weighted_um <= base_errors.without_down_weighted_um

    def extended(self, terms: Sequence[Term]) -> list[Trial]:
        """Return models with angles that depend on temperature, where these lower the held-out
        error.
        """
        chosen, best = list(terms), self.errors(terms).without_down_weighted_um
        accepted = []
        for name, extension in self.extensions.items():
            errors = self.errors([*chosen, *extension])
            if errors.without_down_weighted_um < WORTH * best:
                chosen, best = [*chosen, *extension], errors.without_down_weighted_um
                accepted.append(Trial(name, chosen, errors))
        return accepted

    def regressed(
        self, trials: Sequence[Trial], thermal_order: int | None, offset: bool
    ) -> tuple[int, Identification, Errors]:
        """Apply the paper's method: return order, fit, and its errors on held-out readings.

        Raises `ArmdError` where the temperatures are too few for the order.
        """
        errors = {trial.name: trial.errors for trial in trials}
        orders = [thermal_order] if thermal_order else self._regression_orders
        if not orders or max(orders) not in self._regression_orders:
            needed = (thermal_order or 1) + 2
            raise ArmdError(
                f"per temperature: found {format_count(len(self.groups), 'temperature')},"
                f" expected at least {needed} for order {thermal_order or 1}, one of them left out"
                " in turn"
            )
        order = orders[0]
        for m in orders[1:]:
            if (
                errors[_name_regression(m, offset)].without_down_weighted_um
                < WORTH * errors[_name_regression(order, offset)].without_down_weighted_um
            ):
                order = m
        arm = self.fit.observations.arm
        names = arm.used_sensors
        weights = {name: 1.0 / len(names) for name in names}
        identification = fit_regression(
            self.fit, self._identified_alone, self._temperature_c, weights, order, offset
        )
        return order, identification, errors[_name_regression(order, offset)]

    def _chosen(self, terms: Sequence[Term]) -> I64:
        places = [self._n_constants + self._place[_make_key(term)] for term in terms]
        return np.array([*range(self._n_constants), *places], dtype=np.int64)

    @property
    def _regression_orders(self) -> range:
        return range(1, min(MOST_ORDER, len(self.groups) - 2) + 1)

    def _regression_errors(self, order: int, offset: bool) -> Errors:
        """Compute the held-out errors of the paper's method.

        The constants are identified at each temperature, then a polynomial is fitted to each.
        """
        constants = np.arange(self._n_constants)
        identified = np.array([solution.known_step for solution in self._identified_alone])
        changes = []
        for left_out, part in zip(self._out, self._identified_in_part, strict=True):
            steps = identified.copy()
            is_used = np.ones(len(steps), dtype=bool)
            is_used[left_out.group] = part is not None
            if part is not None:
                steps[left_out.group] = part.known_step
            from_c, linear = make_regression(
                self._temperature_c[is_used], order, offset, self.fit.reference_c
            )
            temperature_c = self._temperature_c[left_out.group]
            powers = np.vander([temperature_c - from_c], order + 1, increasing=True)[0]
            changes.append(powers @ linear @ steps[is_used])
        return self._heldout.summarise(self._heldout.try_changes(constants, changes))

    @property
    def _temperature_c(self) -> F64:
        return np.array([temperature for temperature, _ in self.groups])

    @cached_property
    def _identified_alone(self) -> list[Solution]:
        """The changes of the constants, identified from each temperature's readings only."""
        return self._identified_from([mask for _, mask in self.groups])

    @cached_property
    def _identified_in_part(self) -> list[Solution | None]:
        """The changes identified from a temperature's readings that are not held out.

        One for each held-out set; None where no reading of the temperature remains.
        """
        parts = iter(self._identified_from([o.stays for o in self._out if o.stays.any()]))
        return [next(parts) if left_out.stays.any() else None for left_out in self._out]

    def _identified_from(self, sets: Sequence[Mask]) -> list[Solution]:
        constants = np.arange(self._n_constants)
        by_set = HeldOut(
            self.fit, self._columns[:, :, : self._n_constants], self._heldout.scale[constants],
            self._residual, self._pull[constants], [~rows for rows in sets],
        )  # fmt: skip
        return [by_set.solve(i, constants) for i in range(len(sets))]


def _name_regression(order: int, offset: bool) -> str:
    return f"per temperature, order {order}" + " and offset" * offset


def _make_key(term: Term) -> str:
    return term.model_copy(
        update={"coefficient": 0.0, "standard_uncertainty": None}
    ).model_dump_json()
