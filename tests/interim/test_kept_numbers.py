"""A check's numbers on disk: what was kept is what is read, and a spoilt file says where."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.interim.checks.reduced import Reduced
from armd.compensation.interim.checks.statistics import DIGITS, from_json, to_json
from armd.compensation.interim.report.judgement import Epoch, Judgement
from armd.errors import BadInput

SHARED = ("known_names", "target_names", "certified", "catalogue", "readings", "mean_unix_s")


def a_check(rows: int = 5) -> Reduced:
    rng = np.random.default_rng(1)
    return Reduced(
        residual=rng.normal(size=rows),
        causes=1e5 * rng.normal(size=(rows, 4)),
        error_columns=1e-9 * rng.normal(size=(rows, 2)),
        known_names=("calibrated 0", "beam B1 x"),
        targets=rng.normal(size=(rows, 3)),
        target_names=("beam B1",),
        certified=(True,),
        mean_unix_s=1.77e9 + 0.25,
        first_unix_s=1.77e9,
        last_unix_s=1.77e9 + 3600.5,
        readings=20,
        rms_um=4.5,
        catalogue="ab" * 32,
    )


def test_what_was_kept_is_read_to_seven_digits_of_each_number() -> None:
    kept = a_check()
    read = from_json(Path("statistics.json"), to_json(kept).encode())
    for name in ("residual", "causes", "error_columns", "targets"):
        ours, theirs = getattr(kept, name), getattr(read, name)
        assert ours.shape == theirs.shape
        assert (np.abs(theirs - ours) <= 0.5001 * 10.0 ** (1 - DIGITS) * np.abs(ours)).all()
    assert [getattr(read, name) for name in SHARED] == [getattr(kept, name) for name in SHARED]
    assert to_json(read) == to_json(kept)  # once rounded, it stays


def test_a_check_without_known_errors_keeps_its_shape() -> None:
    nothing = np.zeros((5, 0))
    kept = replace(
        a_check(), error_columns=nothing, known_names=(), targets=nothing, target_names=()
    )
    read = from_json(Path("statistics.json"), to_json(kept).encode())
    assert read.error_columns.shape == read.targets.shape == (5, 0)


@pytest.mark.parametrize(
    ("key", "value"),
    [("schema", "armd.interim.statistics/2"), ("readings", "many"), ("residual", None)],
)
def test_a_spoilt_file_names_itself_and_the_key(key: str, value: object) -> None:
    data = json.loads(to_json(a_check())) | {key: value}
    with pytest.raises(BadInput, match=rf"statistics\.json.*{key}"):
        from_json(Path("kept/statistics.json"), json.dumps(data).encode())


def epoch(first_unix_s: float, *, bad: tuple[int, ...] = (), firsts: tuple[int, ...] = ()) -> Any:
    line = SimpleNamespace(first_unix_s=first_unix_s)
    changes = tuple(SimpleNamespace(first=first) for first in firsts)
    found: Any = SimpleNamespace(bad=bad, changes=changes)
    nothing: Any = None
    checks: Any = (SimpleNamespace(line=line),)
    return Epoch(checks, nothing, (), found, changes, ())  # type: ignore[arg-type]


def test_a_check_is_bad_changed_or_in_control() -> None:
    one = epoch(0.0, bad=(1, 4), firsts=(3, 5))
    verdicts = [one.verdict(i) for i in range(7)]
    assert verdicts == [
        "in_control", "bad_check", "in_control", "changed", "bad_check", "changed", "changed",
    ]  # fmt: skip


def test_the_epoch_of_the_latest_check_decides() -> None:
    changed, sound = epoch(5.0, firsts=(0,)), epoch(9.0)
    assert Judgement((changed, sound)).latest is sound
    assert not Judgement((sound, changed)).changed
    assert Judgement((epoch(1.0), changed)).changed
