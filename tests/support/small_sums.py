"""Three candidates beside four shared columns, made up by hand: their sums of products."""

from types import SimpleNamespace
from typing import Any

import numpy as np

from armd.compensation.diagnose.problem.signatures import identify_kind
from armd.compensation.diagnose.scoring.evidence import Sums
from armd.compensation.estimate.linear.linear_model import LinearModel
from support.small_fit import candidate

N = 90
CANDIDATES = [
    candidate("encoder_scale", 1),
    candidate("encoder_slip", 2, 2),
    candidate("unknown", 3),
]
TYPICAL, REACH = np.array([0.3, 2.0, 0.5, 1.0]), np.array([np.inf, np.inf, 5.0, np.inf])


def problem(seed: int = 1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nuisance columns (N, 4), candidates' (N, 4), residual (N,) that the second explains."""
    rng = np.random.default_rng(seed)
    b, x = rng.normal(size=(N, 4)), rng.normal(size=(N, 4))
    x[:, 0] += 2.0 * b[:, 1]
    return b, x, rng.normal(size=N) + b @ [3.0, -1.0, 0.0, 2.0] + x[:, 1] * 0.8


def sums_of(b: np.ndarray, x: np.ndarray, r: np.ndarray, variance: np.ndarray) -> Sums:
    counts = [len(c.columns) for c in CANDIDATES]
    first = np.cumsum([0, *counts[:-1]])
    signatures: Any = SimpleNamespace(
        candidates=tuple(CANDIDATES),
        first=first,
        count=np.array(counts),
        kinds=tuple(map(identify_kind, CANDIDATES)),
        prior_sd=TYPICAL,
        reach=REACH,
        columns_of=lambda i: range(first[i], first[i] + counts[i]),
    )
    grams = {
        m: (
            np.flatnonzero(np.array(counts) == m),
            np.stack(
                [
                    x[:, f : f + m].T @ x[:, f : f + m]
                    for f, c in zip(first, counts, strict=True)
                    if c == m
                ]
            ),
        )
        for m in set(counts)
    }
    shared = LinearModel.from_rows([("shared", b, variance)])
    return Sums(signatures, shared, b.T @ r, b.T @ x, x.T @ r, (x**2).sum(axis=0), grams)
