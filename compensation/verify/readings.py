"""The readings of a verification: corrected points by target, placement and surface."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.data.sessions.format import Distance, Surface
from armd.compensation.data.sessions.session import Session
from armd.compensation.identify.admission.far_off import list_without_temperature
from armd.compensation.model.arm import Arm
from armd.compensation.verify import single
from armd.compensation.verify.limits import TestUncertainty
from armd.compensation.verify.results import Deviation
from armd.compensation.verify.spheres import fit_sphere
from armd.compensation.verify.touched import SPHERE_POINTS, fit_parallel_planes

SPHERE = ("SPHERE.a", "SPHERE.b")


class NotSupported(Exception):
    """The session lacks readings or data that a figure needs."""


@dataclass(frozen=True)
class TouchedSphere:
    """A sphere of the artefact's surfaces in one placement, with the tip's centres on it."""

    label: str
    placement: str
    surface: Surface
    points_mm: F64  # (n, 3)


class VerifiedReadings:
    """A session's corrected points, by target and placement."""

    def __init__(
        self, session: Session, arm: Arm, position: F64, test: TestUncertainty, complete: bool
    ) -> None:
        self.complete = complete
        self.tip_radius_mm = arm.tip.radius_mm
        self.remarks: list[str] = []  # on readings that a test uses in another way than it demands
        self.test = test
        self._session = session
        self._position = position
        self._names = session.artefact.target_names
        self._usable = np.isfinite(position[:, 0])

    def get_points(self, target: str, placement: str | None = None) -> F64:
        """Return usable points (n, 3) at a target in the order of measurement."""
        return self._position[self._find_rows(target, placement)]

    def get_one_per_target(self, prefix: str, count: int) -> F64:
        """Return points (count, 3), one at each target whose name starts with *prefix*.

        Several readings of a target are averaged. Raises `NotSupported` for fewer than *count*
        targets.
        """
        names = [name for name in self._names if name.startswith(prefix)]
        points = [self.get_points(name) for name in names]
        n_measured = sum(len(target_points) > 0 for target_points in points)
        if n_measured < count:
            raise NotSupported(f"{n_measured} of {count} points on {prefix}*")
        self.remarks += [
            f"{name}: {len(target_points)} readings, their mean counts"
            for name, target_points in zip(names, points, strict=True)
            if len(target_points) > 1
        ]
        return np.vstack(
            [target_points.mean(axis=0) for target_points in points if len(target_points)]
        )

    def get_repeats(self, target: str, placement: str, count: int) -> F64:
        """Return the first *count* points, or fewer, at a target in a placement."""
        points = self.get_points(target, placement)
        if len(points) > count:
            self.remarks.append(
                f"{target} in {placement}: {len(points)} readings, the first {count} count"
            )
        return points[:count]

    def list_without_position(self) -> list[str]:
        """Return a line about readings that lack a temperature which the model needs, or none."""
        return list_without_temperature(self._session, self._usable)

    def list_far_off(self) -> list[str]:
        """Describe single readings far from where the others place them."""
        session, position = self._session, self._position
        checks = [
            single.check_repeats(session, position),
            single.check_lengths(
                session,
                position,
                lambda distance, placement: self.compute_length(distance, placement)[0],
            ),
        ]
        radii_mm = {
            surface.name: surface.radius_mm + self.tip_radius_mm
            for surface in session.artefact.surfaces
            if surface.kind == "sphere" and surface.radius_mm is not None
        }
        checks.append(single.check_surfaces(session, position, radii_mm))
        with suppress(NotSupported):
            radius_mm = self.compute_length(self.get_certified(SPHERE))[0] / 2 + self.tip_radius_mm
            checks.append(single.check_spheres(session, position, radius_mm))
        return [line for check in checks for line in check.in_words(session)]

    def list_placements(self, target: str) -> list[str]:
        """List the placements in which a target was measured, in order of appearance."""
        if target not in self._names:
            return []
        placements = self._session.placement[self._find_rows(target, None)]
        return [self._session.placement_names[i] for i in dict.fromkeys(placements.tolist())]

    def get_certified(self, between: tuple[str, str]) -> Distance:
        for distance in self._session.artefact.distances:
            if set(distance.between) == set(between):
                return distance
        raise NotSupported(f"no certified length between {between[0]} and {between[1]}")

    def compute_length(
        self, distance: Distance, placement: str | None = None
    ) -> tuple[float, float]:
        """Return a certified length at its placement's temperature, and its uncertainty (k = 1)."""
        names = () if placement is None else distance.between
        return self._correct_for_temperature(
            distance.length_mm, distance.standard_uncertainty_mm, names, placement
        )

    def _correct_for_temperature(
        self, length_mm: float, uncertainty_mm: float, names: tuple[str, ...], placement: str | None
    ) -> tuple[float, float]:
        """Correct any length for the temperature of the readings at *names*, or of all readings.

        Also return its standard uncertainty.
        """
        artefact = self._session.artefact
        rows = np.concatenate(
            [self._find_rows(name, placement) for name in names] or [np.flatnonzero(self._usable)]
        )
        over_k = float(self._session.artefact_rise_k[rows].mean()) if len(rows) else 0.0
        length = length_mm * (1 + artefact.expansion_per_k * over_k)
        thermal = artefact.expansion_per_k * length_mm * self.test.artefact_temperature_c
        return length, math.hypot(uncertainty_mm, thermal)

    def list_spheres(self) -> list[TouchedSphere]:
        """List each sphere of the artefact's surfaces in each placement; none without such a
        surface.

        Raises `NotSupported` for a sphere with too few points, or, for a complete test, only one
        position.
        """
        spheres = []
        for surface in self._session.artefact.surfaces:
            for placement in self.list_placements(surface.name) if surface.kind == "sphere" else ():
                points = self.get_points(surface.name, placement)
                label = f"{placement} {surface.name}"
                if len(points) < SPHERE_POINTS:
                    raise NotSupported(f"{len(points)} of {SPHERE_POINTS} points on {label}")
                if len(points) > SPHERE_POINTS:
                    remark = f"{label}: all {len(points)} points count, of {SPHERE_POINTS} wanted"
                    self.remarks.append(remark)
                spheres.append(TouchedSphere(label, placement, surface, points))
        if len(spheres) == 1:
            if self.complete:
                raise NotSupported("1 of 2 positions of a sphere")
            self.remarks.append(f"{spheres[0].label}: one position; ISO 10360-12 wants two")
        return spheres

    def compute_size_error(self, touched: TouchedSphere) -> Deviation:
        """Compute the error of a sphere's diameter.

        Raises `NotSupported` without a certified radius.
        """
        surface = touched.surface
        if surface.radius_mm is None:
            raise NotSupported(f"no certified radius_mm of {surface.name}")
        size, uncertainty = self._correct_for_temperature(
            2 * surface.radius_mm, 2 * surface.standard_uncertainty_mm, (surface.name,),
            touched.placement,
        )  # fmt: skip
        measured = 2 * (fit_sphere(touched.points_mm)[1] - self.tip_radius_mm)
        return Deviation(touched.label, measured - size, uncertainty, placement=touched.placement)

    def iterate_block_errors(self) -> Iterator[Deviation]:
        """Yield the error of each certified length between two planes, in each placement with both.

        Raises `NotSupported` where the touched places do not determine a plane.
        """
        kinds = self._session.artefact.surface_kinds
        for distance in self._session.artefact.distances:
            first, second = distance.between
            if kinds.get(first) != "plane" or kinds.get(second) != "plane":
                continue
            for placement in self.list_placements(first):
                faces = [self.get_points(name, placement) for name in distance.between]
                label = f"{placement} {first}, {second}"
                planes = fit_parallel_planes(faces)
                if planes is None:
                    raise NotSupported(f"{label}: touched at too few places, or too near together")
                length, uncertainty = self.compute_length(distance, placement)
                error = planes.distance_mm - 2 * self.tip_radius_mm - length
                yield Deviation(label, error, uncertainty, length, placement)

    def _find_rows(self, target: str, placement: str | None) -> I64:
        if target not in self._names:
            return np.zeros(0, np.int64)
        session = self._session
        chosen = self._usable & (session.target == self._names.index(target))
        if placement is not None:
            chosen &= session.placement == session.placement_names.index(placement)
        return np.flatnonzero(chosen)
