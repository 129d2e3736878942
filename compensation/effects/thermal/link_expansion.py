"""A link's coefficient of expansion is wrong or missing."""

from collections.abc import Iterator, Sequence
from itertools import chain

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    list_lengths,
    list_stylus_offsets,
    make_temperature,
    tie,
)
from armd.compensation.wording import format_plain

#: 1/K; prior standard deviation of a length's expansion: carbon fibre 0 to 2e-6, steel 12e-6,
#: aluminium 23e-6
EXPANSION_PER_K = 20e-6

TYPICAL_PER_K = 10e-6
TOGETHER = "of all links per kelvin"


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    for k in facts.joints:
        own_weights = facts.weights(k)
        sensors = [own_weights] if own_weights else [{name: 1.0} for name in facts.sensors]
        link_lengths = list_lengths(facts, k)
        choices = (
            [link_lengths]
            if len(link_lengths) == 1
            else [link_lengths, *([piece] for piece in link_lengths)]
            if link_lengths
            else []
        )
        pieces = [[piece] for piece in link_lengths]
        if k == facts.arm.n_joints:  # the stylus is a body of its own
            choices.append(list_stylus_offsets(facts))
            pieces.append(list_stylus_offsets(facts))
        expected = not facts.open_growth.isdisjoint(name for piece in pieces for name, _ in piece)
        if expected and link_lengths and k == facts.arm.n_joints:
            choices.append([*link_lengths, *list_stylus_offsets(facts)])
        for weights in sensors:
            factor, depends = make_temperature(weights), tuple(weights)
            for lengths_mm in choices:
                column = Column("per kelvin", "1/K", TYPICAL_PER_K, tie(lengths_mm, factor))
                yield Candidate(
                    "link_expansion", location.link(k), (column,), depends, expected=expected
                )
            if expected and len(pieces) > 1:  # of several materials
                columns = tuple(
                    Column(f"{_name(piece)} per kelvin", "1/K", TYPICAL_PER_K, tie(piece, factor))
                    for piece in pieces
                )
                yield Candidate("link_expansion", location.link(k), columns, depends, expected=True)
    if not facts.open_growth and facts.has_fixed_constants:
        yield from list_together(facts)


def list_together(facts: SessionFacts) -> Iterator[Candidate]:
    """Yield candidates with one coefficient for all links: an arm of one material.

    Each link follows its own sensors, or all follow one sensor. The location is the longest link. A
    wrong expansion of the artefact has almost the same signature, so the candidate may replace only
    that finding. Beside other findings it would explain two expanding links by all six.
    """
    by_link = {k: pieces for k in facts.joints if (pieces := list_lengths(facts, k))}
    weights = {k: facts.weights(k) for k in by_link}
    if len(by_link) < 2:
        return
    choices = [weights] if all(weights.values()) else []
    if not any(weights.values()):
        choices = [{k: {name: 1.0} for k in by_link} for name in facts.sensors]
    longest = max(by_link, key=lambda k: sum(abs(length_mm) for _, length_mm in by_link[k]))
    for chosen in choices:
        terms = [tie(pieces, make_temperature(chosen[k])) for k, pieces in by_link.items()]
        column = Column(TOGETHER, "1/K", TYPICAL_PER_K, tuple(chain.from_iterable(terms)))
        sensors = tuple(dict.fromkeys(chain.from_iterable(chosen.values())))
        yield Candidate(
            "link_expansion",
            location.link(longest),
            (column,),
            sensors,
            instead_of="artefact_expansion",
        )


def _name(lengths_mm: Sequence[tuple[str, float]]) -> str:
    """Return the name of a piece of a link in its amplitude."""
    return "stylus" if len(lengths_mm) > 1 else lengths_mm[0][0].split("_")[0]


def describe(candidate: Candidate, amplitudes: F64) -> str:
    values = [f"{format_plain(value * 1e6, sign='+')} µm" for value in amplitudes]
    names = [f" ({column.name.split()[0]})" for column in candidate.columns]
    growth = " and ".join(
        value + (name if len(values) > 1 else "") for value, name in zip(values, names, strict=True)
    )
    if candidate.columns[0].name == TOGETHER:
        return f"all links expand by {growth} per metre and kelvin more"
    return f"{candidate.location} expands by {growth} per metre and kelvin more"


EFFECT = Effect(
    "link_expansion",
    "a link of another material, or a coefficient that was never identified",
    "the artefact's expansion, when all links share it",
    "measure at two more temperatures, at least 6 K apart",
    list_candidates,
    describe,
    "temperatures that vary over the readings, and a calibration to compare with: without one, the "
    "same readings identify it",
    by_temperature=True,
)
