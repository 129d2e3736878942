"""What is eliminated once for all sizes, against each size by itself; and how often it is done."""

from __future__ import annotations

import numpy as np
import pytest
from test_interim_changes import off_from
from test_interim_evidence import with_standing

from armd.arrays import F64
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.evidence import stack as stacked
from armd.compensation.interim.evidence.elimination import (
    CheckSums,
    EliminatedErrors,
    eliminate_standing,
)
from armd.compensation.interim.evidence.likelihood import integrate_amplitudes, weigh
from armd.compensation.interim.evidence.stack import RunningSums, Stack
from armd.compensation.interim.evidence.watch import UNSETTLED, detect_changes

SCALES = (0.03, 0.3, 1.0, 10.0)


@pytest.mark.parametrize("standing", [slice(2, 5), slice(0, 0), slice(0, 6)])
def test_one_rotation_does_for_every_size(standing: slice) -> None:
    rng = np.random.default_rng(3)
    rows = 30.0 * rng.normal(size=(20, 6))
    rows[:, 4] = rows[:, 3]  # two errors that no reading tells apart
    residual = rng.normal(size=20)
    side, square = rows.T @ residual, float(residual @ residual)
    known = eliminate_standing(rows.T @ rows, side, square, standing, SCALES)
    for k, scale in enumerate(SCALES):
        prior = np.ones(6)
        prior[standing] = scale**2
        inverse = np.linalg.inv(rows.T @ rows + np.diag(1.0 / prior))
        found = known.rotation.T @ np.diag(known.weights[k]) @ known.rotation
        # Of a condition of 1e6 both inverses have ten digits.
        assert found == pytest.approx(inverse, rel=1e-8, abs=1e-12)
        assert known.rotation @ side == pytest.approx(known.side)
        assert known.square[k] == pytest.approx(square - side @ inverse @ side, abs=1e-9)
        covariance = np.eye(20) + rows @ np.diag(prior) @ rows.T
        assert known.spread[k] == pytest.approx(0.5 * np.linalg.slogdet(covariance)[1], abs=1e-9)


@pytest.mark.parametrize("p", [1, 2, 4])
def test_amplitudes_of_many_grams_at_once_are_those_of_each(p: int) -> None:
    rng = np.random.default_rng(p)
    rows = 10.0 * rng.normal(size=(7, 5, p))
    rows[:, :, -1] *= 1e-9  # hardly seen
    gram, side = rows.transpose(0, 2, 1) @ rows, rng.normal(size=(7, p))
    sizes = (0.1, 1.0, 10.0)
    lower = {(i, j): gram[:, i, j] for i in range(p) for j in range(i + 1)}
    spread, quad = integrate_amplitudes(lower, list(side.T), sizes)
    for s, size in enumerate(sizes):
        whole = np.eye(p) + size**2 * gram
        assert spread[:, s] == pytest.approx(np.linalg.slogdet(whole)[1], abs=1e-9)
        told = np.linalg.solve(whole, side[..., None])[..., 0]
        assert quad[:, s] == pytest.approx(size**2 * (side * told).sum(axis=1))


@pytest.mark.parametrize("left_out", [(), (4,), (3, 4), (1, 3)])
@pytest.mark.parametrize("back", [1, 9])
def test_sums_without_some_of_the_last_checks_are_those_of_the_others(
    left_out: tuple[int, ...], back: int
) -> None:
    of, causes = with_standing(1)
    n = 5
    some, begin = RunningSums(of).drop_checks(left_out, n, back)
    kept = [i for i in range(n) if i not in left_out]
    anew = RunningSums(of.select_checks(kept))
    onsets = np.arange(max(0, len(kept) - back), len(kept))
    expected = weigh(anew, causes, len(kept), onsets)
    # Counted from where these sums begin; none that is left out lies before.
    found = weigh(some, causes, some.stack.n, onsets - begin)
    assert found.log_by_size == pytest.approx(expected.log_by_size, abs=1e-8)


def eliminations(of: Stack, causes: list[Cause], monkeypatch: pytest.MonkeyPatch) -> int:
    """How often known errors are eliminated while these checks are watched."""
    count = 0

    def counted(
        curvature: F64, side: F64, square: float, standing: slice, scales: tuple[float, ...]
    ) -> EliminatedErrors:
        nonlocal count
        count += 1
        return eliminate_standing(curvature, side, square, standing, scales)

    def never(of: Stack, chosen: object) -> CheckSums:
        raise AssertionError("summed up anew")

    with monkeypatch.context() as patched:
        patched.setattr(stacked, "eliminate_standing", counted)
        patched.setattr(Stack, "sum_checks", never)
        assert detect_changes(of, causes).alarm is None
    return count


def test_a_check_more_costs_the_same_however_many_there_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    of, causes = off_from(np.random.default_rng(0), 99, 99)  # never off
    each = 1 + UNSETTLED  # the statistic, and whether any of the last checks was spoilt
    found = [eliminations(of.select_checks(range(n)), causes, monkeypatch) for n in (10, 20, 40)]
    assert np.diff(found).tolist() == [10 * each, 20 * each]
