"""The batch kernel against C of the same mathematics, and against what the machine can do; one live
call; what a covariance and what a pose term costs.

"batch" is compiled in the process, for this processor; "rows" is what `armd evaluate` calls, by the
library if there is one, which is for any processor of its kind: it compares each row's temperatures
with the one's before, too.

All in one process and one run, on the same inputs, the results held against each other. Every
figure is the best of many short rounds taken in turn, so that a busy machine slows all alike.
"""

from __future__ import annotations

import ctypes
import math
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from armd import POINT
from armd.arrays import F64
from armd.compensation.kernel import kernel
from armd.compensation.kernel.model import Model
from armd.compensation.kernel.points import fill
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.model.kinematics import compute_jacobian
from armd.compensation.model.state import States
from support.drawn import drawn

SAMPLES = 1 << 14
ROUNDS = 60
AGREEMENT_MM = 1e-9
#: Additions and multiplications of one sample in a batch, counted in `chain` and `kernel`, a fused
#: one as two; the quadrant takes none, but integers. Of each joint: its sine and cosine (reduction
#: 9, polynomials 25) and its step toward the world (18 of the matrix, 6 of the turn).
OPERATIONS = 6 * (9 + 25 + 18 + 6)
FLAGS = {
    "one_by_one": ["-O3"],
    "in_blocks": ["-O3", "-march=native", "-ffast-math"],
}


def run() -> dict[str, Any]:
    """Nanoseconds per sample, and ratios."""
    arm, angle = an_arm(), np.random.default_rng(1).uniform(-3, 3, (SAMPLES, 6))
    coefficients = np.random.default_rng(2).normal(0, 1, (6, 5, 4)) * [1e-6, 1e-7, 1e-9, 1e-11]
    celsius = np.linspace(22.0, 27.0, 6)
    model = Model(arm, calibrated(arm, polynomial_terms(coefficients)))
    model.fold(celsius, 0.0)
    flat = model.flat.for_batches()
    nothing = np.zeros((SAMPLES, 6)), np.zeros((SAMPLES, 3))
    position = np.empty((SAMPLES, 3))
    no_correction = np.empty((0, 3))

    def batch() -> F64:
        kernel.correct(angle, *nothing, flat, position, no_correction)
        return position

    states = States(angle, nothing[0], np.tile(celsius, (SAMPLES, 1)), np.zeros(SAMPLES),
                    nothing[1], np.zeros(SAMPLES, np.int64))  # fmt: skip
    slow = np.ascontiguousarray(model.slow_values(states))

    def rows() -> F64:
        return model.position_rows(states, slow)

    ways: dict[str, Callable[[], F64]] = {"kernel": batch, "rows": rows}
    with tempfile.TemporaryDirectory() as folder:
        if shutil.which("gcc"):
            for name, flags in FLAGS.items():
                ways[name] = _c(name, flags, Path(folder), arm, coefficients, angle, celsius)
        truth = ways["kernel"]().copy()
        for name, way in ways.items():
            apart = float(np.abs(way() - truth).max())
            assert apart < AGREEMENT_MM, f"{name} differs by {apart} mm"
        ns = {name: best / SAMPLES for name, best in best_ns(ways).items()}
        peak_per_ns = _peak_per_ns(Path(folder)) if shutil.which("gcc") else math.nan
    figures: dict[str, Any] = {"batch_ns": ns["kernel"], "rows_ns": ns["rows"]}
    if "in_blocks" in ns:
        figures |= {
            "c_scalar_ns": ns["one_by_one"],
            "c_vectorised_ns": ns["in_blocks"],
            "times_faster_than_scalar_c": ns["one_by_one"] / ns["kernel"],
            "ratio_to_vectorised_c": ns["kernel"] / ns["in_blocks"],
            "operations": OPERATIONS,
            "operations_per_ns": OPERATIONS / ns["kernel"],
            "multiply_add_operations_per_ns": peak_per_ns,
            "share_of_peak": OPERATIONS / ns["kernel"] / peak_per_ns,
        }
    return figures | {
        "covariance": covariance(model),
        "live": live(model),
        "pose_terms": pose_terms(arm),
    }


def covariance(model: Model) -> dict[str, float]:
    """What a covariance adds to a point, in a batch and live, ns; its floor is the product of the
    derivatives and the factor alone, by BLAS."""
    n, angle = 1 << 11, np.random.default_rng(1).uniform(-3, 3, (1 << 11, 6))
    unknown = np.full((n, 6), np.nan), np.full((n, 3), np.nan)
    celsius = np.full((n, 6), 25.0)
    states = States(angle, unknown[0], celsius, np.zeros(n), unknown[1], np.zeros(n, np.int64))
    slow = np.ascontiguousarray(model.slow_values(states))
    model.fold(celsius[0], 0.0)
    factor, rows, floor = model.covariance
    derivatives = compute_jacobian(angle, model.constants)[1][:, :, rows].reshape(3 * n, -1)
    product, points = np.empty((3 * n, factor.shape[1])), np.zeros(n, POINT)

    def live(floor_mm2: float) -> Callable[[], object]:
        return lambda: fill(angle, *unknown, model.flat, factor, rows, floor_mm2, points)

    best = best_ns(
        {
            "batch": lambda: model.covariance_rows(states, slow),
            "floor": lambda: np.matmul(derivatives, factor, out=product),
            "live": live(floor),
            "position": live(math.nan),
        }
    )
    return {
        "batch_ns": best["batch"] / n,
        "live_ns": (best["live"] - best["position"]) / n,
        "product_alone_ns": best["floor"] / n,
    }


def live(model: Model) -> dict[str, float]:
    """One sample: uncorrected tip, then the finished point with covariance."""
    q, approach, points = np.zeros((1, 6)), np.zeros((1, 3)), np.zeros(1, POINT)
    tip = np.zeros((1, 3))
    batch = np.zeros((64, 6)), np.zeros((64, 6)), np.zeros((64, 3)), np.zeros(64, POINT)
    ways: dict[str, Callable[[], object]] = {
        "uncorrected_call_ns": lambda: kernel.compute_uncorrected(q, model.flat, tip),
        "point_call_ns": lambda: model.correct(q, q, approach, points),
        "point_of_64_ns": lambda: model.correct(*batch),
        "fold_us": lambda: model.fold(np.full(6, 25.0), 0.0),
    }
    best = best_ns(ways, calls=20)
    best["point_of_64_ns"] /= 64
    best["fold_us"] /= 1000
    return best


def pose_terms(arm: Arm) -> dict[str, float]:
    """What terms add to a sample in a batch, ns: the first of a joint, and each further one."""
    harmonic = {"kind": "sin", "joint": 3}
    first = [("theta_3", harmonic)]
    sets = {
        "none": [],
        "first": first,
        "eccentricity_everywhere": [
            (f"theta_{k}", {"kind": kind, "joint": k})
            for k in range(1, 7)
            for kind in ("sin", "cos")
        ],
        "another_first_order": [*first, ("theta_3", {"kind": "cos", "joint": 3})],
        "another_order": [*first, ("theta_3", {"kind": "sin", "joint": 3, "order": 2})],
        "another_curve": [*first, ("theta_3", {"kind": "curve", "joint": 3, "values": [0.0] * 64})],
        "another_gravity_torque": [*first, ("theta_3", {"kind": "gravity_torque", "joint": 3})],
    }
    q = np.random.default_rng(1).uniform(-3, 3, (SAMPLES, 6))
    nothing = np.zeros((SAMPLES, 6)), np.zeros((SAMPLES, 3))
    position, no_correction = np.empty((SAMPLES, 3)), np.empty((0, 3))

    def way(chosen: list[tuple[str, dict[str, object]]]) -> Callable[[], object]:
        terms = [
            {"parameter": name, "basis": [factor], "coefficient": 1e-6} for name, factor in chosen
        ]
        flat = Model(arm, calibrated(arm, terms)).flat.for_batches()
        return lambda: kernel.correct(q, *nothing, flat, position, no_correction)

    best = best_ns({name: way(chosen) for name, chosen in sets.items()})
    ns = {name: value / SAMPLES for name, value in best.items()}
    return {
        "first_of_a_joint_ns": ns["first"] - ns["none"],
        "twelve_over_six_joints_ns": ns["eccentricity_everywhere"] - ns["none"],
        **{name + "_ns": ns[name] - ns["first"] for name in ns if name.startswith("another")},
    }


def best_ns(ways: dict[str, Callable[[], object]], calls: int = 1) -> dict[str, float]:
    """The shortest time of one call of each, in ns, rounds taken in turn."""
    best = dict.fromkeys(ways, float("inf"))
    for way in ways.values():
        way()
    for _ in range(ROUNDS):
        for name, way in ways.items():
            start = time.perf_counter_ns()
            for _ in range(calls):
                way()
            best[name] = min(best[name], (time.perf_counter_ns() - start) / calls)
    return best


def an_arm() -> Arm:
    joints = [(280.0, 0.0, 90.0), (130.0, 520.0, 0.0), (0.0, 40.0, 90.0)]
    joints += [(460.0, 0.0, -90.0), (0.0, 0.0, 90.0), (120.0, 0.0, 0.0)]
    return Arm.model_validate(
        {
            "schema": "armd.arm/1",
            "serial_number": "BENCH",
            "temperature_sensor": [{"name": f"t{k}"} for k in range(1, 7)],
            "joint": [
                {"d_mm": d, "a_mm": a, "alpha_deg": alpha, "temperature": f"t{k}"}
                for k, (d, a, alpha) in enumerate(joints, 1)
            ],
            "tip": {"offset_mm": [45.0, 0.0, 110.0]},
        }
    )


def calibrated(arm: Arm, terms: list[dict[str, object]]) -> LoadedCalibration:
    known = {"covariance_of": arm.layout.names[:30], "covariance": (np.eye(30) * 1e-10).tolist()}
    return LoadedCalibration(drawn(arm, terms=terms, **known), "00" * 32, Path("bench.json"))


def polynomial_terms(coefficients: F64) -> list[dict[str, object]]:
    """All 30 parameters as fourth-order polynomials of their joint's temperature."""
    names = ("theta", "d", "a", "alpha", "beta")
    return [
        {
            "parameter": f"{name}_{k + 1}",
            "basis": [{"kind": "temperature", "weights": {f"t{k + 1}": 1.0}, "order": order + 1}],
            "coefficient": float(coefficients[k, j, order]),
        }
        for k in range(6)
        for j, name in enumerate(names)
        for order in range(4)
    ]


def _peak_per_ns(folder: Path) -> float:
    """Operations in a nanosecond, of fused multiply-adds alone."""
    function = ctypes.CDLL(str(folder / "in_blocks.so")).multiply_add
    function.restype = ctypes.c_double
    count, by, out = ctypes.c_long(2000), ctypes.c_double(0.999), ctypes.c_double()
    operations = float(function(count, by, ctypes.byref(out)))
    best = best_ns({"peak": lambda: function(count, by, ctypes.byref(out))}, calls=1)
    return operations / best["peak"]


def _c(
    name: str, flags: list[str], folder: Path, arm: Arm, coefficients: F64, angle: F64, celsius: F64
) -> Callable[[], F64]:
    library = folder / f"{name}.so"
    source = Path(__file__).with_name("forward.c")
    command = ["gcc", *flags, "-shared", "-fPIC", str(source), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)
    function = getattr(ctypes.CDLL(str(library)), name)
    n = len(angle)
    arrays = [
        angle,
        np.tile(celsius - 20.0, (n, 1)),
        arm.nominal()[:30].copy(),
        coefficients,
        arm.nominal()[30:33].copy(),
        np.empty((n, 3)),
    ]
    pointers = [array.ctypes.data_as(ctypes.c_void_p) for array in arrays]

    def call() -> F64:
        function(ctypes.c_long(n), *pointers)
        return arrays[-1]

    return call
