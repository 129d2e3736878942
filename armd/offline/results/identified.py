"""The details of an identification, beside its calibration."""

from __future__ import annotations

from dataclasses import dataclass

from armd.compensation.data.sessions.session import Session as StoredSession
from armd.compensation.identify.result import Result
from armd.offline.arm_model import ArmModel


@dataclass(frozen=True)
class Identified:
    """The whole result of an identification, with its sessions and its arm."""

    result: Result
    sessions: list[StoredSession]
    arm: ArmModel
