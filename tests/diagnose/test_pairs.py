"""Products within candidates, of columns that nobody made, against the columns."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.diagnose.problem import pairs
from armd.compensation.diagnose.problem.pairs import Part, Within

N, PARAMETERS, BASES = 23, 6, 5


def drawn(rng: np.random.Generator) -> list[list[list[Part]]]:
    """Candidates of one to four columns of one to three parts; parameters and bases recur."""
    return [
        [
            [
                (int(rng.integers(PARAMETERS)), float(rng.normal()), int(rng.integers(BASES)))
                for _ in range(rng.integers(1, 4))
            ]
            for _ in range(rng.integers(1, 5))
        ]
        for _ in range(9)
    ]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("at_once", [(256, 1024), (3, 7)])
def test_elements_are_the_upper_triangles_of_each_ones_products(
    monkeypatch: pytest.MonkeyPatch, seed: int, at_once: tuple[int, int]
) -> None:
    monkeypatch.setattr(pairs, "PAIRS_CHUNK", at_once[0])
    monkeypatch.setattr(pairs, "PAIRS_PIECE", at_once[1])
    rng = np.random.default_rng(seed)
    candidates = drawn(rng)
    jacobian, bases = rng.normal(size=(PARAMETERS, N, 3)), rng.normal(size=(BASES, N))
    within = Within.from_candidates(candidates)
    found = within.products(jacobian, bases)
    ends = [*within.first[1:], len(found)]
    for columns, begin, end in zip(candidates, within.first, ends, strict=True):
        full = np.array(
            [sum(w * jacobian[p] * bases[b][:, None] for p, w, b in parts) for parts in columns]
        ).reshape(len(columns), 3 * N)
        expected = (full @ full.T)[np.triu_indices(len(columns))]
        assert found[begin:end] == pytest.approx(expected, abs=1e-9)


def test_a_pair_of_parameters_is_multiplied_once_whoever_has_it() -> None:
    """Two candidates of one parameter, each with a basis of its own: one product of parameters."""
    within = Within.from_candidates([[[(2, 1.0, 0)]], [[(2, -1.0, 1)]]])
    assert within.parameters.tolist() == [[2, 2]]
    assert [len(group) for group, _ in within.groups] == [2]


def test_no_candidates_have_no_products() -> None:
    assert len(Within.from_candidates([]).products(np.zeros((1, N, 3)), np.zeros((1, N)))) == 0
