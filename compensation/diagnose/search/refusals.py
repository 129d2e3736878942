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
        self.told: list[RefusedCandidate] = []
        #: Place → the findings beside which it was refused; None once it was asked again.
        self._beside: dict[tuple[str, str], str | None] = {}

    @property
    def places(self) -> set[tuple[str, str]]:
        """Where nothing is looked for."""
        return {one.candidate.place for one in self.told}

    def add(self, candidate: Candidate, reason: str, beside: str) -> bool:
        """Look for it no more, *beside* these findings; whether the candidates are others now."""
        self.told.append(RefusedCandidate(candidate, reason))
        self._beside.setdefault(candidate.place, beside)
        left = [c for c in self.candidates if c.place != candidate.place]
        if fewer := len(left) < len(self.candidates):
            self.candidates = left
        return fewer

    def ask_again(self, beside: str) -> bool:
        """Whether something was refused beside findings other than *beside*, and not asked again
        yet: then it is a candidate again."""
        again = {place for place, key in self._beside.items() if key not in (None, beside)}
        if not again:
            return False
        self._beside |= dict.fromkeys(again)
        self.told = [r for r in self.told if r.candidate.place not in again]
        barred = self.places
        self.candidates = [c for c in self._catalogue if c.place not in barred]
        return True
