"""A link follows its sensor with a delay."""

from collections.abc import Iterator, Sequence

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.by_temperature import (
    find_temperature,
    is_difference,
    replace_part,
    replace_temperature,
)
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    list_lengths,
    make_temperature,
    tie,
)
from armd.compensation.model.terms import Term
from armd.compensation.wording import format_plain

OF_A_LENGTH = 0.3  # 1; deviation of one length's delay from that of its link, as a share
#: 1; if sessions began on a ramp, a lag looks shorter than it is, 10 and 25 min as 1 to 10. So lags
#: this many times longer are tried, too.
SLOWER_LAGS = (4.0, 16.0)
LONGER_LAGS = (1.0, 5.0)  # 1; an initial error fades with this many time constants

TIME_CONSTANTS_S = (60.0, 120.0, 240.0, 480.0, 900.0, 1500.0, 2400.0, 3600.0, 5400.0)
TYPICAL_PER_K = 15e-6
#: A link is delayed by all of its expansion at most, and is warm throughout within about an hour.
#: On a steady ramp only share × time constant is identifiable: a larger share makes up for too
#: short a time constant.
WARMED_THROUGH_S = 3600.0


def _lagging(
    facts: SessionFacts,
    weights: dict[str, float],
    lag_s: float,
    finest: bool,
    acting_terms: Sequence[Term] = (),
    by_length: bool = False,
) -> Candidate:
    """Make a candidate in which every link on these sensors follows them with one time constant.

    The *acting_terms*, those of other findings, follow likewise. *by_length*: only lengths do, each
    in proportion to itself.
    """
    links = [k for k in facts.joints if facts.weights(k) == weights and list_lengths(facts, k)]
    share = None if by_length else _delayed_terms((*facts.terms, *acting_terms), weights, lag_s)
    column = share or _delayed_lengths(
        [pair for k in links for pair in list_lengths(facts, k)], weights, lag_s
    )
    # The location is the link if it is alone on its sensors, and otherwise the sensors.
    place = location.link(links[0]) if len(links) == 1 else location.sensors(*weights)

    def rebuild(value: float) -> Candidate:
        return _lagging(facts, weights, value, True, acting_terms, by_length)

    def refine() -> list[Candidate]:
        return [rebuild(lag_s * factor) for factor in (0.7, 0.8, 0.9, 1.1, 1.25, 1.4)]

    return Candidate(
        "thermal_lag",
        place,
        (column,),
        (*weights, "time_s"),
        (("time constant", lag_s, "s"),),
        refine=None if finest else refine,
        elsewhere=rebuild,
        through=() if share else None,
    )


def _delayed_terms(
    model_terms: Sequence[Term], weights: dict[str, float], lag_s: float
) -> Column | None:
    """Return the model's terms of these sensors, delayed: the amplitude is 1 if the lag
    is right.
    """
    terms = tuple(piece for term in model_terms for piece in _delayed(term, weights, lag_s))
    return Column("share", "1", 1.0, terms, reach=_largest_share(lag_s)) if terms else None


def _largest_share(lag_s: float) -> float:
    """Return the largest plausible share of a link's expansion with this time constant."""
    return max(1.0, WARMED_THROUGH_S / lag_s)


def _delayed(term: Term, weights: dict[str, float], lag_s: float) -> Iterator[Term]:
    """Yield the terms that a term adds if these sensors are delayed.

    Other sensors of a difference are not delayed.
    """
    factor = find_temperature(term)
    if factor is None or factor.lag_s or factor.zone_c:
        return
    if factor.weights == weights:
        yield from replace_temperature(term, factor.model_copy(update={"lag_s": lag_s}))
    elif is_difference(factor.weights) and factor.order == 1 and len(weights) == 1:
        (name,) = weights
        if share := factor.weights.get(name, 0.0):
            late, now = (make_temperature({name: 1.0}, lag_s=s) for s in (lag_s, 0.0))
            yield from replace_part(term, share, now, late)


def _delayed_lengths(
    pairs: list[tuple[str, float]], weights: dict[str, float], lag_s: float
) -> Column:
    """Make a column of lengths that follow with a delay, if the model has no coefficient
    for them.
    """
    terms = (
        *tie(pairs, make_temperature(weights, lag_s=lag_s)),
        *tie([(name, -mm) for name, mm in pairs], make_temperature(weights)),
    )
    return Column("per kelvin", "1/K", TYPICAL_PER_K, terms)


def list_candidates(facts: SessionFacts, acting_terms: Sequence[Term] = ()) -> Iterator[Candidate]:
    if not facts.timed:
        return
    listed: list[dict[str, float]] = []
    for k in facts.joints:
        weights = facts.weights(k)
        if weights and list_lengths(facts, k) and weights not in listed:
            listed.append(weights)
            every = [
                _lagging(facts, weights, lag_s, False, acting_terms) for lag_s in TIME_CONSTANTS_S
            ]
            yield from every
            if not facts.has_fixed_constants and every[0].through is not None:
                # A coefficient of a length that was fitted to the same readings without the lag is
                # wrong.
                for lag_s in TIME_CONSTANTS_S:
                    yield _lagging(facts, weights, lag_s, False, by_length=True)


def list_through_terms(facts: SessionFacts, acting_terms: Sequence[Term]) -> Iterator[Candidate]:
    yield from (c for c in list_candidates(facts, acting_terms) if c.through is not None)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    return f"{candidate.location} follows with a time constant of {_minutes(candidate)}"


def _minutes(candidate: Candidate) -> str:
    return f"{format_plain(candidate.setting[0][1] / 60.0)} min"


EFFECT = Effect(
    "thermal_lag",
    "heat takes time from the sensor to the whole link",
    "the artefact's expansion, and slow drift of the mount",
    "measure during a ramp of 4 K/h or more, up and down",
    list_candidates,
    describe,
    "temperatures that vary over the readings, their times, and the sensor of each joint in "
    "arm.toml",
    through_terms=list_through_terms,
)
