"""The checks of one epoch stacked: sums over time, from which the standing errors are eliminated.

All of it is in the checks' order in time, so the order of adding has no effect.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.interim.checks.columns import Cause
from armd.compensation.interim.checks.open_growth import GROWTH
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.evidence.elimination import (
    CheckSums,
    EliminatedErrors,
    eliminate_standing,
)
from armd.compensation.model.slow_factors import DAY_S

#: Factor on the uncertainties that a calibration states: its model was fitted on other days, in
#: other poses, on another artefact.
TRUST = 2.0
#: Errors that the model lacks are present in all checks and are no change (standing errors). Their
#: size is one of these shares of the typical one, with equal prior probabilities; the checks decide
#: (decision 30).
ALL_ALONG = (0.01, 0.03, 0.1, 0.3)
#: Directions of the known errors that all checks together measure by less than this, in
#: variances of one number, are dropped. This is so little that a later check, which may measure
#: more of them, does not change earlier results.
LEAST_SEEN = 1e-9
#: Growths are stated per this many days.
RAMP_DAYS = 30.0


@dataclass(frozen=True)
class OnsetSums:
    """Sums since T onsets, of C causes' columns group by group."""

    cross: F64  # (T, C, q) with the known errors
    towards: F64  # (T, C) with the readings
    cause_grams: list[F64]  # by group (T, causes, p, p)


@dataclass(frozen=True)
class Stack:
    """n checks in time: per check r numbers, K causes in blocks of columns, q known errors."""

    time_d: F64  # (n,) mean time of each check, days since the first
    residual: tuple[F64, ...]  # n × (r,)
    columns: tuple[F64, ...]  # n × (r, C), per typical size
    error_columns: tuple[F64, ...]  # n × (r, q) per standard deviation of the known errors
    targets: tuple[F64, ...]  # n × (r, 3 T) per mm
    blocks: tuple[slice, ...]  # K causes' columns
    #: The first and last of the known errors that the model lacks (standing errors), and their
    #: share of the typical size.
    standing: tuple[int, int] = (0, 0)
    share: float = 1.0

    @property
    def n(self) -> int:
        return len(self.residual)

    @property
    def gap_d(self) -> float:
        """The usual interval between checks, days."""
        return find_usual_gap_d(self.time_d)

    @property
    def has_standing_errors(self) -> bool:
        """Whether any of the known errors is a standing error."""
        return self.standing[0] < self.standing[1]

    @property
    def scales(self) -> tuple[float, ...]:
        """The factors by which the standing errors may have to be multiplied, with equal
        probabilities.
        """
        if not self.has_standing_errors:
            return (1.0,)
        return tuple(share / self.share for share in ALL_ALONG)

    def scale_factors(self, scale: float) -> F64:
        """Return factors (q,) of the known errors: *scale* for the standing ones, else 1."""
        factors = np.ones(self.error_columns[0].shape[1])
        factors[slice(*self.standing)] = scale
        return factors

    def rescale(self, scale: float) -> Stack:
        """Return the stack with standing errors *scale* times as large."""
        error_columns = tuple(columns * self.scale_factors(scale) for columns in self.error_columns)
        return replace(self, error_columns=error_columns, share=self.share * scale)

    def select_checks(self, chosen: Sequence[int]) -> Stack:
        """Return the stack of the *chosen* checks, in time."""
        return replace(
            self,
            time_d=self.time_d[list(chosen)],
            residual=tuple(self.residual[i] for i in chosen),
            columns=tuple(self.columns[i] for i in chosen),
            error_columns=tuple(self.error_columns[i] for i in chosen),
            targets=tuple(self.targets[i] for i in chosen),
        )

    def sum_checks(self, chosen: Sequence[int]) -> CheckSums:
        """Return the sums over the *chosen* checks."""
        pairs = [(self.error_columns[i], self.residual[i]) for i in chosen]
        q = self.error_columns[0].shape[1]
        return CheckSums(
            sum((errors.T @ errors for errors, _ in pairs), np.zeros((q, q))),
            sum((errors.T @ residual for errors, residual in pairs), np.zeros(q)),
            sum(float(residual @ residual) for _, residual in pairs),
            sum(len(residual) for _, residual in pairs),
        )

    def eliminate_errors(self, sums: CheckSums) -> EliminatedErrors:
        """Eliminate all known errors from *sums* over some of the checks."""
        standing = slice(*self.standing)
        return eliminate_standing(sums.curvature, sums.side, sums.square, standing, self.scales)

    def add_known_errors(self, extra: Sequence[F64]) -> Stack:
        """Return the stack with *extra* known errors, (r, ·) per check."""
        pairs = zip(self.error_columns, extra, strict=True)
        return replace(self, error_columns=tuple(np.concatenate(pair, axis=1) for pair in pairs))


def find_usual_gap_d(time_d: F64) -> float:
    """Return the usual (median) interval between checks at these times, days."""
    return float(np.median(np.diff(time_d))) if len(time_d) > 1 else 1.0


def join_checks(checks: Sequence[Reduced], causes: Sequence[Cause]) -> Stack:
    """Stack *checks*, which are in order of time."""
    typical = np.array([c.prior_sd for cause in causes for c in cause.candidate.columns])
    columns = [check.causes * typical for check in checks]
    share = max(ALL_ALONG)
    stated = _compress(_align(checks))
    standing = _compress([share * values for values in columns])
    error_columns = [np.concatenate(pair, axis=1) for pair in zip(stated, standing, strict=True)]
    ends = np.cumsum([len(cause.candidate.columns) for cause in causes])
    starts = np.concatenate([[0], ends[:-1]])
    begun = checks[0].mean_unix_s
    return Stack(
        np.array([(check.mean_unix_s - begun) / DAY_S for check in checks]),
        tuple(check.residual for check in checks),
        tuple(columns),
        tuple(error_columns),
        tuple(check.targets for check in checks),
        tuple(slice(int(a), int(b)) for a, b in zip(starts, ends, strict=True)),
        (stated[0].shape[1], error_columns[0].shape[1]),
        share,
    )


def _align(checks: Sequence[Reduced]) -> list[F64]:
    """Return the known errors of every check, aligned by their names."""
    names = list(dict.fromkeys(name for check in checks for name in check.known_names))
    place = {name: i for i, name in enumerate(names)}
    aligned = []
    for check in checks:
        wide = np.zeros((len(check.residual), len(names)))
        # a growth's prior comes from the materials, not from the calibration
        trust = [1.0 if name.startswith(GROWTH) else TRUST for name in check.known_names]
        wide[:, [place[name] for name in check.known_names]] = np.array(trust) * check.error_columns
        aligned.append(wide)
    return aligned


def _compress(error_columns: Sequence[F64]) -> list[F64]:
    """Express the errors by fewer, independent unknowns: those that the checks measure at all."""
    gram = sum(
        (columns.T @ columns for columns in error_columns),
        np.zeros((error_columns[0].shape[1],) * 2),
    )
    value, vector = np.linalg.eigh(gram)
    visible = vector[:, value > LEAST_SEEN]
    return [columns @ visible for columns in error_columns]


class RunningSums:
    """Running sums over the first i checks, for changes that begin at a check or between two.

    The causes' sums are computed when first needed: without a change they are not used. They cover
    checks from *begin* on, which is enough for changes that begin there or later. Their C columns
    are ordered group by group.
    """

    def __init__(self, stack: Stack, begin: int = 0) -> None:
        self.stack, self.begin = stack, begin
        days = stack.time_d / RAMP_DAYS
        groups: dict[int, list[int]] = {}
        for k, block in enumerate(stack.blocks):
            groups.setdefault(block.stop - block.start, []).append(k)
        #: causes by their number of columns, and these columns (causes, p)
        self.groups = [
            (
                np.array(members),
                np.array(
                    [list(range(stack.blocks[k].start, stack.blocks[k].stop)) for k in members]
                ),
            )
            for _, members in sorted(groups.items())
        ]
        self._order = np.concatenate(
            [columns.ravel() for _, columns in self.groups] or [np.zeros(0, int)]
        )
        self._powers = np.array([np.ones(stack.n), days, days**2])  # powers of time
        pairs = [*zip(stack.error_columns, stack.residual, strict=True)]
        q = stack.error_columns[0].shape[1]
        self.error_gram = _cumulate(self._powers[:1], (k.T @ k for k, _ in pairs), (q, q))[0]
        self.known_towards = _cumulate(self._powers[:1], (k.T @ z for k, z in pairs), (q,))[0]
        self.square = np.concatenate([[0.0], np.cumsum([z @ z for z in stack.residual])])
        self.numbers = np.concatenate([[0], np.cumsum([len(z) for z in stack.residual])])

    @cached_property
    def cause_grams(self) -> list[F64]:
        """The products of each group's columns (3, n − begin + 1, causes, p, p)."""
        grams = []
        for _, columns in self.groups:
            products = (
                x[:, columns].transpose(1, 2, 0) @ x[:, columns].transpose(1, 0, 2)
                for x in self.stack.columns[self.begin :]
            )
            grams.append(self._since_begin(3, products, (*columns.shape, columns.shape[1])))
        return grams

    @cached_property
    def towards(self) -> F64:
        """The products of the causes' columns and the readings (2, n − begin + 1, C)."""
        pairs = zip(self._columns(), self.stack.residual[self.begin :], strict=True)
        return self._since_begin(2, (x.T @ z for x, z in pairs), self._order.shape)

    @cached_property
    def cross(self) -> F64:
        """The products of the causes' columns and the known errors (2, n − begin + 1, C, q)."""
        pairs = zip(self._columns(), self.stack.error_columns[self.begin :], strict=True)
        shape = (len(self._order), self.stack.error_columns[0].shape[1])
        return self._since_begin(2, (x.T @ k for x, k in pairs), shape)

    def _columns(self) -> Iterator[F64]:
        return (x[:, self._order] for x in self.stack.columns[self.begin :])

    def _since_begin(self, powers: int, products: Iterable[F64], shape: tuple[int, ...]) -> F64:
        return _cumulate(self._powers[:powers, self.begin :], products, shape)

    def sum_first(self, n: int) -> CheckSums:
        """Return the sums over the first *n* checks."""
        numbers = int(self.numbers[n])
        return CheckSums(self.error_gram[n], self.known_towards[n], float(self.square[n]), numbers)

    def drop_checks(self, left_out: Sequence[int], n: int, back: int) -> tuple[RunningSums, int]:
        """Return the sums over the first *n* checks without those *left_out*, and their first
        check.

        They serve changes that begin at one of the last *back* checks. Earlier checks are only in
        the totals, not in sums of their own.
        """
        # The origin of a growth is the check before its first one.
        begin = max(0, n - back - len(left_out) - 1)

        def dropped(values: F64, axis: int, kept_from: int) -> F64:
            sums = np.moveaxis(values, axis, 0)[begin - kept_from : n + 1 - kept_from]
            for place in sorted((i - begin for i in left_out), reverse=True):
                its = sums[place + 1] - sums[place]
                sums = np.concatenate([sums[: place + 1], sums[place + 2 :] - its])
            return np.moveaxis(sums, 0, axis)

        new = copy(self)
        new.stack, new.begin = (
            self.stack.select_checks([i for i in range(begin, n) if i not in left_out]),
            0,
        )
        new.error_gram, new.known_towards, new.square, new.numbers = (
            dropped(values_of_all, 0, 0)
            for values_of_all in (self.error_gram, self.known_towards, self.square, self.numbers)
        )
        new.cause_grams = [dropped(gram, 1, self.begin) for gram in self.cause_grams]
        new.towards, new.cross = (
            dropped(values_of_all, 1, self.begin) for values_of_all in (self.towards, self.cross)
        )
        return new, begin

    def sum_by_onset(self, first: I64, n: int, rotation: F64) -> Iterator[OnsetSums]:
        """Yield the sums of steps, then of growths, that begin at the checks *first* (T,), up to
        check *n*.

        A growth is zero at the check before its first one. *rotation* (q, q) rotates the known
        errors.
        """
        shape = (2, len(first), *self.cross.shape[2:])
        since, until = first - self.begin, n - self.begin
        turned = (self.cross[:, since].reshape(-1, shape[-1]) @ rotation.T).reshape(shape)
        cross = (self.cross[:, until] @ rotation.T)[:, None] - turned
        towards = self.towards[:, until, None] - self.towards[:, since]
        owns = [gram[:, until, None] - gram[:, since] for gram in self.cause_grams]
        yield OnsetSums(cross[0], towards[0], [gram[0] for gram in owns])
        a = (origin := self.compute_origins(first, n))[:, None]
        b = origin[:, None, None, None]
        yield OnsetSums(
            cross[1] - a[:, :, None] * cross[0],
            towards[1] - a * towards[0],
            [gram[2] - 2 * b * gram[1] + b**2 * gram[0] for gram in owns],
        )

    def compute_origins(self, first: I64, n: int) -> F64:
        """Return the origins (T,) of growths that first show at the checks *first* of *n*.

        They are in units of `RAMP_DAYS`.
        """
        days = self.stack.time_d[:n] / RAMP_DAYS
        before = np.concatenate(
            [[days[0] - find_usual_gap_d(self.stack.time_d[:n]) / RAMP_DAYS], days[:-1]]
        )
        return before[first]


def _cumulate(powers: F64, products: Iterable[F64], shape: tuple[int, ...]) -> F64:
    """Return the sums (powers, n + 1, *shape) of *products* times powers of time (powers, n).

    The *products* are n arrays of that shape.
    """
    sums = np.zeros((len(powers), powers.shape[1] + 1, *shape))
    for i, product in enumerate(products):
        for power, total in zip(powers[:, i], sums, strict=True):
            np.add(total[i], power * product, out=total[i + 1])
    return sums
