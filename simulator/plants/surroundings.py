"""Plants faults around the arm: heat, sensors, the artefact, single readings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from armd.arrays import F64
from armd.simulator.measured.artefact import Artefact, Sag
from armd.simulator.measured.campaign import Campaign
from armd.simulator.plants.plant import Plant
from armd.simulator.truth.nominal import list_sensor_names
from armd.simulator.truth.rotations import draw_directions


def plant_lag(campaign: Campaign, plant: Plant, _: np.random.Generator) -> Campaign:
    rig = campaign.rig
    lag = np.zeros(rig.arm.n_joints) if rig.core_lag_s is None else rig.core_lag_s.copy()
    lag[plant.number - 1] = plant.size
    return replace(campaign, rig=replace(rig, core_lag_s=lag))


def _sensors(campaign: Campaign, distort: Callable[[F64], F64]) -> Campaign:
    before = campaign.rig.read_sensors
    rig = replace(campaign.rig, read_sensors=lambda felt: distort(before(felt)))
    return replace(campaign, rig=rig)


def plant_sensor_offset(campaign: Campaign, plant: Plant, _: np.random.Generator) -> Campaign:
    shift = np.zeros(len(list_sensor_names()))
    shift[list_sensor_names().index(plant.location.split()[-1])] = plant.size
    return _sensors(campaign, lambda celsius: celsius + shift)


def plant_sensor_swap(campaign: Campaign, plant: Plant, _: np.random.Generator) -> Campaign:
    names = plant.location.removeprefix("sensors ").split(", ")
    order = list(range(len(list_sensor_names())))
    a, b = (list_sensor_names().index(name) for name in names)
    order[a], order[b] = b, a
    return _sensors(campaign, lambda celsius: celsius[:, order])


def _artefacts(campaign: Campaign, change: Callable[[Artefact], Artefact]) -> Campaign:
    sessions = [(plan, change(artefact)) for plan, artefact in campaign.sessions]
    rig = replace(campaign.rig, artefact=change(campaign.rig.artefact))
    return replace(campaign, rig=rig, sessions=sessions)


def plant_artefact_expansion(campaign: Campaign, plant: Plant, _: np.random.Generator) -> Campaign:
    def change(artefact: Artefact) -> Artefact:
        per_k = artefact.true_expansion_per_k + 1e-6 * plant.size
        return replace(artefact, true_expansion_per_k=per_k)

    return _artefacts(campaign, change)


def plant_artefact_length(campaign: Campaign, plant: Plant, rng: np.random.Generator) -> Campaign:
    """Move one ball since its certificate (µm), or scale the artefact ("artefact", µm/m)."""
    direction = draw_directions(rng, 1)[0]

    def change(artefact: Artefact) -> Artefact:
        true = artefact.true_mm.copy()
        if plant.location == "artefact":
            true *= 1 + 1e-6 * plant.size
        else:
            true[artefact.targets.index(plant.location.split()[-1])] += (
                1e-3 * plant.size * direction
            )
        return replace(artefact, true_mm=true)

    return _artefacts(campaign, change)


def plant_artefact_sag(campaign: Campaign, plant: Plant, rng: np.random.Generator) -> Campaign:
    """Make the artefact sag between its supports by *size* (µm) when level.

    It bends along `axis` 0 or 1, with supports at `supports` of its half length.
    """
    axis = int(plant.detail.get("axis", 0))
    supports = float(plant.detail.get("supports", rng.choice([0.1, 0.9])))
    sag = Sag(1e-3 * plant.size, axis, supports)
    return _artefacts(campaign, lambda artefact: replace(artefact, sag=sag))


def plant_outliers(campaign: Campaign, plant: Plant, _: np.random.Generator) -> Campaign:
    """Displace the tip from its seat in a share of the readings (`fraction`)."""
    fraction = float(plant.detail.get("fraction", 0.015))

    def spoil(rng: np.random.Generator, n: int) -> F64:
        offset_mm = 1e-3 * plant.size * rng.uniform(0.7, 1.5, (n, 1)) * draw_directions(rng, n)
        return np.where(rng.uniform(size=(n, 1)) < fraction, offset_mm, 0.0)

    return replace(campaign, rig=replace(campaign.rig, spoil=spoil))
