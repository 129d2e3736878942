"""All causes that armd can name: the modules of the packages beside this file.

A module there has an `EFFECT`, or several `EFFECTS`: to add a cause, add its file. Other packages
add theirs by `added.py`.
"""

from __future__ import annotations

import math
import pkgutil
from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace
from importlib import import_module

from armd.compensation.effects import encoder, mechanical, setup, thermal, unknown
from armd.compensation.effects.added import load_added_effects
from armd.compensation.effects.effect import Acting, Candidate, Effect, SessionFacts
from armd.compensation.effects.older import drop_absorbed
from armd.compensation.model.arm import Arm
from armd.compensation.wording import ARC_SECOND

PACKAGES = (encoder, mechanical, thermal, setup)
OFFSET = "sensor_offset"
#: Causes in the sensors themselves.
OF_SENSORS = frozenset({OFFSET, "sensor_swapped", "thermal_lag"})
#: Effects with `as_coarse_as_the_arm` have their typical size on an arm whose encoders resolve this
#: angle, or less. On a coarser arm they are larger in proportion: a hobby servo's magnetic encoder
#: of 12 bits errs by half a degree where a disc of 23 bits errs by seconds. The same holds for its
#: bearings and its printed links.
FINE_RAD = 6 * ARC_SECOND
#: The typical sizes also hold on an arm whose readings scatter by no more than this under a
#: calibration. A cause that is visible beside such scatter is ten times the typical one, which the
#: catalogue's sizes allow (`sizes.SCALES`). On an arm that is 12 minutes off it is a hundred times
#: the typical one, and so is everything else that could be visible there.
WELL_MADE_RAD = 10 * FINE_RAD


def _load_effects() -> Iterator[Effect]:
    """Yield the effects package by package, then by name; then those of other packages, `unknown`
    last.
    """
    built_in: list[Effect] = []
    for package in PACKAGES:
        for name in sorted(module.name for module in pkgutil.iter_modules(package.__path__)):
            module = import_module(f"{package.__name__}.{name}")
            built_in += getattr(module, "EFFECTS", None) or (module.EFFECT,)
    yield from built_in
    yield from load_added_effects([*(effect.cause for effect in built_in), unknown.EFFECT.cause])
    yield unknown.EFFECT


CATALOGUE: dict[str, Effect] = {effect.cause: effect for effect in _load_effects()}


def list_all_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    """Yield every candidate that this arm and these sessions allow, the general basis included."""
    for effect in CATALOGUE.values():
        for candidate in _list_candidates(effect, facts):
            # An unnamed effect may also be older than the calibration. Otherwise it would gain
            # probability, because named causes share theirs between both cases.
            may_be_older = effect.by_temperature or candidate.cause == "unknown"
            older = drop_absorbed(candidate, facts) if may_be_older else None
            if not candidate.expected:  # an expected cause is older than the calibration
                yield candidate
            if older is not None:
                yield older


def _list_candidates(effect: Effect, facts: SessionFacts) -> Iterator[Candidate]:
    coarseness = max(_coarseness(facts.arm), facts.scatter_rad / WELL_MADE_RAD)
    if coarseness <= 1.0 or not effect.as_coarse_as_the_arm:
        yield from effect.candidates(facts)
        return
    for candidate in effect.candidates(facts):
        yield _scale_up(candidate, coarseness)


def list_candidates_under(facts: SessionFacts, acting: Sequence[Acting]) -> Iterator[Candidate]:
    """Yield the candidates that act through the model's terms, with findings *acting* in
    the model.
    """
    for effect in CATALOGUE.values():
        if effect.through_terms is not None:
            able = _able(effect.cause, acting)
            for candidate in effect.through_terms(
                facts, [t for finding in able for t in finding.terms]
            ):
                yield _with_through(candidate, select_acting(candidate, acting, facts))


def select_acting(
    candidate: Candidate, acting: Sequence[Acting], facts: SessionFacts
) -> tuple[Acting, ...]:
    """Select the findings *acting* through which a candidate acts: they share a sensor with it."""
    sensors = set(candidate.depends_on) & set(facts.sensors)
    able = _able(candidate.cause, acting)
    return tuple(finding for finding in able if sensors & set(finding.candidate.depends_on))


def _able(cause: str, acting: Sequence[Acting]) -> list[Acting]:
    """Return the findings through which a cause may act.

    A sensor's offset may act through all others, a lag through those that are no sensor's.
    """
    barred = {OFFSET} if cause == OFFSET else OF_SENSORS
    return [finding for finding in acting if finding.candidate.cause not in barred]


def list_exchanged(facts: SessionFacts, exchanged: Candidate) -> Iterator[Candidate]:
    """Yield the candidates that follow one of two *exchanged* sensors, with the other one in its
    place.
    """
    names = set(exchanged.depends_on)
    original_keys = {_make_key(c) for c in _by_sensors(facts, names)}
    for candidate in _by_sensors(replace(facts, arm=_renamed(facts.arm, *names)), names):
        if _make_key(candidate) not in original_keys:
            yield replace(candidate, through=(Acting(exchanged, (1.0,)),))


def _by_sensors(facts: SessionFacts, names: Collection[str]) -> Iterator[Candidate]:
    for effect in CATALOGUE.values():
        if effect.by_temperature:
            yield from (
                c for c in _list_candidates(effect, facts) if set(names) & set(c.depends_on)
            )


def _make_key(candidate: Candidate) -> tuple[object, ...]:
    columns = (column.name for column in candidate.columns)
    return (*candidate.place, candidate.setting, candidate.depends_on, *columns)


def _renamed(arm: Arm, a: str, b: str) -> Arm:
    """Return the arm with two sensors exchanged in its links."""
    exchange = {a: b, b: a}
    joints = [
        joint.model_copy(
            update={
                "temperature": {exchange.get(name, name): w for name, w in joint.weights.items()}
            }
        )
        for joint in arm.joint
    ]
    return arm.model_copy(update={"joint": joints})


def _with_through(candidate: Candidate, through: tuple[Acting, ...]) -> Candidate:
    """Return the candidate with the findings through which it acts, also for its refinements."""
    refine, elsewhere = candidate.refine, candidate.elsewhere
    return replace(
        candidate,
        through=through,
        refine=refine and (lambda: [_with_through(finer, through) for finer in refine()]),
        elsewhere=elsewhere and (lambda value: _with_through(elsewhere(value), through)),
    )


def _coarseness(arm: Arm) -> float:
    """Return a count of the coarsest encoder over `FINE_RAD`; 1 if it is finer, or not known."""
    counts = [joint.counts_per_turn for joint in arm.joint if joint.counts_per_turn is not None]
    return max([1.0, *(2 * math.pi / count / FINE_RAD for count in counts)])


def _scale_up(candidate: Candidate, times: float) -> Candidate:
    """Return the candidate with typical sizes so many *times* as large; so are its other values."""
    columns = tuple(
        replace(column, prior_sd=column.prior_sd * times) for column in candidate.columns
    )
    refine, elsewhere = candidate.refine, candidate.elsewhere
    return replace(
        candidate,
        columns=columns,
        refine=refine and (lambda: [_scale_up(finer, times) for finer in refine()]),
        elsewhere=elsewhere and (lambda value: _scale_up(elsewhere(value), times)),
    )
