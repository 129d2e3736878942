"""Whether what `armd diagnose` says of a case is right. The rules, strictly:

- *Its name* is the planted cause at the planted place (a wrong `depends_on` makes it another where
  the fault needs one: a zero that creeps is a `geometry_shift` only if it goes with `time_s`; a
  touched artefact must be named with its session and placement). An oval disc may also be told as
  an ellipticity of the same joint, a late link by its sensor.
- *Near* is a finding at the place planted that depends on one of the fault's variables, `unknown`
  in nothing but its variables, and a name of the same signal: one that these readings cannot tell
  from the true one, because it leaves less than 3 noise units of what was planted, or because a
  sensor's offset under even growth *is* a length too long.
- *Foreign* is every other finding. What is true of a mess counts for nothing, told or not:
  `outliers` in readings with gross errors, heavy tails, glitches or late latches; the artefact's
  growth where it was not soaked; the tip where somebody presses; the base where a tracker's frame
  drifts; links that are late where the one sensor hangs in the air.

The verdict is the first of these that holds:

- "sure and wrong": a foreign finding with a probability of 0.95 or more;
- "wrong": a foreign finding;
- "right": its name, or nothing where nothing was planted, and nothing else;
- "near": only near findings, or its name with near ones beside it; "near but sure" if one of them
  has a probability of 0.95 or more, is not `unknown`, and has not the same signal;
- "missed": nothing, where something was planted.

Of a crowd (several faults at once), each finding is held against every fault, and counts for the
one that it names best: its name for one says nothing of the others. A fault is *due* over 8 noise
units, clear of all that the others leave free. What names none of them, nor is near one, is
foreign. The verdict is "missed" if nothing is foreign and a due fault has neither its name nor a
near finding, "right" if each has its name and nothing else was said, "near" otherwise.

Targets of one placement that were counted from another end may be refused instead, if the command
names the session, says so, and names no other placement: "right".

The extended model is *worse* if it errs more than 2 % more on the further session, which took no
part, than the model under test.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from outsider.case import Truth

SURE, WORSE = 0.95, 1.02
BEST_FIRST = ("own", "like", "near", "foreign")
DUE_UNITS = 8.0
VERDICTS = ("right", "near", "near but sure", "missed", "wrong", "sure and wrong")


@dataclass(frozen=True)
class Tally:
    """What was said of a crowd."""

    told: tuple[str, ...]  # of each fault the best that was said: "own", "like", "near" or ""
    relations: tuple[tuple[str, bool], ...]  # of each finding, the best to any fault; and if sure

    @property
    def extra(self) -> int:
        return sum(relation == "foreign" for relation, _ in self.relations)

    @property
    def sure_and_wrong(self) -> bool:
        return ("foreign", True) in self.relations


def tally(truth: Truth, report: Mapping[str, Any]) -> Tally:
    """Of a crowd's report, as the contract's section 4 has it."""
    best, relations = ["foreign"] * len(truth.each), []
    for finding in report["findings"]:
        each = [_relation(one, finding) for one in truth.each]
        relation = min(each, key=BEST_FIRST.index)
        relations.append((relation, finding["probability"] >= SURE))
        for i, to_it in enumerate(each):
            if to_it == relation:
                best[i] = min(best[i], relation, key=BEST_FIRST.index)
    told = tuple("" if relation == "foreign" else relation for relation in best)
    return Tally(told, tuple(relations))


def _of_a_crowd(truth: Truth, report: Mapping[str, Any]) -> str:
    said = tally(truth, report)
    if said.extra:
        return "sure and wrong" if said.sure_and_wrong else "wrong"
    due = [
        relation
        for one, relation in zip(truth.each, said.told, strict=True)
        if one.noise_units > DUE_UNITS
    ]
    if "" in due:
        return "missed"
    if {relation for relation, _ in said.relations} | set(due) <= {"own"}:
        return "right"
    return "near but sure" if ("near", True) in said.relations else "near"


def judge(truth: Truth, report: Mapping[str, Any]) -> str:
    """One of VERDICTS, of a report as the contract's section 4 has it."""
    if truth.each:
        return _of_a_crowd(truth, report)
    relations = [
        (_relation(truth, finding), finding["probability"] >= SURE)
        for finding in report["findings"]
        if not _of_the_mess(truth, finding)
    ]
    told = {relation for relation, _ in relations}
    if "foreign" in told:
        return "sure and wrong" if ("foreign", True) in relations else "wrong"
    if not truth.cause:
        return "right"
    if told & {"near", "like"}:
        return "near but sure" if ("near", True) in relations else "near"
    return "right" if told else "missed"


def rightly_refused(truth: Truth, said: str) -> bool:
    """Whether a command refused, in these words, the session of which it had to say why."""
    session, _, placement = truth.mistaken.partition(" ")
    told = f"{session}: the session: found" in said and "counted from another end" in said
    where = re.search(r" in (P\d+(, P\d+)*), expected", said)
    return bool(session) and told and (where is None or where[1] == placement)


def _of_the_mess(truth: Truth, finding: Mapping[str, Any]) -> bool:
    if finding["cause"] == "unknown":
        depends_on = set(finding["depends_on"])
        return bool(depends_on) and depends_on <= set(truth.mess_depends_on)
    return (finding["cause"], finding["location"]) in truth.mess_names


def _relation(truth: Truth, finding: Mapping[str, Any]) -> str:
    """ "own", "near", "like" (nothing is wrong with being sure of it) or "foreign"."""
    if not truth.cause:
        return "foreign"
    name, depends_on = (finding["cause"], finding["location"]), set(finding["depends_on"])
    if name == (truth.cause, truth.location) and _as_needed(truth, finding):
        return "own"
    if name in truth.beside:
        return "own"
    if name in truth.same_signal:
        return "like"
    shared = depends_on & set(truth.depends_on)
    if finding["cause"] == "unknown":
        return "like" if shared and depends_on <= set(truth.depends_on) else "foreign"
    return "near" if shared and _place(finding["location"]) == _place(truth.location) else "foreign"


def _as_needed(truth: Truth, finding: Mapping[str, Any]) -> bool:
    if truth.placement:
        return f"{finding['session']} {finding['placement']}" == truth.placement
    return not truth.needs or truth.needs in finding["depends_on"]


def _place(location: str) -> str:
    """Joint 3, link 3 and sensor t3 are one place; of two sensors it is both numbers."""
    return " ".join(re.findall(r"\d+", location)) or location


def is_worse(before_um: float, after_um: float) -> bool:
    return after_um > WORSE * before_um
