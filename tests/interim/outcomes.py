"""What became of histories with one change each, and the tables of it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from drawn_changes import Case
from whole_path import interval

from armd.simulator.plants.causes import CAUSES

#: How a table names sizes, by their share of the typical one.
SIZE_CLASSES = (("a tenth", 0.18), ("a third", 0.55), ("the typical size", np.inf))
#: A cause less likely than this is not among the alternatives: it counts as so likely.
NAMED = 0.01
#: A correction whose error is at most so many times the oracle's is as good.
MOST_RATIO = 1.2
#: Chances to be wrong are told apart at these.
CHANCES = (0.0, 0.1, 0.3, 1.0)
#: A name this sure or surer is held to be right.
SURE = 0.95


@dataclass(frozen=True)
class Asked:
    """A doubtful cause, and what one more check says of it: the usual one, or the advised one.

    Each pair: the probability of the true cause, and whether it is the likeliest.
    """

    before: tuple[float, bool]
    usual: tuple[float, bool]
    advised: tuple[float, bool]
    wrong_now: float  # the chance of it, as told
    foretold_usual: float  # … after it, as foretold
    foretold_advised: float


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
    stated_um: float  # what the calibration states of the first of these
    advised_um: float  # corrected again after the check that was advised, if one was
    watched: int  # checks before the onset
    asked: Asked | None  # of the check that was advised, early on

    @property
    def words(self) -> str:
        text = (
            f"{self.case.words}: delay {self.delay:g}/{self.oracle_delay:g}{' EARLY' * self.early} "
            f"inside {self.inside:d} right {self.right:d} among {self.among:d} sure {self.sure:d} "
            f"shape {self.shape_right:d} extra {self.extra} bad {self.bad_right:d} "
            f"µm {self.uncorrected_um:.1f} → {self.error_um:.1f}/{self.oracle_error_um:.1f} "
            f"stated {self.stated_um:.1f} advised {self.advised_um:.1f}"
        )
        if self.asked is None:
            return text
        before, usual, advised = self.asked.before, self.asked.usual, self.asked.advised
        return f"{text}; p {before[0]:.2f}, usual {usual[0]:.2f}, advised {advised[0]:.2f}"


def share(of: list[bool]) -> str:
    return f"{sum(of)} of {len(of)}" + (f" ({100 * np.mean(of):.0f} %)" if of else "")


def _interval(alarms: int, watched: int) -> str:
    if not watched:
        return ""
    often, seldom = interval(alarms, watched)
    return f" (95 %: 1 in {often:.0f} to 1 in {seldom:.0f})"


def table(
    outcomes: list[Outcome], simulated: tuple[int, int], measured: tuple[int, int, int]
) -> str:
    found = [o for o in outcomes if o.found and not o.early]
    both = [o for o in outcomes if np.isfinite(o.oracle_delay) and not o.early]
    before = sum(o.watched for o in outcomes)
    early = sum(o.early for o in outcomes)
    errors = [o for o in found if np.isfinite(o.error_um)]
    delays = np.array([o.delay for o in both])
    oracles = np.array([o.oracle_delay for o in both])
    missed = int(np.isinf(delays).sum())
    median, oracle = (float(np.median(d)) if len(d) else np.nan for d in (delays, oracles))
    wrong = [o.sure and not o.right for o in found]
    rms = [
        float(np.sqrt(np.mean([getattr(o, k) ** 2 for o in errors]))) if errors else np.nan
        for k in ("uncorrected_um", "error_um", "oracle_error_um", "stated_um", "advised_um")
    ]
    rows = [
        ("false alarms, the statistic alone, noise drawn anew",
         f"{simulated[0]} in {simulated[1]} checks", "1 in 300"),
        ("false alarms without a change, the whole path",
         f"{measured[0]} in {measured[1]} checks{_interval(*measured[:2])}", "1 in 300"),
        ("good checks called bad there", str(measured[2]), ""),
        ("false alarms before an onset", f"{early} in {before} checks", "1 in 300"),
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
            ", ".join(f"{v:.1f}" for v in rms[:3]) + f"; ratio {rms[1] / rms[2]:.2f}",
            "1.2",
        ),
        *(("the same, " + what, said, "") for what, said in one_by_one(errors)),
        ("what the corrected calibration states of that, µm RMS", f"{rms[3]:.1f}", ""),
        (
            "the same with the advised check where one is advised at the end, µm RMS",
            f"{rms[4]:.1f}; ratio {rms[4] / rms[2]:.2f}",
            "1.2",
        ),
    ]  # fmt: skip
    lines = ["| Figure | Measured | Mark |", "|---|---|---|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)])


def one_by_one(told: list[Outcome]) -> list[tuple[str, str]]:
    """Errors of corrected measurements against the oracle's, history by history: an RMS over all of
    them is that of a few."""
    errors, oracles = (np.array([getattr(o, k) for o in told]) for k in
                       ("error_um", "oracle_error_um"))  # fmt: skip
    if not len(errors):
        return []
    ratio = errors / oracles
    found = [
        ("history by history: median ratio", f"{np.median(ratio):.2f}"),
        (f"histories within {MOST_RATIO} of the oracle", share(list(ratio <= MOST_RATIO))),
        ("histories made worse than uncorrected",
         share([o.error_um > o.uncorrected_um for o in told])),
    ]  # fmt: skip
    worst = int(np.argmax(errors**2 - oracles**2))
    left = np.arange(len(errors)) != worst
    if left.any():
        ratio_left = np.sqrt((errors[left] ** 2).sum() / (oracles[left] ** 2).sum())
        found.append((f"ratio without the worst ({told[worst].case.words})", f"{ratio_left:.2f}"))
    for artefact in sorted({o.case.artefact for o in told}):
        own = np.array([o.case.artefact == artefact for o in told])
        of_it = np.sqrt((errors[own] ** 2).sum() / (oracles[own] ** 2).sum())
        found.append((f"ratio on {artefact}, of {own.sum()}", f"{of_it:.2f}"))
    return found


def by_kind(outcomes: list[Outcome]) -> str:
    """The same per cause and shape, and per size; of the changes told."""
    kinds: dict[str, list[Outcome]] = {}
    for o in outcomes:
        shape = "growing" if o.case.grows else "sudden"
        typical = CAUSES[o.case.plant.cause].typical
        share = abs(o.case.plant.size) / typical
        size = next(name for name, most in SIZE_CLASSES if share < most)
        kinds.setdefault(f"{o.case.plant.cause.replace('_', ' ')}, {shape}", []).append(o)
        kinds.setdefault(f"all of {size}", []).append(o)
    head = "told, of those the oracle sees", "delay, oracle", "inside", "shape", "cause", "among"
    lines = [f"| Change | {' | '.join(head)} | wrong though sure |", f"|---|{'---|' * 7}"]
    for kind, own in sorted(kinds.items(), key=lambda pair: ("all of" in pair[0], pair[0])):
        both = [o for o in own if np.isfinite(o.oracle_delay) and not o.early]
        told = [o for o in own if o.found and not o.early]
        cells = [f"{sum(np.isfinite(o.delay) for o in both)} of {len(both)}"]
        delays = [np.median([getattr(o, k) for o in both] or [np.nan])
                  for k in ("delay", "oracle_delay")]  # fmt: skip
        cells.append(", ".join(f"{d:.1f}" for d in delays))
        cells += [str(sum(getattr(o, k) for o in told))
                  for k in ("inside", "shape_right", "right", "among")]  # fmt: skip
        cells.append(str(sum(o.sure and not o.right for o in told)))
        lines.append(f"| {kind} | {' | '.join(cells)} |")
    return "\n".join(lines)


def by_advice(outcomes: list[Outcome]) -> str:
    """What the advised check is worth, beside one more usual one, where a cause was in doubt."""
    asked = [o.asked for o in outcomes if o.asked is not None]
    lines = [
        f"| Of {len(asked)} doubtful causes | before | after the usual check | after the advised |",
        "|---|---|---|---|",
    ]
    if not asked:
        return "\n".join(lines)
    each = [[getattr(one, name) for one in asked] for name in ("before", "usual", "advised")]
    bits = [-np.mean([np.log2(max(p, NAMED)) for p, _ in column]) for column in each]
    right = [sum(named for _, named in column) for column in each]
    foretold = [
        np.mean([getattr(one, name) for one in asked])
        for name in ("foretold_usual", "foretold_advised")
    ]
    mean = [np.mean([p for p, _ in column]) for column in each]
    lines += [
        f"| probability of the true cause, mean | {' | '.join(f'{v:.2f}' for v in mean)} |",
        f"| bits that the true cause lacks, mean | {' | '.join(f'{v:.2f}' for v in bits)} |",
        f"| likeliest cause right | {' | '.join(str(v) for v in right)} |",
        f"| chance to be wrong, as foretold, mean | | {foretold[0]:.2f} | {foretold[1]:.2f} |",
    ]
    return "\n".join(lines)


def reliability(outcomes: list[Outcome]) -> str:
    """Chances to be wrong as foretold, against how often the likeliest cause was wrong."""
    asked = [o.asked for o in outcomes if o.asked is not None]
    pairs = {
        "now": [(one.wrong_now, one.before[1]) for one in asked],
        "after the usual check": [(one.foretold_usual, one.usual[1]) for one in asked],
        "after the advised check": [(one.foretold_advised, one.advised[1]) for one in asked],
    }
    lines = [
        "| Chance to be wrong | foretold | causes | wrong | expected |",
        "|---|---|---|---|---|",
    ]
    for when, own in pairs.items():
        for low, high in [*pairwise(CHANCES), (CHANCES[0], CHANCES[-1])]:
            here = [(chance, right) for chance, right in own if low <= chance < high]
            chances = np.array([chance for chance, _ in here])
            wrong = sum(not right for _, right in here)
            spread = float(np.sqrt((chances * (1.0 - chances)).sum()))
            lines.append(
                f"| {when} | {low:g} to {high:g} | {len(here)} | {wrong} | "
                f"{chances.sum():.1f} ± {spread:.1f} |"
            )
    return "\n".join(lines)
