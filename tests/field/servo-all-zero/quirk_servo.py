"""armd's own simulated servo arm; after 10 s every servo says 0 or 1 as its position.

python quirk_servo.py --servo dynamixel --arm-out arm.toml --seconds 30 --link port
"""

import sys

import armd.simulator.servobus.servo as servo

feel = servo.SimulatedServo.feel


def stuck(self, raw, celsius, time_s, runs_on):
    if time_s > 10:
        raw, runs_on = self.id % 2, False
    feel(self, raw, celsius, time_s, runs_on)


servo.SimulatedServo.feel = stuck

from armd.simulator.__main__ import main  # noqa: E402

sys.exit(main(sys.argv[1:]))
