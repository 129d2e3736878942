"""Plates, spheres, blocks and pins touched by the simulator's arm: sessions, and the truth.

The simulator turns its own arm until the ball at its tip rests on a surface, the shaft outside of
it, and writes down what its encoders show. Nothing here knows how armd models arm or surface.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from armd.arrays import F64, Mask
from armd.simulator.measured.noise import Noise
from armd.simulator.measured.poses import MARGIN_RAD, solve_posture
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.effects.effect import Conditions
from armd.simulator.truth.nominal import TIP_RADIUS_MM
from armd.simulator.truth.rotations import draw_directions

#: Least cosine of the shaft with the way out of a surface: flatter, it would touch it.
LEAST_COSINE = 0.3
#: A ball that sits as well as a hand holds it; encoders of half a second of arc.
NOISE = Noise(encoder_arcsec=2.0, seating_um=5.0)
#: Goals that are tried at once.
BATCH = 64

#: Points (n, 3) on a surface and unit vectors (n, 3) out of it, mm in the artefact's frame.
Skin = Callable[[np.random.Generator, int], tuple[F64, F64]]


@dataclass(frozen=True)
class Surface:
    """One surface: where it may be touched, and what session.toml says of it."""

    name: str
    skin: Skin
    toml: str  # kind, and radius where certified


def plane(name: str, z_mm: float = 0.0, up: float = 1.0, half_mm: float = 120.0) -> Surface:
    """A square about the z axis at the height *z_mm*, its outside along *up* times z."""

    def skin(rng: np.random.Generator, n: int) -> tuple[F64, F64]:
        points = rng.uniform(-half_mm, half_mm, (n, 3))
        points[:, 2] = z_mm
        return points, np.tile([0.0, 0.0, up], (n, 1))

    return Surface(name, skin, 'kind = "plane"')


def sphere(
    name: str,
    radius_mm: float,
    certified: tuple[float, float] | None = None,
    least_z: float = -0.3,
    centre_mm: Sequence[float] = (0.0, 0.0, 0.0),
) -> Surface:
    """A sphere on a post, touched above *least_z* of its radius; *certified*: radius and its
    standard uncertainty, mm."""

    def skin(rng: np.random.Generator, n: int) -> tuple[F64, F64]:
        z = rng.uniform(least_z, 1.0, n)
        angle = rng.uniform(0.0, 2.0 * np.pi, n)
        level = np.sqrt(1.0 - z**2)
        out = np.stack([level * np.cos(angle), level * np.sin(angle), z], axis=1)
        return np.array(centre_mm) + radius_mm * out, out

    return Surface(name, skin, 'kind = "sphere"' + _radius(certified))


def cylinder(
    name: str,
    radius_mm: float,
    certified: tuple[float, float] | None = None,
    half_mm: float = 60.0,
    inside: bool = False,
) -> Surface:
    """A pin about z, or a bore."""

    def skin(rng: np.random.Generator, n: int) -> tuple[F64, F64]:
        angle = rng.uniform(0.0, 2.0 * np.pi, n)
        out = np.stack([np.cos(angle), np.sin(angle), np.zeros(n)], axis=1)
        points = radius_mm * out
        points[:, 2] = rng.uniform(-half_mm, half_mm, n)
        return points, -out if inside else out

    return Surface(name, skin, 'kind = "cylinder"' + _radius(certified))


def _radius(certified: tuple[float, float] | None) -> str:
    if certified is None:
        return ""
    return f"\nradius_mm = {certified[0]:.6f}\nstandard_uncertainty_mm = {certified[1]!r}"


class Workshop:
    """One arm of the simulator among surfaces."""

    def __init__(self, seed: int = 1, reach_size: int = 6000) -> None:
        self.arm = TrueArm.default(seed)
        self.rng = np.random.default_rng([seed, 0x5F])
        self._low, self._high = nominal.get_limits_rad()
        inside = self._low + MARGIN_RAD, self._high - MARGIN_RAD
        self._phi = self.rng.uniform(*inside, (reach_size, self.arm.n_joints))
        still = Conditions.at_rest(reach_size, self.arm.n_joints)
        self._near = cKDTree(self.arm.tip(self._phi, still))

    def postures(self, surface: Surface, rotation: F64, origin_mm: F64, count: int) -> F64:
        """(count, N) true angles that put the ball against *surface*, stood at such a pose, its
        seating noise contained."""
        found = np.empty((0, self.arm.n_joints))
        for _ in range(60):
            points, out = surface.skin(self.rng, BATCH)
            goal = (points + TIP_RADIUS_MM * out) @ rotation.T + origin_mm
            goal = goal + NOISE.seating(self.rng, BATCH)
            phi, kept = self._reached(goal)
            shaft = self._shaft(phi)
            kept &= np.einsum("ni,ni->n", shaft, out @ rotation.T) > LEAST_COSINE
            found = np.concatenate([found, phi[kept]])
            if len(found) >= count:
                return found[:count]
        raise AssertionError(f"{surface.name} is out of reach at {origin_mm}")

    def _reached(self, goal: F64) -> tuple[F64, Mask]:
        """Angles (n, N) with the ball's centre at *goal* (n, 3), and which of them hold."""
        near = np.asarray(self._near.query(goal, k=200)[1])
        picked = near[np.arange(len(goal)), self.rng.integers(0, 200, len(goal))]
        still = Conditions.at_rest(len(goal), self.arm.n_joints)
        phi = solve_posture(self.arm, self._phi[picked], goal, still)
        missed = np.linalg.norm(self.arm.tip(phi, still) - goal, axis=1)
        inside = ((phi >= self._low) & (phi <= self._high)).all(axis=1)
        return phi, inside & (missed < 1e-4)

    def _shaft(self, phi: F64) -> F64:
        """Unit vectors (n, 3) from the ball up to the wrist."""
        posture = self.arm.posture(phi, Conditions.at_rest(len(phi), self.arm.n_joints))
        way = posture.origin[-1] - posture.tip
        unit: F64 = way / np.linalg.norm(way, axis=1, keepdims=True)
        return unit

    def stand(self, tilted: float = 0.6) -> tuple[F64, F64]:
        """A pose within reach: somewhere around the column, tilted at random."""
        azimuth = self.rng.uniform(-np.pi, np.pi)
        radius, height = self.rng.uniform(420.0, 650.0), self.rng.uniform(-50.0, 450.0)
        where = np.array([radius * np.cos(azimuth), radius * np.sin(azimuth), height])
        turn = Rotation.from_rotvec(tilted * draw_directions(self.rng, 1)[0])
        turn = turn * Rotation.from_rotvec([0.0, 0.0, self.rng.uniform(0.0, 2.0 * np.pi)])
        return np.asarray(turn.as_matrix()), where

    def session(
        self,
        folder: Path,
        surfaces: Sequence[Surface],
        placements: int,
        each: int,
        lengths: Sequence[str] = (),
        tilted: float = 0.6,
    ) -> Path:
        """Write a session: all *surfaces* touched *each* times in so many placements; *lengths*:
        tables of session.toml."""
        rows, where, what = [], [], []
        for p in range(placements):
            for _ in range(50):
                rotation, origin = self.stand(tilted)
                try:
                    own = [self.postures(s, rotation, origin, each) for s in surfaces]
                    break
                except AssertionError:
                    continue
            else:
                raise AssertionError("no placement in which all surfaces are within reach")
            for surface, phi in zip(surfaces, own, strict=True):
                rows.append(phi)
                where += [f"P{p + 1}"] * each
                what += [surface.name] * each
        phi = np.concatenate(rows)
        conditions = Conditions.at_rest(len(phi), self.arm.n_joints)
        q = self.arm.encoder_angles(phi, conditions) + NOISE.encoders(self.rng, phi.shape)
        order = self.rng.permutation(len(q))
        write_session(folder, surfaces, lengths, q[order], [where[i] for i in order],
                      [what[i] for i in order])  # fmt: skip
        return folder


def write_session(
    folder: Path,
    surfaces: Sequence[Surface],
    lengths: Sequence[str],
    q: F64,
    placement: Sequence[str],
    target: Sequence[str],
) -> None:
    """Write session.toml and readings.csv."""
    folder.mkdir(parents=True)
    tables = [f'[[artefact.surface]]\nname = "{s.name}"\n{s.toml}\n' for s in surfaces]
    head = (
        f'schema = "armd.session/1"\narm = "{nominal.SERIAL_NUMBER}"\n'
        'started = 2026-03-01T09:00:00Z\nangle_unit = "rad"\n\n[artefact]\nname = "surfaces"\n'
    )
    (folder / "session.toml").write_text("\n".join([head, *tables, *lengths]), encoding="utf-8")
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time_s", "placement", "target", *(f"q{k + 1}" for k in range(q.shape[1]))])
    for i, row in enumerate(q):
        writer.writerow([f"{10.0 * i:.1f}", placement[i], target[i], *(f"{x:.10f}" for x in row)])
    (folder / "readings.csv").write_text(text.getvalue(), encoding="utf-8")


def distance(one: str, other: str, length_mm: float, uncertainty_mm: float) -> str:
    """A certified length between two planes, as session.toml has it."""
    return (
        f'[[artefact.distance]]\nbetween = ["{one}", "{other}"]\nlength_mm = {length_mm:.6f}\n'
        f"standard_uncertainty_mm = {uncertainty_mm!r}\n"
    )
