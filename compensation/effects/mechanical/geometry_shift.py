"""A constant of a joint differs from the calibration: knocked, re-mounted, drifting."""

import math
from collections.abc import Iterator
from functools import partial

from armd.arrays import F64
from armd.compensation.effects import location
from armd.compensation.effects.by_session import (
    compute_values_by_session,
    is_by_session,
    make_column,
    make_session_functions,
)
from armd.compensation.effects.courses import (
    Function,
    compute_swing,
    describe_course,
    is_drift,
    make_drifts,
    make_steps,
)
from armd.compensation.effects.effect import (
    Candidate,
    Column,
    Effect,
    SessionFacts,
    describe_instant,
    list_lengths,
    tie,
)
from armd.compensation.model.slow_factors import After
from armd.compensation.wording import ARC_SECOND, format_plain, seconds_of_arc

TYPICAL = {
    "theta": 10 * ARC_SECOND,
    "d": 20e-3,
    "a": 20e-3,
    "alpha": 10 * ARC_SECOND,
    "beta": 10 * ARC_SECOND,
}
#: β is a constant of its own only between nearly parallel axes (limit of the sine of their angle).
#: If the next axis is across, it turns about the joint's own axis and is equivalent to θ.
PARALLEL = 0.5


def _unit(name: str) -> str:
    return "mm" if name in ("d", "a") else "rad"


def _shifted(joint: int, name: str, *basis: After) -> tuple[Column]:
    return (Column(name, _unit(name), TYPICAL[name], tie([(f"{name}_{joint}", 1.0)], *basis)),)


def _drifting(facts: SessionFacts, joint: int, name: str) -> Iterator[Candidate]:
    def columns(function: Function) -> list[Column]:
        terms = function.terms([(f"{name}_{joint}", 1.0)])
        prior_sd = TYPICAL[name] / function.largest
        return [Column(f"{name} {function.name}", _unit(name) + function.per, prior_sd, terms)]

    yield from make_drifts(facts, "geometry_shift", location.joint(joint), columns)


def _in_each_session(facts: SessionFacts, joint: int) -> Iterator[Candidate]:
    """Yield a candidate for a joint whose zero is found anew before each session."""
    columns = tuple(
        make_column(function, "theta", "rad", TYPICAL["theta"], [(f"theta_{joint}", 1.0)])
        for function in make_session_functions(facts)
    )
    if columns:
        yield Candidate("geometry_shift", location.joint(joint), columns, ("time_s",))


def _growing(facts: SessionFacts, joint: int) -> Iterator[Candidate]:
    """Yield candidates for a growth of all lengths of a link together, because it
    absorbs humidity.
    """
    pairs = list_lengths(facts, joint)
    if len(pairs) < 2:
        return
    size = math.hypot(*(mm for _, mm in pairs))

    def columns(function: Function) -> list[Column]:
        prior_sd = TYPICAL["a"] / size / function.largest
        return [
            Column(f"length {function.name}", "1" + function.per, prior_sd, function.terms(pairs))
        ]

    yield from make_drifts(facts, "geometry_shift", location.joint(joint), columns)


def list_candidates(facts: SessionFacts) -> Iterator[Candidate]:
    # Every constant of the last joint only moves the tip in its frame, which is the cause
    # tip_offset.
    for k in facts.joints[:-1]:
        for name in TYPICAL:
            if name == "beta" and abs(math.sin(facts.constant(k, "alpha"))) > PARALLEL:
                continue
            if facts.has_fixed_constants:
                yield Candidate("geometry_shift", location.joint(k), _shifted(k, name), ())
            if name != "theta":  # a step of the angle is the cause encoder_slip
                shifted = partial(_shifted, k, name)
                yield from make_steps(facts, "geometry_shift", location.joint(k), shifted)
            yield from _drifting(facts, k, name)
        yield from _in_each_session(facts, k)
        yield from _growing(facts, k)


def describe(candidate: Candidate, amplitudes: F64) -> str:
    column, value = candidate.columns[0], float(amplitudes[0])
    if is_by_session(candidate):
        values, against = compute_values_by_session(candidate, amplitudes)
        shifts = ", ".join(
            f"{name} {format_plain(angle[0] / ARC_SECOND, sign='+')}″" for name, angle in values
        )
        place = candidate.location
        return f"the zero of {place} is another in each session: {shifts} against {against}"
    if is_drift(candidate):
        term = column.terms[0]
        extent = compute_swing(candidate, amplitudes, term.parameter)
        size = (
            f"{format_plain(extent * 1e3)} µm"
            if term.parameter[:1] in "da" and "alpha" not in term.parameter
            else seconds_of_arc(extent)
        )
        constant_name = column.name.split()[0]
        course = describe_course(candidate)
        return f"{constant_name} of {candidate.location} {course}, by {size} in the time seen"
    size = (
        f"{format_plain(value * 1e3, 3, '+')} µm" if column.unit == "mm" else seconds_of_arc(value)
    )
    since = describe_instant(candidate).replace(" at ", " since ")
    return f"{column.name} of {candidate.location} differs by {size} from the calibration{since}"


EFFECT = Effect(
    "geometry_shift",
    "a blow, a re-mounted joint or creep changed a constant",
    "the tip's offset, for the last joint; the placement, for the first",
    "calibrate again at one temperature and compare",
    list_candidates,
    describe,
    "the time of each reading (time_s), or a calibration to compare with",
    accident=True,
    as_coarse_as_the_arm=True,
)
