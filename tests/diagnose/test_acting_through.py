"""A sensor's offset acts through what else was found: its columns, its size, what is written."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from armd.arrays import F64
from armd.compensation.diagnose.extend import extend_calibration
from armd.compensation.diagnose.fitting.refit import solve_with_findings
from armd.compensation.diagnose.problem.acting_causes import (
    add_acting,
    find_acting,
    update_candidate,
)
from armd.compensation.diagnose.problem.baseline import add_findings
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.signatures import compile_candidates, make_finding_columns
from armd.compensation.diagnose.scoring import candidates
from armd.compensation.diagnose.scoring.candidates import find_weakest, score_candidates
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.compensation.identify.evaluation.evaluate import evaluate
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.kinematics import compute_pose
from support.found_problem import (
    ARM,
    FOUND,
    GRADIENT,
    NOISE_MM,
    OFFSET_K,
    Problem,
    fitted,
    measured,
    problem,
    problem_of,
)
from support.selection import parametrize_default

__all__ = ["problem"]  # the fixture


def tip(problem: Problem, found: Any, sensor: int, step_k: float) -> F64:
    """(n, 3) where the arm with what was found is, one of its sensors reading *step_k* more."""
    model = add_findings(problem.baseline.model, found.findings, found.amplitudes)
    states = problem.rests.observations.states
    celsius = states.temperature_c.copy()
    celsius[:, sensor] += step_k
    states = replace(states, temperature_c=celsius)
    values = compute_basis_values(model.terms, states, ARM, model.reference_c, model.constants)
    return compute_pose(states.q, compute_parameter_rows(model.constants, model.terms, values))[0]


@parametrize_default("sensor", [2, 3, 4])
@pytest.mark.parametrize("causes", [(), (GRADIENT,), [cause for cause, _ in FOUND]])
def test_an_offset_is_the_derivative_of_all_that_was_found(
    problem: Problem, sensor: int, causes: tuple[str, ...]
) -> None:
    found = problem.found(*causes)
    model = add_findings(problem.baseline.model, found.findings, found.amplitudes)
    offset = problem.offset(f"t{sensor + 1}")
    made = update_candidate(offset, problem.facts, find_acting(found))
    assert made is not None
    linear = linearise(problem.rests, model, ARM)
    own = make_finding_columns(linear, [made], ARM)[0][: 3 * problem.rests.n, 0]
    up, down = (tip(problem, found, sensor, step) for step in (1e-3, -1e-3))
    expected = ((up - down) / 2e-3).ravel()
    np.testing.assert_allclose(own, expected, atol=1e-6 * np.abs(expected).max())
    touched = any(f"t{sensor + 1}" in c.depends_on for c in found.findings)
    assert (made is offset) == (not touched)


@pytest.mark.slow
def test_offset_and_gradient_come_back_and_are_written_as_fitted(problem: Problem) -> None:
    true = problem.found(GRADIENT)
    own = problem_of(measured(true))
    gradient, offset = own.found(GRADIENT).findings[0], own.offset()
    last = fitted(own, [gradient, offset])
    assert last.amplitudes[1][0] == pytest.approx(-OFFSET_K, rel=0.02)
    np.testing.assert_allclose(last.amplitudes[0], true.amplitudes[0], rtol=0.02, atol=2e-6)
    apart = fitted(own, [gradient, offset], turns=False)  # of the lengths alone
    assert last.noise.scale_mm < 0.5 * apart.noise.scale_mm
    other = measured(true, "another")
    calibration = extend_calibration(last, ARM, [])
    rms_mm = np.sqrt((evaluate([other], ARM, calibration).residual_mm ** 2).mean())
    assert rms_mm < 1.2 * NOISE_MM
    plain = extend_calibration(apart, ARM, [])
    assert np.sqrt((evaluate([other], ARM, plain).residual_mm ** 2).mean()) > 3 * NOISE_MM


class Asked:
    """Which findings are taken out, for which one's worth."""

    of: ClassVar[list[tuple[int, ...]]] = []

    def score_without_finding(self, *out: int) -> Any:
        self.of.append(out)
        return SimpleNamespace(log_p=np.zeros(2))


@pytest.mark.slow
def test_it_acts_through_what_is_in_the_model_and_through_nothing_else(
    problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = problem_of(measured(problem.found(GRADIENT)))
    gradient, offset = own.found(GRADIENT).findings[0], own.offset()
    with_it, without = fitted(own, [gradient]), fitted(own, [])
    plain = compile_candidates([gradient, offset], without.linear, ARM)
    assert add_acting(plain, without, own.facts, (), ARM) is plain
    assert add_acting(plain, with_it, own.facts, {offset.place}, ARM).n_columns > plain.n_columns
    both = add_acting(plain, with_it, own.facts, (), ARM)
    assert both.bases is plain.bases or len(both.bases) > len(plain.bases)
    at = next(i for i, c in enumerate(both.candidates) if c.through and c.place == offset.place)
    scored = score_candidates(make_projection(with_it, ARM), both)
    assert scored.scores.freedom[[1, at]].tolist() == [0, 1]
    assert scored.score_eligible_without(0).freedom[[1, at]].tolist() == [1, 0]
    nothing = score_candidates(make_projection(without, ARM), both)
    assert nothing.scores.freedom[[1, at]].tolist() == [1, 0]
    # What acts through the gradient takes no part in what the gradient is worth.
    last = fitted(own, [gradient, offset])
    about = make_projection(last, ARM)
    beside = score_candidates(about, both)
    neither = make_projection(solve_with_findings(last, [], ARM), ARM)
    itself = score_candidates(neither, last.findings[:1]).scores.statistic[0]
    assert beside.score_findings_without_acting(0).statistic[0] == pytest.approx(itself, rel=1e-6)
    assert (
        beside.score_findings_without_acting(1).statistic[1]
        == beside.score_findings(1).statistic[1]
        < itself
    )
    monkeypatch.setattr(candidates, "score_candidates", lambda *_: Asked())
    find_weakest(about)
    assert Asked.of == [(0, 1), (1,)]
    assert update_candidate(last.findings[1], own.facts, find_acting(without)).is_like(offset)  # type: ignore[union-attr]
