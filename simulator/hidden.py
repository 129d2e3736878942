"""Generates cases that hide an effect: sessions with a planted cause, and the truth in memory.

For tests and `make hidden`: `generate_case` writes a folder that an operator could have measured,
and returns the truth, which the folder does not contain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from armd.arrays import F64
from armd.files.writing import write_whole
from armd.simulator.campaigns.hidden import NOISE, Design, plan_campaigns
from armd.simulator.measured.artefact import Artefact
from armd.simulator.measured.campaign import Campaign, Rig
from armd.simulator.measured.measuring import (
    Measured,
    make_session_files,
    measure_campaign,
    write_session,
)
from armd.simulator.measured.mess import spoil_campaign, spoil_files
from armd.simulator.measured.noise import Noise
from armd.simulator.plants.causes import plant_all
from armd.simulator.plants.plant import Plant, list_columns
from armd.simulator.truth.true_values import list_true_constants, list_true_expansion


@dataclass(frozen=True)
class HiddenEffect:
    """A planted cause and its effect on the readings."""

    plant: Plant
    depends_on: list[str]  # columns on which it depends
    error_mm: dict[str, F64]  # by session: (n, 3) error of a model without it, base frame
    rms_um: float  # its RMS over the sessions to diagnose (3-D, before any fit)


@dataclass(frozen=True, kw_only=True)
class HiddenCase:
    """The paths of the written files, and the truth."""

    arm: Path
    sessions: list[Path]
    holdout: list[Path]
    before: list[Path]  # of the healthy arm
    effects: list[HiddenEffect]
    noise_mm: dict[str, F64]  # by session: (n, 3) residuals of a perfect model
    constants: dict[str, float]  # true geometry at the reference temperature, rad and mm
    expansion: list[tuple[str, str, float]]  # parameter, sensor, change per kelvin, mm/K
    measured: dict[str, Measured]
    present: Campaign  # the arm and its surroundings as they are now

    def oracle_rms_um(self, sessions: Sequence[Path]) -> float:
        """Return the 3-D RMS of the noise over *sessions*, the limit of every model."""
        noise = np.concatenate([self.noise_mm[path.name] for path in sessions])
        return 1e3 * float(np.sqrt(np.mean(np.sum(noise**2, axis=1))))


def generate_case(
    folder: Path,
    seed: int,
    plants: Sequence[Plant] = (),
    design: Design | None = None,
    noise: Noise = NOISE,
    mess: str = "",
) -> HiddenCase:
    """Write a case under *folder*: arm.toml and one folder per session; return its truth.

    *design* None is the standard one: eight sessions of a hundred readings, 16–28 °C. *mess*: one
    of `mess.KINDS`, in the sessions to diagnose.
    """
    design = design or Design()
    healthy, later = plan_campaigns(seed, design, noise)
    rng = np.random.default_rng([seed, 0xCA5E])

    def make_plant_rng(i: int) -> np.random.Generator:
        return np.random.default_rng([seed, 0x9147, i])

    # The random properties of a plant must not depend on the number of other plants.
    single_plant_campaigns = [
        plant_all(later, [plant], make_plant_rng(i)) for i, plant in enumerate(plants)
    ]
    sick = later
    for i, plant in enumerate(plants):
        sick = plant_all(sick, [plant], make_plant_rng(i))
    sick = spoil_campaign(sick, mess, np.random.default_rng([seed, 0x3E55]))
    earlier, present = list(measure_campaign(healthy, rng)), list(measure_campaign(sick, rng))
    measured = earlier + present
    folder.mkdir(parents=True, exist_ok=True)
    write_whole(folder / "arm.toml", later.arm_toml)
    for session in measured:
        write_session(folder / session.plan.name, session)
    _write_mess(folder, mess, [m for m in present if not m.plan.held_out], seed)

    def starting(prefix: str) -> list[Path]:
        return [folder / m.plan.name for m in measured if m.plan.name.startswith(prefix)]

    effects = [
        _effect(plant, campaign, later, present)
        for plant, campaign in zip(plants, single_plant_campaigns, strict=True)
    ]
    return HiddenCase(
        arm=folder / "arm.toml",
        sessions=starting("session"),
        holdout=starting("holdout"),
        before=starting("before"),
        effects=effects,
        noise_mm={
            m.plan.name: m.noise_mm + _certificate_error(m, later.rig.artefact) for m in measured
        },
        constants=list_true_constants(later.rig.arm),
        expansion=list_true_expansion(later.rig.arm),
        measured={m.plan.name: m for m in measured},
        present=sick,
    )


def _write_mess(folder: Path, mess: str, sessions: list[Measured], seed: int) -> None:
    texts = [make_session_files(session) for session in sessions]
    texts = spoil_files(mess, texts, np.random.default_rng([seed, 0xDE5C]))
    for session, files in zip(sessions, texts, strict=True):
        for name, text in files.items():
            write_whole(folder / session.plan.name / name, text)


def _certificate_error(measured: Measured, healthy: Artefact) -> F64:
    """Return the error (n, 3) mm of the *healthy* artefact's certificate at each reading."""
    local = np.nan_to_num(healthy.true_mm - healthy.certified_mm)[measured.target]
    return measured.to_base(local)


def _effect(
    plant: Plant, planted: Campaign, healthy: Campaign, measured: list[Measured]
) -> HiddenEffect:
    error = {m.plan.name: _error(planted.rig, healthy.rig, m) for m in measured}
    rows = np.concatenate([v for name, v in error.items() if name.startswith("session")])
    rms_um = 1e3 * float(np.sqrt(np.mean(np.sum(rows**2, axis=1))))
    return HiddenEffect(plant, list_columns(plant), error, rms_um)


def _error(planted: Rig, healthy: Rig, measured: Measured) -> F64:
    """Return the error (n, 3) mm of a model of the *healthy* rig on readings of *planted*.

    It is the model's prediction from encoders and sensors, minus its position of the target.
    """
    conditions, phi = measured.conditions, measured.phi
    arm = planted.arm.with_payload(measured.plan.payload_kg)
    sensor_error_c = planted.read_sensors(measured.felt_c) - measured.felt_c
    believed = replace(conditions, link_c=conditions.link_c + sensor_error_c)
    error = healthy.arm.tip(arm.encoder_angles(phi, conditions), believed)
    error -= arm.tip(phi, conditions)
    if planted.core_lag_s is not None:
        felt = replace(conditions, link_c=measured.felt_c)
        error += healthy.arm.tip(phi, felt) - healthy.arm.tip(phi, conditions)
    touched = (measured.target, measured.artefact_c, measured.down)
    moved = planted.artefact.positions(*touched) - healthy.artefact.positions(*touched)
    return error + measured.to_base(moved)
