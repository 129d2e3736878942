"""The findings that held-out readings refute, and a test whether a diagnosis without them is
better.

In sessions that grew warmer one after another, a drift in time and one with temperature are nearly
one signal, and the search names the likelier. Held-out readings decide which it is: a finding with
which they are predicted significantly worse is not there, and its alternatives are tried.
"""

from __future__ import annotations

from collections.abc import Sequence

from armd.compensation.diagnose.diagnosis import Diagnosis
from armd.compensation.effects.effect import Candidate
from armd.compensation.model.slow_factors import Dated


def select_refuted(diagnosis: Diagnosis) -> tuple[Candidate, ...]:
    """Return the named, unwritten findings that held-out or later readings refute.

    With such a finding, held-out readings are predicted significantly worse, or later readings
    worse.
    """
    return tuple(
        finding.candidate
        for i, (finding, gain) in enumerate(zip(diagnosis.findings, diagnosis.gains, strict=True))
        if finding.candidate.cause != "unknown" and i not in diagnosis.written
        if i in diagnosis.contradicted_later or gain.interval_um[1] < 0.0
    )


def is_refuted(candidate: Candidate, refuted: Sequence[Candidate]) -> bool:
    """Whether a candidate is one of those *refuted*.

    It has the place of one of them, or no name, and depends on time or on temperatures as that one
    does. At the same place both may depend on neither.
    """
    return any(
        _goes_by(candidate) == _goes_by(refuted_candidate)
        and (
            candidate.place == refuted_candidate.place
            or (candidate.cause == "unknown" and _goes_by(candidate) != "")
        )
        for refuted_candidate in refuted
    )


def is_better(another: Diagnosis, diagnosis: Diagnosis) -> bool:
    """Whether the extended calibration of *another* diagnosis predicts held-out readings better."""
    return bool(another.written) and another.written_rms_um[1] < diagnosis.written_rms_um[1]


def describe_refuted(refuted: Sequence[Candidate]) -> str:
    """Describe in a sentence the findings that another diagnosis has replaced."""
    names = (
        f"{candidate.cause} ({candidate.location}{', by ' if candidate.depends_on else ''}"
        f"{', '.join(candidate.depends_on)})"
        for candidate in refuted
    )
    return f"Held-out readings refuted {', '.join(names)}: the diagnosis is without that."


def _goes_by(candidate: Candidate) -> str:
    """Return whether a candidate depends on time, on what a sensor reads, or (empty) on neither."""
    if candidate.instant_unix_s is not None or any(isinstance(f, Dated) for f in candidate.factors):
        return "time"
    return "temperature" if any(name[:1] not in "qw" for name in candidate.depends_on) else ""
