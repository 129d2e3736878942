"""Whether what a revision reported of a case is right, and how two revisions differ.

A finding is its cause's *own* name (the planted cause at its place, or a name just as true), *near*
(at the place, in one of the cause's variables; `unknown` in its variables; a name that these
readings cannot separate from it), *neutral* (true of how it was measured), or *foreign*. A cause is
*due* from 8 noise units on, clear of all that absorbs it.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from hidden.frozen.case import Cause, Truth
from hidden.frozen.run import Ran

SURE, WORSE = 0.95, 1.02
#: A gain is counted where the model under test errs by so much more than the oracle: the RMS of
#: eighty readings is itself known to 5 %.
WORTH = 1.1
#: Of fewer cases no interval is printed.
FEW = 8
Finding = Mapping[str, Any]


@dataclass(frozen=True)
class Score:
    """One case under one revision."""

    due: int
    named: int  # of the due
    first: bool  # the first finding is the name of a due cause
    foreign: int
    sure_and_wrong: bool
    clean: bool  # nothing was planted
    worse: bool
    gain: tuple[float, float] | None  # before² − after² and before² − oracle², µm²
    seconds: float
    diagnose_s: float
    failed: bool
    answer: str  # in one line; equal lines are equal answers


def score(truth: Truth, ran: Ran) -> Score:
    rightly_refused = bool(truth.refusable) and truth.refusable in ran.refused and not ran.failed
    relations = [find_relation(truth, finding) for finding in ran.findings]
    foreign = [
        finding
        for finding, relation in zip(ran.findings, relations, strict=True)
        if relation == "foreign" and truth.count_foreign
    ]
    due = [cause for cause in truth.causes if cause.due]
    named = [any(is_name(cause, f) for f in ran.findings) for cause in due]
    first = bool(ran.findings) and any(is_name(cause, ran.findings[0]) for cause in due)
    return Score(
        0 if rightly_refused else len(due),
        sum(named),
        first,
        len(foreign),
        any(finding["probability"] >= SURE for finding in foreign),
        not truth.causes and truth.count_foreign,
        _is_worse(ran),
        _gain(truth, ran),
        ran.seconds,
        ran.diagnose_s,
        bool(ran.refused) and not rightly_refused,
        _in_words(ran),
    )


def _is_worse(ran: Ran) -> bool:
    if ran.before_um is None or ran.after_um is None:
        return False
    return ran.after_um > WORSE * ran.before_um


def _gain(truth: Truth, ran: Ran) -> tuple[float, float] | None:
    """Of cases that have something to gain."""
    if ran.before_um is None or ran.after_um is None or truth.oracle_um is None:
        return None
    if not any(cause.due for cause in truth.causes) or ran.before_um < WORTH * truth.oracle_um:
        return None
    before = ran.before_um
    return before - ran.after_um, before - truth.oracle_um


def _in_words(ran: Ran) -> str:
    if ran.refused:
        return "refused: " + " ".join(ran.refused.split())[:160]
    found = "; ".join(
        f"{f['cause']} {_where(f)} {f['probability']:.2f}" for f in ran.findings
    )  # fmt: skip
    return f"{found or 'nothing'}, {ran.before_um:.2f} → {ran.after_um:.2f} µm"


def _where(finding: Finding) -> str:
    if finding["cause"] == "unknown":
        return "in " + ", ".join(finding["depends_on"])
    return str(finding["location"])


def find_relation(truth: Truth, finding: Finding) -> str:
    if any(is_name(cause, finding) for cause in truth.causes):
        return "own"
    if _is_neutral(truth, finding):
        return "neutral"
    return "near" if any(_is_near(cause, finding) for cause in truth.causes) else "foreign"


def is_name(cause: Cause, finding: Finding) -> bool:
    name = (finding["cause"], finding["location"])
    if name in cause.names:
        return True
    if name != (cause.cause, cause.location):
        return False
    if cause.placement:
        return f"{finding.get('session')} {finding.get('placement')}" == cause.placement
    return not cause.needs or cause.needs in finding["depends_on"]


def _is_neutral(truth: Truth, finding: Finding) -> bool:
    if finding["cause"] == "unknown":
        depends_on = set(finding["depends_on"])
        return bool(depends_on) and depends_on <= set(truth.neutral_variables)
    return (finding["cause"], finding["location"]) in truth.neutral


def _is_near(cause: Cause, finding: Finding) -> bool:
    if (finding["cause"], finding["location"]) in cause.same_signal:
        return True
    depends_on = set(finding["depends_on"])
    shared = depends_on & set(cause.variables)
    if finding["cause"] == "unknown":
        return bool(shared) and depends_on <= set(cause.variables)
    return bool(shared) and _place(finding["location"]) == _place(cause.location)


def _place(location: str) -> str:
    """Joint 3, link 3 and sensor t3 are one place; of two sensors it is both numbers."""
    return " ".join(re.findall(r"\d+", location)) or location


@dataclass(frozen=True)
class Line:
    """A row of the table: a figure before and after, and what the difference may be (95 %)."""

    name: str
    before: str
    after: str
    interval: str


def compare(pairs: Sequence[tuple[Score, Score]], rng: np.random.Generator) -> list[Line]:
    """Figures of a kind, paired by case."""
    clean = [pair for pair in pairs if pair[0].clean]
    due = [pair for pair in pairs if pair[0].due or pair[1].due]
    lines = [
        _share("named and located", due, lambda s: s.named, lambda s: s.due, rng),
        _share("named first", due, lambda s: s.first, lambda s: 1, rng),
        _share("false alarms, clean", clean, lambda s: s.foreign > 0, lambda s: 1, rng),
        _share("foreign findings", pairs, lambda s: s.foreign, lambda s: 1, rng),
        _share("wrong with P over 0.95", pairs, lambda s: s.sure_and_wrong, lambda s: 1, rng),
        _share("written models worse", pairs, lambda s: s.worse, lambda s: 1, rng),
        _share("failed", pairs, lambda s: s.failed, lambda s: 1, rng),
    ]
    gained = [(a, b) for a, b in pairs if a.gain is not None and b.gain is not None]
    lines.append(
        _share("gain, of the oracle's", gained, lambda s: s.gain[0] if s.gain else 0.0,
               lambda s: s.gain[1] if s.gain else 0.0, rng)
    )  # fmt: skip
    lines.append(_share("processor s a case", pairs, lambda s: s.seconds, lambda s: 1, rng))
    lines.append(_share("of it, diagnose", pairs, lambda s: s.diagnose_s, lambda s: 1, rng))
    return [line for line in lines if line.before]


def _share(
    name: str,
    pairs: Sequence[tuple[Score, Score]],
    above: Callable[[Score], float],
    below: Callable[[Score], float],
    rng: np.random.Generator,
) -> Line:
    """Σ above / Σ below of each revision; the interval of the difference by resampling cases, and
    by the rule of three where no case differs."""
    if not pairs:
        return Line(name, "", "", "")
    table = np.array([[above(a), below(a), above(b), below(b)] for a, b in pairs], dtype=float)
    picked = rng.integers(len(pairs), size=(2000, len(pairs)))
    totals = table[picked].sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        change = totals[:, 2] / totals[:, 3] - totals[:, 0] / totals[:, 1]
    whole = table.sum(axis=0)
    said = [_ratio(whole[0], whole[1]), _ratio(whole[2], whole[3])]
    if len(pairs) < FEW or not np.isfinite(change).any():
        return Line(name, *said, "few cases")
    low, high = np.nanpercentile(change, [2.5, 97.5])
    if np.array_equal(table[:, :2], table[:, 2:]):
        low, high = -3.0 / len(pairs), 3.0 / len(pairs)
    return Line(name, *said, f"{low:+.2f} to {high:+.2f}")


def _ratio(above: float, below: float) -> str:
    if not below:
        return "–"
    if float(above).is_integer() and float(below).is_integer():
        return f"{above:.0f}/{below:.0f}"
    return f"{above / below:.2f}"
