"""What came of the cases of a Monte Carlo: a line for each, and the table of marks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import drifts
import numpy as np
import strangers
from cases import NOISES
from drifts import Drifted
from messy import MessOutcome, tell_mess
from strangers import Strange

BINS = ((0.0, 3.0), (3.0, 5.0), (5.0, 8.0), (8.0, 12.0), (12.0, np.inf))


@dataclass(frozen=True)
class Outcome:
    """What of a judged case the table needs; small enough to pass between processes."""

    kind: str
    seed: int
    truths: tuple[tuple[str, str, float], ...]
    snr: tuple[float, ...]
    named: tuple[bool, ...]
    among: tuple[bool, ...]
    places: tuple[tuple[str, str], ...]
    false_causes: int
    unknown: tuple[tuple[str, ...], ...]
    variables: tuple[str, ...]
    errors: tuple[float, ...]
    before_um: float
    after_um: float
    oracle_um: float
    p_values: tuple[float, ...]  # family-wise, of each finding, and of the strongest left out
    seconds: float


@dataclass(frozen=True)
class Asked:
    """What came of a case measured so that it may be in doubt."""

    kind: str
    seed: int
    reason: str
    truth: tuple[str, str, float]
    found: tuple[tuple[str, str, float], ...]  # with probabilities, at first
    doubt: str  # "": these data leave none
    proposal: str
    after: tuple[tuple[str, str, float], ...]  # with the next experiment
    resolved: bool
    seconds: float


Case = Outcome | Asked | Drifted | MessOutcome | Strange


def tell_asked(asked: Asked) -> str:
    def said(found: Sequence[tuple[str, str, float]]) -> str:
        return "; ".join(f"{c} {where} {p:.2f}" for c, where, p in found) or "silence"

    cause, where, size = asked.truth
    head = f"{asked.kind} {asked.seed}: {asked.reason}, {cause} {where} {size:.3g}"
    if not asked.doubt:
        return f"   {head} → {said(asked.found)}; not in doubt, {asked.seconds:.1f} s"
    return (
        f"{'ok ' if asked.resolved else '-- '}{head} → {said(asked.found)}; {asked.doubt}: "
        f"{asked.proposal} → {said(asked.after)}; {asked.seconds:.1f} s"
    )


def tell(outcome: Case) -> str:
    if isinstance(outcome, Drifted):
        return drifts.tell(outcome)
    if isinstance(outcome, MessOutcome):
        return tell_mess(outcome)
    if isinstance(outcome, Strange):
        return strangers.tell(outcome)
    if isinstance(outcome, Asked):
        return tell_asked(outcome)
    truths = " + ".join(f"{c} {where} {size:.3g}" for c, where, size in outcome.truths) or "clean"
    snr = ", ".join(f"{value:.1f}" for value in outcome.snr)
    found = "; ".join(f"{c} {where}" for c, where in outcome.places) or "silence"
    good = all(outcome.named) and outcome.false_causes == 0
    if outcome.kind == "unknown":
        good = bool(outcome.unknown)
    elif not outcome.truths:
        good = not outcome.places
    return (
        f"{'ok ' if good else '-- '}{outcome.kind} {outcome.seed}: {truths} [SNR {snr}] → {found}; "
        f"{outcome.before_um:.2f} → {outcome.after_um:.2f} (oracle {outcome.oracle_um:.2f}) µm, "
        f"{outcome.seconds:.1f} s"
    )


def share(values: Sequence[bool]) -> str:
    return f"{np.mean(values):.3f} of {len(values)}" if len(values) else "no case"


def table(everything: Sequence[Case]) -> None:
    """Print the marks of the diagnosis beside what was reached."""
    outcomes = [o for o in everything if isinstance(o, Outcome)]
    asked = [o for o in everything if isinstance(o, Asked)]
    singles = [o for o in outcomes if o.kind == "single"]
    # Outliers have no signature, so no projected norm: they stand in a line of their own.
    signed = [o for o in singles if o.truths[0][0] != "outliers"]
    row = "{:52s} {:>18s}   {}"
    print(row.format("", "reached", "mark"))
    marks = {5.0: "0.75", 8.0: "0.95", 12.0: "0.95"}
    for low, high in BINS:
        inside = [o for o in signed if low <= o.snr[0] < high]
        label = f"SNR {low:g}–{high:g}"
        print(
            row.format(f"{label}: exactly named and located", share([o.named[0] for o in inside]),
                       marks.get(low, ""))
        )  # fmt: skip
        print(
            row.format(f"{label}: in finding or alternatives", share([o.among[0] for o in inside]),
                       "0.98" if low >= 8 else "")
        )  # fmt: skip
    lonely = [o.named[0] for o in singles if o.truths[0][0] == "outliers"]
    print(row.format("outliers found", share(lonely), ""))
    for noise in NOISES:
        clean = [bool(o.places) for o in outcomes if o.kind == noise]
        print(row.format(f"false alarms, clean, {noise}", share(clean), "at most 0.02"))
    strong = [o for o in singles if o.snr[0] > 5.0]
    print(row.format("gain, share of the oracle's, pooled", _gain(strong), "0.95"))
    worse = [o.after_um > o.before_um * 1.002 for o in outcomes if o.places]
    print(row.format("extended models worse than before", share(worse), "at most 0.01"))
    covered = [abs(error) < 1.96 for o in outcomes for error in o.errors]
    print(row.format("95 % intervals that hold the truth", share(covered), "0.93–0.97"))
    pairs = [o for o in outcomes if o.kind == "pair"]
    recall = [named for o in pairs for named, snr in zip(o.named, o.snr, strict=True) if snr > 8]
    print(row.format("two or three at once: recall above SNR 8", share(recall), "0.95"))
    false = np.mean([o.false_causes for o in pairs]) if pairs else np.nan
    print(row.format("two or three at once: false causes per set", f"{false:.3f}", "at most 0.1"))
    false = np.mean([o.false_causes for o in singles]) if singles else np.nan
    print(row.format("one: false causes per set", f"{false:.3f}", ""))
    bent = [o for o in outcomes if o.kind == "distorted" and o.snr[0] > 8]
    print(
        row.format("shape 30 % off: first name right above SNR 8",
                   share([o.places[:1] == (o.truths[0][:2],) for o in bent]), "0.90")
    )  # fmt: skip
    false = np.mean([o.false_causes for o in bent]) if bent else np.nan
    print(row.format("shape 30 % off: false causes per set", f"{false:.3f}", ""))
    foreign = [o for o in outcomes if o.kind == "unknown" and o.snr[0] > 15]
    print(
        row.format("outside the catalogue: flagged above SNR 15",
                   share([bool(o.unknown) for o in foreign]), "0.85")
    )  # fmt: skip
    print(
        row.format("outside the catalogue: right variables",
                   share([_right(o) for o in foreign if o.unknown]), "0.90")
    )  # fmt: skip
    in_doubt = [o.resolved for o in asked if o.doubt]
    resolved = f"{sum(in_doubt)} of {len(in_doubt)}" if in_doubt else "no case"
    print(row.format("next experiment: ambiguities resolved", resolved, "0.80"))
    print(row.format("cases for it that were not in doubt", str(len(asked) - len(in_doubt)), ""))
    for line in drifts.rows([o for o in everything if isinstance(o, Drifted)]):
        print(row.format(*line))
    for line in strangers.rows([o for o in everything if isinstance(o, Strange)]):
        print(row.format(*line))
    seconds = f"{np.median([o.seconds for o in outcomes]):.1f}" if outcomes else "no case"
    print(row.format("seconds per diagnosis, median", seconds, "10"))


def _gain(outcomes: Sequence[Outcome]) -> str:
    reached = sum(o.before_um**2 - o.after_um**2 for o in outcomes)
    possible = sum(o.before_um**2 - o.oracle_um**2 for o in outcomes)
    return f"{reached / possible:.3f} of {len(outcomes)}" if possible > 0 else "no case"


def _right(outcome: Outcome) -> bool:
    """The first unknown finding names at least one true variable, and only such."""
    return any(set(found) <= set(outcome.variables) for found in outcome.unknown)
