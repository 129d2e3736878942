"""Decide on figures by their limits: the decision rule of ISO 14253-1."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

from armd.compensation.identify.admission.mistakes import LENGTHS_MM
from armd.compensation.verify.figures import BLOCK
from armd.compensation.verify.limits import PermissibleErrors
from armd.compensation.verify.results import Deviation, Figure, Verification

COVERAGE_FACTOR = 2.0
NOT_STATED = "not stated"
#: The longest length of E_Uni must be at least this part of the measuring range.
LONGEST_SHARE = 0.66
#: A larger error does not come from this arm: the data are of another arm.
ABSURD_MM = 20.0
#: A limit this many times the largest result is useless, or was typed in another unit.
LOOSE = 100.0
#: A length in another unit is recognised within this share.
SAME_UNIT = 0.1
#: The advice about readings far off.
FAR_OFF = (
    "if the button was pressed in the air, or the tip was not in its seat: take these readings"
    " again where the standard allows it, and verify the session that has them in their place"
)

Outcome = Literal["conforms", "does not conform", "not proven", "not judged", "not tested"]

RULES = {
    "guarded": "ISO 14253-1: conforms within the limit reduced by U (k = 2); between the limit "
    "less U and the limit plus U nothing is proven",
    "simple": "simple acceptance: conforms within the limit, whatever U",
}


@dataclass(frozen=True)
class Judged:
    """A figure and its outcome.

    `deciding` is the deviation nearest its limit, or farthest beyond. It need not be the largest,
    where limits or uncertainties differ. `limit_mm` and U belong to it.
    """

    figure: Figure
    outcome: Outcome
    deciding: Deviation
    limit_mm: float | None

    @property
    def expanded_uncertainty_mm(self) -> float:
        return COVERAGE_FACTOR * self.deciding.standard_uncertainty_mm

    def uncertainty_um(self, digits: int) -> str:
        """Return U as a person reads it."""
        if not self.uncertainty_stated:
            return NOT_STATED
        return f"{1e3 * self.expanded_uncertainty_mm:.{digits}f} µm"

    @property
    def uncertainty_stated(self) -> bool:
        """Whether an uncertainty is stated; if not, U is unknown and not 0."""
        return self.expanded_uncertainty_mm > 0.0


@dataclass(frozen=True)
class Verdict:
    """The verdict: passed if all figures with a limit, one at least, were tested and conform."""

    verification: Verification
    limits: PermissibleErrors | None
    judged: tuple[Judged, ...]
    not_tested: dict[str, str]  # figures with a limit that the session does not support

    @property
    def covered(self) -> list[str]:
        """The names of the figures that were judged; the verdict covers no others."""
        return [item.figure.name for item in self.judged if item.outcome != "not judged"]

    @property
    def passed(self) -> bool:
        """Whether all judged figures conform; at least one must have been judged."""
        outcomes = {item.outcome for item in self.judged} - {"not judged"}
        return not self.not_tested and outcomes == {"conforms"}

    @property
    def in_words(self) -> str:
        """The verdict, what it covers, and the reasons if it is negative."""
        if self.limits is None:
            return "none: no limits given"
        silent = [item.figure.name for item in self.judged if item.outcome == "not judged"]
        not_judged = f"; not judged, having no limit: {', '.join(silent)}" if silent else ""
        if self.passed:
            return f"PASSED for {', '.join(self.covered)}{not_judged}"
        reasons = [
            f"{item.figure.name}: {item.outcome} ({1e3 * item.deciding.value_mm:+.1f} µm at"
            f" {item.deciding.label}, MPE {1e3 * (item.limit_mm or 0.0):.1f} µm,"
            f" U {item.uncertainty_um(1)})"
            for item in self.judged
            if item.outcome not in ("conforms", "not judged")
        ]
        reasons += [f"{key}: not tested, {reason}" for key, reason in self.not_tested.items()]
        return f"FAILED: {'; '.join(reasons)}{not_judged}"

    @property
    def rule(self) -> str:
        return RULES[self.limits.decision] if self.limits else "no limits given: no verdict"

    @property
    def remarks(self) -> list[str]:
        remarks = list(self.verification.remarks)
        far_off = self.verification.far_off
        remarks += [f"far off, and counted as it was measured: {reading}" for reading in far_off]
        if far_off:
            remarks.append(FAR_OFF)
        range_mm = self.limits.measuring_range_mm if self.limits else None
        for figure in self.verification.figures:
            longest = max(deviation.length_mm for deviation in figure.deviations)
            if figure.key == "e_uni" and range_mm and longest < LONGEST_SHARE * range_mm:
                remarks.append(
                    f"E_Uni: the longest length, {longest:.0f} mm, is less than 66 % of the "
                    f"measuring range of {range_mm:.0f} mm"
                )
            if unit := _find_certified_unit(figure.worst):
                remarks.append(
                    f"{figure.name}: its certified lengths fit the arm if they are taken as {unit}:"
                    " length_mm in session.toml is in mm"
                )
            elif abs(figure.worst.value_mm) > ABSURD_MM and not far_off:
                remarks.append(
                    f"{figure.name}: {figure.worst.value_mm:.0f} mm: is arm.toml the drawing of"
                    " this arm, and the session's unit of angles right?"
                )
        for item in self.judged:
            if item.outcome != "not judged" and not item.uncertainty_stated:
                remarks.append(
                    f"{item.figure.name}: the test's uncertainty is not stated: decided as if it"
                    " were 0 ([uncertainty] of the limits' file, and that of the certified lengths)"
                )
            largest = abs(item.figure.worst.value_mm)
            if item.limit_mm is not None and item.limit_mm > LOOSE * largest > 0:
                remarks.append(
                    f"{item.figure.name}: the limit is {item.limit_mm / largest:.0f} times the"
                    " largest found; limits are in mm"
                )
        return remarks

    def as_json(self) -> dict[str, Any]:
        """Return the object that `armd verify --json` writes."""
        verification = self.verification
        return {
            "schema": "armd.verification/1",
            "passed": self.passed if self.limits else None,
            "verdict": self.in_words,
            "covers": [item.figure.key for item in self.judged if item.outcome != "not judged"],
            "not_judged": [item.figure.key for item in self.judged if item.outcome == "not judged"],
            "decision_rule": self.rule,
            "figures": {
                item.figure.key: {
                    "name": item.figure.name,
                    "standard": item.figure.standard,
                    "value_mm": item.figure.worst.value_mm,
                    "at": item.figure.worst.label,
                    "deciding_mm": item.deciding.value_mm,
                    "deciding_at": item.deciding.label,
                    "mpe_mm": item.limit_mm,
                    "expanded_uncertainty_mm": item.expanded_uncertainty_mm,
                    "outcome": item.outcome,
                    "deviations": [
                        {"at": d.label, "value_mm": d.value_mm, "length_mm": d.length_mm}
                        for d in item.figure.deviations
                    ],
                }
                for item in self.judged
            },
            "not_supported": verification.left_out,
            "not_tested": self.not_tested,
            "far_off": list(verification.far_off),
            "remarks": self.remarks,
        }


def _find_certified_unit(worst: Deviation) -> str:
    """Return the unit that a certified length seems to have instead of mm, or ""."""
    if not worst.length_mm:
        return ""
    ratio = 1.0 + worst.value_mm / worst.length_mm
    units = LENGTHS_MM.items()
    return next((unit for unit, mm in units if abs(ratio / mm - 1.0) < SAME_UNIT), "")


def judge(verification: Verification, limits: PermissibleErrors | None) -> Verdict:
    """Decide on every figure; without *limits* nothing is decided."""
    judged = tuple(_judge(figure, limits) for figure in verification.figures)
    left_out = verification.left_out
    limited = {
        key for key in left_out if limits is not None and limits.mpe.limit_mm(key, 0.0) is not None
    }
    verification = replace(
        verification, left_out={k: why for k, why in left_out.items() if k in limited or k != BLOCK}
    )
    missing = {key: why for key, why in left_out.items() if key in limited}
    return Verdict(verification, limits, judged, missing)


def _judge(figure: Figure, limits: PermissibleErrors | None) -> Judged:
    """Judge a figure by the deviation nearest to its limit, or farthest beyond it."""
    if limits is None or limits.mpe.limit_mm(figure.key, 0.0) is None:
        return Judged(figure, "not judged", figure.worst, None)

    def excess(deviation: Deviation) -> float:
        limit = limits.mpe.limit_mm(figure.key, deviation.length_mm) or 0.0
        guard = COVERAGE_FACTOR * deviation.standard_uncertainty_mm
        return abs(deviation.value_mm) - limit + (guard if limits.decision == "guarded" else 0.0)

    deciding = max(figure.deviations, key=excess)
    limit = limits.mpe.limit_mm(figure.key, deciding.length_mm) or 0.0
    guard = COVERAGE_FACTOR * deciding.standard_uncertainty_mm
    outcome: Outcome
    if excess(deciding) <= 0:
        outcome = "conforms"
    elif limits.decision == "guarded" and abs(deciding.value_mm) <= limit + guard:
        outcome = "not proven"
    else:
        outcome = "does not conform"
    return Judged(figure, outcome, deciding, limit)
