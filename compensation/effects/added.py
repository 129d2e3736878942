"""Causes of other packages: entry points in the group `armd.causes` (docs/developer/plugins.md).

An exception in a package's code is reported once; its cause then has no candidate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import replace
from typing import Any

from armd.compensation.effects.effect import Candidate, Effect, SessionFacts
from armd.compensation.model.calibration import check_terms
from armd.errors import BadInput
from armd.plugins.entry_points import Group, Plugin, load_all, report

GROUP: Group = "armd.causes"


def load_added_effects(built_in: Collection[str]) -> list[Effect]:
    """Load the causes of other packages, in the order of their names."""
    return list(load_all(GROUP, built_in, _checked).values())


def _checked(plugin: Plugin, loaded: Any) -> Effect:
    if not isinstance(loaded, Effect):
        expected = "an armd.compensation.effects.effect.Effect"
        raise plugin.fault(repr(loaded), expected)
    if loaded.cause != plugin.name:
        raise plugin.fault(f"the cause {loaded.cause!r}", "the entry point's own name")
    return _Guard(plugin, loaded).guarded()


class _Guard:
    """A cause of a package, whose exceptions are caught."""

    def __init__(self, plugin: Plugin, effect: Effect) -> None:
        self._plugin = plugin
        self._effect = effect

    def guarded(self) -> Effect:
        """Return the cause with functions that never raise."""
        effect = self._effect
        through, curve = effect.through_terms, effect.describe_curve
        return replace(
            effect,
            candidates=lambda facts: self._sound(lambda: effect.candidates(facts), facts),
            describe=lambda candidate, amplitudes: self._text(
                candidate, lambda: effect.describe(candidate, amplitudes)
            ),
            through_terms=through
            and (lambda facts, terms: self._sound(lambda: through(facts, terms), facts)),
            describe_curve=curve
            and (lambda candidate, rms, order: self._text(
                candidate, lambda: curve(candidate, rms, order)
            )),
        )  # fmt: skip

    def _sound(
        self, make: Callable[[], Iterable[Candidate]], facts: SessionFacts
    ) -> Iterator[Candidate]:
        """Yield all candidates, or none if one of them is not valid."""
        try:
            candidates = list(make())
            for candidate in candidates:
                self._check(candidate, facts)
        except BadInput as error:
            report(str(error))
            return
        except Exception as error:
            report(str(self._plugin.fault_of(error, "candidates for these sessions")))
            return
        for candidate in candidates:
            yield self._guarded_again(candidate, facts)

    def _guarded_again(self, candidate: Candidate, facts: SessionFacts) -> Candidate:
        """Return the candidate with functions whose candidates are checked, too."""
        refine, elsewhere = candidate.refine, candidate.elsewhere
        return replace(
            candidate,
            refine=refine and (lambda: list(self._sound(refine, facts))),
            elsewhere=elsewhere
            and (lambda value: next(self._sound(lambda: [elsewhere(value)], facts), candidate)),
        )

    def _check(self, candidate: object, facts: SessionFacts) -> None:
        """Raise `BadInput` for a candidate that the search cannot use."""
        if not isinstance(candidate, Candidate) or candidate.cause != self._effect.cause:
            raise self._plugin.fault(repr(candidate), f"a Candidate of {self._effect.cause!r}")
        for column in candidate.columns:
            if not (math.isfinite(column.prior_sd) and column.prior_sd > 0.0):
                description = f"the typical size {column.prior_sd!r} of {column.name}"
                raise self._plugin.fault(description, "a number above 0")
            check_terms(str(self._plugin.package), column.terms, facts.arm)

    def _text(self, candidate: Candidate, make: Callable[[], str]) -> str:
        try:
            return str(make())
        except Exception as error:
            report(str(self._plugin.fault_of(error, "a text")))
            return f"{candidate.location}: {self._effect.reason}"
