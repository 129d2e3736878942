"""armd, the open driver for articulated measuring arms: the subscriber's public face.

Names are looked up when they are used: a command that needs no network does not pay for one.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from armd.errors import ArmdError, BadInput, NoAnswer

if TYPE_CHECKING:
    from armd import client, joints, keys, point
    from armd.client import Arm, connect
    from armd.joints import JOINTS_ENCODING, joints_dtype
    from armd.point import POINT, POINT_ENCODING, Flag, Lost, Point
    from armd.received import Refused
    from armd.zenoh_session import ENDPOINT

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
    "NoAnswer",
    "Point",
    "Refused",
    "client",
    "connect",
    "joints",
    "joints_dtype",
    "keys",
    "point",
]
__version__ = "0.2.0.dev0"

_MODULES = ("client", "joints", "keys", "point")
#: name → the module that it comes from
_HOMES = {
    "client": ("Arm", "connect"),
    "joints": ("JOINTS_ENCODING", "joints_dtype"),
    "point": ("POINT", "POINT_ENCODING", "Flag", "Lost", "Point"),
    "received": ("Refused",),
    "zenoh_session": ("ENDPOINT",),
}

if not TYPE_CHECKING:  # which would take every name for one that is there

    def __getattr__(name: str) -> Any:
        if name in _MODULES:
            return importlib.import_module(f"armd.{name}")
        for module, names in _HOMES.items():
            if name in names:
                value = globals()[name] = getattr(importlib.import_module(f"armd.{module}"), name)
                return value
        raise AttributeError(f"module 'armd' has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*__all__, *globals()})
