"""The file `session.toml`: which arm was measured, when, and on which artefact."""

from __future__ import annotations

import datetime
import math
import re
from collections.abc import Iterable
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    AwareDatetime,
    BeforeValidator,
    Field,
    ValidationInfo,
    field_validator,
    model_validator,
)

from armd.arrays import F64
from armd.compensation.model.arm import Vector3
from armd.files.schema import Strict
from armd.terminal.suggest import suggest_names

#: The largest difference between a certified length and the certified positions, in addition to
#: their uncertainties.
CONTRADICTION_MM = 1.0

#: Years of plausible instants; the calendar here ends with them.
FIRST_YEAR, LAST_YEAR = 1970, 2200

#: Names of targets that belong to a test of `armd verify` (docs/how-to/verify.md). They need no
#: entry, because nothing is known of these points.
OF_A_VERIFICATION = re.compile(
    r"SPHERE[12]\..+|SPHERE\.[ab]|LDIA\.[1-5]\..+|L[0-5]|EFFDIA\.[1-3]\..+|SPAT[123]|BAR[SL]\.[ab]"
)

AngleUnit = Literal["rad", "deg", "count"]
SurfaceKind = Literal["plane", "sphere", "cylinder"]
Name = Annotated[str, Field(min_length=1)]


def _is_day(text: str) -> str:
    """Return *text* if it is a day of the calendar; raises `ValueError` with what is expected."""
    try:
        datetime.date.fromisoformat(text)
    except ValueError:
        raise ValueError("a day as 2027-03-01") from None
    return text


#: A day as text; TOML's own dates are accepted, too.
Day = Annotated[
    str,
    BeforeValidator(lambda day: day.isoformat() if type(day) is datetime.date else day),
    AfterValidator(_is_day),
]


def check_instant(instant: datetime.datetime) -> datetime.datetime:
    """Return *instant* if it is a plausible time of a measurement; raises `ValueError` otherwise.

    The error states what is expected.
    """
    if not FIRST_YEAR <= instant.year <= LAST_YEAR:
        raise ValueError(f"an instant of the years {FIRST_YEAR} to {LAST_YEAR}")
    return instant


def is_documented(name: str) -> bool:
    """Return whether `armd verify` knows this name."""
    return OF_A_VERIFICATION.fullmatch(name) is not None


class Target(Strict):
    """A point of the artefact; without a position it is an unknown fixed point (a seat)."""

    name: Name
    position_mm: Vector3 | None = None
    standard_uncertainty_mm: Annotated[float, Field(ge=0)] = 0.0


class Distance(Strict):
    """A certified length between two targets, at the artefact's reference temperature."""

    between: tuple[Name, Name]
    length_mm: Annotated[float, Field(gt=0)]
    standard_uncertainty_mm: Annotated[float, Field(ge=0)] = 0.0


class Surface(Strict):
    """A surface of unknown pose, which the tip touches from outside at any points."""

    name: Name
    kind: SurfaceKind
    radius_mm: Annotated[float, Field(gt=0)] | None = None  # certified; None: unknown
    standard_uncertainty_mm: Annotated[float, Field(ge=0)] = 0.0  # of the radius

    @model_validator(mode="after")
    def _round(self) -> Surface:
        if self.kind == "plane" and self.radius_mm is not None:
            raise ValueError(f"no radius_mm for {self.name!r}: a plane has none")
        return self


def _of_distances(artefact: dict[str, Any]) -> list[Target]:
    """Return the targets between which the distances of *artefact* are, if it lists no targets."""
    distances: list[Distance] = artefact.get("distances", [])
    surfaces = {surface.name for surface in artefact.get("surfaces", [])}
    names = dict.fromkeys(name for distance in distances for name in distance.between)
    return [Target(name=name) for name in names if name not in surfaces]


class Artefact(Strict):
    """The measured object; positions hold at its reference temperature."""

    name: Name
    certificate: Name | None = None  # number of the certificate its positions come from
    certificate_valid_until: Day | None = None  # last day; reports name it
    expansion_per_k: Annotated[float, Field(ge=-1e-3, le=1e-3)] = 0.0
    reference_temperature_c: float = 20.0
    distances: Annotated[list[Distance], Field(alias="distance")] = []
    surfaces: Annotated[list[Surface], Field(alias="surface")] = []
    targets: Annotated[list[Target], Field(alias="target", default_factory=_of_distances)]

    @field_validator("targets", mode="after")
    @classmethod
    def _with_ends(cls, targets: list[Target], info: ValidationInfo) -> list[Target]:
        """Add ends of distances with a verification's names, if the list lacks them."""
        listed = {target.name for target in targets}
        listed |= {surface.name for surface in info.data.get("surfaces", [])}
        ends = [target.name for target in _of_distances(info.data)]
        new = [name for name in ends if name not in listed and is_documented(name)]
        return [*targets, *(Target(name=name) for name in new)]

    @model_validator(mode="after")
    def _consistent(self) -> Artefact:
        names = self.target_names
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"target names that differ from each other, not two {name!r}")
        for i, distance in enumerate(self.distances, 1):
            for name in distance.between:
                if name not in names:
                    like = suggest_names(name, names)
                    raise ValueError(f"a target's name in distance[{i}], not {name!r}{like}")
            if distance.between[0] == distance.between[1]:
                raise ValueError(f"distance[{i}] between two different targets")
            self._agrees(i, distance)
        return self

    def _between_planes(self, i: int, distance: Distance) -> bool:
        """Return whether it is a gauge block's length; raises `ValueError` for a point and a
        surface.
        """
        kinds = [self.surface_kinds.get(name) for name in distance.between]
        if kinds == [None, None]:
            return False
        if kinds != ["plane", "plane"]:
            first, second = distance.between
            raise ValueError(
                f"distance[{i}] between two targets or between two surfaces of kind"
                f' "plane", not {first!r} and {second!r}'
            )
        return True

    def _agrees(self, i: int, distance: Distance) -> None:
        """Raise `ValueError` if a certified length contradicts the certified positions of
        its ends.
        """
        if self._between_planes(i, distance):
            return
        ends = [self.targets[self.target_names.index(name)] for name in distance.between]
        first_mm, second_mm = (end.position_mm for end in ends)
        if first_mm is None or second_mm is None:
            return
        distance_mm = math.dist(first_mm, second_mm)
        uncertainty_mm = (
            sum(end.standard_uncertainty_mm for end in ends) + distance.standard_uncertainty_mm
        )
        if abs(distance_mm - distance.length_mm) > CONTRADICTION_MM + 6.0 * uncertainty_mm:
            raise ValueError(
                f"a length_mm in distance[{i}] as far as the positions of {ends[0].name} and"
                f" {ends[1].name} are apart, {distance_mm:.3f} mm, not {distance.length_mm:g}"
            )

    @property
    def entries(self) -> list[Target | Surface]:
        """The targets, then the surfaces."""
        return [*self.targets, *self.surfaces]

    @property
    def target_names(self) -> list[str]:
        """The names that a reading's `target` may have."""
        return [entry.name for entry in self.entries]

    @property
    def surface_kinds(self) -> dict[str, SurfaceKind]:
        """The kind of each surface by its name."""
        return {surface.name: surface.kind for surface in self.surfaces}

    def with_documented(self, names: Iterable[str]) -> Artefact:
        """Return the artefact with those of *names* that a verification uses, as unknown points."""
        listed = set(self.target_names)
        new = [Target(name=name) for name in names if name not in listed and is_documented(name)]
        return self.model_copy(update={"targets": [*self.targets, *new]}) if new else self

    def positions_mm(self) -> F64:
        """Return the certified positions (K, 3) mm; NaN where a target is an unknown seat.

        A surface has a frame of its own. Its third coordinate is its radius or, for a plane, its
        height there: 0 for one that no certified length ties to another.
        """
        unknown = (np.nan, np.nan, np.nan)
        tied = {name for distance in self.distances for name in distance.between}
        rows = [target.position_mm or unknown for target in self.targets]
        for surface in self.surfaces:
            size = 0.0 if surface.kind == "plane" else surface.radius_mm
            rows.append(unknown if size is None or surface.name in tied else (0.0, 0.0, size))
        return np.array(rows, dtype=float).reshape(-1, 3)

    def uncertainties_mm(self) -> F64:
        """Return standard uncertainties (K,) mm per axis of the certified positions, and
        of radii.
        """
        round_ = [s.standard_uncertainty_mm * (s.kind != "plane") for s in self.surfaces]
        return np.array([*(target.standard_uncertainty_mm for target in self.targets), *round_])


def _with_targets(artefact: Artefact) -> Artefact:
    if not artefact.target_names:
        raise ValueError(
            "the points that were touched: a [[artefact.target]] with name (and position_mm,"
            " where it is certified) for each, [[artefact.distance]] between two of them, or an"
            " [[artefact.surface]]"
        )
    return artefact


class ArtefactFile(Strict):
    """The content of an artefact's file: the table `[artefact]` of session.toml by itself."""

    schema_: Annotated[Literal["armd.artefact/1"], Field(alias="schema")] = "armd.artefact/1"
    artefact: Annotated[Artefact, AfterValidator(_with_targets)]


class Reflector(Strict):
    """A reflector with a known position in the last frame."""

    name: Name
    offset_mm: Vector3


class SessionFile(Strict):
    """The content of `session.toml`."""

    schema_: Literal["armd.session/1"] = Field(alias="schema")
    arm: Name
    started: Annotated[AwareDatetime, AfterValidator(check_instant)]
    operator: Name | None = None
    angle_unit: AngleUnit = "rad"
    artefact: Artefact
    reflectors: Annotated[list[Reflector], Field(alias="reflector")] = []

    @model_validator(mode="after")
    def _reflectors_once(self) -> SessionFile:
        names = [reflector.name for reflector in self.reflectors]
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"reflectors' names that differ, not two {name!r}")
        return self
