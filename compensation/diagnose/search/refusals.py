"""What the search refused, and whether it is to be asked again."""

from __future__ import annotations

from collections.abc import Sequence

from armd.compensation.diagnose.diagnosis import RefusedCandidate
from armd.compensation.effects.effect import Candidate


class Refusals:
    """The catalogue without what was refused.

    A fit may be led astray by what else is wrong and was not found yet. So what was refused beside
    other findings may be looked for again, once.
    """

    def __init__(self, catalogue: Sequence[Candidate]) -> None:
        self._catalogue = tuple(catalogue)
        self.candidates = list(catalogue)  # the same list as long as they are the same
        self.refused: list[RefusedCandidate] = []
        #: Place → the findings beside which it was refused; None once it was asked again.
        self._refused_beside: dict[tuple[str, str], str | None] = {}

    @property
    def places(self) -> set[tuple[str, str]]:
        """Where nothing is looked for."""
        return {refusal.candidate.place for refusal in self.refused}

    def add(self, candidate: Candidate, reason: str, findings_key: str) -> bool:
        """Look for it no more beside the findings of that key; whether the candidates changed."""
        self.refused.append(RefusedCandidate(candidate, reason))
        self._refused_beside.setdefault(candidate.place, findings_key)
        remaining = [c for c in self.candidates if c.place != candidate.place]
        if fewer := len(remaining) < len(self.candidates):
            self.candidates = remaining
        return fewer

    def ask_again(self, findings_key: str) -> bool:
        """Whether something was refused beside other findings than these, and not asked again
        yet: then it is a candidate again."""
        again = {
            place for place, key in self._refused_beside.items() if key not in (None, findings_key)
        }
        if not again:
            return False
        self._refused_beside |= dict.fromkeys(again)
        self.refused = [r for r in self.refused if r.candidate.place not in again]
        barred = self.places
        self.candidates = [c for c in self._catalogue if c.place not in barred]
        return True
