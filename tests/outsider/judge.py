"""Whether what `armd diagnose` says of a case is right. The rules, strictly:

- *Its name* is the planted cause at the planted place (a wrong `depends_on` makes it another where
  the fault needs one: a zero that creeps is a `geometry_shift` only if it goes with `time_s`; a
  touched artefact must be named with its session and placement). An oval disc may also be told as
  an ellipticity of the same joint, a late link by its sensor.
- *Near* is a finding at the place planted, or `unknown`, that depends on variables of the fault
  and on none besides (at the place: at least one of them); and a name that no readings can tell
  from the true one. Any probability.
- *Foreign* is every other finding. Only in readings with gross errors or heavy tails `outliers` is
  none.

The verdict is the first of these that holds:

- "sure and wrong": a foreign finding with a probability of 0.95 or more;
- "wrong": a foreign finding;
- "right": its name, or nothing where nothing was planted, and nothing else;
- "near": only near findings, or its name with near ones beside it;
- "missed": nothing, where something was planted.

The extended model is *worse* if it errs more than 2 % more on the further session, which took no
part, than the model under test.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

from outsider.case import Truth

SURE, WORSE = 0.95, 1.02
VERDICTS = ("right", "near", "missed", "wrong", "sure and wrong")


def judge(truth: Truth, report: Mapping[str, Any]) -> str:
    """One of VERDICTS, of a report as the contract's section 4 has it."""
    kinds = {"own": 0, "near": 0, "foreign": 0, "sure": 0}
    for finding in report["findings"]:
        if finding["cause"] == "outliers" and truth.kind in ("gross", "t3"):
            continue
        relation = _relation(truth, finding)
        kinds[relation] += 1
        kinds["sure"] += relation == "foreign" and finding["probability"] >= SURE
    if kinds["foreign"]:
        return "sure and wrong" if kinds["sure"] else "wrong"
    if not truth.cause:
        return "right"
    if kinds["near"]:
        return "near"
    return "right" if kinds["own"] else "missed"


def _relation(truth: Truth, finding: Mapping[str, Any]) -> str:
    if not truth.cause:
        return "foreign"
    name, depends_on = (finding["cause"], finding["location"]), set(finding["depends_on"])
    if name == (truth.cause, truth.location) and _as_needed(truth, finding):
        return "own"
    if name in truth.beside:
        return "own"
    if name in truth.same_signal:
        return "near"
    shared = depends_on & set(truth.depends_on)
    if finding["cause"] == "unknown":
        return "near" if shared and depends_on <= set(truth.depends_on) else "foreign"
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
