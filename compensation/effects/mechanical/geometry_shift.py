"""A constant of a joint is no longer what the calibration says: knocked, re-mounted, drifting."""

import math
from collections.abc import Iterator
from functools import partial

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.by_session import (
    by_session,
    column,
    is_by_session,
    values_by_session,
)
from armd.compensation.effects.courses import Function, drifts, goes, is_drift, steps, swing
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    lengths,
    tie,
    when,
)
from armd.compensation.model.slow_factors import After
from armd.compensation.wording import ARC_SECOND, plain, seconds_of_arc

TYPICAL = {
    "theta": 10 * ARC_SECOND,
    "d": 20e-3,
    "a": 20e-3,
    "alpha": 10 * ARC_SECOND,
    "beta": 10 * ARC_SECOND,
}
#: β is a constant of its own only between nearly parallel axes (sine of the angle between them);
#: where the next axis stands across, it turns about the joint's own axis and is θ again.
PARALLEL = 0.5


def _unit(name: str) -> str:
    return "mm" if name in ("d", "a") else "rad"


def _shifted(joint: int, name: str, *basis: After) -> tuple[Column]:
    return (Column(name, _unit(name), TYPICAL[name], tie([(f"{name}_{joint}", 1.0)], *basis)),)


def _drifting(facts: SessionFacts, joint: int, name: str) -> Iterator[Candidate]:
    def columns(function: Function) -> list[Column]:
        terms = function.terms([(f"{name}_{joint}", 1.0)])
        typical = TYPICAL[name] / function.largest
        return [Column(f"{name} {function.name}", _unit(name) + function.per, typical, terms)]

    yield from drifts(facts, "geometry_shift", location.joint(joint), columns)


def _in_each_session(facts: SessionFacts, joint: int) -> Iterator[Candidate]:
    """A joint's zero that is found anew before each session."""
    columns = tuple(
        column(function, "theta", "rad", TYPICAL["theta"], [(f"theta_{joint}", 1.0)])
        for function in by_session(facts)
    )
    if columns:
        yield Candidate("geometry_shift", location.joint(joint), columns, ("time_s",))


def _growing(facts: SessionFacts, joint: int) -> Iterator[Candidate]:
    """All lengths of a link together: it takes up humidity."""
    pairs = lengths(facts, joint)
    if len(pairs) < 2:
        return
    size = math.hypot(*(mm for _, mm in pairs))

    def columns(function: Function) -> list[Column]:
        typical = TYPICAL["a"] / size / function.largest
        return [
            Column(f"length {function.name}", "1" + function.per, typical, function.terms(pairs))
        ]

    yield from drifts(facts, "geometry_shift", location.joint(joint), columns)


def candidates(facts: SessionFacts) -> Iterator[Candidate]:
    # Every constant of the last joint only moves the tip in its frame: that is tip_offset.
    for k in facts.joints[:-1]:
        for name in TYPICAL:
            if name == "beta" and abs(math.sin(facts.constant(k, "alpha"))) > PARALLEL:
                continue
            if facts.held:
                yield Candidate("geometry_shift", location.joint(k), _shifted(k, name), ())
            if name != "theta":  # a step of the angle is the encoder's: encoder_slip
                shifted = partial(_shifted, k, name)
                yield from steps(facts, "geometry_shift", location.joint(k), shifted)
            yield from _drifting(facts, k, name)
        yield from _in_each_session(facts, k)
        yield from _growing(facts, k)


def reading(candidate: Candidate, amplitudes: F64) -> str:
    column, value = candidate.columns[0], float(amplitudes[0])
    if is_by_session(candidate):
        values, against = values_by_session(candidate, amplitudes)
        told = ", ".join(
            f"{name} {plain(angle[0] / ARC_SECOND, sign='+')}″" for name, angle in values
        )
        where = candidate.location
        return f"the zero of {where} is another in each session: {told} against {against}"
    if is_drift(candidate):
        term = column.terms[0]
        far = swing(candidate, amplitudes, term.parameter)
        size = (
            f"{plain(far * 1e3)} µm"
            if term.parameter[:1] in "da" and "alpha" not in term.parameter
            else seconds_of_arc(far)
        )
        what = column.name.split()[0]
        return f"{what} of {candidate.location} {goes(candidate)}, by {size} in the time seen"
    size = f"{plain(value * 1e3, 3, '+')} µm" if column.unit == "mm" else seconds_of_arc(value)
    since = when(candidate).replace(" at ", " since ")
    return f"{column.name} of {candidate.location} differs by {size} from the calibration{since}"


EFFECT = Effect(
    "geometry_shift",
    "a blow, a re-mounted joint or creep changed a constant",
    "the tip's offset, for the last joint; the placement, for the first",
    "calibrate again at one temperature and compare",
    candidates,
    reading,
    "the time of each reading (time_s), or a calibration to compare with",
    accident=True,
    as_coarse_as_the_arm=True,
)
