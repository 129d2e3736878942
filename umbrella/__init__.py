"""armd, the open driver for articulated measuring arms: the subscriber's public face."""

from armd.errors import ArmdError, BadInput
from armd.point import POINT, POINT_ENCODING, Flag

__all__ = ["POINT", "POINT_ENCODING", "ArmdError", "BadInput", "Flag"]
__version__ = "0.1.0"
