"""The next experiment, in one sentence for a person at the artefact."""

from __future__ import annotations

from armd.compensation.diagnose.diagnose import Diagnosis
from armd.compensation.diagnose.search import Found
from armd.compensation.effects.catalogue import CATALOGUE

#: A finding less probable than this is worth an experiment of its own.
SURE = 0.95


def most_doubtful(diagnosis: Diagnosis) -> Found | None:
    """The finding an experiment should settle; None when none is in doubt."""
    doubtful = [found for found in diagnosis.found if found.rivals and found.probability < SURE]
    return min(doubtful, key=lambda found: found.probability) if doubtful else None


def next_experiment(diagnosis: Diagnosis) -> str:
    """What to measure next: to settle the most doubtful finding, or to confirm the mended model."""
    worst = most_doubtful(diagnosis)
    if worst is not None:
        rival = worst.rivals[0].candidate
        return (
            f"To tell {_named(worst)} from {_words(rival.cause)} ({rival.location}): "
            f"{CATALOGUE[worst.candidate.cause].experiment}; "
            "`armd design` picks the poses."
        )
    if diagnosis.outliers:
        return "Measure the readings named as outliers again; the rest needs nothing."
    if diagnosis.found:
        found = diagnosis.found[-1]
        return (
            f"To confirm {_named(found)} with the extended calibration: "
            f"{CATALOGUE[found.candidate.cause].experiment}."
        )
    return "Nothing significant is left to find; measure again after the next season or transport."


def _named(found: Found) -> str:
    return f"{_words(found.candidate.cause)} ({found.candidate.location})"


def _words(cause: str) -> str:
    return cause.replace("_", " ")
