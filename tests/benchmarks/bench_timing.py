"""What timing alone costs: latch skew of each joint and error of the stamps, serial and CAN.

The simulator's arm moves the same for the same seed, so its true angles are known at every
instant. A real driver reads the simulated arm from its wire; then

- the error of a sample's stamp is its `monotonic_ns` against the true latch, and
- the skew of a joint is the delay by which its counts would have to be shifted to lie on its true
  angles at the stamped instants: the regression of the difference on the joint's rate.

Both are shown as a position error of a tip at 0.5 m/s.
"""

from __future__ import annotations

import json
import tempfile
import time
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from armd.drivers.config import CanConfig, SerialConfig
from armd.drivers.identity import Expectation
from armd.drivers.table import open_driver
from armd.simulator.live.electronics import COUNTS_PER_TURN
from armd.simulator.live.operator import Operator
from armd.simulator.live.physics import STEP_S, STEPS, generate_blocks
from armd.simulator.truth.arm import TrueArm
from support.simulated_arm import SimulatedArm, simulated_arm

TIP_MM_S = 500.0
SEED = 1
SETTLE_S = 3.0  # the contract's time for mapping the clock
GRID_HZ = 1000


def run(seconds: float = 15.0) -> dict[str, Any]:
    """Figures by wire: `serial_1000_hz`, `can_500_hz`."""
    return {"serial_1000_hz": _serial(seconds), "can_500_hz": _can(seconds)}


def _serial(seconds: float) -> dict[str, Any]:
    with tempfile.TemporaryDirectory() as name, simulated_arm(Path(name), seconds=seconds) as arm:
        samples = _samples(arm, SerialConfig(kind="serial", port=arm.port))
        boot = arm.events("boot")[0]
        latch_ns = arm.latch_ns(samples["seq"].astype(np.int64))
    return _figures(samples, latch_ns, boot["latch_monotonic_ns"], boot["clock_ppm"], seconds)


def _can(seconds: float) -> dict[str, Any]:
    wire = ("--can", "socketcand")
    with (
        tempfile.TemporaryDirectory() as name,
        simulated_arm(Path(name), wire=wire, seconds=seconds) as arm,
    ):
        host, port = arm.port.split(":")
        config = CanConfig.model_validate(
            {"kind": "can", "interface": "socketcand", "channel": "can0", "host": host}
            | {"port": int(port), "rate_hz": 500.0}
        )
        samples = _samples(arm, config)
        true_ns = arm.truth()["seq"].astype(np.int64)
        start = arm.events("start")[0]
    after = np.clip(np.searchsorted(true_ns, samples["monotonic_ns"]), 1, len(true_ns) - 1)
    before_ns, after_ns = true_ns[after - 1], true_ns[after]
    nearer = samples["monotonic_ns"] - before_ns < after_ns - samples["monotonic_ns"]
    latch_ns = np.where(nearer, before_ns, after_ns)
    return _figures(samples, latch_ns, start["start_monotonic_ns"], 0.0, seconds)


def _samples(arm: SimulatedArm, config: SerialConfig | CanConfig) -> np.ndarray:
    """Valid samples with a mapped clock, read until the simulated arm ends."""
    expectation = Expectation("SIM-0001", 6, 6, (COUNTS_PER_TURN,) * 6)
    driver = open_driver(config, expectation)
    arrays = []
    try:
        while arm.process.poll() is None:
            arrays += [item for item in driver.read(0.2) if isinstance(item, np.ndarray)]
    finally:
        driver.close()
    samples = np.concatenate(arrays)
    settled = samples["monotonic_ns"] > samples["monotonic_ns"][0] + SETTLE_S * 1e9
    return samples[samples["clock_mapped"] & (samples["joint_invalid"] == 0) & settled]


def _figures(
    samples: np.ndarray, latch_ns: np.ndarray, start_ns: int, clock_ppm: float, seconds: float
) -> dict[str, Any]:
    arm = TrueArm.default(SEED)
    life = islice(
        generate_blocks(arm, Operator(arm, SEED), GRID_HZ, 20.0, None),
        round(seconds / (STEPS * STEP_S)) + 2,
    )
    true_rad = np.concatenate([block.encoder_rad for block in life])
    grid_s = np.arange(len(true_rad)) / GRID_HZ
    stamped_s = (samples["monotonic_ns"] - start_ns) * 1e-9 * (1 + clock_ppm * 1e-6)
    error_us = np.abs(samples["monotonic_ns"] - latch_ns) * 1e-3
    p50, p99, worst = (float(np.percentile(error_us, p)) for p in (50, 99, 100))
    usual = error_us <= p99  # single late stamps are told by p99 and max, not by the mean
    skew_us = []
    for joint in range(true_rad.shape[1]):
        shown = samples["count"][:, joint] * (2 * np.pi / COUNTS_PER_TURN)
        rate = np.interp(stamped_s, grid_s, np.gradient(true_rad[:, joint], 1 / GRID_HZ))
        ahead = shown - np.interp(stamped_s, grid_s, true_rad[:, joint])
        ahead -= 2 * np.pi * np.round(np.median(ahead) / (2 * np.pi))
        rate, ahead = rate[usual], ahead[usual]
        skew_us.append(-1e6 * float(rate @ ahead) / float(rate @ rate))
    spread_us = max(skew_us) - min(skew_us)
    return {
        "samples": len(samples),
        "stamp_error_us": {"p50": p50, "p99": p99, "max": worst},
        "joint_skew_us": [round(skew, 3) for skew in skew_us],
        "skew_between_joints_us": spread_us,
        "position_error_um_at_0.5_m_s": {
            "p50": p50 * TIP_MM_S * 1e-3,
            "p99": p99 * TIP_MM_S * 1e-3,
            "max": worst * TIP_MM_S * 1e-3,
            "between_joints": spread_us * TIP_MM_S * 1e-3,
        },
    }


def main() -> None:
    start = time.monotonic()
    for wire, figures in run().items():
        print(f"{wire}: {json.dumps(figures)}")
    print(f"{time.monotonic() - start:.0f} s")


if __name__ == "__main__":
    main()
