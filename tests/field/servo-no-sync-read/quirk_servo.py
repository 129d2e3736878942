"""armd's own simulated Feetech arm whose servos answer ping and read, and not sync read.

python quirk_servo.py --servo feetech --arm-out arm.toml --seconds 40 --link port
"""

import sys

import armd.simulator.servobus.device as device

obey = device.ServoBus._obey
device.ServoBus._obey = lambda self, packet, heard: (
    None if packet.code in (0x82, 0x8A) else obey(self, packet, heard)
)

from armd.simulator.__main__ import main  # noqa: E402

sys.exit(main(sys.argv[1:]))
