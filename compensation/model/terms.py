"""The terms of a model: parameter = constant + Σ coefficient × basis function of the arm's state.

A `Term` is one such product, and a calibration file stores terms. Its basis is a product of
factors. Each factor is a function of one quantity that the daemon knows at an instant:
`pose_factors` and `slow_factors`.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from armd.compensation.model.pose_factors import AnyPoseFactor
from armd.compensation.model.slow_factors import AnySlowFactor, SlowFactor
from armd.files.schema import Strict

Factor = Annotated[AnySlowFactor | AnyPoseFactor, Field(discriminator="kind")]


class Term(Strict):
    """The product that changes a parameter: parameter += coefficient × Π basis.

    The coefficient is in the parameter's unit per basis unit.
    """

    parameter: str
    basis: list[Factor] = Field(default_factory=list)
    coefficient: float = 0.0
    standard_uncertainty: Annotated[float, Field(ge=0)] | None = None
    effect: str | None = None  # the effect it belongs to, e.g. "encoder_eccentricity joint 3"

    @property
    def slow(self) -> bool:
        """True if no factor depends on the pose: folded at the rate of the temperatures."""
        return all(isinstance(factor, SlowFactor) for factor in self.basis)
