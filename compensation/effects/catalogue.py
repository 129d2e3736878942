"""All causes armd can name; adding one is adding its file and its line here."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from armd.compensation.effects import unknown
from armd.compensation.effects.effect import ARC_SECOND, Candidate, Effect, SessionFacts
from armd.compensation.effects.encoder import (
    encoder_eccentricity,
    encoder_ellipticity,
    encoder_periodic,
    encoder_scale,
    encoder_slip,
    time_skew,
)
from armd.compensation.effects.mechanical import (
    axis_wobble,
    geometry_shift,
    joint_backlash,
    joint_compliance,
    link_bending,
)
from armd.compensation.effects.setup import (
    artefact,
    mount_drift,
    outliers,
    probing_force,
    tip_offset,
)
from armd.compensation.effects.thermal import (
    joint_thermal,
    link_expansion,
    nonlinear_expansion,
    sensor_offset,
    sensor_swapped,
    thermal_gradient,
    thermal_lag,
)
from armd.compensation.model.arm import Arm

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


#: How large these are goes with how finely an arm is made, and of that its encoders tell: a hobby
#: servo's magnetic encoder of 12 bits is half a degree off where a disc of 23 bits is seconds off,
#: and so are its bearings and its printed links.
AS_COARSE_AS_ITS_ENCODERS = frozenset(
    {
        "encoder_eccentricity",
        "encoder_ellipticity",
        "encoder_periodic",
        "joint_backlash",
        "axis_wobble",
        "joint_compliance",
        "link_bending",
    }
)
#: The typical sizes are those of an arm whose encoders tell this apart, or less.
FINE_RAD = 6 * ARC_SECOND


def candidates(facts: SessionFacts) -> Iterator[Candidate]:
    """Every candidate that this arm and these sessions allow, the general basis included."""
    coarseness = _coarseness(facts.arm)
    for effect in CATALOGUE.values():
        if effect.cause in AS_COARSE_AS_ITS_ENCODERS and coarseness > 1.0:
            yield from (_larger(candidate, coarseness) for candidate in effect.candidates(facts))
        else:
            yield from effect.candidates(facts)


def _coarseness(arm: Arm) -> float:
    """A count of the coarsest encoder over `FINE_RAD`; 1 for all that are finer, or not known."""
    counts = [joint.counts_per_turn for joint in arm.joint if joint.counts_per_turn is not None]
    return max([1.0, *(2 * math.pi / count / FINE_RAD for count in counts)])


def _larger(candidate: Candidate, factor: float) -> Candidate:
    """The same cause, typically *factor* times as large; its refinements too."""
    columns = tuple(
        replace(column, typical=column.typical * factor) for column in candidate.columns
    )
    refine = candidate.refine
    if refine is None:
        return replace(candidate, columns=columns)
    return replace(
        candidate, columns=columns, refine=lambda: [_larger(finer, factor) for finer in refine()]
    )
