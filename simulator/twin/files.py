"""Reads arm.toml and calibration.json for the twin, after `armd check` has passed."""

from __future__ import annotations

import datetime
import json
import math
import subprocess
import sys
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.errors import ArmdError, BadInput
from armd.files.inputs import read_input
from armd.simulator.twin.chain import LinkWeights, Parameters, estimate_weight
from armd.simulator.twin.factors import POSE, SLOW, FactorData

OF_A_JOINT = ("theta", "d", "a", "alpha", "beta")
OF_THE_TIP = ("tip_x", "tip_y", "tip_z")
OF_THE_BASE = ("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz")


class CheckFailed(ArmdError):
    """The faults that `armd check` found in the files, one sentence each."""

    def __init__(self, faults: Sequence[str]) -> None:
        super().__init__(faults[0])
        self.further_faults = tuple(faults[1:])


@dataclass(frozen=True)
class FileTerm:
    """A term: parameter += coefficient · Π factors."""

    place: int  # index of its parameter in `list_parameter_names`
    coefficient: float
    slow: tuple[FactorData, ...]
    pose: tuple[FactorData, ...]


@dataclass(frozen=True)
class ArmData:
    """The content of arm.toml."""

    serial_number: str
    sensors: tuple[str, ...]
    drawn: F64  # (P,) in the order of `list_parameter_names`
    weights: LinkWeights
    counts_per_turn: tuple[int | None, ...]  # (N,)
    direction: F64  # (N,) ±1
    limits_rad: tuple[F64, F64]  # (N,) each, ∓inf where there is none
    #: (S,) the joint (from 0) to which each sensor belongs; the first of several, 0 for none
    joint_of_sensor: tuple[int, ...]

    @property
    def n_joints(self) -> int:
        return len(self.direction)


@dataclass(frozen=True)
class CalibrationData:
    """The content of a calibration."""

    constants: F64  # (P,)
    terms: tuple[FileTerm, ...]
    reference_c: float
    created_unix_s: float
    artefact: Mapping[str, Any] = field(default_factory=dict)  # estimates for the artefact


def list_parameter_names(n_joints: int) -> list[str]:
    """List all parameters by name, joint by joint, then the tip's, then the base's."""
    joints = [f"{name}_{k}" for k in range(1, n_joints + 1) for name in OF_A_JOINT]
    return [*joints, *OF_THE_TIP, *OF_THE_BASE]


def as_parameters(values: F64) -> Parameters:
    """Convert values (P,) or (n, P) in the order of `list_parameter_names`."""
    values = np.atleast_2d(values)
    rows = values[:, : -len(OF_THE_TIP) - len(OF_THE_BASE)].reshape(len(values), -1, 5)
    return Parameters(rows, values[:, -9:-6], values[:, -6:])


def _check_files(*paths: Path) -> None:
    """Raise `ArmdError` with the faults that `armd check` finds in another process."""
    command = [sys.executable, "-P", "-m", "armd", "check", "-q", *map(str, paths)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        lines = [line.removeprefix("armd: ") for line in done.stderr.splitlines()]
        raise CheckFailed(lines or [f"{paths[0]}: found a file that cannot be checked"])


def read_twin(
    arm_path: Path, calibration_path: Path, *sessions: Path
) -> tuple[ArmData, CalibrationData]:
    """Read arm and calibration.

    Raises `ArmdError` where one is invalid, the calibration is another arm's, or one of *sessions*
    cannot be read.
    """
    _check_files(arm_path, calibration_path, *sessions)
    arm = to_arm_data(tomllib.loads(read_input(arm_path).decode("utf-8")))
    content = json.loads(read_input(calibration_path))
    if content["arm"] != arm.serial_number:
        expected = f"{arm.serial_number!r}, as in arm.toml"
        raise BadInput(calibration_path, "arm", repr(content["arm"]), expected)
    return arm, to_calibration_data(content, arm.n_joints)


def to_arm_data(content: Mapping[str, Any]) -> ArmData:
    """Return the arm of an arm.toml's *content*, which must be valid."""
    joints = content["joint"]
    sensors = tuple(sensor["name"] for sensor in content.get("temperature_sensor", []))
    tip_mm = np.array(content.get("tip", {}).get("offset_mm", (0.0, 0.0, 0.0)), dtype=float)
    rows = np.array([_row(joint) for joint in joints])
    kg, centre_mm = np.empty(len(joints)), np.empty((len(joints), 3))
    for k, joint in enumerate(joints):
        end_mm = tip_mm if k == len(joints) - 1 else np.zeros(3)
        kg[k], centre_mm[k] = estimate_weight(rows[k], end_mm)
        kg[k] = joint.get("mass_kg", kg[k])
        centre_mm[k] = joint.get("centre_of_mass_mm", centre_mm[k])
    down = np.array(content.get("gravity", (0.0, 0.0, -1.0)), dtype=float)
    spoken_for = [_sensors_of(joint) for joint in joints]
    return ArmData(
        serial_number=content["serial_number"],
        sensors=sensors,
        drawn=np.concatenate([rows.ravel(), tip_mm, np.zeros(len(OF_THE_BASE))]),
        weights=LinkWeights(kg, centre_mm, down),
        counts_per_turn=tuple(joint.get("counts_per_turn") for joint in joints),
        direction=np.array([float(joint.get("direction", 1)) for joint in joints]),
        limits_rad=(
            np.radians([joint.get("min_deg", -math.inf) for joint in joints]),
            np.radians([joint.get("max_deg", math.inf) for joint in joints]),
        ),
        joint_of_sensor=tuple(
            next((k for k, names in enumerate(spoken_for) if name in names), 0) for name in sensors
        ),
    )


def _row(joint: Mapping[str, Any]) -> list[float]:
    """Return θ0, d, a, α, β in mm and rad."""
    names = ("theta_deg", "d_mm", "a_mm", "alpha_deg", "beta_deg")
    values = [float(joint.get(name, 0.0)) for name in names]
    return [
        math.radians(x) if name.endswith("deg") else x
        for name, x in zip(names, values, strict=True)
    ]


def _sensors_of(joint: Mapping[str, Any]) -> list[str]:
    named = joint.get("temperature")
    if named is None:
        return []
    return [named] if isinstance(named, str) else [name for name, w in named.items() if w]


def to_calibration_data(content: Mapping[str, Any], n_joints: int) -> CalibrationData:
    """Return the calibration of a file's *content*, which must be valid."""
    names = list_parameter_names(n_joints)
    created = datetime.datetime.fromisoformat(content["created"])
    created = created.replace(tzinfo=created.tzinfo or datetime.UTC)
    terms = []
    for term in content.get("terms", []):
        basis = term.get("basis", [])
        terms.append(
            FileTerm(
                names.index(term["parameter"]),
                float(term.get("coefficient", 0.0)),
                tuple(factor for factor in basis if factor["kind"] in SLOW),
                tuple(factor for factor in basis if factor["kind"] in POSE),
            )
        )
    return CalibrationData(
        constants=np.array([float(content["constants"].get(name, 0.0)) for name in names]),
        terms=tuple(terms),
        reference_c=float(content["reference_temperature_c"]),
        created_unix_s=created.timestamp(),
        artefact=content.get("artefact") or {},
    )
