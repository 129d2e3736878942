"""All causes armd can name; adding one is adding its file and its line here."""

from __future__ import annotations

from collections.abc import Iterator

from armd.compensation.effects import (
    artefact,
    axis_wobble,
    encoder_eccentricity,
    encoder_ellipticity,
    encoder_periodic,
    encoder_scale,
    encoder_slip,
    geometry_shift,
    joint_backlash,
    joint_compliance,
    joint_thermal,
    link_bending,
    link_expansion,
    mount_drift,
    nonlinear_expansion,
    outliers,
    probing_force,
    sensor_offset,
    sensor_swapped,
    thermal_gradient,
    thermal_lag,
    time_skew,
    tip_offset,
    unknown,
)
from armd.compensation.effects.effect import Candidate, Effect, Scene

CATALOGUE: dict[str, Effect] = {
    effect.cause: effect
    for effect in (
        encoder_eccentricity.EFFECT,
        encoder_ellipticity.EFFECT,
        encoder_periodic.EFFECT,
        encoder_scale.EFFECT,
        encoder_slip.EFFECT,
        joint_backlash.EFFECT,
        axis_wobble.EFFECT,
        joint_compliance.EFFECT,
        link_bending.EFFECT,
        probing_force.EFFECT,
        link_expansion.EFFECT,
        nonlinear_expansion.EFFECT,
        thermal_lag.EFFECT,
        thermal_gradient.EFFECT,
        geometry_shift.EFFECT,
        joint_thermal.EFFECT,
        sensor_offset.EFFECT,
        sensor_swapped.EFFECT,
        artefact.EXPANSION,
        artefact.LENGTH,
        time_skew.EFFECT,
        mount_drift.EFFECT,
        tip_offset.EFFECT,
        outliers.EFFECT,
        unknown.EFFECT,
    )
}


def candidates(scene: Scene) -> Iterator[Candidate]:
    """Every candidate that this arm and these sessions allow, the general basis included."""
    for effect in CATALOGUE.values():
        yield from effect.candidates(scene)
