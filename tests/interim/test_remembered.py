"""A history's earlier checks are not watched again; what is remembered of them decides nothing."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_interim_changes import off_from

from armd.compensation.interim.checks.history import STATISTICS
from armd.compensation.interim.evidence.quiet import NOTHING_YET, Quiet
from armd.compensation.interim.evidence.stack import Stack
from armd.compensation.interim.evidence.watch import watch
from armd.compensation.interim.told.remembered import NOTHING, WATCHED, recall, remember


def with_a_bad_check(seed: int, bad: int) -> tuple[Stack, list[Any]]:
    """Checks without a change; in one of them the target lies elsewhere."""
    of, causes = off_from(np.random.default_rng(seed), 99, 99)
    residual = list(of.residual)
    residual[bad] = residual[bad] + 3.0 * of.targets[bad] @ [1.0, -0.4, 0.3]
    return Stack(of.time_d, tuple(residual), of.columns, of.known, of.targets, of.blocks), causes


@pytest.mark.parametrize("until", [1, 5, 9, 10, 11, 12, 13, 30])
def test_watched_on_from_any_check_is_watched_from_the_first(until: int) -> None:
    of, causes = with_a_bad_check(3, 9)
    whole = watch(of, causes)
    assert whole.alarm is None and whole.bad == (9,)
    before = watch(of.only(range(until)), causes).quiet
    assert len(before.statistic) == until - 1
    later = watch(of, causes, begun=before)
    assert later.statistic == pytest.approx(whole.statistic, abs=1e-9)
    assert (later.alarm, later.bad, later.quiet.bad) == (None, (9,), (9,))


def test_a_change_is_told_at_the_same_check() -> None:
    of, causes = off_from(np.random.default_rng(1), 12, 40)
    whole = watch(of, causes)
    assert whole.alarm is not None and len(whole.quiet.statistic) == whole.alarm
    before = watch(of.only(range(13)), causes).quiet
    later = watch(of, causes, begun=before)
    assert later.alarm == whole.alarm
    until = whole.alarm + 1
    assert later.statistic[:until] == pytest.approx(whole.statistic[:until], abs=1e-9)
    # And what is remembered of a history with an alarm ends before it: it is raised again.
    again = watch(of, causes, begun=whole.quiet)
    assert again.alarm == whole.alarm and again.quiet == whole.quiet


@dataclass(frozen=True)
class FakeCheck:
    """As much of a check as is remembered of it."""

    number: int
    epoch: tuple[str, str] = ("calibration", "arm")

    @property
    def line(self) -> Any:
        return SimpleNamespace(files={STATISTICS: f"{self.number:064x}"})

    @property
    def reduced(self) -> Any:
        return SimpleNamespace(catalogue="of today")


QUIET = Quiet((0.5, 1.0, 4.7), (1,))
CHECKS: Any = tuple(FakeCheck(i) for i in range(4))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    epoch = SimpleNamespace(checks=CHECKS, found=SimpleNamespace(quiet=QUIET))
    judgement: Any = SimpleNamespace(epochs=(epoch,))
    remember(tmp_path, judgement)
    return tmp_path


def test_what_is_remembered_is_of_these_checks_in_this_order(folder: Path) -> None:
    found = recall(folder)
    assert found.of(CHECKS) == found.of([*CHECKS, FakeCheck(9)]) == QUIET  # type: ignore[list-item]
    others: list[Any] = [
        CHECKS[:3],  # a history put back to what it was: its last check is watched again
        CHECKS[1:],
        [CHECKS[1], CHECKS[0], *CHECKS[2:]],
        [CHECKS[0], FakeCheck(9), *CHECKS[1:]],  # dated before the last one
        [FakeCheck(i, ("another", "arm")) for i in range(4)],
    ]
    for other in others:
        assert found.of(other) == NOTHING_YET


def broken(text: str, how: str) -> str:
    data = json.loads(text)
    match how:
        case "torn":
            return text[:100]
        case "edited":
            data["epochs"][0]["statistic"][1] = 1.5
        case "of another version":
            data["armd"] = "0.1.0"
        case "another schema":
            data["schema"] = "armd.interim.watched/2"
        case "not finite":
            return text.replace("4.7", "NaN")
        case "a key more":
            data["more"] = 1
    return json.dumps(data)


@pytest.mark.parametrize(
    "how", ["torn", "edited", "of another version", "another schema", "not finite", "a key more"]
)
def test_what_is_in_doubt_is_not_believed(folder: Path, how: str) -> None:
    path = folder / WATCHED
    text = path.read_text()
    path.write_text(broken(text, how))
    assert recall(folder) == NOTHING
    path.unlink()
    assert recall(folder) == NOTHING
    path.write_text(text)
    assert recall(folder) != NOTHING


@pytest.mark.parametrize("quiet", [Quiet((0.5, 5.0, 1.0)), Quiet((0.5, 1.0, 1.0), (3,))])
def test_what_cannot_be_is_not_believed(tmp_path: Path, quiet: Quiet) -> None:
    """A statistic over the limit, or a bad check that is none of these: its hash may be right."""
    epoch = SimpleNamespace(checks=CHECKS, found=SimpleNamespace(quiet=quiet))
    judgement: Any = SimpleNamespace(epochs=(epoch,))
    remember(tmp_path, judgement)
    assert recall(tmp_path) == NOTHING


def test_where_it_cannot_be_written_nothing_is_lost(tmp_path: Path) -> None:
    (tmp_path / WATCHED).mkdir()
    epoch = SimpleNamespace(checks=CHECKS, found=SimpleNamespace(quiet=QUIET))
    judgement: Any = SimpleNamespace(epochs=(epoch,))
    remember(tmp_path, judgement)
    assert recall(tmp_path) == NOTHING
