"""armd, the open driver for articulated measuring arms: its public names (docs/how-to/python.md).

Names are loaded when they are used, so a command without network does not load Zenoh.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from armd.errors import ArmdError, BadInput, Closed, NoAnswer

if TYPE_CHECKING:
    from armd import client, joints, keys, point
    from armd.client import Arm, connect
    from armd.joints import JOINTS_ENCODING, joints_dtype
    from armd.offline.arm_model import ArmModel, read_arm
    from armd.offline.calibrate import calibrate
    from armd.offline.calibration import Calibration, read_calibration
    from armd.offline.corrector import Corrector
    from armd.offline.design import DesignResult, design
    from armd.offline.diagnose import Diagnosis, DiagnosisFinding, diagnose
    from armd.offline.evaluate import EvaluationResult, evaluate
    from armd.offline.first_design import FirstDesignResult
    from armd.offline.inputs.session import Session, make_session, read_session
    from armd.offline.model import Model
    from armd.offline.verify import VerificationResult, verify
    from armd.point import POINT, POINT_ENCODING, Flag, Lost, Point
    from armd.received import Refused
    from armd.zenoh_session import ENDPOINT

__all__ = [
    "ENDPOINT",
    "JOINTS_ENCODING",
    "POINT",
    "POINT_ENCODING",
    "Arm",
    "ArmModel",
    "ArmdError",
    "BadInput",
    "Calibration",
    "Closed",
    "Corrector",
    "DesignResult",
    "Diagnosis",
    "DiagnosisFinding",
    "EvaluationResult",
    "FirstDesignResult",
    "Flag",
    "Lost",
    "Model",
    "NoAnswer",
    "Point",
    "Refused",
    "Session",
    "VerificationResult",
    "calibrate",
    "client",
    "connect",
    "design",
    "diagnose",
    "evaluate",
    "joints",
    "joints_dtype",
    "keys",
    "make_session",
    "point",
    "read_arm",
    "read_calibration",
    "read_session",
    "verify",
]
__version__ = "0.3.0"

_MODULES = ("client", "joints", "keys", "point")
#: name → the module that it comes from
_HOMES = {
    "client": ("Arm", "connect"),
    "joints": ("JOINTS_ENCODING", "joints_dtype"),
    "offline.arm_model": ("ArmModel", "read_arm"),
    "offline.calibrate": ("calibrate",),
    "offline.calibration": ("Calibration", "read_calibration"),
    "offline.corrector": ("Corrector",),
    "offline.design": ("DesignResult", "design"),
    "offline.first_design": ("FirstDesignResult",),
    "offline.diagnose": ("Diagnosis", "DiagnosisFinding", "diagnose"),
    "offline.evaluate": ("EvaluationResult", "evaluate"),
    "offline.model": ("Model",),
    "offline.inputs.session": ("Session", "make_session", "read_session"),
    "offline.verify": ("VerificationResult", "verify"),
    "point": ("POINT", "POINT_ENCODING", "Flag", "Lost", "Point"),
    "received": ("Refused",),
    "zenoh_session": ("ENDPOINT",),
}

if not TYPE_CHECKING:  # a type checker would accept every name

    def __getattr__(name: str) -> Any:
        if name in _MODULES:
            return importlib.import_module(f"armd.{name}")
        for module, names in _HOMES.items():
            if name in names:
                try:
                    home = importlib.import_module(f"armd.{module}")
                except ModuleNotFoundError as error:
                    # Only the subscriber's part is installed.
                    if str(error.name).startswith("armd.offline"):
                        advice = f"armd.{name} is not part of armd-client: install armd"
                        raise ImportError(advice) from error
                    raise
                value = globals()[name] = getattr(home, name)
                return value
        raise AttributeError(f"module 'armd' has no attribute {name!r}")

    def __dir__() -> list[str]:
        return sorted({*__all__, *(name for name in globals() if name.startswith("__"))})
