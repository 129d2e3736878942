"""The causes of the catalogue that may begin between two checks, as columns.

The catalogue's causes are present at all times. Here the amplitude of a cause is a function of
time, zero before an onset. So each cause is listed once, without instants; `changes` adds the time.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armd.compensation.effects.catalogue import list_all_candidates
from armd.compensation.effects.effect import Candidate, SessionFacts
from armd.compensation.effects.encoder import encoder_slip
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration

#: Causes that can begin within weeks: blows, slips, wear, a loose tip, a failing sensor. The
#: expansion of a material, the ruling of a disc and the time base do not change.
HAPPENS = (
    "encoder_eccentricity",
    "encoder_ellipticity",
    "encoder_scale",
    "joint_backlash",
    "axis_wobble",
    "joint_compliance",
    "link_bending",
    "probing_force",
    "geometry_shift",
    "sensor_offset",
    "tip_offset",
)
#: A worn bearing tilts once a turn; higher orders come from its manufacture.
WOBBLE_ORDER = 1.0
#: A sudden change of a joint's zero is attributed to the encoder, as in the catalogue. This share
#: is the probability that the joint itself was knocked: no reading separates the two.
KNOCKED_SHARE = 0.07


@dataclass(frozen=True)
class Cause:
    """A candidate of the catalogue with its prior probabilities."""

    candidate: Candidate
    prior_sudden: float  # of a sudden change
    prior_gradual: float  # of one that grows

    @property
    def place(self) -> tuple[str, str]:
        return self.candidate.place


def list_causes(arm: Arm, calibration: Calibration) -> list[Cause]:
    """List every cause that may begin between two checks, with its prior.

    The prior is uniform over families, then over places, then over the forms at one place.
    """
    possible = [c for c in list_all_candidates(_make_scene(arm, calibration)) if _can_happen(c)]
    slips = [_make_slip(c) for c in possible if _is_turn(c)]
    sudden, gradual = _make_priors([*possible, *slips]), _make_priors(possible)
    causes: list[Cause] = []
    for candidate, prior in zip([*possible, *slips], sudden, strict=True):
        # A sudden change of the zero is rarely a knock; a gradual one is always a creep of the
        # joint.
        share = KNOCKED_SHARE if _is_turn(candidate) else 1.0
        growing = gradual[len(causes)] if len(causes) < len(possible) else 0.0
        causes.append(Cause(candidate, share * prior, growing))
    total = sum(cause.prior_sudden + cause.prior_gradual for cause in causes)
    return [
        replace(c, prior_sudden=c.prior_sudden / total, prior_gradual=c.prior_gradual / total)
        for c in causes
    ]


def _make_scene(arm: Arm, calibration: Calibration) -> SessionFacts:
    """Make the facts of a session with a fixed calibration and without instants.

    The catalogue's causes with instants are not needed: the onset of a change is estimated
    separately.
    """
    return SessionFacts(
        arm=arm,
        constants=calibration.vector(arm.n_joints),
        terms=tuple(calibration.terms),
        reference_c=calibration.reference_temperature_c,
        has_fixed_constants=True,
        sensors=tuple(arm.sensors),
        timed=False,
        rates=True,
        approach=True,
        artefact_c=False,
        artefact_unread=False,
        artefacts=(),
        targets=(),
        distances=(),
        start_unix_s=0.0,
        end_unix_s=0.0,
        spells_unix_s=(),
        sessions=(),
        instants_unix_s=(),
        all_instants_unix_s=np.empty(0),
        lost_links=frozenset(),
    )


def _can_happen(candidate: Candidate) -> bool:
    orders = [value for name, value, _ in candidate.setting if name == "order"]
    if candidate.cause == "axis_wobble" and orders != [WOBBLE_ORDER]:
        return False
    return candidate.cause in HAPPENS


def _is_turn(candidate: Candidate) -> bool:
    return candidate.cause == "geometry_shift" and candidate.columns[0].name == "theta"


def _make_slip(turn: Candidate) -> Candidate:
    joint = turn.location.joint
    assert joint is not None  # a geometry shift always has a joint
    return Candidate("encoder_slip", turn.location, encoder_slip.make_columns(joint), ("time_s",))


def _make_priors(forms: list[Candidate]) -> list[float]:
    families = {c.cause for c in forms}
    places = {c.place for c in forms}
    return [
        1.0
        / len(families)
        / sum(place[0] == c.cause for place in places)
        / sum(form.place == c.place for form in forms)
        for c in forms
    ]
