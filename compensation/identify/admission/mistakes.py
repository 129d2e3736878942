"""What a person may have got wrong in a whole session: a unit, two names, two columns, a sign.

Each guess is the same session, read as it may have been meant. Which of them is right, the
residuals tell, under a model that the session had no part in.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.estimate.fit_poses import fit_poses, fit_robust_poses
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.surface_kinds import POINT
from armd.compensation.identify.admission.other_ends import other_ends
from armd.compensation.identify.evaluation.lengths import certified_lengths
from armd.compensation.identify.fit import Identification
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import basis_values, parameter_rows
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import forward
from armd.compensation.model.terms import Term

#: A guess explains a session if the readings then miss by less than this share.
EXPLAINED = 0.2
#: mm in what a person may have written instead of mm
LENGTHS_MM = {"inches": 25.4, "centimetres": 10.0, "metres": 1000.0}
#: Nobody measures in a room as hot as a number in °F looks in °C.
LEAST_FAHRENHEIT = 45.0
#: Exchanges of two seats in one placement are tried up to so many; each takes some milliseconds.
MOST_EXCHANGES = 400
#: Less than this is noise and no mistake (mm).
LEAST_MM = 0.05
#: A placement of fewer readings says nothing.
LEAST_READINGS = 3


@dataclass(frozen=True)
class AssumedModel:
    """What readings are held against."""

    constants: F64  # (P,)
    terms: Sequence[Term]
    reference_c: float

    @classmethod
    def of(cls, found: Identification) -> AssumedModel:
        return cls(found.constants, found.terms, found.reference_c)

    @classmethod
    def under(cls, arm: Arm, calibration: Calibration | None) -> AssumedModel:
        """A calibration, or the drawing."""
        if calibration is None:
            return cls(arm.nominal(), [], arm.reference_temperature_c)
        constants = calibration.vector(arm.n_joints)
        return cls(constants, calibration.terms, calibration.reference_temperature_c)

    def tip_mm(self, observations: Observations) -> F64:
        """(n, 3) base frame; NaN where a temperature is missing."""
        arm, states = observations.arm, observations.states
        basis = basis_values(self.terms, states, arm, self.reference_c, self.constants)
        position: F64 = forward(states.q, parameter_rows(self.constants, self.terms, basis))[0]
        return position


@dataclass(frozen=True)
class Guess:
    """A session as it may have been meant."""

    words: str  # after "if"
    expected: str
    observations: Observations


def misses_mm(observations: Observations, model: AssumedModel) -> F64:
    """(P,) how far readings miss, at the target of each placement where they miss most.

    At a target the median counts: one reading gone wrong says nothing of the session. NaN for a
    placement of fewer than `LEAST_READINGS`.
    """
    return _largest(observations, model.tip_mm(observations))


def miss_mm(observations: Observations, model: AssumedModel) -> float:
    """The same in the placement where it is largest; 0 where no placement has enough readings."""
    return float(np.nanmax(misses_mm(observations, model), initial=0.0))


def best_guess(observations: Observations, model: AssumedModel) -> tuple[Guess, float] | None:
    """The guess under which the readings of one session miss least, in mm, if it explains them.

    It must explain them for what the joints move too: an arm that hardly moves misses little
    whatever it measures, and so explains nothing.
    """
    before = miss_mm(observations, model)
    moves = joint_motion(observations.states.q)
    explaining = []
    for guess in _guesses(observations, model):
        after = miss_mm(guess.observations, model)
        moves_then = joint_motion(guess.observations.states.q)
        if after < EXPLAINED * before and after * moves < EXPLAINED * before * moves_then:
            explaining.append((guess, after))
    return min(explaining, key=lambda one: one[1], default=None)


def joint_motion(q: F64) -> float:
    """How far the joints move, rad, RMS over joints: near the standard deviation of small motions,
    at most √2 where angles stand all around the circle.

    q: (n, joints) rad; a row with an angle missing has no part.
    """
    whole = q[np.isfinite(q).all(axis=1)]
    if not len(whole):
        return 0.0
    resultant = np.abs(np.exp(1j * whole).mean(axis=0))
    return float(np.sqrt(np.mean(2.0 * (1.0 - resultant))))


def wrong_length_unit(observations: Observations, model: AssumedModel) -> str:
    """The unit that all certified distances of a session seem to have instead of mm, if any."""
    position = model.tip_mm(observations)
    kept = np.isfinite(position[:, 0])
    if not kept.any() or not len(observations.distances.length_mm):
        return ""
    observations, position = observations.rows(kept), position[kept]
    poses = fit_poses(observations, position)
    lengths = certified_lengths(observations, poses, poses.residual(observations, position))
    ratios = np.array([one.measured_mm / max(one.certified_mm, 1e-9) for one in lengths])
    for unit, factor in LENGTHS_MM.items():
        if len(ratios) and np.all(np.abs(ratios / factor - 1.0) < 0.1):
            return unit
    return ""


def _largest(observations: Observations, position_mm: F64) -> F64:
    kept = np.isfinite(position_mm[:, 0])
    largest = np.full(len(observations.placement_names), np.nan)
    if not kept.any():
        return largest
    observations, position_mm = observations.rows(kept), position_mm[kept]
    _, distance = fit_robust_poses(observations, position_mm)
    for placement in np.unique(observations.placement):
        own = observations.placement == placement
        if own.sum() < LEAST_READINGS:
            continue
        target = np.where(observations.has_truth, -1, observations.target)[own]
        largest[placement] = max(
            float(np.median(distance[own][target == k])) for k in np.unique(target)
        )
    return largest


def _guesses(observations: Observations, model: AssumedModel) -> Iterator[Guess]:
    yield from _other_lengths(observations)
    yield from _other_angles(observations)
    yield from _other_temperatures(observations)
    yield from _other_targets(observations, model)


def _other_lengths(observations: Observations) -> Iterator[Guess]:
    known = np.isfinite(observations.position_mm).any() or observations.has_truth.any()
    for unit, factor in LENGTHS_MM.items() if known else ():
        yield Guess(
            f"its positions are taken as {unit}",
            "positions in mm",
            replace(
                observations,
                position_mm=factor * observations.position_mm,
                truth_mm=factor * observations.truth_mm,
            ),
        )


def _other_angles(observations: Observations) -> Iterator[Guess]:
    q = observations.states.q
    expected = "angles in the unit that angle_unit of session.toml names"
    yield _turned(observations, np.degrees(q), "its angles are taken as radians", expected)
    yield _turned(observations, np.radians(q), "its angles are taken as degrees", expected)
    joints = range(q.shape[1])
    for a, b in combinations(joints, 2):
        order = list(joints)
        order[a], order[b] = b, a
        words = f"its columns q{a + 1} and q{b + 1} are exchanged"
        yield _turned(observations, q[:, order], words, "each joint in its own column")
    for joint in joints:
        sign = np.where(np.arange(q.shape[1]) == joint, -1.0, 1.0)
        words = f"its column q{joint + 1} has the other sign"
        yield _turned(observations, q * sign, words, "each angle with the sign of arm.toml")


def _turned(observations: Observations, q: F64, words: str, expected: str) -> Guess:
    return Guess(words, expected, replace(observations, states=replace(observations.states, q=q)))


def _other_temperatures(observations: Observations) -> Iterator[Guess]:
    temperature_c = observations.states.temperature_c
    if not np.isfinite(temperature_c).any() or np.nanmin(temperature_c) < LEAST_FAHRENHEIT:
        return
    states = replace(observations.states, temperature_c=celsius(temperature_c))
    yield Guess(
        "its temperatures are taken as °F", "temperatures in °C",
        replace(observations, states=states),
    )  # fmt: skip


def celsius(fahrenheit: F64) -> F64:
    return (fahrenheit - 32.0) / 1.8


def _other_targets(observations: Observations, model: AssumedModel) -> Iterator[Guess]:
    """Targets under each other's names, where that makes a placement's readings fit."""
    position = model.tip_mm(observations)
    as_it_is = _largest(observations, position)
    own_names = np.arange(len(observations.unknown))
    placements = np.unique(observations.placement)

    def better(names: I64) -> I64:
        renamed = _largest(_renamed(observations, names, placements), position)
        return np.flatnonzero(renamed < EXPLAINED * as_it_is)

    points = observations.kind == POINT
    touched = np.unique(observations.target[~observations.has_truth])
    touched = touched[points[touched]]
    pairs = list(combinations(touched, 2))
    seats = bool(observations.unknown[touched].any())
    for a, b in [] if seats and len(pairs) * len(placements) > MOST_EXCHANGES else pairs:
        names = own_names.copy()
        names[[a, b]] = b, a
        # A seat's place is the same in all placements of the session: one by one.
        where = (
            [placements[k : k + 1] for k in range(len(placements))] if seats else [better(names)]
        )
        one, other = _own_name(observations, a), _own_name(observations, b)
        yield from _renamings(
            observations, names, where, f"its targets {one} and {other} are exchanged"
        )
    session = np.isin(observations.target_session, observations.session)
    certified = np.flatnonzero(session & points & ~observations.unknown)
    for onto in other_ends(observations.position_mm[certified]):
        names = own_names.copy()
        names[certified] = certified[onto]
        first = int(np.flatnonzero(names != own_names)[0])
        named, at = _own_name(observations, first), _own_name(observations, names[first])
        words = f"its targets are counted from another end ({named} is {at})"
        yield from _renamings(observations, names, [better(names)], words)


def _renamings(
    observations: Observations, names: I64, where: Sequence[I64], words: str
) -> Iterator[Guess]:
    """Targets under other *names* (K,) in each of some sets of placements that has any."""
    for placements in where:
        if len(placements):
            yield Guess(
                words + _where_in_words(observations, placements),
                "each target under its own name",
                _renamed(observations, names, placements),
            )


def _renamed(observations: Observations, names: I64, placements: I64) -> Observations:
    there = np.isin(observations.placement, placements)
    target = observations.target
    return replace(observations, target=np.where(there, names[target], target))


def _own_name(observations: Observations, target: int) -> str:
    """In its session."""
    return observations.target_names[target].partition("/")[2]


def _where_in_words(observations: Observations, placements: I64) -> str:
    """ " in P1, P2", or nothing for all."""
    if len(placements) == len(np.unique(observations.placement)):
        return ""
    names = (observations.placement_names[p].partition("/")[2] for p in placements)
    return f" in {', '.join(names)}"
