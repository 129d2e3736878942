"""A search for changes that comes back to where it was: which of its readings of the checks it ends
with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from armd.compensation.interim.changes.change import Change, add_known_changes
from armd.compensation.interim.evidence.likelihood import LIMIT, compute_log_marginal
from armd.compensation.interim.evidence.looks import EpochLook
from armd.compensation.interim.evidence.stack import Stack


@dataclass(frozen=True)
class SearchState:
    """Where a search stood after a look at the checks; where it went on to depends on nothing
    else."""

    look: EpochLook
    changes: tuple[Change, ...]
    alarms: tuple[int, ...]  # each change's
    bad: tuple[int, ...]


def find_circle(
    stands: Sequence[SearchState],
    since: int,
    left_out: Sequence[int],
    known_numbers: Sequence[float],
    alarms: Sequence[int],
) -> Sequence[SearchState]:
    """The stands since the search was last about to look so; none if it never was."""
    for number, stand in enumerate(stands):
        if stand.alarms == tuple(alarms) and stand.look.is_at(since, left_out, known_numbers):
            return stands[number:]
    return ()


def choose_best_stand(stack: Stack, stands: Sequence[SearchState]) -> SearchState:
    """The stand whose changes make all readings likeliest, each change more at the price of an
    alarm; of the checks that no stand takes for bad.

    A search goes round because each change was named by the readings until some alarm, one of them
    by fewer than the other. All readings decide, wherever the circle was entered.
    """
    bad = {i for stand in stands for i in stand.bad}
    good = [i for i in range(stack.n) if i not in bad]

    def evidence(stand: SearchState) -> float:
        changed = add_known_changes(stack, stand.changes)
        return compute_log_marginal(changed, changed.sum_checks(good)) - LIMIT * len(stand.changes)

    return max(stands, key=evidence)
