"""The candidates that the search refused."""

from __future__ import annotations

from collections.abc import Sequence

from armd.compensation.diagnose.diagnosis import RefusedCandidate
from armd.compensation.effects.effect import Candidate


class Refusals:
    """The catalogue without the candidates that were refused."""

    def __init__(self, catalogue: Sequence[Candidate]) -> None:
        self.candidates = list(catalogue)  # stays the same object until a candidate is removed
        self.refused: list[RefusedCandidate] = []

    @property
    def places(self) -> set[tuple[str, str]]:
        """The places at which nothing is searched."""
        return {refusal.candidate.place for refusal in self.refused}

    def add(self, candidate: Candidate, reason: str) -> None:
        """Refuse a candidate with its *reason*, and remove all candidates of its place."""
        self.refused.append(RefusedCandidate(candidate, reason))
        remaining = [c for c in self.candidates if c.place != candidate.place]
        if len(remaining) < len(self.candidates):
            self.candidates = remaining
