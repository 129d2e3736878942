"""Findings that held-out readings refute, and whether a diagnosis without them is better.

In sessions that grew warmer one after another a drift in time and one with temperature are nearly
one signal, and the search names the likelier. Readings held out tell which it is: a finding with
which they are predicted worse beyond doubt is not there, and its alternatives are asked for.
"""

from __future__ import annotations

from collections.abc import Sequence

from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.slow_factors import Dated


def select_refuted(diagnosis: Diagnosis) -> tuple[Candidate, ...]:
    """The named findings that are not written since held-out readings are predicted worse with
    them beyond doubt, or later readings worse."""
    return tuple(
        finding.candidate
        for i, (finding, gain) in enumerate(zip(diagnosis.findings, diagnosis.gains, strict=True))
        if finding.candidate.cause != "unknown" and i not in diagnosis.written
        if i in diagnosis.contradicted_later or gain.interval_um[1] < 0.0
    )


def is_refuted(candidate: Candidate, refuted: Sequence[Candidate]) -> bool:
    """Whether a candidate is one of those *refuted*, or has no name and goes by the same: by
    temperatures, or by time."""
    return any(
        _goes_by(candidate) == _goes_by(refuted_candidate)
        and (
            candidate.place == refuted_candidate.place
            or (candidate.cause == "unknown" and _goes_by(candidate) != "")
        )
        for refuted_candidate in refuted
    )


def is_better(another: Diagnosis, diagnosis: Diagnosis) -> bool:
    """Whether what is written of *another* diagnosis predicts held-out readings better."""
    return bool(another.written) and another.written_rms_um[1] < diagnosis.written_rms_um[1]


def describe_refuted(refuted: Sequence[Candidate]) -> str:
    """What is said of findings that another diagnosis has replaced."""
    names = (
        f"{candidate.cause} ({candidate.location}{', by ' if candidate.depends_on else ''}"
        f"{', '.join(candidate.depends_on)})"
        for candidate in refuted
    )
    return f"Held-out readings refuted {', '.join(names)}: the diagnosis is without that."


def _goes_by(candidate: Candidate) -> str:
    """Whether a candidate goes by time, by what a sensor reads, or by neither."""
    if candidate.instant_unix_s is not None or any(isinstance(f, Dated) for f in candidate.factors):
        return "time"
    return "temperature" if any(name[:1] not in "qw" for name in candidate.depends_on) else ""
