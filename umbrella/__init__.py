"""armd, the open driver for articulated measuring arms: the subscriber's public face."""

from armd.client import ENDPOINT, Arm, connect
from armd.errors import ArmdError, BadInput
from armd.joints import JOINTS_ENCODING, joints_dtype
from armd.point import POINT, POINT_ENCODING, Flag, Lost, Point

__all__ = [
    "ENDPOINT",
    "JOINTS_ENCODING",
    "POINT",
    "POINT_ENCODING",
    "Arm",
    "ArmdError",
    "BadInput",
    "Flag",
    "Lost",
    "Point",
    "connect",
    "joints_dtype",
]
__version__ = "0.1.0"
