"""The parameters an arm's model has, by index and by name.

One flat vector holds them all, so that a term, a Jacobian column and an identified constant
speak of the same number: five per joint (θ offset, d, a, α, Hayati β), the tip's offset, and the
base's small displacement. Millimetres and radians throughout.
"""

from __future__ import annotations

from armd.errors import ArmdError

JOINT_PARAMETERS = ("theta", "d", "a", "alpha", "beta")
TIP_PARAMETERS = ("tip_x", "tip_y", "tip_z")
BASE_PARAMETERS = ("base_x", "base_y", "base_z", "base_rx", "base_ry", "base_rz")
#: Offsets of the five within a joint's block of the vector.
THETA, D, A, ALPHA, BETA = range(5)


def count(n_joints: int) -> int:
    """Length of the parameter vector of an arm with *n_joints* joints: 5 N + 3 + 6."""
    return 5 * n_joints + len(TIP_PARAMETERS) + len(BASE_PARAMETERS)


def names(n_joints: int) -> list[str]:
    """All names in order: theta_1 … beta_N, tip_x …, base_rz."""
    joints = [f"{name}_{k}" for k in range(1, n_joints + 1) for name in JOINT_PARAMETERS]
    return [*joints, *TIP_PARAMETERS, *BASE_PARAMETERS]


def index(name: str, n_joints: int) -> int:
    """Index of a parameter by name; raises `ArmdError` for a name this arm does not have."""
    try:
        return names(n_joints).index(name)
    except ValueError:
        raise ArmdError(f"no parameter {name!r} on an arm of {n_joints} joints") from None


def unit(name: str) -> str:
    """The unit of a parameter: "rad" or "mm"."""
    stem = name.split("_")[0]
    angular = stem in ("theta", "alpha", "beta") or name in ("base_rx", "base_ry", "base_rz")
    return "rad" if angular else "mm"
