"""Eliminating placement by placement, and leaving parts out of sums, against all rows at once."""

import numpy as np
import pytest

from armd.compensation.diagnose.fitting.refit import (
    make_refits_without,
    set_findings,
    solve_with_findings,
)
from armd.compensation.diagnose.problem.rests import assign_folds
from armd.compensation.diagnose.problem.signatures import compile_candidates, make_finding_columns
from armd.compensation.diagnose.scoring.candidates import PartedSurvey
from armd.compensation.diagnose.scoring.evidence import add_sums, score
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.simulator.plants.plant import Plant
from support.first_fit import clear_of_absorbing, first_fit, whitened
from support.small_fit import whitened_by


@pytest.fixture(scope="module")
def problem():
    """A fit of small sessions, the arm, and the catalogue's candidates."""
    plants = [Plant("encoder_eccentricity", "joint 3", 2.0)]
    _, found, arm, candidates = first_fit(5, plants)
    return found, arm, candidates


def statistic(current, candidate, arm) -> float:
    """χ² of a candidate by one dense least-squares problem with all that absorbs."""
    x = current.noise.whiten(make_finding_columns(current.linear, [candidate], arm)[0])
    x = clear_of_absorbing(current, x / np.linalg.norm(x, axis=0))
    left = clear_of_absorbing(current, current.noise.whiten(current.residual))
    return float(left @ x @ np.linalg.pinv(x.T @ x, rcond=1e-9, hermitian=True) @ x.T @ left)


def _moves(candidate, joint: int) -> bool:
    terms = [term for column in candidate.columns for term in column.terms]
    return any(term.parameter.endswith(f"_{joint}") for term in terms)


@pytest.mark.slow
def test_scores_are_those_of_one_dense_problem(problem) -> None:
    current, arm, candidates = problem
    strong = [c for c in candidates if c.place == ("encoder_eccentricity", "joint 3")]
    # The last joint's constants and the tip are one gauge: rounding tells them apart.
    others = [c for c in candidates if not _moves(c, arm.n_joints)]
    some = [*strong, *others[::200]]
    signatures = compile_candidates(some, current.linear, arm)
    scores = score(make_projection(current, arm).sums(signatures))
    told = [i for i in range(len(some)) if scores.freedom[i] == len(some[i].columns)]
    assert 0 in told and len(told) > 5
    dense = [statistic(current, some[i], arm) for i in told]
    np.testing.assert_allclose(scores.statistic[told], dense, rtol=1e-4, atol=1e-4)
    assert scores.statistic[0] > 50.0


@pytest.mark.slow
def test_a_part_left_out_of_the_sums_is_left_out_of_the_problem(problem) -> None:
    current, arm, candidates = problem
    signatures = compile_candidates(candidates[::40], current.linear, arm)
    part_of = current.linear.rests.observations.placement % 2
    whole = make_projection(current, arm, part_of)
    first, second, distances = whole.sums_by_part(signatures)
    whitener = np.where((part_of == 1)[:, None, None], 0.0, current.noise.whitener)
    without = solve_with_findings(whitened_by(current, whitener), [], arm)
    anew = score(make_projection(without, arm).sums(signatures))
    from_parts = score(add_sums([first, distances]))
    np.testing.assert_allclose(from_parts.statistic, anew.statistic, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(from_parts.freedom, anew.freedom)
    assert second.xr.any()


def test_a_fit_without_a_part_is_the_fit_of_the_others_alone(problem) -> None:
    """Also along what they hardly know: a prior of what was left out once was the measure there."""
    current, arm, _ = problem
    observations = current.linear.rests.observations
    out = observations.placement % 2 == 1
    whitener = np.where(out[:, None, None], 0.0, current.noise.whitener)
    without = solve_with_findings(whitened_by(current, whitener), [], arm)
    kept = np.append(np.repeat(~out, 3), np.ones(len(current.residual) - 3 * len(out), bool))
    white, scale = whitened(without.noise, without.nuisance.columns.to_dense())
    held = np.minimum(without.nuisance.variance, without.layout.nominal_variance)
    prior = 1.0 / np.sqrt(held) / scale
    heard = white[kept].any(axis=0)
    rows = np.vstack([white[kept], np.diag(prior)])[:, heard]
    side = np.append(current.noise.whiten(current.residual)[kept], np.zeros(len(prior)))
    alone = np.linalg.lstsq(rows, side, rcond=1e-9)[0] / scale[heard]
    own = np.flatnonzero(heard[without.layout.identified]) + without.layout.identified.start
    move = current.nuisance.columns.to_dense(own)
    expected = move @ alone[np.searchsorted(np.flatnonzero(heard), own)]
    np.testing.assert_allclose(move @ without.solution[own], expected, atol=2e-5)


def test_findings_join_what_absorbs_without_another_pass(problem) -> None:
    current, arm, candidates = problem
    signatures = compile_candidates(candidates[::40], current.linear, arm)
    nothing = make_projection(current, arm)
    finding = next(c for c in candidates if c.place == ("encoder_eccentricity", "joint 3"))
    found = solve_with_findings(current, [finding], arm)
    grown = nothing.with_findings_of(found)
    known = score(grown.sums_with(nothing.sums(signatures)))
    anew = score(make_projection(found, arm).sums(signatures))
    np.testing.assert_allclose(known.statistic, anew.statistic, rtol=1e-5, atol=1e-6)
    np.testing.assert_array_equal(known.freedom, anew.freedom)


def test_a_survey_by_parts_is_the_one_of_all_rows_and_of_all_but_a_part(problem) -> None:
    """Also of few candidates, for which its parts are one."""
    current, arm, candidates = problem
    signatures = compile_candidates(candidates[::40], current.linear, arm)
    few = compile_candidates(candidates[20::400], current.linear, arm)
    finding = next(c for c in candidates if c.place == ("encoder_eccentricity", "joint 3"))
    found = solve_with_findings(current, [finding], arm)
    parted = PartedSurvey.from_fit(set_findings(found, [], arm), signatures, arm)
    surveys = [(parted.with_findings(found), found), (parted.without_findings(current), current)]
    folds = assign_folds(current.linear.rests)
    outs = [folds == 0, folds == 1]
    for part, refits in enumerate(make_refits_without(current, outs)):
        whitener = np.where(outs[part][:, None, None], 0.0, current.noise.whitener)
        anew = solve_with_findings(whitened_by(current, whitener), [], arm)
        surveys.append((parted.without(part, refits.with_subset([])), anew))
    for survey, fitted in surveys:
        projection = make_projection(fitted, arm)
        for sums, some in ((survey.sums, signatures), (survey.projection.sums(few), few)):
            scores, expected = score(sums), score(projection.sums(some))
            np.testing.assert_array_equal(scores.freedom, expected.freedom)
            np.testing.assert_allclose(scores.statistic, expected.statistic, rtol=1e-5, atol=1e-6)
            np.testing.assert_allclose(
                scores.log_evidence, expected.log_evidence, rtol=1e-5, atol=1e-6
            )
