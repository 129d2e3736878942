"""The next experiment, in one sentence for the person at the artefact."""

from __future__ import annotations

from dataclasses import dataclass

from armd.compensation.diagnose.constants import SURE
from armd.compensation.diagnose.diagnosis import Diagnosis, Finding, Rival
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate


@dataclass(frozen=True)
class Doubt:
    """A finding that these data leave open, and what else it could be."""

    index: int  # among the diagnosis' findings
    finding: Finding
    rivals: tuple[Candidate, ...]  # the most probable one first
    share: tuple[float, ...]  # probability of each rival

    @property
    def words(self) -> str:
        """The purpose of an experiment about it, in words."""
        return f"tell {_named(self.finding.candidate)} from {_named(self.rivals[0])}"


def find_most_doubtful(diagnosis: Diagnosis) -> Doubt | None:
    """Return the finding that an experiment should settle first; None if none is in doubt."""
    doubts = []
    for i, finding in enumerate(diagnosis.findings):
        rivals = [r for r in finding.rivals if not is_alike(r.candidate, finding.candidate)]
        if rivals and finding.probability < SURE:
            doubts.append(_doubt(i, finding, rivals[0]))
    return min(doubts, key=lambda doubt: doubt.finding.probability, default=None)


def _doubt(index: int, finding: Finding, first: Rival) -> Doubt:
    """Compare a finding with its likeliest rival and all other variants of what it may be."""
    variants = [(c, share) for c, share in finding.variants if c is not first.candidate]
    rivals = (first.candidate, *(candidate for candidate, _ in variants))
    return Doubt(index, finding, rivals, (first.probability, *(share for _, share in variants)))


def is_alike(first: Candidate, second: Candidate) -> bool:
    """Whether an experiment need not separate two candidates.

    They are one cause at one place, or two structures without a name in the same variables.
    """
    unnamed = first.cause == second.cause == "unknown" and first.depends_on == second.depends_on
    return unnamed or first.place == second.place


def propose_experiment(diagnosis: Diagnosis) -> str:
    """Propose what to measure next: to settle the most doubtful finding, or to confirm the extended
    model.
    """
    unrecorded = _unrecorded(diagnosis)
    if unrecorded and diagnosis.significant_rest:
        return unrecorded
    doubt = find_most_doubtful(diagnosis)
    if doubt is not None:
        cause = doubt.finding.candidate.cause
        return f"To {doubt.words}: {CATALOGUE[cause].experiment}; `armd design` picks the poses."
    if diagnosis.outliers:
        return "Measure the readings named as outliers again; the rest needs nothing."
    if diagnosis.findings:
        candidate = diagnosis.findings[-1].candidate
        return (
            f"To confirm {_named(candidate)} with the extended calibration: "
            f"{CATALOGUE[candidate.cause].experiment}."
        )
    if diagnosis.significant_rest:
        on = ", ".join(diagnosis.search.remaining_depends_on) or "what these data do not show"
        return (
            f"What is left goes with {on}, and no cause was found for it: measure again with "
            "these spread wider, all else as it is; `armd design` picks the poses."
        )
    return (
        "Nothing significant is left to find; measure again after the next season or transport. "
        "`armd design` picks poses that tighten the least well known parameter."
    )


def _unrecorded(diagnosis: Diagnosis) -> str:
    """Propose what to record with the angles, where only that can show a cause of what is left."""
    facts, untold = diagnosis.search.facts, diagnosis.search.untold
    missing = [
        quantity
        for quantity, is_recorded in (("the time", facts.timed), ("the joint rates", facts.rates))
        if not is_recorded
    ]
    by_motion = [cause for cause, effect in CATALOGUE.items() if effect.by_motion]
    of_them = [cause.replace("_", " ") for cause in by_motion if cause in untold]
    if not (missing and of_them):
        return ""
    return (
        f"Record {' and '.join(missing)} of each reading, and measure the same poses from both "
        f"sides of each joint: what is left may be a cause that these data cannot tell "
        f"({', '.join(of_them)})."
    )


def _named(candidate: Candidate) -> str:
    if candidate.cause == "unknown":
        return f"a structure in {', '.join(candidate.depends_on)} without a name"
    return f"{candidate.cause.replace('_', ' ')} ({candidate.location})"
