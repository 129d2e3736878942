"""Artefacts: their certified and their true dimensions."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, replace

import numpy as np

from armd.arrays import F64, I64


@dataclass(frozen=True)
class Length:
    """A certified length between two targets."""

    between: tuple[str, str]
    length_mm: float
    standard_uncertainty_mm: float


@dataclass(frozen=True)
class Sag:
    """The sag of a beam on two supports under its own weight.

    `deflection_mm` is between its highest and lowest points when level, `axis` its direction;
    `supports` is the place of the supports as a share of half its length.
    """

    deflection_mm: float
    axis: int  # 0 or 1
    supports: float

    def deflection_at(self, along: F64) -> F64:
        """Return the deflection (n,) mm at places (n,) from −1 to 1: a uniform beam's (Euler,
        Bernoulli).

        With weight and stiffness 1: y'' = s − (1 + x²)/2 between the supports at ±s, and −(1 −
        |x|)²/2 beyond them.
        """
        bend = self._bend(np.linspace(0.0, 1.0, 201))
        hangs: F64 = self._bend(np.array([self.supports])) - self._bend(np.abs(along))
        return self.deflection_mm * hangs / np.ptp(bend)

    def _bend(self, x: F64) -> F64:
        """Return y of the beam, upwards, at places (n,) from 0 to 1."""
        s = self.supports
        slope = (s - 0.5) * s - s**3 / 6
        beyond = (slope - (1 - s) ** 3 / 6) * (x - s) + ((1 - s) ** 4 - (1 - x) ** 4) / 24
        at_support = (s - 0.5) * s**2 / 2 - s**4 / 24
        y: F64 = np.where(x < s, (s - 0.5) * x**2 / 2 - x**4 / 24, at_support + beyond)
        return y


@dataclass(frozen=True)
class Artefact:
    """An artefact's targets: certified and true positions, mm in its own frame."""

    name: str
    targets: list[str]
    certified_mm: F64  # (K, 3); NaN: not certified, an unknown seat
    true_mm: F64  # (K, 3) at the reference temperature
    standard_uncertainty_mm: float
    expansion_per_k: float  # as certified
    true_expansion_per_k: float
    _: KW_ONLY
    lengths: list[Length] = field(default_factory=list)
    reference_c: float = 20.0
    inward: F64 = field(default_factory=lambda: np.empty((0, 3)))  # (K, 3) into a surface, or NaN
    sag: Sag | None = None

    def __post_init__(self) -> None:
        if len(self.inward) == 0:
            object.__setattr__(self, "inward", np.full_like(self.true_mm, np.nan))

    @classmethod
    def certified(
        cls,
        name: str,
        nominal: dict[str, tuple[float, float, float]],
        rng: np.random.Generator,
        *,
        manufacturing_mm: float = 0.05,
        standard_uncertainty_mm: float = 0.0001,
        expansion_per_k: float = 0.5e-6,
    ) -> Artefact:
        """Make an artefact with *manufacturing_mm* errors, certified with that uncertainty."""
        drawn = np.array(list(nominal.values()))
        true = drawn + rng.normal(0.0, manufacturing_mm, drawn.shape)
        certified = true + rng.normal(0.0, standard_uncertainty_mm, drawn.shape)
        # A certificate has a resolution of 10 nm.
        certified = np.round(certified, 5)
        return cls(
            name,
            list(nominal),
            certified,
            true,
            standard_uncertainty_mm,
            expansion_per_k,
            expansion_per_k,
        )

    def uncertified(self) -> Artefact:
        """Return the same targets as unknown points: seats."""
        return replace(self, certified_mm=np.full_like(self.certified_mm, np.nan))

    def index(self, names: tuple[str, ...]) -> I64:
        """Return the indices of the named targets; of all, if none is named."""
        return np.array([self.targets.index(name) for name in names or self.targets])

    def positions(self, target: I64, artefact_c: F64, down: F64) -> F64:
        """Return the true positions (n, 3) mm of targets (n,) in the artefact's frame.

        *artefact_c* (n,) is its temperature, *down* (n, 3) the unit vector of gravity in that
        frame.
        """
        scale = 1.0 + self.true_expansion_per_k * (artefact_c - self.reference_c)
        position_mm: F64 = self.true_mm[target] * scale[:, None]
        if self.sag is not None:
            along_mm = self.true_mm[:, self.sag.axis]
            along = (2.0 * along_mm - along_mm.max() - along_mm.min()) / np.ptp(along_mm)
            across = down.copy()
            across[:, self.sag.axis] = 0.0
            position_mm = position_mm + self.sag.deflection_at(along)[target][:, None] * across
        return position_mm

    def toml(self) -> str:
        """Return the [artefact] part of session.toml: the certified values."""
        lines = [
            "[artefact]",
            f'name = "{self.name}"',
            f"expansion_per_k = {self.expansion_per_k!r}",
            f"reference_temperature_c = {self.reference_c!r}",
        ]
        for name, position in zip(self.targets, self.certified_mm, strict=True):
            lines += ["", "[[artefact.target]]", f'name = "{name}"']
            if np.isfinite(position).all():
                lines.append(f"position_mm = [{', '.join(f'{x:.5f}' for x in position)}]")
                lines.append(f"standard_uncertainty_mm = {self.standard_uncertainty_mm!r}")
        for length in self.lengths:
            lines += [
                "",
                "[[artefact.distance]]",
                f'between = ["{length.between[0]}", "{length.between[1]}"]',
                f"length_mm = {length.length_mm:.5f}",
                f"standard_uncertainty_mm = {length.standard_uncertainty_mm!r}",
            ]
        return "\n".join(lines) + "\n"


def make_ball_beam(rng: np.random.Generator) -> Artefact:
    """Make seven balls along a beam of 720 mm and three on an outrigger, certified to 0.1 µm."""
    balls = {f"B{i + 1}": (120.0 * i, 0.0, 0.0) for i in range(7)}
    balls |= {"B8": (240.0, 260.0, 0.0), "B9": (360.0, 180.0, 140.0), "B10": (480.0, 260.0, 0.0)}
    return Artefact.certified("ball beam", balls, rng)


def make_ball_frame(rng: np.random.Generator, standard_uncertainty_mm: float = 0.0001) -> Artefact:
    """Make twenty balls on posts of several heights on a frame of 500 mm × 400 mm, of steel."""
    heights = (0.0, 160.0, 60.0, 220.0, 110.0)
    balls = {
        f"B{5 * row + column + 1}": (
            125.0 * column,
            400.0 / 3 * row,
            heights[(column + 2 * row) % 5],
        )
        for row in range(4)
        for column in range(5)
    }
    return Artefact.certified(
        "ball frame",
        balls,
        rng,
        standard_uncertainty_mm=standard_uncertainty_mm,
        expansion_per_k=11.5e-6,
    )


def make_seat(name: str = "S1") -> Artefact:
    """Make one kinematic seat at an unknown position."""
    nowhere = np.full((1, 3), np.nan)
    return Artefact("kinematic seat", [name], nowhere, np.zeros((1, 3)), 0.0, 0.0, 0.0)
