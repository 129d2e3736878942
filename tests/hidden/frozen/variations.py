"""Every constant that decides in the diagnosis, halved and doubled: each a rule of its own.

They are those of the first section of `diagnose/constants.py`; each stands there with its unit and
its reason. Of a share that would become one, and of what is just over one, the distance to one is
changed instead: twice 0.8 is no share, and half of 1.02 is something else.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path
from typing import Any

from hidden.frozen.switches import CONSTANTS, Rule

#: What is doubled and halved, and how the rule is called.
WAYS = {"halved": 0.5, "doubled": 2.0}
#: Which harmonics a shape has: twice these are others, not more.
NOT_VARIED = {"SHAPE_ORDERS"}


def list_deciding_constants() -> Mapping[str, Any]:
    """Their names and values, in the order of the table."""
    module = import_module(CONSTANTS)
    text = Path(str(module.__file__)).read_text(encoding="utf-8")
    section = re.split(r"^# --- ", text, flags=re.MULTILINE)[1]
    if not section.startswith("What decides"):
        raise ValueError(f"{module.__file__}: the first section: found {section[:20]!r}, "
                         "expected 'What decides'")  # fmt: skip
    names = re.findall(r"^([A-Z][A-Z0-9_]*) = ", section, flags=re.MULTILINE)
    return {name: getattr(module, name) for name in names}


def list_variations() -> Iterator[Rule]:
    """A rule for each constant and way, which sets it."""
    for name, value in list_deciding_constants().items():
        if name not in NOT_VARIED:
            for way, factor in WAYS.items():
                yield Rule(f"{name} {way}", values={name: vary(value, factor)}, always=True)


def vary(value: Any, factor: float) -> Any:
    """A constant times *factor*, of several each; a count is rounded, to at least one."""
    if isinstance(value, tuple):
        return tuple(vary(one, factor) for one in value)
    if isinstance(value, dict):
        return {key: vary(one, factor) for key, one in value.items()}
    if isinstance(value, int):
        return max(1, round(value * factor))
    if 1.0 < value < 2.0:
        return 1.0 + (value - 1.0) * factor
    if 0.5 < value < 1.0 or value < 1.0 <= value * factor:
        return 1.0 - (1.0 - value) / factor
    return value * factor
