"""What sessions must offer to be identified from; otherwise they are refused, and why."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from armd.compensation import parameters
from armd.compensation.identify.fit import Fit
from armd.compensation.identify.gauge import unidentifiable
from armd.compensation.identify.observations import Observations
from armd.compensation.identify.thermal import temperature_groups
from armd.errors import BadInput

Mask = npt.NDArray[np.bool_]

#: Residuals beyond this are not an arm's: another unit, another arm, a wrong direction.
ABSURD_RMS_MM = 20.0
#: A link that differs from its drawing by more than this is another link, or in another unit.
ABSURD_CHANGE_MM = 100.0
#: Least rank, as a share of what ideal readings would give, that is worth a calibration.
LEAST_RANK = 0.5


def choose_readings(
    observations: Observations, files: str, wanted: int | None, notes: list[str]
) -> tuple[Observations, list[tuple[float, Mask]]]:
    """The readings to use, and their groups by temperature where a thermal model is possible."""
    arm = observations.arm
    if wanted == 0:
        return observations, []
    sensors = [s for s in arm.sensors if any(joint.weights.get(s) for joint in arm.joint)]
    temperature_c = observations.states.temperature_c[:, [arm.sensors.index(s) for s in sensors]]
    complete: Mask = np.all(np.isfinite(temperature_c), axis=1)
    if not sensors or not complete.any():
        if wanted:
            found = "no readings that have them all" if sensors else "no joint with a temperature"
            raise BadInput(files, "temperatures", found, "the sensors that arm.toml names")
        notes.append("no temperatures: geometry only")
        return observations, []
    if not complete.all():
        notes.append(f"{int((~complete).sum())} readings lack a temperature and are not used")
        observations = observations.rows(complete)
    groups = temperature_groups(observations)
    needed = 2 if wanted is None else wanted + 1
    if len(groups) < needed:
        found = f"{len(groups)} ({', '.join(f'{mean:.1f} °C' for mean, _ in groups)})"
        if wanted:
            expected = f"at least {needed} for a thermal model of order {wanted}"
            raise BadInput(files, "temperatures", found, expected)
        notes.append(f"one temperature only, {groups[0][0]:.1f} °C: no thermal model (order 0)")
    return observations, groups


def require_enough(observations: Observations, unknown: Sequence[str], files: str) -> None:
    """Refuse readings that are fewer than the unknowns, whatever their poses."""
    needed = readings_needed(observations)
    if observations.n < needed:
        placements, seats = _placements(observations), _seats(observations)
        expected = (
            f"at least {needed} for {len(unknown)} constants, {placements} placements"
            f" and {seats} unknown points"
        )
        raise BadInput(files, "readings", f"{observations.n} poses", expected)


def readings_needed(observations: Observations) -> int:
    """Readings below which the unknowns have no one answer, whatever their poses."""
    identifiable = 4 * observations.arm.n_joints - 3
    unknown = identifiable + 6 * _placements(observations) + 3 * _seats(observations)
    return -(-unknown // 3) + 1


def _placements(observations: Observations) -> int:
    return len(np.unique(observations.placement))


def _seats(observations: Observations) -> int:
    touched = np.unique(observations.target[~observations.has_truth])
    return int(observations.unknown[touched].sum())


def require_plausible(found: Fit, files: str) -> None:
    """Refuse a fit that is none: residuals beyond any arm's, or poses that say next to nothing."""
    if found.rms_um > 1e3 * ABSURD_RMS_MM:
        raise BadInput(
            files,
            "readings",
            f"residuals of {found.rms_um / 1e3:.0f} mm after fitting",
            "readings of this arm (units of angles and lengths, directions, targets?)",
        )
    arm = found.observations.arm
    links = slice(0, 5 * (arm.n_joints - 1))  # the last link and the tip may be anything
    lengths = [parameters.unit(name) == "mm" for name in parameters.names(arm.n_joints)[links]]
    change = np.abs(found.constants - arm.nominal())[links] * lengths
    if change.max() > ABSURD_CHANGE_MM:
        name = parameters.names(arm.n_joints)[int(np.argmax(change))]
        raise BadInput(
            files,
            "readings",
            f"{name} changed by {change.max():.0f} mm",
            f"readings of this arm, lengths in mm (a change of {ABSURD_CHANGE_MM:g} mm at most)",
        )
    ideal = 4 * arm.n_joints - 3
    rank = found.solution.rank - len(found.unknowns.terms)
    if rank < LEAST_RANK * ideal:
        words = "; ".join(not_known(found)[:4])
        raise BadInput(
            files,
            "poses",
            f"rank {max(rank, 0)} of {len(found.unknowns.constants)} constants ({words}; …)",
            f"poses that tell at least {int(LEAST_RANK * ideal) + 1} of {ideal} apart",
        )


def not_known(found: Fit) -> list[str]:
    """What the readings cannot tell apart, in words."""
    names = found.unknowns.words(found.terms)
    return unidentifiable(found.solution.null, names, found.observations.arm)
