"""The parameters an arm's model has, by place and by name.

One flat vector holds them all, so that a term, a Jacobian column and an identified constant
speak of the same number: five per joint (θ offset, d, a, α, Hayati β), the tip's offset, and the
base's small displacement. Millimetres and radians throughout.

`ParameterLayout` says where each stands. Compiled code, which takes no such objects, steps through
the vector by itself: joint k from 5 k, then the tip, then the base.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armd.arrays import Mask
from armd.errors import ArmdError

#: Of an arm, offline; the live path has a limit of its own.
MOST_JOINTS = 20

JOINT_PARAMETERS = ("theta", "d", "a", "alpha", "beta")
TIP_PARAMETERS = ("tip_x", "tip_y", "tip_z")
BASE_PARAMETERS = ("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz")

#: A length shorter than this does not matter thermally: 1 mm of aluminium grows 0.02 µm/K.
LEAST_LENGTH_MM = 1.0

PER_JOINT = len(JOINT_PARAMETERS)
BESIDE_JOINTS = len(TIP_PARAMETERS) + len(BASE_PARAMETERS)


@dataclass(frozen=True)
class ParameterLayout:
    """Where the parameters of an arm with so many joints stand in the vector (P,)."""

    n_joints: int

    @classmethod
    def from_count(cls, count: int) -> ParameterLayout:
        """That of a vector of *count* parameters; raises `ArmdError` where no arm has so many."""
        n_joints, remainder = divmod(count - BESIDE_JOINTS, PER_JOINT)
        if remainder or n_joints < 1:
            raise ArmdError(f"no arm has {count} parameters")
        return cls(n_joints)

    @property
    def count(self) -> int:
        """P: 5 N + 3 + 6."""
        return PER_JOINT * self.n_joints + BESIDE_JOINTS

    @cached_property
    def names(self) -> tuple[str, ...]:
        """All names in order: theta_1 … beta_N, tip_x …, base_rz."""
        joints = (f"{name}_{k}" for k in range(1, self.n_joints + 1) for name in JOINT_PARAMETERS)
        return (*joints, *TIP_PARAMETERS, *BASE_PARAMETERS)

    @cached_property
    def _place(self) -> dict[str, int]:
        return {name: i for i, name in enumerate(self.names)}

    def __contains__(self, name: object) -> bool:
        return name in self._place

    def index(self, name: str) -> int:
        """Place of a parameter by name; raises `ArmdError` for a name this arm does not have."""
        try:
            return self._place[name]
        except KeyError:
            raise ArmdError(f"no parameter {name!r} on an arm of {self.n_joints} joints") from None

    def indices(self, names: Iterable[str]) -> list[int]:
        """Places of several parameters, as `index`."""
        return [self.index(name) for name in names]

    def joint(self, number: int) -> slice:
        """The five of a joint (1…N)."""
        return slice(PER_JOINT * (number - 1), PER_JOINT * number)

    def slice_of_joints(self, name: str) -> slice:
        """One of `JOINT_PARAMETERS` of all joints."""
        return slice(JOINT_PARAMETERS.index(name), PER_JOINT * self.n_joints, PER_JOINT)

    @property
    def angles(self) -> slice:
        """θ of all joints: where a Jacobian's columns are d tip / d angle."""
        return self.slice_of_joints("theta")

    @property
    def tip(self) -> slice:
        """The tip's offset x, y, z."""
        return slice(PER_JOINT * self.n_joints, PER_JOINT * self.n_joints + len(TIP_PARAMETERS))

    @property
    def base(self) -> slice:
        """The base's displacement and turn."""
        return slice(self.tip.stop, self.count)

    @cached_property
    def are_lengths(self) -> Mask:
        """(P,) which are in mm."""
        return np.array([find_unit(name) == "mm" for name in self.names])


def find_unit(name: str) -> str:
    """The unit of a parameter: "rad" or "mm"."""
    stem = name.split("_")[0]
    angular = stem in ("theta", "alpha", "beta") or name in ("base_rx", "base_ry", "base_rz")
    return "rad" if angular else "mm"
