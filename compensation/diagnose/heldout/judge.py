"""A judge whether one model predicts held-out readings significantly better than another."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import AXES, CHANGED_PRIOR, MOST_WORSE, TINY_MM2
from armd.compensation.diagnose.diagnosis import Gain
from armd.compensation.diagnose.heldout.gain import compute_gain, limit_squares
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.effects.courses import is_slow


@dataclass(frozen=True)
class HoldoutScheme:
    """One way to hold readings out.

    *squares*: the squared residuals (n,) mm², given the findings in the model and whether the first
    link expands in it. *groups* (n,): what readings are resampled by.
    """

    squares: Callable[[Sequence[int], bool], F64]
    groups: I64
    axes: float = float(AXES)  # mean number of directions of a reading; one on a surface


#: Findings in a model, by number, and whether the first link expands in it.
Composition = tuple[tuple[int, ...], bool]
#: Whether the first scheme cannot show a finding, by number, given the findings in a model.
IsUninformative = Callable[[int, tuple[int, ...]], bool]


class Judge:
    """A comparison of models of one fit's findings; each held-out error is computed once."""

    def __init__(
        self,
        last: Fit,
        schemes: Sequence[HoldoutScheme],
        is_uninformative: IsUninformative,
        later: Callable[[Sequence[int], bool], F64] | None,
    ) -> None:
        self._last, self._schemes = last, schemes
        self._is_uninformative, self._later = is_uninformative, later
        self._errors: dict[Composition, list[F64]] = {}

    def errors(self, model: Composition) -> list[F64]:
        """Return the squared held-out residuals of each scheme."""
        if model not in self._errors:
            self._errors[model] = [scheme.squares(*model) for scheme in self._schemes]
        return self._errors[model]

    def predicts_later_no_worse(self, before: Composition, after: Composition) -> bool:
        """Whether later readings get no worse by what depends on time or temperature in *after*
        only.

        Where something drifts, a temperature may stand in for the time.
        """
        added = {*after[0]} - {*before[0]}
        if self._later is None or not any(is_slow(self._last.findings[i]) for i in added):
            return True
        old_mm2, new_mm2 = limit_squares(self._later(*before), self._later(*after))
        return float(new_mm2.sum()) <= float(old_mm2.sum())

    def find_confirming_scheme(
        self, before: Composition, after: Composition
    ) -> tuple[int, Gain] | None:
        """Return the number of the first scheme that confirms what is new, and its gain.

        None is returned where no scheme does, or where the first one, if informative, contradicts.
        """
        pairs = [
            (old, new, scheme.groups)
            for old, new, scheme in zip(
                self.errors(before), self.errors(after), self._schemes, strict=True
            )
        ]
        decided = [compute_gain(*limit_squares(old, new), groups) for old, new, groups in pairs]
        of_all = [compute_gain(*pair) for pair in pairs]
        new = {*after[0]} - {*before[0]}
        is_informative = not new or not all(self._is_uninformative(i, after[0]) for i in new)
        if is_informative and (decided[0].interval_um[1] < 0.0 or _raises_rms_clearly(of_all[0])):
            return None
        for k, decision in enumerate(decided):
            if decision.is_confirmed and not _raises_rms_clearly(of_all[k]):
                return k, replace(of_all[k], is_confirmed=True)
        return None

    def compute_gain_of(self, finding: int, numbers: tuple[int, ...], growth: bool) -> Gain:
        """Return the first scheme's gain of a finding given those of *numbers* found before it."""
        earlier = tuple(i for i in numbers if i < finding)
        old, new = (self.errors((model, growth))[0] for model in (earlier, (*earlier, finding)))
        return compute_gain(old, new, self._schemes[0].groups)

    def is_harmful(self, finding: int, reduced: Composition, full: Composition) -> bool:
        """Whether the first scheme, if it can show a finding, predicts better without it."""
        if self._is_uninformative(finding, full[0]):
            return False
        without_mm2, with_mm2 = limit_squares(self.errors(reduced)[0], self.errors(full)[0])
        return float(without_mm2.sum()) < float(with_mm2.sum())

    def compute_odds_factor(self, finding: int, reduced: Composition, full: Composition) -> float:
        """Return a factor, at most 1, for the odds of a finding.

        It is below 1 where the first scheme predicts significantly worse with the finding. It is
        then the likelihood ratio of the held-out readings, but at least the probability that the
        arm changed.
        """
        if self._is_uninformative(finding, full[0]):
            return 1.0
        old, new = limit_squares(self.errors(reduced)[0], self.errors(full)[0])
        if compute_gain(old, new, self._schemes[0].groups).interval_um[1] >= 0.0:
            return 1.0
        variance_mm2 = max(float(old.mean()) / self._schemes[0].axes, TINY_MM2)  # per direction
        nats = 0.5 * float((new - old).sum()) / variance_mm2
        return max(math.exp(-max(nats, 0.0)), CHANGED_PRIOR)

    def predicts_better_with_growth(self, numbers: tuple[int, ...]) -> bool:
        """Whether the last scheme predicts better if the first link expands in the model of
        *numbers*.

        The error of all readings together must not get worse.
        """
        old, new = (self.errors((numbers, growth))[-1] for growth in (False, True))
        capped_old, capped_new = limit_squares(old, new)
        better = float(capped_new.sum()) < float(capped_old.sum())
        return better and not _raises_rms_clearly(compute_gain(old, new, self._schemes[-1].groups))


def _raises_rms_clearly(gained: Gain) -> bool:
    return gained.after_um > (1.0 + MOST_WORSE) * gained.before_um
