"""The constants to identify, and descriptions of those that the readings cannot separate."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy.linalg import qr

from armd.arrays import F64
from armd.compensation.model import parameters
from armd.compensation.model.arm import PARALLEL_DEG, Arm

#: Plausible departures from nominal; a direction known worse than a tenth of this is unknown.
PLAUSIBLE = {"mm": 10.0, "rad": 0.02}
#: A direction that moves points by less than this, relative to the strongest one, moves none.
ROUNDING = 1e-9
#: A direction with at least this cosine to all lengths in proportion is the arm's size.
ALL_LENGTHS = 0.8


def find_parallel_joints(arm: Arm) -> list[int]:
    """Find the joints k (from 1) whose axis is nearly parallel to that of joint k + 1."""
    limit = math.sin(math.radians(PARALLEL_DEG))
    return [
        k
        for k, joint in enumerate(arm.joint[:-1], 1)
        if abs(math.sin(math.radians(joint.alpha_deg))) < limit
    ]


def list_free_constants(arm: Arm) -> list[str]:
    """List the names of the constants to identify: θ, d, a, α of every joint and the tip's offset.

    Where consecutive axes are nearly parallel, their common normal has no definite place. There
    Hayati's β is identified instead of d (Hayati 1983), which stays nominal.
    """
    hayati = find_parallel_joints(arm)
    names = []
    for k in range(1, arm.n_joints + 1):
        length = f"beta_{k}" if k in hayati else f"d_{k}"
        names += [f"theta_{k}", length, f"a_{k}", f"alpha_{k}"]
    return [*names, *parameters.TIP_PARAMETERS]


def compute_gauge(columns: F64, scale: F64) -> F64:
    """Return the directions (C, k), in scaled unknowns, that move no point.

    *columns* (m, 3, C): d tip / d unknown in postures all over the arm's reach. A direction that
    moves no point there is a choice of coordinates: nothing depends on it, and it is not uncertain.
    """
    flat = columns.reshape(-1, columns.shape[2]) * scale
    _, s, vt = np.linalg.svd(np.linalg.qr(flat, mode="r"))
    largest = s.max(initial=0.0)
    directions: F64 = vt[np.r_[s <= ROUNDING * largest, np.ones(len(vt) - len(s), dtype=bool)]].T
    return directions


def describe_unidentifiable(null: F64, names: Sequence[str], arm: Arm) -> list[str]:
    """Describe each direction of the null space in words.

    *null* (C, k): a basis, in units of plausible departures; *names* (C,) of the unknowns.
    """
    return [
        _describe_direction(vector, lead, names, arm)
        for vector, lead in _make_sparse(null, names, arm)
    ]


def is_scale_free(null: F64, names: Sequence[str], arm: Arm) -> bool:
    """Return whether a direction is the arm's size: then no measurement determines its scale."""
    return any(_is_size(vector, names, arm) for vector, _ in _make_sparse(null, names, arm))


def _is_size(vector: F64, names: Sequence[str], arm: Arm) -> bool:
    """Return whether a direction is all lengths in proportion."""
    drawn = dict(zip(arm.layout.names, arm.nominal().tolist(), strict=True))
    lengths = np.array(
        [drawn.get(name, 0.0) * (parameters.find_unit(name) == "mm") for name in names]
    )
    along = abs(vector @ lengths)
    return bool(along > ALL_LENGTHS * np.linalg.norm(vector) * np.linalg.norm(lengths))


def _make_sparse(null: F64, names: Sequence[str], arm: Arm) -> list[tuple[F64, int]]:
    """Return a basis of the same space with few entries per vector, and their leading entries.

    Leads are chosen by a pivoted QR that prefers the constants that a reader would give up first:
    those of the last joint, which only place the tip, then of the first, which place the arm.
    """
    if null.shape[1] == 0:
        return []
    last = f"_{arm.n_joints}"
    prefer = [100.0 if n.endswith(last) else 10.0 if n.endswith("_1") else 1.0 for n in names]
    prefer = [p * (1.0 - 1e-6 * i) for i, p in enumerate(prefer)]  # between equals the first
    pivots = qr(null.T * prefer, mode="r", pivoting=True)[1][: null.shape[1]]
    rows = np.linalg.solve(null.T[:, pivots], null.T)
    return sorted(zip(rows, map(int, pivots), strict=True), key=lambda lead_pair: lead_pair[1])


def _describe_direction(vector: F64, lead: int, names: Sequence[str], arm: Arm) -> str:
    size = np.abs(vector)
    largest = int(np.argmax(size))
    lead = lead if size[lead] > 0.02 * size[largest] else largest
    involved = [i for i in np.argsort(-size) if size[i] > 0.02 * size[largest] and i != lead]
    together = [names[lead], *(names[i] for i in involved)]
    text = names[lead]
    if involved:
        named = [names[i] for i in involved[:6]]
        remainder = f" and {len(involved) - 6} more" if len(involved) > 6 else ""
        text += " with " + ", ".join(named) + remainder
    return f"{text}: {_describe_reason(vector, names, together, arm)}"


def _describe_reason(vector: F64, names: Sequence[str], together: Sequence[str], arm: Arm) -> str:
    last = f"_{arm.n_joints}"
    if all(name in parameters.TIP_PARAMETERS or name.endswith(last) for name in together):
        return "the last joint's constants and the tip's offset place the same point"
    if all(name in ("theta_1", "d_1") for name in together):
        return "moving the whole arm about its first axis moves every placement alike"
    if _is_size(vector, names, arm):
        return "no certified length determines the scale of the arm well enough"
    if any("ΔT" in name for name in together):
        return "these temperatures and poses do not tell them apart"
    return "these poses do not tell them apart"
