"""The terms that a thermal model may have: of lengths, of angles, by zones, by components."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from armd.arrays import F64
from armd.compensation.estimate.observations import Observations
from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm
from armd.compensation.model.parameters import LEAST_LENGTH_MM
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term

#: Principal components are added until they explain this share of the variance.
EXPLAINED = 0.995
#: The first link's expansion may join a model if it exceeds its uncertainty this many times. A
#: calibration tests this before its terms are chosen. An extended calibration tests it, too,
#: because the findings were fitted together with it. Held-out readings may still reject it.
GROWTH_KNOWN = 5.0


def make_length_terms(arm: Arm, orders: Sequence[int]) -> list[Term]:
    """Return terms ΔT^m of every length that matters, by its joint's own temperature."""
    return [
        Term(parameter=name, basis=[Temperature(weights=weights, order=m)])
        for name, weights in _list_lengths(arm)
        for m in orders
    ]


def make_angle_terms(arm: Arm, stem: str) -> list[Term]:
    """Return terms ΔT of θ ("theta") or α ("alpha") of every joint with a temperature."""
    return [
        Term(parameter=f"{stem}_{k}", basis=[Temperature(weights=joint.weights)])
        for k, joint in enumerate(arm.joint, 1)
        if joint.weights
    ]


def make_growth_terms(arm: Arm) -> list[Term]:
    """Return the term by which the first link and its support expand; none without a sensor.

    Between placements the placements' poses absorb this expansion. A ramp within a placement shows
    it; without the term it would be attributed to the other lengths and angles.
    """
    weights = arm.joint[0].weights
    return [Term(parameter="d_1", basis=[Temperature(weights=weights)])] if weights else []


def make_zone_terms(arm: Arm, edges_c: Sequence[float]) -> list[Term]:
    """Return the paper's temperature zones: a broken line, one slope per zone of *edges_c*."""
    return [
        Term(parameter=name, basis=[Temperature(weights=weights, zone_c=(low, high))])
        for name, weights in _list_lengths(arm)
        for low, high in itertools.pairwise(edges_c)
    ]


def make_component_terms(arm: Arm, observations: Observations) -> list[Term]:
    """Return terms of the sensors' principal components instead of each joint's temperature.

    The mean temperature is the first direction of sensors that move together; as many components
    are used as explain 99.5 % of the variance.
    """
    names = arm.used_sensors
    columns = [arm.sensors.index(name) for name in names]
    values = observations.states.temperature_c[:, columns]
    _, s, vt = np.linalg.svd(values - values.mean(axis=0), full_matrices=False)
    share = np.cumsum(s**2) / max(float(np.sum(s**2)), 1e-300)
    count = int(np.searchsorted(share, EXPLAINED)) + 1
    terms = []
    for name, _ in _list_lengths(arm):
        for direction in vt[:count]:
            weights = dict(zip(names, (direction / np.abs(direction).sum()).tolist(), strict=True))
            reference = arm.reference_temperature_c * sum(weights.values())
            basis = Temperature(weights=weights, reference_c=reference)
            terms.append(Term(parameter=name, basis=[basis]))
    return terms


def get_last_lever_mm(arm: Arm) -> F64:
    """Return the lever (3,) from the last joint to the tip, in the last frame.

    Link and stylus expand as one.
    """
    last = arm.joint[-1]
    link = Rotation.from_euler("XY", [last.alpha_deg, last.beta_deg], degrees=True)
    lever: F64 = link.inv().apply([last.a_mm, 0.0, last.d_mm]) + arm.tip.offset_mm
    return lever


def _list_lengths(arm: Arm) -> list[tuple[str, dict[str, float]]]:
    """List the lengths that matter, with the weights of their temperature.

    d of joint 1 is left out, because it moves every placement alike (`make_growth_terms`). The last
    link's part of the tip's offset expands with it, all by the last joint's temperature.
    """
    lengths = [
        (f"{stem}_{k}", joint.weights, length)
        for k, joint in enumerate(arm.joint[:-1], 1)
        for stem, length in (("d", joint.d_mm), ("a", joint.a_mm))
    ]
    last, lever = arm.joint[-1], get_last_lever_mm(arm)
    lengths += [
        (name, last.weights, float(length))
        for name, length in zip(parameters.TIP_PARAMETERS, lever, strict=True)
    ]
    return [
        (name, weights)
        for name, weights, length in lengths
        if weights and name != "d_1" and abs(length) > LEAST_LENGTH_MM
    ]
