"""Runs the live pipeline once on made-up samples, so that it is compiled before the daemon is
ready.
"""

from __future__ import annotations

import numpy as np

from armd.daemon.config import Config
from armd.daemon.health import Tally
from armd.daemon.live.arm_in_use import ArmInUse
from armd.daemon.live.measurement import Averager
from armd.daemon.live.pipeline import Pipeline
from armd.drivers.sample import Temperatures, sample_dtype


def run_rehearsal(config: Config, arm: ArmInUse) -> None:
    """Run a pipeline of its own, without a change of *arm*."""
    pipeline = Pipeline(config.arm, arm.calibration, config.file.limits)
    celsius = np.full(len(config.arm.sensors), config.arm.reference_temperature_c)
    pipeline.take_temperatures(Temperatures(celsius, 0, 0, 0))
    samples = np.zeros(1, sample_dtype(config.arm.n_joints))
    samples["buttons"] = 1
    points, joints = pipeline.correct(samples)
    Averager(1.0, config.arm.n_joints).remember(points, joints.q)
    tally = Tally(0)
    tally.add(points, samples, 0)
    tally.count()
