"""What a simulated servo arm's encoders showed, by the simulator's own clock."""

from __future__ import annotations

import time

import numpy as np

from armd.simulator.servobus.arm import ServoArm, list_servo_ids

JOINTS = list(list_servo_ids(5)[:5])


class Truth:
    """What the encoders showed between two instants, each joint by itself."""

    def __init__(self, arm):
        while not arm.events("boot"):
            time.sleep(0.01)
        self._began_ns = arm.events("boot")[0]["monotonic_ns"]
        self._arm = ServoArm(1, 20.0)

    def raw(self, instant_ns):
        return [self._arm.raw(k, (instant_ns - self._began_ns) * 1e-9) for k in JOINTS]

    def agrees(self, raw, before_ns, after_ns):
        """Whether *raw* (5,) were shown within a call of a client's, to a count."""
        shown = np.array([self.raw(t) for t in np.linspace(before_ns, after_ns, 40)])
        raw = np.array(raw)
        return ((raw >= shown.min(axis=0) - 1) & (raw <= shown.max(axis=0) + 1)).all()
