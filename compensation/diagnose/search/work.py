"""The bound on what a diagnosis computes: a number of products, equal on every machine.

Readings of ordinary quality never come near the bound. Bad ones are another arm's readings,
mixed-up rows, or dozens of causes. With them the search finds ten causes, tries other sets of as
many, and repeats itself without each part of the readings. That takes minutes and adds nothing to
the first causes. The report lists what is skipped.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from armd.compensation.diagnose.constants import (
    LEAST_REPEATED,
    MANY_READINGS,
    MOST_OF_SETS,
    MOST_PRODUCTS,
    MOST_TIMES,
)


@dataclass
class WorkBudget:
    """The work that a diagnosis has done so far, and the list of what it skipped."""

    limit: float = MOST_PRODUCTS
    done: float = 0.0
    of_sets: float = 0.0
    skipped: list[str] = field(default_factory=list)

    def add(self, products: float, times: float, *, of_sets: bool = False) -> None:
        """Add the work of scoring the catalogue once, *products* products, *times* over.

        *of_sets*: whether it is done to try another set of causes.
        """
        products *= times
        self.done += products
        if of_sets:
            self.of_sets += products

    def split(self, count: int) -> WorkBudget:
        """Return the budget of one of *count* pieces that are computed in parallel.

        It is an equal part of what is left, or of what is reserved for them.
        """
        return WorkBudget(max(self.limit - self.done, LEAST_REPEATED * self.limit) / count)

    def take(self, piece: WorkBudget) -> None:
        """Add the work that a piece has done, and what it skipped."""
        self.done += piece.done
        for description in piece.skipped:
            self.skip(description)

    @classmethod
    def of_readings(cls, count: int) -> WorkBudget:
        """Return the budget for *count* readings."""
        times = min(max(MANY_READINGS / max(count, 1), 1.0), MOST_TIMES)
        return cls(MOST_PRODUCTS * times)

    @property
    def may_try_sets(self) -> bool:
        """Whether other sets of causes may still be tried."""
        return self.of_sets < MOST_OF_SETS * self.limit and self.may_go_on

    @property
    def may_go_on(self) -> bool:
        """Whether anything more may be computed."""
        return self.done < self.limit

    def skip(self, description: str) -> None:
        """Record once what is not computed."""
        if description not in self.skipped:
            self.skipped.append(description)

    def in_words(self) -> list[str]:
        """Return a sentence for a person; nothing where nothing was skipped."""
        if not self.skipped:
            return []
        return [
            "The work of the search is bounded, and these readings take more of it: "
            f"{'; '.join(self.skipped)}. Look for what is wrong with the readings first."
        ]
