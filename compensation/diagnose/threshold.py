"""When a score is too high for noise: the largest of all candidates', simulated."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from armd.compensation.diagnose.fit import Fit

F64 = npt.NDArray[np.float64]

DRAWS = 200


def noise_draws(current: Fit, seed: int) -> F64:
    """Whitened noise (N, R) with no effect in it but with the tails that the residuals have.

    Every rest keeps its own residual in size; its sign is drawn anew. What rests share is drawn
    from its variance.
    """
    rng = np.random.default_rng(seed)
    n = 3 * current.linear.rests.n
    left = current.noise.whiten(current.residual - current.fitted)
    left /= max(float(np.sqrt(np.mean(left[:n] ** 2))), 1e-12)
    signs = np.ones((len(left), DRAWS))
    signs[:n] = np.repeat(rng.choice([-1.0, 1.0], (n // 3, DRAWS)), 3, axis=0)
    signs[n:] = rng.standard_normal((len(left) - n, DRAWS))
    draws = left[:, None] * signs
    finite = np.isfinite(current.absorbing.variance)
    columns = current.noise.whiten(current.absorbing.columns[:, finite])
    spread = np.sqrt(current.absorbing.variance[finite])
    return draws + columns @ (spread[:, None] * rng.standard_normal((int(finite.sum()), DRAWS)))


def effective_tests(least_log_p: F64) -> float:
    """How many independent tests the candidates amount to: median of the smallest p = ½^(1/K)."""
    if not len(least_log_p):
        return 1.0
    median = float(np.median(least_log_p))
    return max(1.0, float(-np.log(2.0) / np.log1p(-min(np.exp(median), 0.999))))


def family_wise(log_p: float, tests: float) -> float:
    """Probability that the smallest of *tests* p values falls below exp(log_p) by chance."""
    return float(-np.expm1(tests * np.log1p(-min(np.exp(log_p), 1.0 - 1e-15))))
