"""Where Gauss–Newton comes to rest: at the truth of exact data, and where the equations hold."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from armd.compensation.estimate.gauge import list_free_constants
from armd.compensation.estimate.linearise import linearise
from armd.compensation.estimate.noise.reading import ReadingNoise, Weighting
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.estimate.placements.fit_poses import fit_poses
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.descent import MOST_STEPS, Descent, End
from armd.compensation.model.kinematics import compute_pose
from support import synthetic

ARM = synthetic.arm()
UNKNOWNS = Unknowns(list_free_constants(ARM))
NOISE = ReadingNoise(3e-5, 0.01)
FLOOR_MM = 1e-4


def measured(exact: bool = False, size: float = 1.0) -> tuple[Observations, np.ndarray]:
    """Readings of an arm up to *size* mm and 0.5° · *size* off the drawing, and its constants."""
    rng = np.random.default_rng(1)
    truth = synthetic.disturbed(ARM, rng, size)
    share = 0.0 if exact else 1.0
    session = synthetic.session(
        ARM, truth, rng, readings=90, encoder_rad=share * NOISE.encoder_rad,
        noise_mm=share * NOISE.reading_mm,
    )  # fmt: skip
    return collect_observations([session], ARM), truth


def descended(
    observations: Observations,
    begin: np.ndarray,
    held: bool = False,
    noise: ReadingNoise = NOISE,
) -> End:
    """From constants *begin*, the drawing to lean on being the nominal one."""
    nominal, n = ARM.nominal(), observations.n
    position = compute_pose(observations.states.q, np.tile(begin, (n, 1)))[0]
    poses = fit_poses(observations, position)
    basis = np.zeros((n, 0))
    at = linearise(observations, begin, [], poses, 20.0, basis)
    start = UNKNOWNS.values(nominal, [])
    weighting = Weighting(noise, at.joints, np.ones(n))
    descent = Descent(observations, begin, [], UNKNOWNS, 20.0, basis, start, weighting)
    return descent.run(UNKNOWNS.values(begin, []), at, FLOOR_MM, held)


def standard(end: End, step: np.ndarray) -> np.ndarray:
    """A step of the unknowns along what the readings know, in its standard uncertainties."""
    solution = end.solution
    directions = solution.directions[:, solution.is_known]
    along: np.ndarray = directions.T @ (step / solution.scale)
    return along * solution.singular_values[solution.is_known]


def per_freedom(end: End) -> float:
    """χ² of the readings per degree of freedom left."""
    taken = end.arm_problem.rank + end.solution.effective_rank
    return end.arm_problem.cost / (3 * end.linearisation.observations.n - taken)


def test_exact_readings_are_met() -> None:
    observations, _ = measured(exact=True)
    end = descended(observations, ARM.nominal())
    assert end.converged and end.steps < MOST_STEPS / 2
    assert per_freedom(end) < 1e-4  # leaning on the drawing keeps them from none at all


def test_at_rest_whitened_columns_are_square_to_the_residual() -> None:
    """By dense algebra, placements among the columns; and from elsewhere it is the same place."""
    observations, truth = measured()
    end = descended(observations, ARM.nominal())
    at = linearise(observations, *UNKNOWNS.put(end.x, truth, []), end.linearisation.poses, 20.0)
    n = observations.n
    poses = np.zeros((n, 3, 6 * len(observations.placement_names)))
    for i, p in enumerate(observations.placement):
        poses[i, :, 6 * p : 6 * p + 6] = at.pose_columns[i]
    own = UNKNOWNS.columns(at.jacobian, at.basis, []) * end.solution.scale
    whiten = end.arm_problem.whitening
    white = (whiten @ np.concatenate([own, poses], axis=2)).reshape(3 * n, -1)
    residual = np.einsum("nij,nj->ni", whiten, at.residual_mm).ravel()
    slope = white.T @ residual / np.maximum(np.linalg.norm(white, axis=0), 1e-9)
    assert np.abs(slope[:-18]).max() < 0.05  # noise units; what leans on the drawing pulls a little
    assert np.abs(slope[-18:]).max() < 1e-3
    elsewhere = descended(observations, truth)
    assert np.abs(standard(end, elsewhere.x - end.x)).max() < 0.02  # standard uncertainties


def test_far_off_and_held_it_comes_near_from_where_it_is_let_go() -> None:
    observations, truth = measured(size=5.0)
    drawn = compute_pose(observations.states.q, np.tile(ARM.nominal(), (observations.n, 1)))[0]
    before = fit_poses(observations, drawn).residual(observations, drawn)
    end = descended(observations, ARM.nominal(), held=True)
    assert np.linalg.norm(end.linearisation.residual_mm) < 0.02 * np.linalg.norm(before)
    let_go = descended(observations, UNKNOWNS.put(end.x, truth, [])[0])
    assert let_go.converged
    assert per_freedom(let_go) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize(("off", "tries", "converged"), [(0.02, 2, True), (2.0, 24, False)])
def test_a_promise_of_nothing_that_is_not_kept_is_not_tried_again(
    off: float, tries: int, converged: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From *off* standard uncertainties beside the end no step leads down: as if the cost did not
    agree with the columns. A step that promises 4e-4 of χ² ends there, one that promises 4 is tried
    with damping."""
    observations, _ = measured()
    end = descended(observations, ARM.nominal())
    solution = end.solution
    best = int(np.flatnonzero(solution.is_known)[0])
    away = solution.scale * solution.directions[:, best] / solution.singular_values[best]
    begin, _ = UNKNOWNS.put(end.x + off * away, ARM.nominal(), [])
    moved, asked = Descent._move, []

    def counted(self: Descent, here: Any, step: np.ndarray, *rest: Any) -> Any:
        asked.append(step)
        return moved(self, here, step, *rest)

    monkeypatch.setattr(Descent, "_move", counted)
    monkeypatch.setattr(Descent, "_is_better", lambda *_: False)
    stuck = descended(observations, begin)
    assert stuck.converged is converged
    assert len(asked) == tries


def test_of_many_readings_a_step_keeps_what_it_promises(monkeypatch: pytest.MonkeyPatch) -> None:
    """While the drawing holds, placements are fitted with certified positions as exact, and columns
    let these move: the sum of squares where a step leads may then rise, the more the more readings.
    Judged so, this descent tried 132 places, crept uphill and had not settled after 40 steps."""
    rng = np.random.default_rng(5)
    truth = synthetic.disturbed(ARM, rng, 0.5)
    session = synthetic.session(
        ARM, truth, rng, readings=400, targets=12, placements=4, encoder_rad=NOISE.encoder_rad,
        spread_mm=80.0, uncertainty_mm=0.02,
    )  # fmt: skip
    observations = collect_observations([session], ARM)
    noise = ReadingNoise(0.0, 0.02)
    exact = replace(observations, uncertainty_mm=np.zeros(12))
    first = descended(exact, ARM.nominal(), held=True, noise=noise)
    begin, _ = UNKNOWNS.put(first.x, ARM.nominal(), [])
    linearised: list[np.ndarray] = []
    linear = Descent.linearise

    def counted(self: Descent, x: np.ndarray, *rest: Any) -> Any:
        linearised.append(x)
        return linear(self, x, *rest)

    monkeypatch.setattr(Descent, "linearise", counted)
    end = descended(observations, begin, held=True, noise=noise)
    assert end.converged
    assert len(linearised) <= end.steps <= 4
