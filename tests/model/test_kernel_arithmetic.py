"""The kernel's sine and cosine against numpy's in long double; and the batch kernel compiled for
any processor of this kind: the same positions, and vectors all the same (an x86-64 has SSE2)."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from armd.compensation.kernel.chain import compute_sincos
from armd.compensation.kernel.memory import BLOCK
from armd.compiled.jit import jit

PROGRAM = """
import sys
import numpy as np
from armd.compensation.kernel import kernel
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm

joint = {"d_mm": 120.0, "a_mm": 300.0, "alpha_deg": 90.0}
arm = Arm.model_validate({
    "schema": "armd.arm/1", "serial_number": "ANY", "joint": 6 * [joint],
    "tip": {"offset_mm": [45.0, 0.0, 110.0]},
})
q = np.random.default_rng(1).uniform(-3, 3, (1000, 6))
position = np.empty((1000, 3))
nothing = np.zeros((1000, 6)), np.zeros((1000, 3))
kernel.correct(q, *nothing, Model(arm, None).flat.for_batches(), position, np.empty((0, 3)))
(code,) = kernel.correct.inspect_asm().values()
np.savez(sys.argv[1], position=position, ymm="ymm" in code, mulpd="mulpd\\t" in code)
"""


@jit
def all_of(angle: np.ndarray, found: np.ndarray) -> None:
    compute_sincos(angle, 0, len(angle), 1.0, found, 0)


@pytest.mark.parametrize("reach_rad", [0.8, 3.2, 100.0])
def test_error_is_below_its_word(reach_rad: float) -> None:
    angle = np.linspace(-reach_rad, reach_rad, 999 * BLOCK).reshape(-1, BLOCK)
    angle[0, :9] = np.arange(-4, 5) * (np.pi / 4)
    found = np.empty((2 * len(angle), BLOCK))
    all_of(angle, found)
    exact = angle.astype(np.longdouble)
    # Without a fused multiply-add the reduction rounds as the angle itself was rounded.
    bound = 2e-16 + np.spacing(np.abs(angle)) / 2
    assert (np.abs(found[0::2] - np.sin(exact)) < bound).all()
    assert (np.abs(found[1::2] - np.cos(exact)) < bound).all()


def run(folder: Path, name: str, **processor: str) -> dict[str, np.ndarray]:
    subprocess.run(
        [sys.executable, "-c", PROGRAM, folder / f"{name}.npz"],
        env={
            **os.environ, "ARMD_WITHOUT_LIBRARY": "1", "NUMBA_CACHE_DIR": str(folder / name),
            **processor,
        },
        check=True,
        timeout=580,
    )  # fmt: skip
    return dict(np.load(folder / f"{name}.npz"))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1200)  # it compiles twice, half a minute each where nothing else runs
def test_without_avx_it_gives_the_same_positions(tmp_path: Path) -> None:
    own = run(tmp_path, "own")
    least = run(tmp_path, "least", NUMBA_CPU_NAME="generic", NUMBA_CPU_FEATURES="")
    # Within the rounding of a few operations on lengths of 2 m, fused or not.
    np.testing.assert_allclose(least["position"], own["position"], rtol=0, atol=5e-12)
    if platform.machine() == "x86_64":
        assert least["mulpd"] and not least["ymm"]
