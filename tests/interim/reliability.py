"""Whether probabilities hold: changes drawn as `armd interim` expects them, told by it.

Causes, places, sizes, shapes and what is wrong all along come from its own priors, noise from the
calibration's word, and the poses from the simulator: here a probability that does not hold is an
error of the reckoning. What the priors themselves are worth, `make interim` shows.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from bench import Bench
from scipy.linalg import null_space
from threadpoolctl import threadpool_limits

from armd.arrays import F64
from armd.compensation.interim.changes.change import Change
from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.evidence.likelihood import SIZES
from armd.compensation.interim.evidence.stack import (
    ALL_ALONG,
    DAY_S,
    RAMP_DAYS,
    TRUST,
    join_checks,
)
from armd.compensation.interim.evidence.watch import detect_changes
from armd.compensation.interim.report import next_check
from armd.compensation.interim.report.judge import judge
from armd.compensation.interim.report.judgement import Epoch, Judgement
from armd.compensation.interim.report.possible_checks import (
    PossibleCheck,
    predict_check,
    select_rows,
)
from armd.simulator.campaigns import interim

#: Checks of a history, at which of them a change may begin, and how many more are waited for.
CHECKS, ONSETS, SETTLED = 18, (5, 10), 2
BINS = (0.0, 0.3, 0.5, 0.7, 0.9, 0.99, 1.0)


@dataclass(frozen=True)
class Pair:
    """What was foretold, a probability, and whether it came so."""

    what: str  # "cause", "wrong after the usual check", "wrong after the proposed check"
    probability: float
    came: bool


class Drawn:
    """An arm with one change, drawn."""

    def __init__(self, bench: Bench, month: Sequence[Reduced], rng: np.random.Generator) -> None:
        causes = bench.causes
        priors = np.array([[c.prior_sudden, c.prior_gradual] for c in causes]).ravel()
        self.cause, self._grows = divmod(int(rng.choice(len(priors), p=priors)), 2)
        self.place = causes[self.cause].place
        onset = int(rng.integers(*ONSETS, endpoint=True))
        self.first = onset
        self._begins, self._before = (month[i].mean_unix_s for i in (onset, onset - 1))
        counts = [len(cause.candidate.columns) for cause in causes]
        self._typical = np.array([c.prior_sd for cause in causes for c in cause.candidate.columns])
        self._block = slice(sum(counts[: self.cause]), sum(counts[: self.cause + 1]))
        self._size = float(rng.choice(SIZES)) * rng.normal(size=counts[self.cause])
        self._all_along = rng.choice(ALL_ALONG) * rng.normal(size=len(self._typical))
        self._known: dict[str, float] = {}
        self._rng = rng

    def measured(self, check: Reduced) -> Reduced:
        """A *check* in its poses, with numbers drawn."""
        columns = check.causes * self._typical
        known = [self._known.setdefault(n, self._rng.normal()) for n in check.known_names]
        residual = self._rng.normal(size=len(check.residual)) + TRUST * check.error_columns @ known
        residual += columns @ self._all_along
        residual += self._there(check.mean_unix_s) * columns[:, self._block] @ self._size
        return replace(check, residual=residual)

    def _there(self, unix_s: float) -> float:
        if unix_s < self._begins:
            return 0.0
        return (unix_s - self._before) / DAY_S / RAMP_DAYS if self._grows else 1.0


def told(
    bench: Bench, month: Sequence[Reduced], rng: np.random.Generator, proposed: bool
) -> list[Pair]:
    """What is told of one drawn change soon after its alarm; if *proposed*, of a doubtful one also
    after one more check, the usual or the proposed one."""
    drawn = Drawn(bench, month, rng)
    checks = [drawn.measured(check) for check in month]
    alarm = detect_changes(join_checks(checks, bench.causes), bench.causes).alarm
    if alarm is None or alarm < drawn.first or alarm + SETTLED + 1 >= len(checks):
        return []
    until = alarm + SETTLED + 1

    def judged(some: Sequence[Reduced]) -> Epoch:
        return judge(bench.kept(some)).latest

    def right(epoch: Epoch) -> bool:
        return _place(epoch) == drawn.place

    before = judged(checks[:until])
    change = _first(before)
    if change is None:
        return []
    found = [Pair("cause", change.probability, right(before))]
    advised = next_check.plan_next_check(Judgement((before,))).advised if proposed else None
    if advised is not None:
        at = checks[until - 1].mean_unix_s + DAY_S
        another = drawn.measured(_on_seats(bench, advised, at))
        after_usual = judged(checks[: until + 1])
        after_this = judged([*checks[:until], another])
        found += [
            Pair("wrong after the usual check", advised.after_usual, not right(after_usual)),
            Pair("wrong after the proposed check", advised.after_this, not right(after_this)),
        ]
    return found


def _first(epoch: Epoch) -> Change | None:
    return next((one.change for one in epoch.reported_changes if one.cause is not None), None)


def _place(epoch: Epoch) -> tuple[str, str] | None:
    return next((one.cause.place for one in epoch.reported_changes if one.cause is not None), None)


def _on_seats(bench: Bench, advised: next_check.AdvisedPoses, at_unix_s: float) -> Reduced:
    """The advised check, its seats projected out as any check's are."""
    count = len(advised.seats_mm)
    order = np.concatenate([np.arange(k, advised.states.n, count) for k in range(count)])
    states = advised.states.rows(order)
    states = replace(states, time_s=np.full(states.n, at_unix_s))
    whole = predict_check(
        PossibleCheck(advised.seats_mm, states), bench.arm, bench.calibration, bench.causes
    )
    clear: F64 = null_space(whole.targets.T)
    check = select_rows(whole, np.arange(clear.shape[1]))
    return replace(
        check,
        residual=np.zeros(clear.shape[1]),
        causes=clear.T @ whole.causes,
        error_columns=clear.T @ whole.error_columns,
        targets=clear.T @ whole.targets,
    )


def table(pairs: Sequence[Pair]) -> str:
    """Foretold against seen, by what it is of and how probable it was said to be."""
    lines = ["| Told | probability | times | expected | came |", "|---|---|---|---|---|"]
    for what in dict.fromkeys(pair.what for pair in pairs):
        own = [pair for pair in pairs if pair.what == what]
        for low, high in [*pairwise(BINS), (BINS[0], BINS[-1])]:
            here = [p for p in own if low <= p.probability and (p.probability < high or high == 1)]
            if not here:
                continue
            expected, spread = expectation(here)
            came = sum(pair.came for pair in here)
            lines.append(
                f"| {what} | {low:g} to {high:g} | {len(here)} | {expected:.1f} ± {spread:.1f} | "
                f"{came} |"
            )
    return "\n".join(lines)


def expectation(pairs: Sequence[Pair]) -> tuple[float, float]:
    """How many of *pairs* come if their probabilities hold, and the standard deviation of that."""
    p = np.array([min(pair.probability, 1.0) for pair in pairs])
    return float(p.sum()), float(np.sqrt((p * (1 - p)).sum()))


def months(bench: Bench, seed: int) -> list[list[Reduced]]:
    """Checks on every artefact, for their poses."""
    return [
        list(bench.checks(interim.CheckSeries(CHECKS, artefact=artefact), 10 * seed + k))
        for k, artefact in enumerate(interim.ARTEFACTS)
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--changes", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    args = parser.parse_args()
    next_check.MOST_REMAINING_RISK = np.inf  # whether it is worth proposing or not
    pairs: list[Pair] = []
    with tempfile.TemporaryDirectory() as name, threadpool_limits(limits=1):
        bench = Bench(args.seed, Path(name) / "arm")
        every = months(bench, args.seed)
        for number in range(args.changes):
            rng = np.random.default_rng([args.seed, 0x2E1, number])
            pairs += told(bench, every[number % len(every)], rng, proposed=True)
            print(f"{number}: {pairs[-3:]}", file=sys.stderr, flush=True)
            if number % 10 == 9:
                print(table(pairs), file=sys.stderr, flush=True)
    print(table(pairs))
    return 0


if __name__ == "__main__":
    sys.exit(main())
