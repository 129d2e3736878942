"""Gauss–Newton on the unknowns, with Levenberg's damping where a step fails."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from armd.arrays import F64
from armd.compensation.estimate.linear.solution import Solution
from armd.compensation.estimate.linearise import Linearisation, linearise
from armd.compensation.estimate.noise.reading import Weighting
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.orientations import compute_observed
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.placements.poses import Poses
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.arm_alone import ArmAlone
from armd.compensation.model.basis import compute_parameter_rows
from armd.compensation.model.terms import Term

MOST_STEPS = 40
#: A step that promises less than this share of the cost may be judged with weights and adjusted
#: angles fixed. The columns do not contain how these follow, and beside so small a promise that
#: matters (docs/decisions/0023). A larger step is judged with both following.
NEAR = 0.01
#: A step that promises less (χ²) and fails is not tried again with damping: forty short steps would
#: change no figure.
NOTHING = 1e-3


@dataclass(frozen=True)
class End:
    """The end of a descent."""

    x: F64
    linearisation: Linearisation
    arm_problem: ArmAlone
    solution: Solution
    steps: int
    converged: bool


@dataclass(frozen=True)
class _Place:
    """The current point of a descent."""

    x: F64
    linearisation: Linearisation
    arm_problem: ArmAlone


@dataclass
class _Trial:
    """The point to which a step leads; it is linearised when needed."""

    descent: Descent
    x: F64
    poses: Poses
    floor_mm: float
    with_prior: bool

    @cached_property
    def place(self) -> _Place:
        """The trial point, linearised."""
        return _Place(
            self.x, *self.descent.linearise(self.x, self.poses, self.floor_mm, self.with_prior)
        )


@dataclass(frozen=True)
class Descent:
    """One round of a fit: basis values and the noise of the angles are fixed, the unknowns move."""

    observations: Observations
    constants: F64
    terms: list[Term]
    unknowns: Unknowns
    reference_c: float
    basis: F64
    start: F64  # (C,) values near which unidentifiable directions stay
    weighting: Weighting

    def run(self, x: F64, begun: Linearisation, floor_mm: float, with_prior: bool) -> End:
        """Step until a further step would gain nothing compared with the noise.

        *begun* is a linearisation at *x* (C,), with the poses to begin with.
        """
        scale = self.unknowns.get_plausible(self.terms, self.basis)

        if self._refits_poses(with_prior):
            place = _Place(x, *self.linearise(x, begun.poses, floor_mm, with_prior))
        else:
            place = _Place(x, begun, self._make_arm_problem(begun, floor_mm))
        damping = 0.0
        steps = 0
        while steps < MOST_STEPS:
            steps += 1
            pull = self.start - place.x
            solution = place.arm_problem.solve(scale, pull, along_all=with_prior)
            converged = solution.gain < 1e-6 + 1e-8 * place.arm_problem.cost
            if converged:
                break

            while True:
                damped = (
                    place.arm_problem.solve(scale, pull, damping, with_prior)
                    if damping
                    else solution
                )
                trial = self._move(place, damped.step, floor_mm, with_prior)
                better = self._is_better(place, trial, solution, with_prior)
                if not better:
                    # The valley may be curved, where a link turns with what hangs on it: a second
                    # step from the trial returns to its floor.
                    second_pull = self.start - trial.x
                    second = trial.place.arm_problem.solve(scale, second_pull, damping, with_prior)
                    trial = self._move(trial.place, second.step, floor_mm, with_prior)
                    better = self._is_better(place, trial, solution, with_prior)
                if better or damping > 1e3 or solution.gain < NOTHING:
                    break
                damping = max(10.0 * damping, 1e-6)
            if not better:  # no step gains anything
                converged = solution.gain < NOTHING
                break
            place = trial.place
            damping = damping / 10.0 if damping > 1e-8 else 0.0
        return End(place.x, place.linearisation, place.arm_problem, solution, steps, converged)

    def _move(self, place: _Place, step: F64, floor_mm: float, with_prior: bool) -> _Trial:
        """Return the trial after a step (C,) of the unknowns; placements and targets follow."""
        twist, shift = place.arm_problem.follow(step)
        poses = place.linearisation.poses.moved(place.linearisation.centre_mm, twist, shift)
        return _Trial(self, place.x + step, poses, floor_mm, with_prior)

    def _is_better(
        self, place: _Place, trial: _Trial, solution: Solution, with_prior: bool
    ) -> bool:
        """Return whether to accept a trial.

        Costs include the change of the nominal prior. Where poses are refitted, costs with poses
        eliminated are compared. Otherwise χ² at both points is compared. A step with a small
        promise (`NEAR`) is judged with the weights and angles of the start. Where poses only follow
        the steps, its χ² may also rise by the promised gain.
        """
        leans = solution.compute_nominal_cost(trial.x - self.start)
        leans -= solution.compute_nominal_cost(place.x - self.start)
        start_cost, is_near = (
            place.arm_problem.reduced_cost,
            solution.gain < NEAR * place.arm_problem.cost,
        )
        if self._refits_poses(with_prior):
            trial_cost = (
                self._compute_fixed_cost(place, trial)
                if is_near
                else trial.place.arm_problem.reduced_cost
            )
            return trial_cost + leans <= start_cost
        cost = trial.place.arm_problem.cost
        limit = place.arm_problem.cost + (solution.gain if is_near else 0.0)
        if cost + leans <= limit:
            return True
        followed = cost - trial.place.arm_problem.reduced_cost <= solution.gain
        return is_near and followed and self._compute_fixed_cost(place, trial) + leans <= start_cost

    def _compute_fixed_cost(self, place: _Place, trial: _Trial) -> float:
        """Return a trial's cost with the weights and adjusted angles of *place*."""
        rows = compute_parameter_rows(
            *self.unknowns.put(trial.x, self.constants, self.terms), self.basis
        )
        tip = (
            compute_observed(place.linearisation.q, rows, self.observations.turned)
            - place.linearisation.there_mm
        )
        residual = trial.poses.residual(self.observations, place.linearisation.position_mm + tip)
        return place.arm_problem.compute_reduced_cost(residual, trial.poses)

    def linearise(
        self, x: F64, poses: Poses, floor_mm: float, with_prior: bool
    ) -> tuple[Linearisation, ArmAlone]:
        """Linearise at the unknowns (C,).

        Poses stay as they are, or are fitted again in a round *with_prior*.
        """
        constants, terms = self.unknowns.put(x, self.constants, self.terms)
        if self._refits_poses(with_prior):
            # Far from the solution, poses are not linear: about a beam's own axis they turn by any
            # angle.
            rows = compute_parameter_rows(constants, terms, self.basis)
            position = compute_observed(self.observations.states.q, rows, self.observations.turned)
            poses = fit_poses(self.observations, position, self.weighting.weight, poses)
        linearisation = linearise(
            self.observations, constants, terms, poses, self.reference_c, self.basis
        )
        return linearisation, self._make_arm_problem(linearisation, floor_mm)

    def _make_arm_problem(self, linearisation: Linearisation, floor_mm: float) -> ArmAlone:
        columns = self.unknowns.columns(linearisation.jacobian, linearisation.basis, self.terms)
        return ArmAlone(
            linearisation, self.weighting.compute_whitening(linearisation.joints), columns, floor_mm
        )

    def _refits_poses(self, with_prior: bool) -> bool:
        """Return whether poses are fitted at every point instead of following the steps."""
        return with_prior and not len(self.observations.distances.length_mm)
