"""The parameters of an arm's model, by index and by name.

One flat vector holds them all, so that a term, a Jacobian column and an identified constant refer
to the same number: five per joint (θ offset, d, a, α, Hayati β), the tip's offset, and the base's
small displacement. All are in millimetres and radians.

`ParameterLayout` gives the index of each. Compiled code cannot take such objects and indexes the
vector itself: joint k from 5 k, then the tip, then the base.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armd.arrays import Mask
from armd.errors import ArmdError

#: The limit of an arm offline; the live path has its own limit.
MOST_JOINTS = 20

JOINT_PARAMETERS = ("theta", "d", "a", "alpha", "beta")
TIP_PARAMETERS = ("tip_x", "tip_y", "tip_z")
BASE_PARAMETERS = ("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz")

#: A shorter length does not matter thermally: 1 mm of aluminium expands by 0.02 µm/K.
LEAST_LENGTH_MM = 1.0

PER_JOINT = len(JOINT_PARAMETERS)
BESIDE_JOINTS = len(TIP_PARAMETERS) + len(BASE_PARAMETERS)


@dataclass(frozen=True)
class ParameterLayout:
    """The indices of the parameters of an arm with *n_joints* joints in the vector (P,)."""

    n_joints: int

    @classmethod
    def from_count(cls, count: int) -> ParameterLayout:
        """Return the layout of *count* parameters; raises `ArmdError` if no arm has so many."""
        n_joints, remainder = divmod(count - BESIDE_JOINTS, PER_JOINT)
        if remainder or n_joints < 1:
            raise ArmdError(f"no arm has {count} parameters")
        return cls(n_joints)

    @property
    def count(self) -> int:
        """The number of parameters P = 5 N + 3 + 6."""
        return PER_JOINT * self.n_joints + BESIDE_JOINTS

    @cached_property
    def names(self) -> tuple[str, ...]:
        """The names of all parameters in order: theta_1 … beta_N, tip_x …, base_rz."""
        joints = (f"{name}_{k}" for k in range(1, self.n_joints + 1) for name in JOINT_PARAMETERS)
        return (*joints, *TIP_PARAMETERS, *BASE_PARAMETERS)

    @cached_property
    def _place(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def __contains__(self, name: object) -> bool:
        return name in self._place

    def index(self, name: str) -> int:
        """Return a parameter's index; raises `ArmdError` for a name this arm does not have."""
        try:
            return self._place[name]
        except KeyError:
            raise ArmdError(f"no parameter {name!r} on an arm of {self.n_joints} joints") from None

    def indices(self, names: Iterable[str]) -> list[int]:
        """Return the indices of several parameters; see `index`."""
        return [self.index(name) for name in names]

    def joint(self, number: int) -> slice:
        """Return the slice of the five parameters of a joint (1…N)."""
        return slice(PER_JOINT * (number - 1), PER_JOINT * number)

    def slice_of_joints(self, name: str) -> slice:
        """Return the slice of one of `JOINT_PARAMETERS` of all joints."""
        return slice(JOINT_PARAMETERS.index(name), PER_JOINT * self.n_joints, PER_JOINT)

    @property
    def angles(self) -> slice:
        """The slice of θ of all joints: a Jacobian's columns d tip / d angle."""
        return self.slice_of_joints("theta")

    @property
    def tip(self) -> slice:
        """The slice of the tip's offset x, y, z."""
        return slice(PER_JOINT * self.n_joints, PER_JOINT * self.n_joints + len(TIP_PARAMETERS))

    @property
    def base(self) -> slice:
        """The slice of the base's displacement and turn."""
        return slice(self.tip.stop, self.count)

    @cached_property
    def are_lengths(self) -> Mask:
        """A mask (P,) of the parameters that are in mm."""
        return np.array([find_unit(name) == "mm" for name in self.names])


def find_unit(name: str) -> str:
    """Return the unit of a parameter: "rad" or "mm"."""
    stem = name.split("_")[0]
    angular = stem in ("theta", "alpha", "beta") or name in ("base_rx", "base_ry", "base_rz")
    return "rad" if angular else "mm"
