"""The choice of a result when the search for changes returns to a state that it has already
visited.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from armd.compensation.interim.changes.change import Change, add_known_changes
from armd.compensation.interim.evidence.likelihood import LIMIT, compute_log_marginal
from armd.compensation.interim.evidence.looks import EpochLook
from armd.compensation.interim.evidence.stack import Stack


@dataclass(frozen=True)
class SearchState:
    """The state of the search after one look at the checks; its next step depends on
    nothing else.
    """

    look: EpochLook
    changes: tuple[Change, ...]
    alarms: tuple[int, ...]  # of each change, the check that raised the alarm
    bad: tuple[int, ...]


def find_cycle(
    states: Sequence[SearchState],
    since: int,
    left_out: Sequence[int],
    known_numbers: Sequence[float],
    alarms: Sequence[int],
) -> Sequence[SearchState]:
    """Return the states since the search last was in the same situation; none if it never was."""
    for number, state in enumerate(states):
        if state.alarms == tuple(alarms) and state.look.is_at(since, left_out, known_numbers):
            return states[number:]
    return ()


def choose_best_state(stack: Stack, states: Sequence[SearchState]) -> SearchState:
    """Return the state of a cycle whose changes make all readings likeliest.

    Each further change costs the limit of an alarm. Checks that any of the states takes for bad are
    not counted.

    A search runs in a cycle because each change was named from the readings until some alarm, and
    one alarm has fewer readings than another. All readings decide here, so the result does not
    depend on where the search entered the cycle.
    """
    bad = {i for state in states for i in state.bad}
    good = [i for i in range(stack.n) if i not in bad]

    def evidence(state: SearchState) -> float:
        changed = add_known_changes(stack, state.changes)
        return compute_log_marginal(changed, changed.sum_checks(good)) - LIMIT * len(state.changes)

    return max(states, key=evidence)
