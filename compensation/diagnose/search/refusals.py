"""What the search refused."""

from __future__ import annotations

from collections.abc import Sequence

from armd.compensation.diagnose.diagnosis import RefusedCandidate
from armd.compensation.effects.effect import Candidate


class Refusals:
    """The catalogue without what was refused."""

    def __init__(self, catalogue: Sequence[Candidate]) -> None:
        self.candidates = list(catalogue)  # the same list as long as they are the same
        self.refused: list[RefusedCandidate] = []

    @property
    def places(self) -> set[tuple[str, str]]:
        """Where nothing is looked for."""
        return {refusal.candidate.place for refusal in self.refused}

    def add(self, candidate: Candidate, reason: str) -> None:
        """Look for it no more."""
        self.refused.append(RefusedCandidate(candidate, reason))
        remaining = [c for c in self.candidates if c.place != candidate.place]
        if len(remaining) < len(self.candidates):
            self.candidates = remaining
