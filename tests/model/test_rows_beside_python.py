"""Python runs in other threads while many rows are computed, also by the library made ahead."""

from __future__ import annotations

import threading

import numpy as np

from armd.compensation.kernel import kernel
from armd.compensation.kernel.model import Model
from support.synthetic import arm as synthetic_arm

ROWS = 400_000
TRIES = 20


def test_python_runs_while_rows_are_computed() -> None:
    arm = synthetic_arm()
    model, n_joints = Model(arm, None), arm.n_joints
    q = np.random.default_rng(1).uniform(-1.0, 1.0, (ROWS, n_joints))
    slow, missing = np.zeros((ROWS, 0)), np.full((ROWS, n_joints), np.nan)
    position, none = np.empty((ROWS, 3)), np.empty((0, 3))

    def compute() -> None:
        rows = (q, missing, np.full((ROWS, 3), np.nan), model.flat.for_batches(), position, none)
        kernel.correct_runs(slow, model._amounts, *rows)

    compute()  # loaded, or compiled
    for _ in range(TRIES):
        position[:] = np.nan
        thread = threading.Thread(target=compute)
        thread.start()
        was_between = False
        while thread.is_alive() and not was_between:
            was_between = bool(np.isfinite(position[0, 0]) and np.isnan(position[-1, 0]))
        thread.join()
        assert np.isfinite(position[-1]).all()
        if was_between:
            return
    raise AssertionError(f"never between the first and the last of {ROWS} rows")
