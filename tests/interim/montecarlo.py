"""Interim checks by the simulator's physics, judged, against an oracle: `make interim`.

The oracle knows the cause, the place and the shape, and only has to see when; for corrected
measurements it knows the instant, too. It has the same checks and the same limit.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from bench import Bench
from drawn_changes import DAYS, Case, draw, true_cause
from oracle import oracle_delay
from outcomes import SURE, Asked, Outcome, by_advice, by_kind, reliability, table
from remeasured import as_told, by_the_oracle, errors_um
from run_length import alarms_and_watched, noise_alone
from threadpoolctl import threadpool_limits
from whole_path import whole_path

from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.evidence import likelihood
from armd.compensation.interim.report.judge import judge
from armd.compensation.interim.report.judgement import Epoch, Judgement
from armd.compensation.interim.report.next_check import AdvisedPoses, plan_next_check
from armd.simulator.campaigns import interim

#: Of each history without a change that is measured and added.
PATH_CHECKS = 100
#: So many checks after the one that told a change, what is advised then is tried.
SETTLED = 2


def run_case(case: Case, bench: Bench) -> Outcome:
    checks = list(bench.checks(case.history, case.seed))
    epoch = _judged(bench, checks)
    of, causes, found, told = epoch.stack, epoch.causes, epoch.detected, epoch.reported_changes
    begun = interim.find_first_day(case.happening, case.used)
    first = int(np.ceil(begun)) - 1 + int(case.grows)  # the first check that has some of it
    right = true_cause(case, causes)
    oracle = oracle_delay(of, causes, right, case.grows, first, case.bad_checks)
    early = found.alarm is not None and found.alarm < first
    delay = np.inf if found.alarm is None or early else found.alarm - first + 1
    main = min(told, key=lambda one: abs(one.change.first - first)) if told else None
    onset = interim.find_instant(begun).timestamp()
    inside = named = among = sure = False
    errors, asked = (np.nan,) * 5, None
    place = causes[right].place
    if main is not None:
        low, high = main.between_unix_s
        inside = low <= onset <= high
        named = main.cause is not None and main.cause.place == place
        among = named or any(rival.place == place for rival, _ in main.rivals)
        sure = main.change.probability >= SURE
        errors = _errors(case, bench, epoch, right, first, onset)
        if not early:
            asked = _asked(case, bench, checks, place, found.alarm)
    return Outcome(
        case, early, delay, oracle, main is not None, inside, named, among, sure,
        main is not None and main.change.gradual == case.grows, max(len(told) - 1, 0),
        set(found.bad) <= set(case.bad_checks),  # a bad one may have done no harm
        *errors, min(first, DAYS), asked,
    )  # fmt: skip


def _judged(bench: Bench, checks: Sequence[Reduced]) -> Epoch:
    return judge(bench.kept(checks)).latest


def _advised(epoch: Epoch) -> AdvisedPoses | None:
    return plan_next_check(Judgement((epoch,))).advised


def _errors(
    case: Case, bench: Bench, epoch: Epoch, right: int, first: int, onset: float
) -> tuple[float, ...]:
    """µm RMS of measurements since the onset: corrected again as told, by the oracle, and not
    corrected; what the first calibration states; and corrected as told after an advised check."""
    checks = [check.reduced for check in epoch.checks]
    calibrations = [
        as_told(bench, epoch),
        by_the_oracle(case, bench, epoch, right, first, onset),
        bench.calibration,
    ]
    advised = _advised(epoch)
    if advised is not None:
        more = bench.advised(case, DAYS, advised.seats_mm, advised.states.q)
        calibrations.append(as_told(bench, _judged(bench, [*checks, more])))
    errors, stated = errors_um(case, bench, onset, checks[-1].last_unix_s, calibrations)
    return *errors[:3], stated, errors[-1] if advised is not None else errors[0]


def _asked(
    case: Case, bench: Bench, checks: Sequence[Reduced], place: tuple[str, str], alarm: int | None
) -> Asked | None:
    """Soon after the alarm: the usual check of the next day, or the advised one on that day."""
    day = (alarm or 0) + 1 + SETTLED  # days, as checks do, count from 1
    if alarm is None or day >= DAYS or day in case.bad_checks:
        return None
    before = _judged(bench, checks[:day])
    advised = _advised(before)
    if advised is None:
        return None
    more = bench.advised(case, day + 1, advised.seats_mm, advised.states.q)
    said = [
        _probability(epoch, place)
        for epoch in (
            before,
            _judged(bench, checks[: day + 1]),
            _judged(bench, [*checks[:day], more]),
        )
    ]
    return Asked(*said, advised.now, advised.after_usual, advised.after_this)


def _probability(epoch: Epoch, place: tuple[str, str]) -> tuple[float, bool]:
    """Of the cause at *place*, of the change told first; and whether that is its name."""
    if not epoch.reported_changes or epoch.reported_changes[0].cause is None:
        return 0.0, False
    told = epoch.reported_changes[0]
    every = [(told.cause, told.change.probability), *told.rivals]
    share = sum(p for cause, p in every if cause.place == place)
    return share, told.cause.place == place


def in_control(bench: Bench, seed: int, checks: int, draws: int) -> tuple[int, int]:
    """Alarms and checks watched, of *draws* histories of *checks* checks without a change."""
    statistics = noise_alone(list(bench.checks(interim.CheckSeries(24), seed)), bench.causes,
                             checks, draws, seed)  # fmt: skip
    return alarms_and_watched(statistics, likelihood.LIMIT)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--checks", type=int, default=150, help="of each history without a change")
    parser.add_argument("--draws", type=int, default=40, help="histories without a change")
    parser.add_argument("--histories", type=int, default=6, help="of them by the whole path")
    args = parser.parse_args()
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as name, threadpool_limits(limits=1):
        benches: dict[int, Bench] = {}
        for number in range(args.cases):
            rng = np.random.default_rng([args.seed, 0x1E7, number])
            own = number % 4  # a few arms: calibrating one takes as long as a history
            if own not in benches:
                benches[own] = Bench(100 * args.seed + own, Path(name) / f"arm-{own}")
            begun = time.process_time()
            case = draw(1000 * args.seed + number, rng)
            o = run_case(case, benches[own])
            outcomes.append(o)
            print(f"{number:3} {o.words} ({time.process_time() - begun:.0f} s)",
                  file=sys.stderr, flush=True)  # fmt: skip
        own_benches = list(benches.values())
        simulated, measured = (0, 0), (0, 0, 0)
        if args.draws and benches:
            simulated = in_control(own_benches[0], args.seed, args.checks, args.draws)
        if args.histories and benches:
            measured = whole_path(own_benches, args.seed, PATH_CHECKS, args.histories)
    print(table(outcomes, simulated, measured))
    print()
    print(by_kind(outcomes))
    print()
    print(by_advice(outcomes))
    print()
    print(reliability(outcomes))
    return 0


if __name__ == "__main__":
    sys.exit(main())
