"""Nuisances projected out, also where LAPACK's quicker way does not converge."""

from pathlib import Path

import numpy as np

from armd.compensation.identify.elimination import _Range

#: Upper triangle, row by row, of what 20 targets measured alike came to in one calibration:
#: 54 singular values agree to 1e-7, and gesdd (OpenBLAS 0.3.31) gives up on it.
CLUSTERED = Path(__file__).parent / "data" / "clustered_triangle.npy"


def test_clustered_singular_values_are_decomposed() -> None:
    triangle = np.zeros((60, 60))
    triangle[np.triu_indices(60)] = np.load(CLUSTERED)
    found = _Range(triangle, np.linalg.norm(triangle, axis=0))
    assert found.rank == 60
    rows = np.random.default_rng(1).normal(size=60)
    np.testing.assert_allclose(triangle @ found.solve(rows), rows, atol=1e-12)
    np.testing.assert_allclose(found.clear(rows), 0.0, atol=1e-12)
