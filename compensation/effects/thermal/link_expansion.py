"""A link's coefficient of expansion is wrong or missing."""

from collections.abc import Iterator

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    lengths,
    stylus,
    temperature,
    tie,
)
from armd.compensation.wording import plain

TYPICAL_PER_K = 10e-6


def candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        own = facts.weights(k)
        sensors = [own] if own else [{name: 1.0} for name in facts.sensors]
        both = lengths(facts, k)
        choices = [both] if len(both) == 1 else [both, *([one] for one in both)] if both else []
        if k == facts.arm.n_joints:  # the stylus is a body of its own
            choices.append(stylus(facts))
        for weights in sensors:
            for lengths_mm in choices:
                factor = temperature(weights)
                column = Column("per kelvin", "1/K", TYPICAL_PER_K, tie(lengths_mm, factor))
                depends = tuple(weights)
                yield Candidate("link_expansion", location.link(k), (column,), depends)


def reading(candidate: Candidate, amplitudes: F64) -> str:
    more = plain(amplitudes[0] * 1e6, sign="+")
    return f"{candidate.location} expands by {more} µm per metre and kelvin more"


EFFECT = Effect(
    "link_expansion",
    "a link of another material, or a coefficient that was never identified",
    "the artefact's expansion, when all links share it",
    "measure at two more temperatures, at least 6 K apart",
    candidates,
    reading,
    "temperatures that vary over the readings, and a calibration to compare with: without one, the "
    "same readings identify it",
    by_temperature=True,
)
