"""A joint's axis tilts or runs out as it turns, once or twice a turn."""

from collections.abc import Iterator

import numpy as np

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, Effect, SessionFacts, tie
from armd.compensation.effects.twist import compute_twist_weights
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.wording import ARC_SECOND, format_plain

BASE = (["base_rx", "base_ry", "base_x", "base_y"], np.eye(4))


def _motions(facts: SessionFacts, joint: int) -> tuple[list[str], F64]:
    """Return parameters and weights (n, 4) that tilt and shift the axis of *joint*
    across itself.
    """
    if joint == 1:
        return BASE
    twists = np.zeros((6, 4))
    twists[[0, 1, 3, 4], range(4)] = 1.0
    return compute_twist_weights(facts, joint - 1, twists)


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        names, weights = _motions(facts, k)
        for motion, unit, prior_sd, axes in (
            ("tilt", "rad", 3 * ARC_SECOND, (0, 1)),
            ("run-out", "mm", 5e-3, (2, 3)),
        ):
            for order in (1, 2):
                columns = tuple(
                    Column(
                        f"{motion} {'xy'[axis % 2]} {kind}",
                        unit,
                        prior_sd,
                        tie(
                            list(zip(names, weights[:, axis], strict=True)),
                            Harmonic(kind=kind, joint=k, order=order),
                        ),
                    )
                    for axis in axes
                    for kind in ("sin", "cos")
                )
                setting = (("order", float(order), "1/turn"),)
                yield Candidate("axis_wobble", location.joint(k), columns, (f"q{k}",), setting)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    size = float(np.sqrt((amplitudes**2).sum() / 2))
    if candidate.columns[0].unit == "rad":
        description = f"tilts by {format_plain(size / ARC_SECOND)}″"
    else:
        description = f"runs out by {format_plain(size * 1e3)} µm"
    return f"the axis of {candidate.location} {description}, {candidate.setting[0][1]:.0f} × a turn"


EFFECT = Effect(
    "axis_wobble",
    "bearings whose races are not round or not square let the axis tilt and shift as it turns",
    "eccentricity, for the last joint",
    "measure with a second, bent stylus",
    list_candidates,
    describe,
    as_coarse_as_the_arm=True,
)
