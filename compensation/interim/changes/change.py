"""A detected change: its cause, its first check, and whether it is sudden or gradual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import KW_ONLY, dataclass, replace

import numpy as np

from armd.arrays import F64
from armd.compensation.interim.evidence.looks import EpochLooks
from armd.compensation.interim.evidence.stack import RAMP_DAYS, Stack

#: The prior standard deviation of a reported change's amplitudes, in typical sizes: wide, so that
#: any size is possible.
ANY_SIZE = 100.0
#: At each bend the rate of a growth may change by this share of itself (a long growth: by its own
#: `bending`).
BENDING = 0.7
#: The prior standard deviation of a growth's first rate, as a multiple of its mean rate.
FIRST_RATE_SPREAD = 2.0


@dataclass(frozen=True)
class Change:
    """A change at its likeliest, with its probability; checks are numbered through the
    whole stack.
    """

    cause: int | None  # index into the causes; None: nothing in the catalogue fits
    gradual: bool
    first: int  # the first check that has it
    earliest: int  # 95 % interval of the first check that has it: from
    latest: int  # … to
    origin_d: float  # of a growth: when it begins, days since the first check
    probability: float  # of the cause at its place
    _: KW_ONLY
    rivals: tuple[tuple[int, float], ...] = ()  # other causes, one for each place
    gradual_probability: float = 0.0
    bends_d: tuple[float, ...] = ()  # of a growth: where its rate may change, days
    rate_size: F64 | None = None  # (p,) of a growth: how large its rate is, in typical sizes
    bending: float = BENDING  # of a growth: change at each bend, as a share of its rate
    size: float = ANY_SIZE  # prior standard deviation of its amplitudes, in typical sizes

    @property
    def key(self) -> tuple[int | None, bool, int]:
        return self.cause, self.gradual, self.first

    @property
    def coarser(self) -> Change:
        """The growth with half as many bends, and the same prior spread of its course."""
        bends = self.bends_d[::-1][::2][::-1]
        return replace(self, bends_d=bends, bending=self.bending * float(np.sqrt(2.0)))

    @property
    def numbers(self) -> tuple[float, ...]:
        """All numbers that a stack with this known change depends on."""
        rate = () if self.rate_size is None else tuple(self.rate_size.tolist())
        cause = -1 if self.cause is None else self.cause
        bends = (len(self.bends_d), *self.bends_d)
        course = (self.origin_d, self.bending, *bends, *rate) if self.gradual else ()
        return (float(cause), float(self.gradual), float(self.first), self.size, *course)


#: A possible history of the arm: its share of the probability, and all its changes.
ChangeScenario = tuple[float, tuple[Change, ...]]


@dataclass(frozen=True)
class ChangesFound:
    """The result of the search for changes in one epoch's checks."""

    statistic: F64  # (n,) the alarm's statistic after each check
    alarm: int | None
    changes: tuple[Change, ...]  # in order of onset
    bad: tuple[int, ...]
    looked: EpochLooks  # looks that need not be repeated when a check is added


def compute_shapes(stack: Stack, change: Change) -> F64:
    """Return the course of a change at each check (n, 1 + bends), per amplitude of each of its
    columns.
    """
    if not change.gradual:
        return (np.arange(stack.n) >= change.first).astype(float)[:, None]
    return np.stack(
        [compute_ramp(stack, start_d) for start_d in (change.origin_d, *change.bends_d)], axis=1
    )


def compute_ramp(stack: Stack, origin_d: float) -> F64:
    """Return a ramp (n,): 0 until *origin_d*, and 1 thirty days later."""
    grown: F64 = np.maximum(stack.time_d - origin_d, 0.0) / RAMP_DAYS
    return grown


def list_amplitude_sizes(change: Change, columns: int) -> F64:
    """Return the prior standard deviations (1 + bends, p) of a change's amplitudes, in typical
    sizes.
    """
    if change.rate_size is None:
        return np.full((1, columns), change.size)
    sizes = np.tile(change.bending * change.rate_size, (1 + len(change.bends_d), 1))
    sizes[0] = FIRST_RATE_SPREAD * change.rate_size
    return sizes


def count_amplitudes(stack: Stack, change: Change) -> int:
    """Count the amplitudes of a change; a change without a cause has none."""
    if change.cause is None:
        return 0
    block = stack.blocks[change.cause]
    return (1 + len(change.bends_d)) * int(block.stop - block.start)


def add_known_changes(stack: Stack, changes: Sequence[Change]) -> Stack:
    """Return the stack with these changes among its known errors, their amplitudes unknown."""
    if all(change.cause is None for change in changes):
        return stack
    return stack.add_known_errors(list_change_columns(stack, changes))


def list_change_columns(stack: Stack, changes: Sequence[Change]) -> list[F64]:
    """Return the columns (r, amplitudes of all named changes) of each check, per prior standard
    deviation.
    """
    columns: list[list[F64]] = [[np.zeros((len(residual), 0))] for residual in stack.residual]
    for change in changes:
        if change.cause is None:
            continue
        block = stack.blocks[change.cause]
        shape = compute_shapes(stack, change)
        sizes = list_amplitude_sizes(change, block.stop - block.start)
        for i in range(stack.n):
            block_columns = stack.columns[i][:, block]
            wide = (shape[i][:, None, None] * sizes[:, None, :] * block_columns[None]).transpose(
                1, 0, 2
            )
            columns[i].append(wide.reshape(len(block_columns), -1))
    return [np.concatenate(check_columns, axis=1) for check_columns in columns]
