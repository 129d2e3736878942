"""`session.toml`: which arm was measured, when, and on which artefact."""

from __future__ import annotations

import datetime
import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, AwareDatetime, Field, model_validator

from armd.arrays import F64
from armd.compensation.model.arm import Vector3
from armd.files.schema import Strict
from armd.terminal.suggest import hint

#: What a certified length may be off the certified positions, beside their uncertainties.
CONTRADICTION_MM = 1.0

#: Beyond these an instant is no measurement's, and years from then on have no calendar here.
FIRST_YEAR, LAST_YEAR = 1970, 2200

AngleUnit = Literal["rad", "deg", "count"]
Name = Annotated[str, Field(min_length=1)]


def measured_at(instant: datetime.datetime) -> datetime.datetime:
    """*instant*, if somebody can have measured then; raises `ValueError` with what is expected."""
    if not FIRST_YEAR <= instant.year <= LAST_YEAR:
        raise ValueError(f"an instant of the years {FIRST_YEAR} to {LAST_YEAR}")
    return instant


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


def _of_distances(artefact: dict[str, Any]) -> list[Target]:
    """Targets that no list names: those that the distances of *artefact* are between."""
    distances: list[Distance] = artefact.get("distances", [])
    names = dict.fromkeys(name for distance in distances for name in distance.between)
    return [Target(name=name) for name in names]


class Artefact(Strict):
    """What the tip was put to. Positions hold at the artefact's reference temperature."""

    name: Name
    certificate: Name | None = None  # number of the certificate its positions come from
    expansion_per_k: Annotated[float, Field(ge=-1e-3, le=1e-3)] = 0.0
    reference_temperature_c: float = 20.0
    distances: Annotated[list[Distance], Field(alias="distance")] = []
    targets: Annotated[list[Target], Field(alias="target", default_factory=_of_distances)]

    @model_validator(mode="after")
    def _consistent(self) -> Artefact:
        names = self.target_names
        if not names:
            raise ValueError(
                "the points that were touched: a [[artefact.target]] with name (and position_mm,"
                " where it is certified) for each, or [[artefact.distance]] between two of them"
            )
        for name in names:
            if names.count(name) > 1:
                raise ValueError(f"target names that differ from each other, not two {name!r}")
        for i, distance in enumerate(self.distances, 1):
            for name in distance.between:
                if name not in names:
                    like = hint(name, names)
                    raise ValueError(f"a target's name in distance[{i}], not {name!r}{like}")
            if distance.between[0] == distance.between[1]:
                raise ValueError(f"distance[{i}] between two different targets")
            self._agrees(i, distance)
        return self

    def _agrees(self, i: int, distance: Distance) -> None:
        """One certificate says a length once: between two certified positions, and as a length."""
        ends = [self.targets[self.target_names.index(name)] for name in distance.between]
        one, other = (end.position_mm for end in ends)
        if one is None or other is None:
            return
        apart = math.dist(one, other)
        known = sum(end.standard_uncertainty_mm for end in ends) + distance.standard_uncertainty_mm
        if abs(apart - distance.length_mm) > CONTRADICTION_MM + 6.0 * known:
            raise ValueError(
                f"a length_mm in distance[{i}] as far as the positions of {ends[0].name} and"
                f" {ends[1].name} are apart, {apart:.3f} mm, not {distance.length_mm:g}"
            )

    @property
    def target_names(self) -> list[str]:
        return [target.name for target in self.targets]

    def positions_mm(self) -> F64:
        """Certified positions (K, 3) mm; NaN where a target is an unknown seat."""
        unknown = (np.nan, np.nan, np.nan)
        return np.array([target.position_mm or unknown for target in self.targets], dtype=float)


class ArtefactFile(Strict):
    """The content of an artefact's file: the table `[artefact]` of session.toml, alone."""

    schema_: Annotated[Literal["armd.artefact/1"], Field(alias="schema")] = "armd.artefact/1"
    artefact: Artefact


class SessionFile(Strict):
    """The content of `session.toml`."""

    schema_: Literal["armd.session/1"] = Field(alias="schema")
    arm: Name
    started: Annotated[AwareDatetime, AfterValidator(measured_at)]
    operator: Name | None = None
    angle_unit: AngleUnit = "rad"
    artefact: Artefact
