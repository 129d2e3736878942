"""Guess mistakes in a whole session: a unit, two names, two columns, a sign.

Each guess reads the same session as it may have been meant. The residuals show which guess is
right, under a model to which the session did not contribute.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.placements.fit_poses import fit_poses, fit_robust_poses
from armd.compensation.estimate.surface_kinds import POINT
from armd.compensation.identify.admission.renumberings import find_renumberings
from armd.compensation.identify.evaluation.lengths import measure_certified_lengths
from armd.compensation.identify.fit import Identification
from armd.compensation.model.arm import Arm
from armd.compensation.model.basis import compute_basis_values, compute_parameter_rows
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.terms import Term

#: A guess explains a session if its readings then miss by less than this share.
EXPLAINED = 0.2
#: The length in mm of the units that a person may have used instead of mm.
LENGTHS_MM = {"inches": 25.4, "centimetres": 10.0, "metres": 1000.0}
#: The least temperature, read in °C, that is taken for °F: no measuring room is as hot.
LEAST_FAHRENHEIT = 45.0
#: The most exchanges of two seats in one placement that are tried; each takes some milliseconds.
MOST_EXCHANGES = 400
#: A smaller miss is noise and no mistake (mm).
LEAST_MISS_MM = 0.05
#: A placement with fewer readings is not judged.
LEAST_READINGS = 3


@dataclass(frozen=True)
class AssumedModel:
    """A model with which readings are compared."""

    constants: F64  # (P,)
    terms: Sequence[Term]
    reference_c: float

    @classmethod
    def from_identification(cls, identification: Identification) -> AssumedModel:
        return cls(identification.constants, identification.terms, identification.reference_c)

    @classmethod
    def from_calibration(cls, arm: Arm, calibration: Calibration | None) -> AssumedModel:
        """Return the model of a calibration, or the nominal model without one."""
        if calibration is None:
            return cls(arm.nominal(), [], arm.reference_temperature_c)
        constants = calibration.vector(arm.n_joints)
        return cls(constants, calibration.terms, calibration.reference_temperature_c)

    def tip_mm(self, observations: Observations) -> F64:
        """Return the tip's positions (n, 3), base frame; NaN where a temperature is missing."""
        arm, states = observations.arm, observations.states
        basis = compute_basis_values(self.terms, states, arm, self.reference_c, self.constants)
        position: F64 = compute_pose(
            states.q, compute_parameter_rows(self.constants, self.terms, basis)
        )[0]
        return position


@dataclass(frozen=True)
class Guess:
    """A session as its operator may have meant it."""

    words: str  # after "if"
    expected: str
    observations: Observations


def compute_misses_mm(observations: Observations, model: AssumedModel) -> F64:
    """Compute for each placement (P,) the miss at the target where readings miss most, mm.

    The miss at a target is the median of its readings, so one wrong reading does not matter. It is
    NaN for a placement with fewer than `LEAST_READINGS`.
    """
    return _find_largest_misses(observations, model.tip_mm(observations))


def compute_largest_miss_mm(observations: Observations, model: AssumedModel) -> float:
    """Compute the largest of `compute_misses_mm`; 0 where no placement has enough readings."""
    return float(np.nanmax(compute_misses_mm(observations, model), initial=0.0))


def find_best_guess(observations: Observations, model: AssumedModel) -> tuple[Guess, float] | None:
    """Return the guess that explains the readings of one session best, and its miss in mm.

    A guess must also reduce the miss relative to the motion of the joints. If the joints hardly
    move, readings miss little whatever they mean, so a small miss proves nothing.
    """
    before = compute_largest_miss_mm(observations, model)
    moves = measure_joint_motion(observations.states.q)
    explaining = []
    for guess in _make_guesses(observations, model):
        after = compute_largest_miss_mm(guess.observations, model)
        moves_then = measure_joint_motion(guess.observations.states.q)
        if after < EXPLAINED * before and after * moves < EXPLAINED * before * moves_then:
            explaining.append((guess, after))
    return min(explaining, key=lambda pair: pair[1], default=None)


def measure_joint_motion(q: F64) -> float:
    """Measure how far the joints move, rad, as an RMS over joints.

    For small motions it is near the standard deviation, and at most √2 for angles all around the
    circle. *q*: (n, joints) rad; a row with a missing angle is skipped.
    """
    complete_q = q[np.isfinite(q).all(axis=1)]
    if not len(complete_q):
        return 0.0
    resultant = np.abs(np.exp(1j * complete_q).mean(axis=0))
    return float(np.sqrt(np.mean(2.0 * (1.0 - resultant))))


def find_wrong_length_unit(observations: Observations, model: AssumedModel) -> str:
    """Return the unit that all certified distances seem to have instead of mm, or ""."""
    position = model.tip_mm(observations)
    is_finite = np.isfinite(position[:, 0])
    if not is_finite.any() or not len(observations.distances.length_mm):
        return ""
    observations, position = observations.rows(is_finite), position[is_finite]
    poses = fit_poses(observations, position)
    lengths = measure_certified_lengths(observations, poses, poses.residual(observations, position))
    ratios = np.array([length.measured_mm / max(length.certified_mm, 1e-9) for length in lengths])
    for unit, factor in LENGTHS_MM.items():
        if len(ratios) and np.all(np.abs(ratios / factor - 1.0) < 0.1):
            return unit
    return ""


def _find_largest_misses(observations: Observations, position_mm: F64) -> F64:
    is_finite = np.isfinite(position_mm[:, 0])
    largest = np.full(len(observations.placement_names), np.nan)
    if not is_finite.any():
        return largest
    observations, position_mm = observations.rows(is_finite), position_mm[is_finite]
    _, distance = fit_robust_poses(observations, position_mm)
    for placement in np.unique(observations.placement):
        in_placement = observations.placement == placement
        if in_placement.sum() < LEAST_READINGS:
            continue
        target = np.where(observations.has_truth, -1, observations.target)[in_placement]
        largest[placement] = max(
            float(np.median(distance[in_placement][target == k])) for k in np.unique(target)
        )
    return largest


def _make_guesses(observations: Observations, model: AssumedModel) -> Iterator[Guess]:
    yield from _guess_length_units(observations)
    yield from _guess_angles(observations)
    yield from _guess_temperature_unit(observations)
    yield from _guess_targets(observations, model)


def _guess_length_units(observations: Observations) -> Iterator[Guess]:
    has_positions = np.isfinite(observations.position_mm).any() or observations.has_truth.any()
    for unit, factor in LENGTHS_MM.items() if has_positions else ():
        yield Guess(
            f"its positions are taken as {unit}",
            "positions in mm",
            replace(
                observations,
                position_mm=factor * observations.position_mm,
                truth_mm=factor * observations.truth_mm,
            ),
        )


def _guess_angles(observations: Observations) -> Iterator[Guess]:
    q = observations.states.q
    expected = "angles in the unit that angle_unit of session.toml names"
    yield _guess_with_angles(
        observations, np.degrees(q), "its angles are taken as radians", expected
    )
    yield _guess_with_angles(
        observations, np.radians(q), "its angles are taken as degrees", expected
    )
    joints = range(q.shape[1])
    for a, b in combinations(joints, 2):
        order = list(joints)
        order[a], order[b] = b, a
        words = f"its columns q{a + 1} and q{b + 1} are exchanged"
        yield _guess_with_angles(observations, q[:, order], words, "each joint in its own column")
    for joint in joints:
        sign = np.where(np.arange(q.shape[1]) == joint, -1.0, 1.0)
        words = f"its column q{joint + 1} has the other sign"
        yield _guess_with_angles(
            observations, q * sign, words, "each angle with the sign of arm.toml"
        )


def _guess_with_angles(observations: Observations, q: F64, words: str, expected: str) -> Guess:
    return Guess(words, expected, replace(observations, states=replace(observations.states, q=q)))


def _guess_temperature_unit(observations: Observations) -> Iterator[Guess]:
    temperature_c = observations.states.temperature_c
    if not np.isfinite(temperature_c).any() or np.nanmin(temperature_c) < LEAST_FAHRENHEIT:
        return
    states = replace(observations.states, temperature_c=to_celsius(temperature_c))
    yield Guess(
        "its temperatures are taken as °F", "temperatures in °C",
        replace(observations, states=states),
    )  # fmt: skip


def to_celsius(fahrenheit: F64) -> F64:
    return (fahrenheit - 32.0) / 1.8


def _guess_targets(observations: Observations, model: AssumedModel) -> Iterator[Guess]:
    """Guess exchanged or shifted target names that make a placement's readings fit."""
    position = model.tip_mm(observations)
    as_it_is = _find_largest_misses(observations, position)
    own_names = np.arange(len(observations.unknown))
    placements = np.unique(observations.placement)

    def better(names: I64) -> I64:
        renamed = _find_largest_misses(_rename_targets(observations, names, placements), position)
        return np.flatnonzero(renamed < EXPLAINED * as_it_is)

    points = observations.kind == POINT
    touched = np.unique(observations.target[~observations.has_truth])
    touched = touched[points[touched]]
    pairs = list(combinations(touched, 2))
    seats = bool(observations.unknown[touched].any())
    for a, b in [] if seats and len(pairs) * len(placements) > MOST_EXCHANGES else pairs:
        names = own_names.copy()
        names[[a, b]] = b, a
        # A seat has the same position in all placements, so an exchange in all of them changes
        # nothing: each placement is tried separately.
        sets_of_placements = (
            [placements[k : k + 1] for k in range(len(placements))] if seats else [better(names)]
        )
        first_name, second_name = _get_own_name(observations, a), _get_own_name(observations, b)
        yield from _guess_renamed(
            observations,
            names,
            sets_of_placements,
            f"its targets {first_name} and {second_name} are exchanged",
        )
    session = np.isin(observations.target_session, observations.session)
    certified = np.flatnonzero(session & points & ~observations.unknown)
    for onto in find_renumberings(observations.position_mm[certified]):
        names = own_names.copy()
        names[certified] = certified[onto]
        first = int(np.flatnonzero(names != own_names)[0])
        named, onto_name = (
            _get_own_name(observations, first),
            _get_own_name(observations, names[first]),
        )
        words = f"its targets are counted from another end ({named} is {onto_name})"
        yield from _guess_renamed(observations, names, [better(names)], words)


def _guess_renamed(
    observations: Observations, names: I64, sets_of_placements: Sequence[I64], words: str
) -> Iterator[Guess]:
    """Yield a guess with other *names* (K,) for each non-empty set of placements."""
    for placements in sets_of_placements:
        if len(placements):
            yield Guess(
                words + _describe_placements(observations, placements),
                "each target under its own name",
                _rename_targets(observations, names, placements),
            )


def _rename_targets(observations: Observations, names: I64, placements: I64) -> Observations:
    is_renamed = np.isin(observations.placement, placements)
    target = observations.target
    return replace(observations, target=np.where(is_renamed, names[target], target))


def _get_own_name(observations: Observations, target: int) -> str:
    """Return the target's name within its session."""
    return observations.target_names[target].partition("/")[2]


def _describe_placements(observations: Observations, placements: I64) -> str:
    """Return " in P1, P2", or nothing for all placements."""
    if len(placements) == len(np.unique(observations.placement)):
        return ""
    names = (observations.placement_names[p].partition("/")[2] for p in placements)
    return f" in {', '.join(names)}"
