"""Small motions of a link's end, expressed in the arm's own parameters.

A bent link turns and shifts the frame at its end. The parameters of the joint before and after that
frame span such motions; this module finds the weights.
"""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.compensation.effects.effect import SessionFacts

SHORTEST_MM = 20.0  # a shorter link does not bend noticeably


def compute_outgoing(alpha: float, beta: float) -> F64:
    """Return the rotation from the frame before Rx(α)·Ry(β) to the outgoing frame."""
    ca, sa, cb, sb = np.cos(alpha), np.sin(alpha), np.cos(beta), np.sin(beta)
    about_x = np.array([[1, 0, 0], [0, ca, -sa], [0, sa, ca]])
    about_y = np.array([[cb, 0, sb], [0, 1, 0], [-sb, 0, cb]])
    inverse: F64 = (about_x @ about_y).T
    return inverse


def compute_link_vector(facts: SessionFacts, link: int) -> F64:
    """Return the vector (3,) mm from the axis of joint *link* to the frame at the link's end.

    It is expressed in that frame.
    """
    rotation = compute_outgoing(facts.constant(link, "alpha"), facts.constant(link, "beta"))
    vector: F64 = rotation @ np.array([facts.constant(link, "a"), 0.0, facts.constant(link, "d")])
    return vector


def compute_parameter_twists(facts: SessionFacts, link: int) -> tuple[list[str], F64]:
    """Return the motion of the frame at the end of *link* per unit of each parameter around it.

    The result is the names and a matrix (6, n): rotation in rad, then translation in mm, in that
    frame.
    """
    alpha, beta = facts.constant(link, "alpha"), facts.constant(link, "beta")
    rotation = compute_outgoing(alpha, beta)
    x, z = rotation[:, 0], rotation[:, 2]  # axes of the frame before Rx·Ry
    zero = np.zeros(3)
    arm_of_axis = facts.constant(link, "a") * x  # from the joint's axis to the frame
    twists = {
        f"theta_{link}": (z, np.cross(z, arm_of_axis)),
        f"d_{link}": (zero, z),
        f"a_{link}": (zero, x),
        f"alpha_{link}": (x, zero),
        f"beta_{link}": (np.array([0.0, 1.0, 0.0]), zero),
    }
    if link < facts.arm.n_joints:
        twists[f"theta_{link + 1}"] = (np.array([0.0, 0.0, 1.0]), zero)
        twists[f"d_{link + 1}"] = (zero, np.array([0.0, 0.0, 1.0]))
    else:  # after the last joint the tip's offset moves instead
        for axis, name in enumerate(("tip_x", "tip_y", "tip_z")):
            twists[name] = (zero, np.eye(3)[axis])
    return list(twists), np.array([np.concatenate(pair) for pair in twists.values()]).T


def compute_twist_weights(facts: SessionFacts, link: int, twists: F64) -> tuple[list[str], F64]:
    """Return parameters and weights (n, m) that move the end of *link* by *twists* (6, m).

    If the parameters do not span a motion (a shift across a link of no length), the part that they
    span is returned.
    """
    names, basis = compute_parameter_twists(facts, link)
    scale = np.array([1.0, 1.0, 1.0, 1e-2, 1e-2, 1e-2])  # 100 mm of lever weigh as 1 rad
    weights: F64 = np.linalg.lstsq(basis * scale[:, None], twists * scale[:, None], rcond=1e-6)[0]
    weights[np.abs(weights) < 1e-9 * np.abs(weights).max(initial=1e-30)] = 0.0
    return names, weights
