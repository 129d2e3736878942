"""A MicroScribe read over its wire, held against the truth of the simulated one."""

from __future__ import annotations

from contextlib import closing

import numpy as np

from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_pose
from armd.drivers.config import MicroScribeConfig
from armd.drivers.identity import Expectation
from armd.drivers.microscribe import wire
from armd.drivers.microscribe.geometry import compute_rows_and_tip
from armd.drivers.sample import Item, RawFrame
from armd.drivers.table import open_driver
from support.simulated_arm import SimulatedArm

PARAMETERS = bytes.fromhex(
    "C024 00003FF5FFF93FE5C002C00C 000003C028100215FE6F018F 206CFC92FFFD241C0140EB66"
)
TURNS = (16384, 16384, 8192, 4096, 4096)
EXPECTED = Expectation("40937", 5, 0, TURNS)


def read_until_end(arm: SimulatedArm, **config: object) -> tuple[list[Item], list[RawFrame], dict]:
    items: list[Item] = []
    raw: list[RawFrame] = []
    settings = MicroScribeConfig.model_validate({"kind": "microscribe", "port": arm.port, **config})
    with closing(open_driver(settings, EXPECTED)) as driver:
        while arm.process.poll() is None:
            items += driver.read(0.05)
            raw += driver.take_raw()
        return items, raw, driver.counters


def nominal() -> Arm:
    rows, tip = compute_rows_and_tip(wire.decode_words(PARAMETERS), 3)
    return Arm.model_validate(
        {
            "schema": "armd.arm/1",
            "serial_number": "40937",
            "joint": [
                {"d_mm": r.d_mm, "a_mm": r.a_mm, "alpha_deg": r.alpha_deg, "beta_deg": r.beta_deg}
                for r in rows
            ],
            "tip": {"offset_mm": tip},
        }
    )


def held_against_truth(arm: SimulatedArm, rows: np.ndarray) -> tuple[np.ndarray, ...]:
    """The truth that each row is nearest to of those within 0.1 s, how far it is from that, and how
    much later (ms) its stamp says that it was."""
    truth = arm.truth()
    instants = truth["seq"].astype(np.int64)
    tips = compute_pose(rows["count"] / np.array(TURNS) * 2 * np.pi, nominal().nominal())[0]
    nearest = np.empty(len(rows), int)
    for i, (tip, at_ns) in enumerate(zip(tips, rows["monotonic_ns"], strict=True)):
        first, last = np.searchsorted(instants, [at_ns - 100_000_000, at_ns + 100_000_000])
        near = slice(max(first - 1, 0), last + 1)
        apart_mm = np.linalg.norm(truth["position_mm"][near] - tip, axis=1)
        late = np.abs(instants[near] - at_ns)
        apart_mm = np.where(apart_mm < 0.5, late * 1e-12, apart_mm)  # of those that agree the first
        nearest[i] = near.start + int(np.argmin(apart_mm))
    true_mm = truth["position_mm"][nearest]
    late_ms = (rows["monotonic_ns"] - instants[nearest]) / 1e6
    return true_mm, np.linalg.norm(tips - true_mm, axis=1), late_ms
