"""Which cases of a parametrised test `make test` runs; the others are slow."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from typing import Any

import pytest


def parametrize_default(
    names: str | Sequence[str],
    cases: Iterable[Any],
    *,
    default: int | Collection[int] = 1,
    **options: Any,
) -> pytest.MarkDecorator:
    """Returns `pytest.mark.parametrize`, all *cases* but the *default* ones being slow.

    *default* is how many from the start stay in `make test`, or their positions.
    """
    is_single = isinstance(names, str) and "," not in names
    return pytest.mark.parametrize(names, mark_rest_slow(cases, default, is_single), **options)


def mark_rest_slow(
    cases: Iterable[Any], default: int | Collection[int] = 1, is_single: bool = True
) -> list[Any]:
    """Returns *cases*, all slow but the *default* ones; *is_single*: a tuple is one value."""
    chosen = range(default) if isinstance(default, int) else default
    return [
        case if position in chosen else _mark_slow(case, is_single)
        for position, case in enumerate(cases)
    ]


def _mark_slow(case: Any, is_single: bool) -> Any:
    if hasattr(case, "marks"):  # a pytest.param
        return pytest.param(*case.values, marks=[*case.marks, pytest.mark.slow], id=case.id)
    values = [case] if is_single else case
    return pytest.param(*values, marks=pytest.mark.slow)
