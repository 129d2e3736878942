"""Requirements that sessions must meet to be identified; others are refused with the reason."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import Mask
from armd.compensation.estimate.gauge import describe_unidentifiable
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.surface_kinds import FREEDOM, POINT, TURN
from armd.compensation.identify.admission.reading_counts import count_least_readings
from armd.compensation.identify.fit import Identification, compute_rms_um
from armd.compensation.identify.thermal.temperatures import group_temperatures
from armd.errors import BadInput
from armd.terminal.counted import format_count

#: Larger residuals do not come from this arm: another unit, another arm, a wrong direction.
ABSURD_RMS_MM = 20.0
#: A link that differs from its nominal length by more is another link, or in another unit.
ABSURD_CHANGE_MM = 100.0
#: A link is also another one if its length changes by this share; short links may be drawn
#: carelessly.
ABSURD_SHARE, SHORT_MM = 0.5, 30.0
#: The least rank, as a share of that of ideal readings, that suffices whatever the held-out error.
LEAST_RANK = 0.5
#: Too few readings help if they miss, when held out, by less than this share of their nominal miss.
MOST_SHARE = 1.0


def choose_readings(
    observations: Observations, files: str, thermal_order: int | None, notes: list[str]
) -> tuple[Observations, list[tuple[float, Mask]]]:
    """Return the readings to use, and their temperature groups where a thermal model is possible.

    Raises `BadInput` if the readings do not allow *thermal_order*.
    """
    arm = observations.arm
    if thermal_order == 0:
        return observations, []
    sensors = arm.used_sensors
    temperature_c = observations.states.temperature_c[:, [arm.sensors.index(s) for s in sensors]]
    complete: Mask = np.all(np.isfinite(temperature_c), axis=1)
    if not sensors or not complete.any():
        if thermal_order:
            problem = "no readings that have them all" if sensors else "no joint with a temperature"
            raise BadInput(files, "temperatures", problem, "the sensors that arm.toml names")
        notes.append("no temperatures: geometry alone, for the temperature of these readings")
        return observations, []
    if not complete.all():
        missing = format_count(int((~complete).sum()), "reading")
        notes.append(f"{missing} without a temperature, not used")
        observations = observations.rows(complete)
    groups = group_temperatures(observations)
    needed = 2 if thermal_order is None else thermal_order + 1
    if len(groups) < needed:
        problem = f"{len(groups)} ({', '.join(f'{mean:.1f} °C' for mean, _ in groups)})"
        if thermal_order:
            expected = f"at least {needed} for a thermal model of order {thermal_order}"
            raise BadInput(files, "temperatures", problem, expected)
        notes.append(f"one temperature only, {groups[0][0]:.1f} °C: no thermal model (order 0)")
    return observations, groups


def require_more_than_placing(observations: Observations, files: str) -> None:
    """Raise `BadInput` if placements and seats take up all equations of the readings."""
    placements, seats = _count_placements(observations), _count_seats(observations)
    # An artefact of seats may stand anywhere in its own frame.
    free = count_artefact_unknowns(observations) - 6 * (seats > 0)
    least_readings = int(free // float(observations.freedom.mean())) + 1 if observations.n else 1
    if observations.n < least_readings:
        expected = (
            f"at least {least_readings} for {placements} placements and {seats} unknown points"
        )
        raise BadInput(files, "readings", f"{observations.n} poses", expected)


def require_useful_readings(
    identification: Identification, share: float, files: str, notes: list[str]
) -> None:
    """Raise `BadInput` if the readings cannot separate the unknowns and do not improve the nominal
    model.

    *share* is the miss of held-out readings, as a share of their miss under the nominal geometry.
    The nominal values count as one more reading of every unknown, so a few readings may help much
    or not.
    """
    observations, arm = identification.observations, identification.observations.arm
    needed, ideal = count_least_readings_for_observations(observations), 4 * arm.n_joints - 3
    rank = identification.solution.rank - len(identification.unknowns.terms)
    if observations.n_postures >= needed and rank >= LEAST_RANK * ideal:
        return
    n_constants = len(identification.unknowns.constants)
    if share < MOST_SHARE and rank > 0:
        notes.append(
            f"{observations.n} readings{_describe_postures(observations)} (rank {rank} of {ideal})"
            " are too few for the arm's"
            f" {n_constants} constants: the drawing holds what they do not tell"
        )
        return
    placements, seats = _count_placements(observations), _count_seats(observations)
    missed = f"readings left out miss by {100 * share:.0f}% of what they do under the drawing"
    if observations.n < needed:
        expected = (
            f"at least {needed} for {n_constants} constants, {placements}"
            f" placements and {seats} unknown points, or readings that help all the same"
        )
        raise BadInput(files, "readings", f"{observations.n} poses, and {missed}", expected)
    words = "; ".join(describe_unknown(identification)[:4])
    rank_words = f"rank {max(rank, 0)} of {n_constants} constants"
    raise BadInput(
        files,
        "poses",
        f"{rank_words} ({words}; …), and {missed}",
        f"poses that tell at least {int(LEAST_RANK * ideal) + 1} of {ideal} apart",
    )


def require_enough_readings(observations: Observations, unknown: Sequence[str], files: str) -> None:
    """Raise `BadInput` for fewer readings than the unknowns need without a nominal prior."""
    needed = count_least_readings_for_observations(observations)
    if observations.n_postures < needed:
        placements, seats = _count_placements(observations), _count_seats(observations)
        expected = (
            f"at least {needed} for {len(unknown)} constants, {placements} placements"
            f" and {seats} unknown points"
        )
        problem = f"{observations.n} poses{_describe_postures(observations)}"
        raise BadInput(files, "readings", problem, expected)


def _describe_postures(observations: Observations) -> str:
    """Return the number of postures, in words, if some readings are copies."""
    postures = observations.n_postures
    return f" of {format_count(postures, 'posture')}" if postures < observations.n else ""


def count_least_readings_for_observations(observations: Observations) -> int:
    """Return the number of readings below which no poses determine all unknowns."""
    free = count_artefact_unknowns(observations)
    equations_per_reading = float(observations.freedom.mean())
    return count_least_readings(observations.arm.n_joints, free, equations_per_reading)


def count_artefact_unknowns(observations: Observations) -> int:
    """Count the unknowns of the artefacts: their poses, and positions that nobody certified."""
    touched = np.unique(observations.placement, return_index=True)[1]
    kinds = np.where(observations.on_surface, observations.kind[observations.target], POINT)
    free = sum(FREEDOM[int(kind)] for kind in kinds[touched])
    targets = np.unique(observations.target[~observations.has_truth])
    unknown = targets[observations.unknown[targets]]
    return free + int(np.where(np.isin(observations.kind[unknown], (POINT, TURN)), 3, 1).sum())


def _count_placements(observations: Observations) -> int:
    return len(np.unique(observations.placement))


def _count_seats(observations: Observations) -> int:
    touched = np.unique(observations.target[~observations.has_truth])
    return int((observations.unknown & (observations.kind == POINT))[touched].sum())


def is_plausible(identification: Identification) -> bool:
    """Return whether the residuals can be those of an arm.

    Outliers, however far off, are not counted: the certificate names them.
    """
    residual_mm = np.delete(
        identification.linearisation.residual_mm, identification.outliers, axis=0
    )
    return compute_rms_um(residual_mm) <= 1e3 * ABSURD_RMS_MM


def _describe_farthest(identification: Identification) -> str:
    """Describe the reading farthest off, and the median distance of all readings."""
    off_mm = np.linalg.norm(identification.linearisation.residual_mm, axis=1)
    i = int(np.argmax(off_mm))
    return (
        f" (half of the readings within {np.median(off_mm):.2g} mm; the farthest,"
        f" {identification.observations.name_row(i)}, {off_mm[i]:.3g} mm off)"
    )


def require_plausible(identification: Identification, files: str) -> None:
    """Raise `BadInput` if the residuals, or a link's change, are too large for the nominal arm."""
    if not is_plausible(identification):
        raise BadInput(
            files,
            "readings",
            f"residuals of {identification.rms_um / 1e3:.0f} mm after fitting"
            f"{_describe_farthest(identification)}",
            "readings of this arm, and arm.toml the drawing of it (units of angles and lengths,"
            " directions, offsets, targets?)",
        )
    arm = identification.observations.arm
    # The last link and the tip may be anything.
    links = slice(0, arm.layout.joint(arm.n_joints).start)
    names, lengths = arm.layout.names[links], arm.layout.are_lengths[links]
    drawn = arm.nominal()[links]
    change = np.abs(identification.constants[links] - drawn) * lengths
    limit_mm = np.minimum(ABSURD_CHANGE_MM, np.maximum(ABSURD_SHARE * np.abs(drawn), SHORT_MM))
    if np.any(change > limit_mm):
        worst = int(np.argmax(change / limit_mm))
        raise BadInput(
            files,
            "readings",
            f"{names[worst]} changed by {change[worst]:.0f} mm from the {drawn[worst]:.1f} mm of"
            " the drawing",
            "readings of this arm, and arm.toml the drawing of it, lengths in mm (a change of"
            f" {limit_mm[worst]:.0f} mm at most)",
        )


def describe_unknown(identification: Identification) -> list[str]:
    """Describe the parameters that the readings cannot separate."""
    names = identification.unknowns.words(identification.terms)
    return describe_unidentifiable(
        identification.solution.null, names, identification.observations.arm
    )
