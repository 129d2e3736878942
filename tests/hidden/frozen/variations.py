"""The constants that decide in the diagnosis, halved and doubled: each a rule of its own.

They are those of the first section of `diagnose/constants.py`, where each stands with its unit and
its reason; what bounds the work and what stands with a cause in `effects/` is not among them. Of a
ratio just over one, and of a share that would become one, the distance to one is changed instead:
twice 0.8 is no share, and half of 1.02 is something else. A range becomes narrower and wider.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from hidden.frozen.switches import CONSTANTS, Rule

#: How a rule is called, and the factor.
WAYS = {"halved": 0.5, "doubled": 2.0}
#: Which harmonics a shape has: twice these are others, not more.
NOT_VARIED = {"SHAPE_ORDERS"}
RATIO = "1"  # the unit of shares, probabilities and ratios


@dataclass(frozen=True)
class Constant:
    name: str
    value: Any
    unit: str  # as its comment says


def list_constants() -> list[Constant]:
    """Those that are varied, in the order of the table."""
    module = import_module(CONSTANTS)
    text = Path(str(module.__file__)).read_text(encoding="utf-8")
    section = re.split(r"^# --- ", text, flags=re.MULTILINE)[1]
    if not section.startswith("What decides"):
        raise ValueError(f"{module.__file__}: the first section: found {section[:20]!r}, "
                         "expected 'What decides'")  # fmt: skip
    constants, above = [], ""
    for line in section.splitlines():
        if line.startswith("#: "):
            above = above or line[3:]
        elif match := re.match(r"([A-Z][A-Z0-9_]*) = ", line):
            comment = above or line.partition("  # ")[2]
            name, above = match[1], ""
            if name not in NOT_VARIED:
                unit = re.split(r"[;,]", comment)[0]
                constants.append(Constant(name, getattr(module, name), unit))
    return constants


def list_variations() -> Iterator[Rule]:
    """A rule for each constant and way, which sets it."""
    for constant in list_constants():
        for way, factor in WAYS.items():
            varied = vary(constant.value, factor, constant.unit)
            yield Rule(f"{constant.name} {way}", values={constant.name: varied}, always=True)


def vary(value: Any, factor: float, unit: str) -> Any:
    """A constant times *factor*, as its unit allows; a count is rounded, to at least one."""
    if isinstance(value, tuple):
        low, high = value
        return low / factor, high * factor
    if isinstance(value, dict):
        return {key: vary(one, factor, key) for key, one in value.items()}
    if isinstance(value, int):
        return max(1, round(value * factor))
    if unit == RATIO and 1.0 < value < 2.0:
        return 1.0 + (value - 1.0) * factor
    if unit == RATIO and (0.5 < value < 1.0 or value < 1.0 <= value * factor):
        return 1.0 - (1.0 - value) / factor
    return value * factor
