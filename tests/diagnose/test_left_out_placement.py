"""A fit without the readings of a placement is the pseudo-inverse's, of which it needs none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.diagnose.fitting import refit
from armd.compensation.diagnose.fitting.fit import find_determined_columns
from armd.compensation.diagnose.fitting.refit import (
    Refits,
    make_refits_without,
    solve_shared_again,
    solve_with_findings,
)
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.whitening import Nuisance
from armd.compensation.estimate.linear.blocks import to_blocks
from support import synthetic
from support.small_fit import candidate, small_fit, whitened_by

RESTS = 12
PLACEMENTS, RESTS_OF_EACH = 3, 6


def fit() -> Fit:
    """Of two placements with six columns each, and three constants."""
    rng = np.random.default_rng(1)
    placements = np.zeros((3 * RESTS, 12))
    placements[: 3 * RESTS // 2, :6] = rng.normal(size=(3 * RESTS // 2, 6))
    placements[3 * RESTS // 2 :, 6:] = rng.normal(size=(3 * RESTS // 2, 6))
    return small_fit(
        rng.normal(size=3 * RESTS), placements, identified=rng.normal(size=(3 * RESTS, 3))
    )


def test_the_pose_left_out_stays_and_all_else_is_the_least_norm_solution(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known = fit()
    whitener = known.noise.whitener.copy()
    whitener[RESTS // 2 :] = 0.0
    rows, half = known.nuisance.columns.to_dense(), 3 * RESTS // 2
    prior = np.diag(1.0 / known.nuisance.variance)
    expected = np.linalg.pinv(rows[:half].T @ rows[:half] + prior) @ (
        rows[:half].T @ known.residual[:half]
    )
    monkeypatch.setattr(np.linalg, "eigh", None)  # what takes long, and is not needed
    found = Refits(whitened_by(known, whitener)).with_subset([])
    np.testing.assert_allclose(found.solution, expected, atol=1e-10)
    assert not found.solution[6:12].any() and found.solution[:6].all()
    assert find_determined_columns(found.problem).tolist() == [*range(6), 12, 13, 14]


def fit_of_three(whole: float = 1.0) -> Fit:
    """Of three placements, each with a pose of its own that absorbs freely; of a pose's six columns
    the last is only told of where *whole* is not zero. Three constants, two findings."""
    rng = np.random.default_rng(3)
    rows = 3 * PLACEMENTS * RESTS_OF_EACH
    poses = np.zeros((rows, 6 * PLACEMENTS))
    for k in range(PLACEMENTS):
        own = slice(3 * RESTS_OF_EACH * k, 3 * RESTS_OF_EACH * (k + 1))
        poses[own, 6 * k : 6 * k + 6] = rng.normal(size=(3 * RESTS_OF_EACH, 6))
        poses[own, 6 * k + 5] *= whole
    findings = {
        candidate("wave", 1, widths=2): rng.normal(size=(rows, 2)),
        candidate("wave", 2): rng.normal(size=(rows, 1)),
    }
    known = small_fit(rng.normal(size=rows), poses, findings, identified=rng.normal(size=(rows, 3)))
    placement = np.repeat(np.arange(PLACEMENTS), RESTS_OF_EACH)
    columns = to_blocks([known.nuisance.columns.to_dense()], placement)
    return replace(known, nuisance=Nuisance(columns, known.nuisance.variance))


@pytest.mark.parametrize("some", [(), (0,), (1,), (0, 1)])
@pytest.mark.parametrize("whole", [1.0, 0.0])
@pytest.mark.parametrize("left_out", ["a placement", "every other rest"])
def test_what_placements_share_is_solved_as_beside_their_poses(
    some: tuple[int, ...], whole: float, left_out: str
) -> None:
    """By all columns in one pseudo-inverse; the fit without poses has the same of the others."""
    known = fit_of_three(whole)
    rests = np.arange(PLACEMENTS * RESTS_OF_EACH)
    out = rests < RESTS_OF_EACH if left_out == "a placement" else rests % 2 == 0
    of_findings = [known.layout.findings[i] for i in some]
    shared = np.concatenate(
        [np.r_[known.layout.identified], *(np.r_[at] for at in of_findings)]
    ).astype(int)
    columns = np.concatenate([np.arange(6 * PLACEMENTS), shared])
    rows = known.nuisance.columns.to_dense(columns)[np.repeat(~out, 3)]
    gram = rows.T @ rows + np.diag(1.0 / known.nuisance.variance[columns])
    inverse = np.linalg.pinv(gram, rcond=1e-12, hermitian=True)
    solution = inverse @ (rows.T @ known.residual[np.repeat(~out, 3)])
    (refits,) = make_refits_without(known, [out])
    found = refits.with_subset(some)
    last = len(shared)
    np.testing.assert_allclose(found.solution, solution[-last:], atol=1e-10)
    np.testing.assert_allclose(found.inverse, inverse[-last:, -last:], atol=1e-10)
    full = known.nuisance.columns.to_dense(shared) @ solution[-last:]
    np.testing.assert_allclose(found.fitted, full, atol=1e-10)
    at_full = whitened_by(known, np.where(out[:, None, None], 0.0, known.noise.whitener))
    beside_poses = Refits(at_full).with_subset(some)
    for one, other in zip(found.amplitudes, beside_poses.amplitudes, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-10)


def test_with_other_findings_it_is_the_same_solution(monkeypatch: pytest.MonkeyPatch) -> None:
    """As beside the poses, of which one is not fitted along but a column as others are."""
    known, rng = fit_of_three(), np.random.default_rng(4)
    others = [candidate("sag", 3, widths=2), candidate("wave", 2)]
    columns = [rng.normal(size=(len(known.residual), len(c.columns))) for c in others]
    monkeypatch.setattr(refit, "make_finding_columns", lambda *_: columns)
    whitener = known.noise.whitener.copy()
    whitener[:RESTS_OF_EACH] = 0.0
    known, arm = whitened_by(known, whitener), synthetic.arm()
    alone = np.arange(known.layout.blocks.n - 3) < 12  # two of three poses; no findings
    found = solve_shared_again(known, others, arm, alone)
    expected = solve_with_findings(known, others, arm)
    np.testing.assert_allclose(found.solution, expected.solution[12:], atol=1e-10)
    for one, other in zip(found.covariances, expected.covariances, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-10)
    assert [str(c) for c in found.findings] == [str(c) for c in others]
    at = found.layout.blocks
    assert (at.sizes[0][1], found.layout.findings) == (6, (slice(9, 11), slice(11, 12)))
