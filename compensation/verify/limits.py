"""The content of `mpe.toml`: an arm's specification, and the rule for decisions."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Field, model_validator

from armd.files.schema import Strict, load_toml

#: No articulated arm has a larger specification: such a number was typed in µm.
LARGEST_MM = 5.0


def _require_mm(value: float) -> float:
    if value > LARGEST_MM:
        raise ValueError(f"mm, {LARGEST_MM:g} at most ({value:g} µm are {value / 1e3:g} mm)")
    return value


Limit = Annotated[float, Field(gt=0), AfterValidator(_require_mm)] | None


class Mpe(Strict):
    """Maximum permissible errors in mm, by the figure they limit; missing ones are not judged."""

    p_size_mm: Limit = None
    p_form_mm: Limit = None
    l_dia_mm: Limit = None
    e_uni_mm: Limit = None
    #: added to `e_uni_mm` for every metre measured: MPE = A + L·this
    e_uni_mm_per_m: Annotated[float, Field(ge=0), AfterValidator(_require_mm)] = 0.0
    block_length_mm: Limit = None
    effective_diameter_mm: Limit = None
    spat_max_mm: Limit = None
    spat_2s_mm: Limit = None
    volumetric_max_mm: Limit = None
    volumetric_2rms_mm: Limit = None
    volumetric_range_mm: Limit = None

    @model_validator(mode="after")
    def _limits_something(self) -> Self:
        """Raise `ValueError` for a file without a limit, which would let everything pass."""
        fixed = [name for name in type(self).model_fields if name != "e_uni_mm_per_m"]
        if all(getattr(self, name) is None for name in fixed):
            raise ValueError(f"a limit at least, of {', '.join(fixed)}")
        if self.e_uni_mm_per_m and self.e_uni_mm is None:
            raise ValueError("e_uni_mm beside e_uni_mm_per_m: MPE = A + L times this")
        return self

    def limit_mm(self, figure: str, length_mm: float) -> float | None:
        """Return the limit of a figure (its key without ``_mm``), which may depend on a length."""
        limit: float | None = getattr(self, f"{figure}_mm")
        if limit is not None and figure == "e_uni":
            return limit + self.e_uni_mm_per_m * length_mm / 1000
        return limit


class TestUncertainty(Strict):
    """Standard uncertainties of the test itself, besides those of the certified lengths."""

    __test__ = False  # not a test, although pytest takes the name for one

    artefact_temperature_c: Annotated[float, Field(ge=0)] = 0.1
    sphere_form_mm: Annotated[float, Field(ge=0)] = 0.0
    seat_mm: Annotated[float, Field(ge=0)] = 0.0


class PermissibleErrors(Strict):
    """The content of an MPE file.

    `decision` "guarded": ISO 14253-1, a result conforms if it lies within the limit reduced by the
    test's expanded uncertainty (k = 2). "simple": within the limit.
    """

    schema_: Literal["armd.mpe/1"] = Field(default="armd.mpe/1", alias="schema")
    decision: Literal["guarded", "simple"] = "guarded"
    #: diameter of the space in which the arm measures; the longest length of E_Uni is compared with
    #: it
    measuring_range_mm: Annotated[float, Field(gt=0)] | None = None
    mpe: Mpe
    uncertainty: TestUncertainty = TestUncertainty()


def load_limits(path: str | Path) -> PermissibleErrors:
    """Read and check an MPE file; raises `BadInput` naming file, key, found and expected."""
    return load_toml(path, PermissibleErrors)
