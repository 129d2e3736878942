"""Least squares on constants and coefficients, placements and free targets eliminated.

Gauss–Newton with Levenberg's damping where a step fails, on unknowns scaled by their plausible
departure from the drawing. Between rounds the noise of a reading is found anew from the
residuals, and readings are weighted by it and by the robust loss. While the noise is not yet
known, the drawing counts as one more reading of every unknown, good to its plausible departure:
so a start far off cannot run away along what the readings hardly tell. Then it is let go, and
what the readings cannot tell stays as near the drawing as it can: the solution of minimum norm.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.compensation import parameters
from armd.compensation.basis import basis_values, parameter_rows
from armd.compensation.identify.gauge import PLAUSIBLE
from armd.compensation.identify.linearise import Elimination, Linearisation, linearise
from armd.compensation.identify.noise import (
    LEAST_MM,
    MEDIAN_D2,
    OUTLIER_D2,
    ReadingNoise,
    estimate,
    mahalanobis2,
    robust_weights,
    whitening,
)
from armd.compensation.identify.observations import Observations
from armd.compensation.identify.poses import Poses, fit_poses
from armd.compensation.kinematics import forward, joint_jacobian
from armd.compensation.terms import Temperature, Term

F64 = npt.NDArray[np.float64]
Progress = Callable[[str], None]

#: A singular value below this, relative to the largest, is rounding.
ROUNDING = 1e-9
#: A direction known worse than a tenth of its plausible departure is not known.
LEAST_KNOWN = 10.0
MOST_STEPS = 40
MOST_ROUNDS = 10
#: A term's coefficient is plausible up to this effect on its parameter (rms of its basis).
PLAUSIBLE_TERM = 0.1


@dataclass(frozen=True)
class Unknowns:
    """What is asked for: some constants by name, some terms by index."""

    constants: Sequence[str]
    terms: Sequence[int] = ()

    @property
    def names(self) -> list[str]:
        """As `covariance_of` in a calibration has it: names, then "term I"."""
        return [*self.constants, *(f"term {i}" for i in self.terms)]

    def words(self, terms: Sequence[Term]) -> list[str]:
        """As a person reads them: a term by its parameter and basis."""
        return [*self.constants, *(in_words(terms[i]) for i in self.terms)]

    def values(self, constants: F64, terms: Sequence[Term]) -> F64:
        """(C,) where the unknowns stand in constants (P,) and terms."""
        coefficients = [terms[i].coefficient for i in self.terms]
        return np.concatenate([constants[self._indices(constants)], coefficients])

    def put(self, x: F64, constants: F64, terms: Sequence[Term]) -> tuple[F64, list[Term]]:
        """Constants and terms with the unknowns (C,) in their places."""
        constants, terms = constants.copy(), list(terms)
        indices = self._indices(constants)
        constants[indices] = x[: len(indices)]
        for i, coefficient in zip(self.terms, x[len(indices) :], strict=True):
            terms[i] = terms[i].model_copy(update={"coefficient": float(coefficient)})
        return constants, terms

    def columns(self, at: Linearisation, terms: Sequence[Term]) -> F64:
        """d residual / d unknown (n, 3, C).

        Zero for θ₁ and d₁: moving the whole arm about its first axis moves every placement alike.
        """
        asked = [terms[i] for i in self.terms]
        by_term = at.term_columns(asked, at.basis[:, list(self.terms)])
        by_constant = at.constant_columns(self.constants)
        by_constant[:, :, [name in ("theta_1", "d_1") for name in self.constants]] = 0.0
        return np.concatenate([by_constant, by_term], axis=2)

    def plausible(self, terms: Sequence[Term], basis: F64) -> F64:
        """Plausible departures (C,) in each unknown's own unit."""
        sizes = [PLAUSIBLE[parameters.unit(name)] for name in self.constants]
        for i in self.terms:
            typical = float(np.sqrt(np.mean(basis[:, i] ** 2)))
            unit = PLAUSIBLE[parameters.unit(terms[i].parameter)]
            sizes.append(PLAUSIBLE_TERM * unit / max(typical, 1e-12))
        return np.array(sizes)

    def _indices(self, constants: F64) -> list[int]:
        n_joints = (len(constants) - 9) // 5
        return [parameters.index(name, n_joints) for name in self.constants]


@dataclass(frozen=True)
class Solution:
    """One linear least-squares solution by singular values, in scaled unknowns."""

    step: F64  # (C,) in the unknowns' own units
    singular_values: F64  # (C,)
    known: npt.NDArray[np.bool_]  # (C,) which directions are known
    directions: F64  # (C, C) columns: directions in scaled unknowns
    scale: F64  # (C,) plausible departures
    gain: float  # by how much the sum of squares falls, to first order

    @property
    def rank(self) -> int:
        return int(self.known.sum())

    @property
    def null(self) -> F64:
        """(C, C − rank) directions the readings say nothing about, in plausible departures."""
        return self.directions[:, ~self.known]

    def covariance(self) -> F64:
        """(C, C) covariance of what is known, in the unknowns' own units."""
        root = self.scale[:, None] * self.directions[:, self.known]
        root = root / self.singular_values[self.known]
        covariance: F64 = root @ root.T
        return covariance


@dataclass(frozen=True)
class Fit:
    """What a fit found."""

    observations: Observations
    reference_c: float
    constants: F64  # (P,)
    terms: list[Term]  # with their coefficients and standard uncertainties
    unknowns: Unknowns
    solution: Solution
    at: Linearisation  # at the solution
    elimination: Elimination  # with the last round's weights
    noise: ReadingNoise
    distance2: F64  # (n,) squared Mahalanobis distances of the readings
    covariance: F64  # (C, C) of the unknowns; zero along directions not identifiable
    steps: int
    converged: bool

    @property
    def outliers(self) -> npt.NDArray[np.int64]:
        """Rows that the robust loss weighs down."""
        return np.flatnonzero(self.distance2 > OUTLIER_D2)

    @property
    def rms_um(self) -> float:
        """3-D RMS of all readings' residuals."""
        return rms_um(self.at.residual_mm)


def in_words(term: Term) -> str:
    """A term as a person reads it: d_2·ΔT²(t2)."""
    factors = []
    for factor in term.basis:
        if isinstance(factor, Temperature):
            power = "⁰¹²³⁴"[factor.order] if factor.order > 1 else ""
            zone = f", {factor.zone_c[0]:.0f}…{factor.zone_c[1]:.0f} °C" if factor.zone_c else ""
            factors.append(f"ΔT{power}({'+'.join(factor.weights)}{zone})")
        else:
            joint = getattr(factor, "joint", getattr(factor, "link", ""))
            factors.append(f"{factor.kind}({joint})")
    return "·".join([term.parameter, *factors])


def rms_um(residual_mm: F64) -> float:
    """3-D RMS in µm of residuals (n, 3) mm; rows with NaN are left out."""
    squares = np.sum(residual_mm**2, axis=1)
    return float(np.sqrt(np.nanmean(squares))) * 1e3 if np.isfinite(squares).any() else np.nan


def fit(
    observations: Observations,
    constants: F64,
    terms: Sequence[Term],
    unknowns: Unknowns,
    reference_c: float,
    *,
    noise: ReadingNoise | None = None,
    begin: F64 | None = None,
    rounds: int = MOST_ROUNDS,
    progress: Progress | None = None,
) -> Fit:
    """Fit *unknowns*; *constants* (P,) and the terms' coefficients are the drawing to stay near.

    *begin* (P,): constants to begin at instead, where an earlier fit knows them better.
    *noise* is what to weight the readings by at first, where it is known. `rounds` is how often
    at most noise and robust weights are found anew; 1 keeps the first weights. Every row's
    temperatures must be there where a term needs them.
    """
    start = unknowns.values(constants, terms)
    constants, terms = constants if begin is None else begin, list(terms)
    x = unknowns.values(constants, terms)
    states = observations.states
    basis = basis_values(terms, states, observations.arm, reference_c, constants)
    position = forward(states.q, parameter_rows(constants, terms, basis))[0]
    poses = fit_poses(observations, position)
    weighing = noise or _alike(poses.residual(observations, position))
    distance2 = np.zeros(observations.n)
    steps, held = 0, noise is None
    for round_ in range(1, rounds + 1):
        joints = joint_jacobian(states.q, parameter_rows(constants, terms, basis))
        weight = robust_weights(distance2)
        if held:
            weighing = ReadingNoise(0.0, weighing.typical_mm(joints))
        whiten = whitening(weighing.covariance(joints), weight)
        descent = _Descent(
            observations, constants, terms, unknowns, reference_c, basis, start, weight
        )
        # A certified length bends the problem: far off it must not weigh more than the readings.
        floor_mm = weighing.reading_mm * (1.0 if held else 0.01)
        end = descent.run(x, poses, whiten, floor_mm, held)
        x, poses, steps = end.x, end.at.poses, steps + end.steps
        constants, terms = unknowns.put(x, constants, terms)
        fitted = end.elimination.rank + end.solution.rank
        before, weighing = weighing, estimate(end.at.residual_mm, joints, fitted)
        distance2 = mahalanobis2(end.at.residual_mm, weighing.covariance(joints))
        basis = basis_values(terms, states, observations.arm, reference_c, constants)
        if progress:
            progress(f"round {round_}: {rms_um(end.at.residual_mm):.2f} µm RMS, {steps} steps")
        settled = _settled(before, weighing, joints) and np.allclose(
            weight, robust_weights(distance2), atol=0.05
        )
        if settled and not held:
            break
        held = held and not settled and round_ < rounds // 2
    # The last weights are those of the round before: what is left of the difference is a factor.
    left = max(3 * float(weight.sum()) + end.elimination.n_certified - fitted, 1.0)
    covariance = end.solution.covariance() * end.elimination.cost / left
    deviation = np.sqrt(np.diag(covariance))[len(unknowns.constants) :]
    for i, u in zip(unknowns.terms, deviation, strict=True):
        terms[i] = terms[i].model_copy(update={"standard_uncertainty": float(u)})
    return Fit(
        observations, reference_c, constants, terms, unknowns, end.solution, end.at,
        end.elimination, weighing, distance2, covariance, steps, end.converged,
    )  # fmt: skip


def _alike(residual_mm: F64) -> ReadingNoise:
    """The noise that makes all readings alike, as large as their median residual."""
    typical = float(np.median(np.sum(residual_mm**2, axis=1)) / MEDIAN_D2)
    return ReadingNoise(0.0, max(np.sqrt(typical), LEAST_MM))


def _settled(before: ReadingNoise, after: ReadingNoise, joint_columns: F64) -> bool:
    """Whether the weights would change by less than a few per cent."""
    sizes = [
        np.trace(noise.covariance(joint_columns), axis1=1, axis2=2) for noise in (before, after)
    ]
    return bool(np.all(np.abs(sizes[1] / sizes[0] - 1.0) < 0.05))


def solve(
    triangle: F64, scale: F64, pull: F64, damping: float = 0.0, held: bool = False
) -> Solution:
    """Minimise |A δ + r| from the triangular factor (·, C+1) of [A·scale, r].

    Along directions the readings say nothing about, δ is *pull* (C,); along those they hardly
    know, 0. *held*: δ near *pull* counts as one more reading, and all are known. *damping* is
    relative to the largest singular value squared.
    """
    c = len(scale)
    square = np.zeros((c, c + 1))
    square[: min(c, len(triangle))] = triangle[:c]
    u, s, vt = np.linalg.svd(square[:, :c])
    largest = s[0] if c else 0.0
    touched = s > ROUNDING * largest
    known = touched & (held | (s > LEAST_KNOWN))
    wanted = vt @ (pull / scale)
    slope = s * (u.T @ square[:, c]) - held * wanted
    curvature = s**2 + held
    step = np.where(touched, 0.0, wanted)
    step[known] = (-slope / (curvature + damping * largest**2 + ~known))[known]
    gain = float(np.sum(slope[known] ** 2 / curvature[known]))
    return Solution(scale * (vt.T @ step), s, known, vt.T, scale, gain)


@dataclass(frozen=True)
class _End:
    x: F64
    at: Linearisation
    elimination: Elimination
    solution: Solution
    steps: int
    converged: bool


@dataclass(frozen=True)
class _Descent:
    """One round: basis values and weights are held while the unknowns move."""

    observations: Observations
    constants: F64
    terms: list[Term]
    unknowns: Unknowns
    reference_c: float
    basis: F64
    start: F64  # (C,) what unidentifiable directions stay near
    weight: F64  # (n,) robust weights

    def run(self, x: F64, poses: Poses, whiten: F64, floor_mm: float, held: bool) -> _End:
        """Step until what a step would gain is nothing beside the noise."""
        scale = self.unknowns.plausible(self.terms, self.basis)

        def cost(elimination: Elimination, x: F64) -> float:
            return elimination.cost + held * float(np.sum(((x - self.start) / scale) ** 2))

        at, elimination = self._linearise(x, poses, whiten, floor_mm, held)
        damping = 0.0
        steps = 0
        while steps < MOST_STEPS:
            steps += 1
            columns = self.unknowns.columns(at, self.terms)
            clear = np.column_stack([elimination.columns(columns * scale), elimination.residual()])
            triangle = np.asarray(np.linalg.qr(clear, mode="r"))
            if not self.observations.has_certified_length:
                triangle[:, :-1] = self._without_size(triangle[:, :-1], x, scale)
            solution = solve(triangle, scale, self.start - x, held=held)
            converged = solution.gain < 1e-6 + 1e-8 * elimination.cost
            if converged:
                break
            while True:
                damped = solve(triangle, scale, self.start - x, damping, held)
                twist, shift = elimination.back_substitute(columns @ damped.step)
                moved = at.poses.moved(at.centre_mm, twist, shift)
                trial = self._linearise(x + damped.step, moved, whiten, floor_mm, held)
                better = cost(trial[1], x + damped.step) <= cost(elimination, x)
                if better or damping > 1e3:
                    break
                damping = max(10.0 * damping, 1e-6)
            if not better:  # no step gains anything
                converged = solution.gain < 1e-3
                break
            x = x + damped.step
            at, elimination = trial
            damping = damping / 10.0 if damping > 1e-8 else 0.0
        return _End(x, at, elimination, solution, steps, converged)

    def _without_size(self, columns: F64, x: F64, scale: F64) -> F64:
        """Columns (·, C) that say nothing about the arm's size.

        Without any certified length, an arm shrunk by a factor fits as well, its residuals even
        shrunk with it: least squares would take that for knowledge and shrink it to nothing.
        """
        lengths = [parameters.unit(name) == "mm" for name in self.unknowns.constants]
        size = np.zeros(len(x))
        size[: len(lengths)] = np.where(lengths, x[: len(lengths)], 0.0) / scale[: len(lengths)]
        _, s, vt = np.linalg.svd(columns)
        touching = vt[: len(s)][s > ROUNDING * s[0]]  # leaves what is unknown anyway unknown
        told = touching.T @ (touching @ size)
        if np.linalg.norm(told) < 1e-3 * np.linalg.norm(size):
            return columns
        told /= np.linalg.norm(told)
        without: F64 = columns - np.outer(columns @ told, told)
        return without

    def _linearise(
        self, x: F64, poses: Poses, whiten: F64, floor_mm: float, held: bool
    ) -> tuple[Linearisation, Elimination]:
        constants, terms = self.unknowns.put(x, self.constants, self.terms)
        if held and not len(self.observations.distances.length_mm):
            # Far off, poses are not linear: about a beam's own axis they turn by any angle.
            rows = parameter_rows(constants, terms, self.basis)
            position = forward(self.observations.states.q, rows)[0]
            poses = fit_poses(self.observations, position, self.weight, poses)
        at = linearise(self.observations, constants, terms, poses, self.reference_c, self.basis)
        return at, Elimination(at, whiten, floor_mm)
