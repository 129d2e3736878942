"""armd's own simulated servo arm; after 10 s every servo says 0 or 1 as its position.

python quirk_servo.py --servo dynamixel --arm-out arm.toml --seconds 30 --link port
"""

import os
import sys
from pathlib import Path

import armd.simulator.servobus.servo as servo

WHEN = os.environ.get("STUCK_WHEN")  # this file is there; without it after 10 s
feel = servo.SimulatedServo.feel


def stuck(self, raw, celsius, time_s, runs_on):
    if Path(WHEN).exists() if WHEN else time_s > 10:
        raw, runs_on = self.id % 2, False
    feel(self, raw, celsius, time_s, runs_on)


servo.SimulatedServo.feel = stuck

from armd.simulator.__main__ import main  # noqa: E402

sys.exit(main(sys.argv[1:]))
