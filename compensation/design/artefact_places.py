"""Possible placements of an artefact for a first calibration, and the readings on it there."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from armd.arrays import F64, I64, Mask
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.design.observability import (
    ReadingColumns,
    compute_constant_columns,
    factorise_constants,
)
from armd.compensation.design.reaching import solve_postures
from armd.compensation.estimate.placements.poses import make_rigid_columns
from armd.compensation.identify.admission.reading_counts import LEAST_PLACEMENTS
from armd.compensation.model.arm import Arm
from armd.errors import BadInput

#: Placements that are tried, and postures that are tried in each.
PLACES_TRIED, POSTURES_EACH = 12, 240
#: An artefact stands as in its own frame, turned about the vertical and tilted by at most this.
MOST_TILT_RAD = np.radians(45.0)
#: A placement with fewer readings is not used.
LEAST_READINGS = 12
#: The least uncertainty of a certified length.
LENGTH_MM = 1e-3


@dataclass(frozen=True)
class ArtefactReadings:
    """Readings of an artefact in its placements."""

    q: F64  # (n, N)
    placement: I64  # (n,) from 0
    target: I64  # (n,)
    turn: F64  # (p, 3, 3) of each placement, artefact's frame to base frame

    def rows(self, chosen: I64) -> ArtefactReadings:
        """Return the *chosen* readings."""
        return ArtefactReadings(
            self.q[chosen], self.placement[chosen], self.target[chosen], self.turn
        )

    def groups(self, readings: int) -> I64:
        """Return group numbers (n,): one for each target in each placement, or for each placement.

        The latter is used where *readings* are not enough to touch all targets. A certificate needs
        each placement held out in turn.
        """
        seats = np.unique(np.stack([self.placement, self.target]), axis=1, return_inverse=True)[
            1
        ].reshape(-1)
        enough = readings > seats.max(initial=0)
        numbers: I64 = seats if enough else self.placement
        return numbers


def draw_target_positions(artefact: Artefact, reach_mm: float, rng: np.random.Generator) -> F64:
    """Draw the targets' positions (K, 3) mm in the artefact's frame.

    Positions that nobody certified are random but agree with the certified lengths.
    """
    certified_mm = artefact.positions_mm()
    free = np.isnan(certified_mm[:, 0])
    if not free.any():
        return certified_mm
    names = artefact.target_names
    between = np.array(
        [[names.index(name) for name in d.between] for d in artefact.distances], dtype=np.int64
    ).reshape(-1, 2)
    length = np.array([d.length_mm for d in artefact.distances])
    begin = rng.normal(0.0, reach_mm / 6.0, (int(free.sum()), 3)) * (len(certified_mm) > 1)

    def put(x: F64) -> F64:
        positions = certified_mm.copy()
        positions[free] = x.reshape(-1, 3)
        return positions

    def residual(x: F64) -> F64:
        positions = put(x)
        distance_mm = np.linalg.norm(positions[between[:, 0]] - positions[between[:, 1]], axis=1)
        return np.concatenate([distance_mm - length, 1e-3 * (x - begin.ravel())])

    return put(least_squares(residual, begin.ravel()).x)


def draw_places(
    arm: Arm,
    parameters: F64,
    local_mm: F64,
    within: F64,
    keeps: Callable[[F64], Mask],
    rng: np.random.Generator,
) -> ArtefactReadings:
    """Choose the three placements whose readings together determine most, of PLACES_TRIED random
    ones.

    *local_mm* (K, 3): the targets in the artefact's frame. *within* (m, N): allowed postures to
    begin at. *keeps* returns which other postures are allowed. Raises `BadInput` where the arm
    reaches the artefact in too few placements.
    """
    up = -np.array(arm.gravity) / np.linalg.norm(arm.gravity)
    centres = compute_constant_columns(arm, within, parameters)[0][:PLACES_TRIED]
    drawn, information = [], []
    for centre in centres:
        about = Rotation.from_rotvec(rng.uniform(-np.pi, np.pi) * up)
        tilt = np.cross(up, rng.normal(size=3))
        tilt *= rng.uniform(0.0, MOST_TILT_RAD) / np.linalg.norm(tilt)
        turn = (Rotation.from_rotvec(tilt) * about).as_matrix()
        target = np.arange(POSTURES_EACH) % len(local_mm)
        target_mm = centre + (local_mm - local_mm.mean(axis=0))[target] @ turn.T
        begin = within[rng.integers(len(within), size=POSTURES_EACH)]
        q, reached = solve_postures(arm, parameters, target_mm, begin)
        reached &= keeps(q)
        if reached.sum() < LEAST_READINGS:
            continue
        q, target = q[reached], target[reached]
        tip, constants = compute_constant_columns(arm, q, parameters)
        lone = ReadingColumns(constants, make_rigid_columns(tip - tip.mean(axis=0)), tip)
        s, v = factorise_constants(lone)
        drawn.append((q, target, turn))
        information.append((v * s**2) @ v.T)
    if len(drawn) < LEAST_PLACEMENTS:
        raise BadInput(
            "--artefact", "its targets", f"{len(drawn)} places where the arm reaches them",
            f"at least {LEAST_PLACEMENTS} (joint limits, --reach, the artefact's size?)",
        )  # fmt: skip
    chosen = _best_places(information)
    return ArtefactReadings(
        np.concatenate([drawn[i][0] for i in chosen]),
        np.repeat(np.arange(len(chosen)), [len(drawn[i][0]) for i in chosen]),
        np.concatenate([drawn[i][1] for i in chosen]),
        np.array([drawn[i][2] for i in chosen]),
    )


def _best_places(information: list[F64]) -> list[int]:
    """Choose LEAST_PLACEMENTS greedily by the determinant of their *information*, each (C, C)."""
    total = 1e-9 * np.trace(sum(information)) * np.eye(len(information[0]))
    chosen: list[int] = []
    for _ in range(LEAST_PLACEMENTS):
        merit = [
            -np.inf if i in chosen else np.linalg.slogdet(total + gain)[1]
            for i, gain in enumerate(information)
        ]
        chosen.append(int(np.argmax(merit)))
        total = total + information[chosen[-1]]
    return chosen


def compute_artefact_columns(
    arm: Arm, parameters: F64, places: ArtefactReadings, artefact: Artefact
) -> ReadingColumns:
    """Compute the columns of readings on an artefact.

    Nuisances: six of each placement, three of each target without a certified position.
    """
    tip, constants = compute_constant_columns(arm, places.q, parameters)
    n, p = len(tip), len(places.turn)
    seats = np.flatnonzero(np.isnan(artefact.positions_mm()[:, 0]))
    nuisances = np.zeros((n, 3, 6 * p + 3 * len(seats)))
    for i in range(p):
        rows = places.placement == i
        nuisances[rows, :, 6 * i : 6 * i + 6] = make_rigid_columns(
            tip[rows] - tip[rows].mean(axis=0)
        )
    for k, seat in enumerate(seats):
        rows = places.target == seat
        first = 6 * p + 3 * k
        nuisances[rows, :, first : first + 3] = -places.turn[places.placement[rows]]
    return ReadingColumns(constants, nuisances, tip)


def compute_length_rows(artefact: Artefact, local_mm: F64, placements: int, noise_mm: float) -> F64:
    """Compute rows (D, k) of the certified lengths by the nuisances, over a reading's noise."""
    seats = np.flatnonzero(np.isnan(artefact.positions_mm()[:, 0])).tolist()
    names, first = artefact.target_names, 6 * placements
    rows = np.zeros((len(artefact.distances), first + 3 * len(seats)))
    for row, distance in zip(rows, artefact.distances, strict=True):
        i, j = (names.index(name) for name in distance.between)
        along = local_mm[i] - local_mm[j]
        along /= max(float(np.linalg.norm(along)), 1e-9)
        weight = noise_mm / max(distance.standard_uncertainty_mm, LENGTH_MM)
        for target, sign in ((i, 1.0), (j, -1.0)):
            if target in seats:
                column = first + 3 * seats.index(target)
                row[column : column + 3] = sign * weight * along
    return rows
