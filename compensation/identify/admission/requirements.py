"""What sessions must offer to be identified from; otherwise they are refused, and why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armd.arrays import Mask
from armd.compensation.estimate.gauge import describe_unidentifiable
from armd.compensation.estimate.observations import Observations
from armd.compensation.estimate.surface_kinds import FREEDOM, POINT, TURN
from armd.compensation.identify.admission.needed import count_readings_for
from armd.compensation.identify.fit import Identification, compute_rms_um
from armd.compensation.identify.thermal.temperatures import group_temperatures
from armd.errors import BadInput
from armd.terminal.counted import format_count

#: Residuals beyond this are not an arm's: another unit, another arm, a wrong direction.
ABSURD_RMS_MM = 20.0
#: A link that differs from its drawing by more than this is another link, or in another unit.
ABSURD_CHANGE_MM = 100.0
#: So is one that lost or gained half of itself; short ones may be drawn carelessly.
ABSURD_SHARE, SHORT_MM = 0.5, 30.0
#: Least rank, as a share of what ideal readings would give, that is worth a calibration whatever
#: readings left out say.
LEAST_RANK = 0.5
#: Too few readings help if those left out miss by less than under the drawing.
MOST_SHARE = 1.0


def choose_readings(
    observations: Observations, files: str, thermal_order: int | None, notes: list[str]
) -> tuple[Observations, list[tuple[float, Mask]]]:
    """The readings to use, and their groups by temperature where a thermal model is possible."""
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


def require_some(observations: Observations, files: str) -> None:
    """Refuse readings of which placements and seats leave nothing that tells of the arm."""
    placements, seats = _count_placements(observations), _count_seats(observations)
    # An artefact of seats may stand anywhere in its own frame.
    free = count_artefact_unknowns(observations) - 6 * (seats > 0)
    least_readings = int(free // float(observations.freedom.mean())) + 1 if observations.n else 1
    if observations.n < least_readings:
        expected = (
            f"at least {least_readings} for {placements} placements and {seats} unknown points"
        )
        raise BadInput(files, "readings", f"{observations.n} poses", expected)


def require_help(
    identification: Identification, share: float, files: str, notes: list[str]
) -> None:
    """Of readings that cannot tell the arm apart from its drawing, refuse those that do not help.

    *share*: what readings left out miss by, of what they miss by under the drawing. The drawing
    counts as one more reading of every unknown, so a few readings may help much, and may not.
    """
    observations, arm = identification.observations, identification.observations.arm
    needed, ideal = count_needed_readings(observations), 4 * arm.n_joints - 3
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


def require_enough(observations: Observations, unknown: Sequence[str], files: str) -> None:
    """Refuse readings that are fewer than the unknowns, where these are identified alone."""
    needed = count_needed_readings(observations)
    if observations.n_postures < needed:
        placements, seats = _count_placements(observations), _count_seats(observations)
        expected = (
            f"at least {needed} for {len(unknown)} constants, {placements} placements"
            f" and {seats} unknown points"
        )
        problem = f"{observations.n} poses{_describe_postures(observations)}"
        raise BadInput(files, "readings", problem, expected)


def _describe_postures(observations: Observations) -> str:
    """Of how many postures readings are, where some are copies."""
    postures = observations.n_postures
    return f" of {format_count(postures, 'posture')}" if postures < observations.n else ""


def count_needed_readings(observations: Observations) -> int:
    """Readings below which the unknowns have no one answer, whatever their poses."""
    free = count_artefact_unknowns(observations)
    equations_per_reading = float(observations.freedom.mean())
    return count_readings_for(observations.arm.n_joints, free, equations_per_reading)


def count_artefact_unknowns(observations: Observations) -> int:
    """How many numbers say where the artefacts were, and what nobody certified of them."""
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
    """Whether what is left after fitting is an arm's; a few readings gone wrong, however far, are
    the certificate's to name."""
    residual_mm = np.delete(
        identification.linearisation.residual_mm, identification.outliers, axis=0
    )
    return compute_rms_um(residual_mm) <= 1e3 * ABSURD_RMS_MM


def _describe_farthest(identification: Identification) -> str:
    """Which readings are farthest off, and what half of all are within."""
    off_mm = np.linalg.norm(identification.linearisation.residual_mm, axis=1)
    i = int(np.argmax(off_mm))
    return (
        f" (half of the readings within {np.median(off_mm):.2g} mm; the farthest,"
        f" {identification.observations.name_row(i)}, {off_mm[i]:.3g} mm off)"
    )


def require_plausible(identification: Identification, files: str) -> None:
    """Refuse a fit that is none: residuals beyond any arm's, or another arm than was drawn."""
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
    """What the readings cannot tell apart, in words."""
    names = identification.unknowns.words(identification.terms)
    return describe_unidentifiable(
        identification.solution.null, names, identification.observations.arm
    )
