"""Interim checks by the simulator's physics, judged, against an oracle: `make interim`.

The oracle knows the cause, the place and the shape, and only has to see when; for corrected
measurements it knows the instant, too. It has the same checks and the same limit.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.special import logsumexp
from threadpoolctl import threadpool_limits

from armd.compensation.data.session import load_session
from armd.compensation.identify.calibrate import Options, calibrate
from armd.compensation.interim import evidence
from armd.compensation.interim.amend import amended, fit
from armd.compensation.interim.changes import Change, _growth, _origin_d, find
from armd.compensation.interim.columns import Cause, causes_of
from armd.compensation.interim.reach import placement_columns
from armd.compensation.interim.reduce import Reduced, reduce
from armd.compensation.interim.stack import DAY_S, Stack, Sums, stack
from armd.compensation.model.arm import Arm, load_arm
from armd.compensation.model.basis import basis_values, parameter_rows
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.kinematics import forward
from armd.compensation.model.state import States
from armd.simulator.campaigns import interim
from armd.simulator.campaigns.calibration import calibration as calibration_campaign
from armd.simulator.measuring import write_session
from armd.simulator.noise import Noise
from armd.simulator.plan import MOUNTED
from armd.simulator.plants.causes import CAUSES
from armd.simulator.plants.plant import Plant
from armd.simulator.truth import nominal
from armd.simulator.truth.conditions import Conditions

DAYS = 32
#: Onsets to draw from: with checks enough before to know the arm, and behind to see it.
ONSETS = (8, 20)
#: Sizes, in typical ones: small, as they come, large; each with a spread of ±30 %.
FACTORS = (0.1, 0.3, 1.0)
#: cause → joints it is planted at
SUDDEN: dict[str, tuple[int, ...]] = {
    "encoder_slip": (2, 3, 4, 5),
    "geometry_shift": (2, 3, 4, 5),
    "tip_offset": (0,),
    "encoder_eccentricity": (2, 3, 4, 5),
}
GROWING: dict[str, tuple[int, ...]] = {
    "geometry_shift": (2, 3, 4, 5),
    "joint_compliance": (2, 3),
    "joint_backlash": (2, 3, 4, 5),
    "tip_offset": (0,),
}
#: A name this sure or surer is held to be right.
SURE = 0.95
#: Measured again by each mended calibration.
MEASURED = 300


@dataclass(frozen=True)
class Case:
    """One history with one change."""

    seed: int
    plant: Plant
    day: float
    grows: bool
    artefact: str
    bad: tuple[tuple[interim.Bad, int], ...]

    @property
    def words(self) -> str:
        detail = " ".join(str(v) for v in self.plant.detail.values())
        grows = "+" if self.grows else ""
        return (
            f"{self.plant.cause} {self.plant.location} {detail} {self.plant.size:.2f}"
            f"@{self.day:g}{grows} on {self.artefact}"
        )


@dataclass(frozen=True)
class Outcome:
    """What became of a case."""

    case: Case
    early: bool  # an alarm before the onset
    delay: float  # checks from the onset to the alarm, inf: none
    oracle_delay: float
    found: bool
    inside: bool  # the onset inside the interval
    right: bool
    among: bool
    sure: bool
    shape_right: bool
    extra: int
    bad_right: bool
    error_um: float
    oracle_error_um: float
    uncorrected_um: float
    watched: int  # checks before the onset


def draw(seed: int, rng: np.random.Generator) -> Case:
    grows = bool(rng.uniform() < 0.4)
    table = GROWING if grows else SUDDEN
    cause = str(rng.choice(list(table)))
    joint = int(rng.choice(table[cause]))
    size = CAUSES[cause].typical * float(rng.choice(FACTORS)) * float(np.exp(rng.normal(0, 0.3)))
    detail: dict[str, float | str] = {}
    if cause == "geometry_shift":
        known = ["alpha", "d", "a", *(["theta"] if grows else [])]
        parameter = str(rng.choice(known))
        detail["parameter"] = parameter
        if parameter == "d":  # along parallel axes a shift of one joint is that of the other
            joint = int(rng.choice([4, 5]))
    location = "tip" if joint == 0 else f"joint {joint}"
    day = float(rng.integers(*ONSETS, endpoint=True))
    bad: tuple[tuple[interim.Bad, int], ...] = ()
    if rng.uniform() < 0.4:
        kind = interim.BAD[int(rng.integers(2))]
        bad = ((kind, int(rng.integers(3, DAYS - 3))),)
    artefact = str(rng.choice(list(interim.ARTEFACTS)))
    return Case(seed, Plant(cause, location, size, detail), day, grows, artefact, bad)


class Bench:
    """An arm of a seed, its arm.toml and its calibration."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.seed, self.folder = seed, folder
        folder.mkdir()
        path = folder / "arm.toml"
        path.write_text(nominal.arm_toml())
        self.arm: Arm = load_arm(path)
        campaign = calibration_campaign(seed, Noise())
        sessions = []
        for measured in campaign.carry_out(np.random.default_rng([seed, 0x5E55])):
            write_session(folder / measured.plan.name, measured)
            sessions.append(load_session(folder / measured.plan.name, self.arm))
        self.calibration: Calibration = calibrate(sessions, self.arm, Options()).calibration
        self.causes = causes_of(self.arm, self.calibration)

    def checks(self, history: interim.History, seed: int) -> Iterator[Reduced]:
        where = Path(tempfile.mkdtemp(dir=self.folder))
        for measured in interim.carry_out(history, self.seed, Noise(), seed):
            write_session(where / measured.plan.name, measured)
            session = load_session(where / measured.plan.name, self.arm)
            yield reduce(session, self.arm, self.calibration, self.causes)


def true_cause(case: Case, causes: list[Cause]) -> int:
    for k, cause in enumerate(causes):
        if cause.place != (case.plant.cause, case.plant.location):
            continue
        wanted = case.plant.detail.get("parameter")
        if wanted is None or cause.candidate.columns[0].name == wanted:
            return k
    raise AssertionError(case.words)


def run_case(case: Case, bench: Bench) -> Outcome:
    happening = interim.Happening(case.plant, case.day, case.grows)
    history = interim.History(DAYS, (happening,), case.bad, case.artefact)
    checks = list(bench.checks(history, case.seed))
    of, causes = stack(checks, bench.causes), bench.causes
    begun = interim.begins(happening, interim.use(DAYS, case.seed))
    first = int(np.ceil(begun)) - 1 + int(case.grows)  # the first check that has some of it
    found = find(of, causes)
    right = true_cause(case, causes)
    bad = [day - 1 for _, day in case.bad]
    oracle = _oracle_delay(of, causes, right, case.grows, first, bad)
    early = found.alarm is not None and found.alarm < first
    delay = np.inf if found.alarm is None or early else found.alarm - first + 1
    told = found.changes
    main = min(told, key=lambda c: abs(c.first - first)) if told else None
    instant = interim.instant(begun).timestamp()
    inside = named = among = sure = False
    if main is not None:
        inside = _inside(checks, of, main, instant)
        place = causes[right].place
        here = None if main.cause is None else causes[main.cause].place
        named = here == place
        among = named or any(causes[k].place == place for k, _ in main.rivals)
        sure = main.probability >= SURE
    errors = _errors(case, bench, checks, of, found.changes, found.bad, right, first, instant)
    return Outcome(
        case, early, delay, oracle, main is not None, inside, named, among, sure,
        main is not None and main.gradual == case.grows, max(len(told) - 1, 0),
        _bad_right(case, found.bad), *errors, min(first, DAYS),
    )  # fmt: skip


def _bad_right(case: Case, told: tuple[int, ...]) -> bool:
    """Whether no good check is called bad; a bad one may have done no harm."""
    return set(told) <= {day - 1 for _, day in case.bad}


def _inside(checks: list[Reduced], of: Stack, change: Change, instant: float) -> bool:
    from types import SimpleNamespace

    from armd.compensation.interim.judge import _between

    low, high = _between([SimpleNamespace(reduced=c) for c in checks], of, change)  # type: ignore[misc]
    return low <= instant <= high


def _oracle_delay(
    of: Stack, causes: list[Cause], right: int, grows: bool, first: int, bad: list[int]
) -> float:
    """The same statistic with the whole prior on the truth, bad checks left out by hand."""
    knowing = [
        replace(c, prior_sudden=float(k == right and not grows),
                prior_gradual=float(k == right and grows))
        for k, c in enumerate(causes)
    ]  # fmt: skip
    kept = [i for i in range(of.n) if i not in bad]
    sums = Sums(of.only(kept))
    for count in range(1, len(kept) + 1):
        if kept[count - 1] < first:
            continue
        weighed = evidence.weigh(sums, knowing, count, np.arange(count))
        if weighed.log_sum >= evidence.LIMIT:
            return kept[count - 1] - first + 1
    return float(np.inf)


def _errors(
    case: Case,
    bench: Bench,
    checks: list[Reduced],
    of: Stack,
    told: tuple[Change, ...],
    bad: tuple[int, ...],
    right: int,
    first: int,
    instant: float,
) -> tuple[float, float, float]:
    """µm RMS of measurements since the onset, corrected again: as told, by the oracle, and not."""
    if not told:
        return (np.nan,) * 3
    kept = [i for i in range(of.n) if i not in {day - 1 for _, day in case.bad}]
    nearest = min(kept, key=lambda i: abs(i - first))
    truth = Change(right, case.grows, nearest, nearest, nearest, np.nan, 1.0)
    if case.grows:
        origin = _origin_d(of, kept, kept.index(nearest))
        truth = _growth(of, bench.causes, replace(truth, origin_d=origin), kept, [nearest])
    begun = checks[0].mean_unix_s
    last = checks[-1].last_unix_s

    def mended(changes: tuple[Change, ...], instants: list[float], left_out: list[int]):
        amplitudes = fit(of, bench.causes, changes, left_out)
        return amended(
            bench.calibration, of, begun, bench.causes, changes, instants, amplitudes, last, {}
        )

    own = [
        begun + c.origin_d * DAY_S
        if c.gradual
        else (checks[max(c.first - 1, 0)].last_unix_s + checks[c.first].first_unix_s) / 2
        for c in told
    ]
    calibrations = (
        mended(told, own, list(bad)),
        mended((truth,), [instant], [day - 1 for _, day in case.bad]),
        bench.calibration,
    )
    rng = np.random.default_rng([case.seed, 0xE44])
    start = (instant - MOUNTED.timestamp()) / 86400.0
    end = (last - MOUNTED.timestamp()) / 86400.0
    days = rng.uniform(start, end, 12)
    squares = np.zeros(3)
    for day in days:
        squares += _measured(case, bench, day, calibrations, rng)
    return tuple(float(v) for v in 1e3 * np.sqrt(squares / len(days)))  # type: ignore[return-value]


def _measured(
    case: Case,
    bench: Bench,
    mounted_d: float,
    calibrations: tuple[Calibration, ...],
    rng: np.random.Generator,
) -> np.ndarray:
    """Mean square error (mm²) of measurements at one moment under each calibration, a rigid
    motion of all of them removed, which the base of an arm is known to only."""
    day = (mounted_d * 24.0 - interim.FIRST_H) / 24.0 + 1.0
    happening = interim.Happening(case.plant, case.day, case.grows)
    arm = interim.arm_at(bench.seed, (happening,), day, interim.use(DAYS, case.seed), case.seed)
    low, high = nominal.limits_rad()
    n = MEASURED // 12
    phi = rng.uniform(low, high, (n, len(low)))
    conditions = Conditions.at_rest(n, len(low))
    rate = 0.003 * rng.normal(size=phi.shape)
    conditions = replace(conditions, rate=rate)
    shown, tip = arm.encoder_angles(phi, conditions), arm.tip(phi, conditions)
    states = States(
        q=shown,
        rate=rate,
        temperature_c=np.full((n, len(bench.arm.sensors)), 20.0),
        time_s=np.full(n, MOUNTED.timestamp() + mounted_d * 86400.0),
        approach=conditions.approach,
        series=np.zeros(n, np.int64),
    )
    found = []
    for calibration in calibrations:
        constants = calibration.vector(bench.arm.n_joints)
        values = basis_values(
            calibration.terms, states, bench.arm, calibration.reference_temperature_c, constants
        )
        own = forward(states.q, parameter_rows(constants, calibration.terms, values))[0]
        off = (own - tip).reshape(-1)
        rigid = placement_columns(own).reshape(-1, 6)
        left = off - rigid @ np.linalg.lstsq(rigid, off, rcond=None)[0]
        found.append((left**2).sum() / n)
    return np.array(found)


def in_control(bench: Bench, seed: int, checks: int, draws: int) -> tuple[int, int]:
    """Alarms and checks watched, of *draws* histories of *checks* checks with poses of one month
    and noise drawn anew: the statistic alone, vectorised over the draws."""
    month = list(bench.checks(interim.History(24), seed))
    many = [
        replace(month[i % 24], mean_unix_s=month[0].mean_unix_s + DAY_S * i) for i in range(checks)
    ]
    of = stack(many, bench.causes)
    rng = np.random.default_rng([seed, 0x1C])
    known = rng.normal(size=(of.known[0].shape[1], draws))
    noise = [k @ known + rng.normal(size=(len(k), draws)) for k in of.known]
    sums = Sums(of)
    towards = [c.T @ z for c, z in zip(of.columns, noise, strict=True)]
    days = of.time_d / 30.0
    plain = np.cumsum(np.stack(towards), axis=0)
    timed = np.cumsum(np.stack([d * t for d, t in zip(days, towards, strict=True)]), axis=0)
    zero = np.zeros_like(plain[:1])
    plain, timed = np.concatenate([zero, plain]), np.concatenate([zero, timed])
    known_side = np.cumsum(
        np.stack([k.T @ z for k, z in zip(of.known, noise, strict=True)]), axis=0
    )
    square = np.cumsum(np.stack([(z**2).sum(axis=0) for z in noise]), axis=0)
    highest = np.full(draws, -np.inf)
    alive, watched, alarms = np.ones(draws, dtype=bool), 0, 0
    priors = np.log(
        np.maximum([[c.prior_sudden, c.prior_gradual] for c in bench.causes], 1e-300)
    ) - np.log(len(evidence.SIZES))
    for n in range(1, of.n + 1):
        first = np.arange(max(0, n - 64), n)
        factor = np.linalg.cholesky(sums.known[n])
        inverse = np.linalg.inv(factor)
        side = inverse @ known_side[n - 1]
        left = evidence.NOISE_WORD + square[n - 1] - (side**2).sum(axis=0)
        freedom = evidence.NOISE_WORD + float(sums.numbers[n])
        total = np.full(draws, -np.inf)
        for shape in (0, 1):
            cross, _, owns = sums.begun(first, n, ramp=shape == 1)
            cross = inverse @ cross
            if shape == 0:
                own_side = plain[n] - plain[first]
            else:
                origin = sums.origin(first)[:, None, None]
                own_side = timed[n] - timed[first] - origin * (plain[n] - plain[first])
            clear = own_side - np.einsum("tqc,qs->tcs", cross, side)
            for (members, at), own in zip(sums.groups, owns, strict=True):
                block = cross[:, :, at].transpose(0, 2, 3, 1)
                value, vector = np.linalg.eigh(own - block @ block.transpose(0, 1, 3, 2))
                value = np.maximum(value, 0.0)[..., None]
                along2 = (vector.swapaxes(-1, -2) @ clear[:, at]) ** 2
                for size in evidence.SIZES:
                    curvature = 1.0 + size**2 * value
                    quad = np.minimum((size**2 * along2 / curvature).sum(axis=2), 0.999 * left)
                    ratio = -0.5 * np.log(curvature).sum(axis=2)
                    ratio = ratio - 0.5 * freedom * np.log1p(-quad / left)
                    ratio = ratio + priors[members, shape][None, :, None]
                    total = np.logaddexp(total, logsumexp(ratio, axis=(0, 1)))
        watched += int(alive.sum())
        alarmed = alive & (total >= evidence.LIMIT)
        alarms += int(alarmed.sum())
        alive &= ~alarmed
        highest = np.maximum(highest, total)
    print("highest", np.round(np.sort(highest)[::-1][:12], 2), file=sys.stderr)
    return alarms, watched


def share(of: list[bool]) -> str:
    return f"{sum(of)} of {len(of)}" + (f" ({100 * np.mean(of):.0f} %)" if of else "")


def table(outcomes: list[Outcome], alarms: int, watched: int) -> str:
    found = [o for o in outcomes if o.found and not o.early]
    both = [o for o in outcomes if np.isfinite(o.oracle_delay) and not o.early]
    before = sum(o.watched for o in outcomes)
    early = sum(o.early for o in outcomes)
    errors = [o for o in found if np.isfinite(o.error_um)]
    ratio = (
        np.sqrt(np.mean([o.error_um**2 for o in errors]))
        / np.sqrt(np.mean([o.oracle_error_um**2 for o in errors]))
        if errors
        else np.nan
    )
    delays = np.array([o.delay for o in both])
    oracles = np.array([o.oracle_delay for o in both])
    missed = int(np.isinf(delays).sum())
    median, oracle = (float(np.median(d)) if len(d) else np.nan for d in (delays, oracles))
    wrong = [o.sure and not o.right for o in found]
    rms = [
        float(np.sqrt(np.mean([getattr(o, k) ** 2 for o in errors]))) if errors else np.nan
        for k in ("uncorrected_um", "error_um", "oracle_error_um")
    ]
    rows = [
        ("false alarms, noise drawn anew", f"{alarms} in {watched} checks", "1 in 300"),
        ("false alarms before an onset, simulated", f"{early} in {before} checks", "1 in 300"),
        ("changes that the oracle sees, told", f"{len(both) - missed} of {len(both)}", ""),
        ("median delay, checks", f"{median:.1f}, oracle {oracle:.1f}", "1.5 × the oracle's"),
        ("onset inside the interval", share([o.inside for o in found]), "90 %"),
        ("sudden or growing, right", share([o.shape_right for o in found]), ""),
        ("cause and place right", share([o.right for o in found]), ""),
        ("right, or among the alternatives", share([o.among for o in found]), ""),
        (f"wrong though {SURE:.2f} sure", share(wrong), "2 %"),
        ("changes told beyond the one planted", str(sum(o.extra for o in found)), ""),
        ("histories without a good check called bad", share([o.bad_right for o in outcomes]), ""),
        (
            "measurements since, µm RMS: uncorrected, corrected again, by the oracle",
            ", ".join(f"{v:.1f}" for v in rms) + f"; ratio {ratio:.2f}",
            "1.2",
        ),
    ]  # fmt: skip
    lines = ["| Figure | Measured | Mark |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--checks", type=int, default=150, help="of each history without a change")
    parser.add_argument("--draws", type=int, default=40, help="histories without a change")
    args = parser.parse_args()
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as name, threadpool_limits(limits=1):
        benches: dict[int, Bench] = {}
        for number in range(args.cases):
            rng = np.random.default_rng([args.seed, 0x1E7, number])
            own = number % 4  # a few arms: calibrating one takes as long as a history
            if own not in benches:
                benches[own] = Bench(100 * args.seed + own, Path(name) / f"arm-{own}")
            begun = time.monotonic()
            case = draw(1000 * args.seed + number, rng)
            o = run_case(case, benches[own])
            outcomes.append(o)
            print(
                f"{number:3} {case.words}: delay {o.delay:g}/{o.oracle_delay:g}"
                f"{' EARLY' * o.early} inside {o.inside:d} right {o.right:d} among {o.among:d} "
                f"sure {o.sure:d} shape {o.shape_right:d} extra {o.extra} bad {o.bad_right:d} "
                f"µm {o.uncorrected_um:.1f} → {o.error_um:.1f}/{o.oracle_error_um:.1f} "
                f"({time.monotonic() - begun:.0f} s)",
                file=sys.stderr, flush=True,
            )  # fmt: skip
        alarms = watched = 0
        if args.draws and benches:
            alarms, watched = in_control(benches[0], args.seed, args.checks, args.draws)
    print(table(outcomes, alarms, watched))
    return 0


if __name__ == "__main__":
    sys.exit(main())
