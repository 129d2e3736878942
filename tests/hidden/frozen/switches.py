"""How one rule of the diagnosis is switched off in this process, and whether it changed anything.

A rule is a function of the diagnosis, named by its module and name, and what stands there without
it. While all rules are watched, each call of such a function is compared with what would have
stood there.
"""

from __future__ import annotations

import functools
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

import numpy as np

ROOM = "armd.compensation."
CONSTANTS = ROOM + "diagnose.constants"
Function = Callable[..., Any]
#: What a function gives without the rule, from the function itself and its arguments.
Without = Callable[..., Any]
#: Whether a rule changed something: from a result and the arguments.
Changed = Callable[..., bool]


@dataclass(frozen=True)
class Rule:
    """One rule: where it stands, what stands there without it, and when it changed something."""

    name: str  # in words
    at: str = ""  # "diagnose.search.selection:choose_shape"
    without: Without | None = None
    changed: Changed | None = None  # without: whether the result differs from what *without* gives
    here_only: bool = False  # in that module's own calls, not wherever the function is imported
    values: Mapping[str, float] = field(default_factory=dict)  # constants that switch it off
    watched_at: str = ""  # where it is seen that it changed something, if elsewhere
    always: bool = False  # it takes part in every diagnosis


def is_other(result: Any, neutral: Any) -> bool:
    """Whether a result is another one, by identity where it is no plain value."""
    if isinstance(result, np.ndarray) or isinstance(neutral, np.ndarray):
        return not np.array_equal(result, neutral)
    if isinstance(result, tuple | list) and isinstance(neutral, tuple | list):
        if len(result) != len(neutral):
            return True
        return any(map(is_other, result, neutral))
    if isinstance(result, bool | int | float | str | None | dict | set):
        return bool(result != neutral)
    return result is not neutral


def switch_off(rule: Rule) -> None:
    """Leave a rule out, from now on and in the whole process."""
    for name, value in rule.values.items():
        _set_constant(name, value)
    if rule.without is not None:
        without = rule.without

        def wrap(original: Function) -> Function:
            @functools.wraps(original)
            def left_out(*args: Any, **options: Any) -> Any:
                return without(original, *args, **options)

            return left_out

        _replace(rule.at, wrap, rule.here_only)


def watch(rules: Sequence[Rule], counts: Counter[str]) -> None:
    """Count from now on by each rule's name how often it changes something; nothing else is
    different."""
    for rule in rules:
        if not rule.always:
            _replace(rule.watched_at or rule.at, functools.partial(_watched, rule, counts),
                     rule.here_only and not rule.watched_at)  # fmt: skip


def _watched(rule: Rule, counts: Counter[str], original: Function) -> Function:
    @functools.wraps(original)
    def counted(*args: Any, **options: Any) -> Any:
        result = original(*args, **options)
        if rule.changed is not None:
            changed = rule.changed(result, *args, **options)
        else:
            assert rule.without is not None, rule.name
            changed = is_other(result, rule.without(original, *args, **options))
        counts[rule.name] += bool(changed)
        return result

    return counted


def _replace(at: str, wrap: Callable[[Function], Function], here_only: bool) -> None:
    """Put what *wrap* makes of a function in its place, wherever it was imported."""
    module_name, _, name = at.partition(":")
    module = import_module(ROOM + module_name)
    if "." in name:
        owner, _, name = name.partition(".")
        setattr(getattr(module, owner), name, wrap(getattr(getattr(module, owner), name)))
        return
    original = getattr(module, name)
    wrapped = wrap(original)
    for one in [module] if here_only else _list_modules():
        for key, value in list(vars(one).items()):
            if value is original:
                setattr(one, key, wrapped)


def _set_constant(name: str, value: float) -> None:
    """Give a constant another value, wherever it was imported."""
    before = getattr(import_module(CONSTANTS), name)
    for one in _list_modules():
        if name in vars(one) and vars(one)[name] is before:
            setattr(one, name, value)


def _list_modules() -> list[Any]:
    return [module for key, module in list(sys.modules.items()) if key.startswith("armd.")]
