"""A history's earlier checks are not watched again; what is remembered of them decides nothing."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from test_interim_changes import off_from

from armd.compensation.effects import catalogue
from armd.compensation.interim.changes import find as search
from armd.compensation.interim.changes.change import ChangesFound
from armd.compensation.interim.changes.find import find
from armd.compensation.interim.checks.history import STATISTICS
from armd.compensation.interim.evidence import watch as watching
from armd.compensation.interim.evidence.likelihood import Weighed, weigh
from armd.compensation.interim.evidence.looks import (
    NEVER_YET,
    NOTHING_YET,
    EpochLook,
    EpochLooks,
    QuietRun,
)
from armd.compensation.interim.evidence.stack import Stack
from armd.compensation.interim.evidence.watch import detect_changes
from armd.compensation.interim.report.watch_memory import (
    NOTHING,
    WATCHED,
    hash_sources,
    read_memory,
    write_memory,
)
from support.selection import parametrize_default


def with_a_bad_check(seed: int, bad: int, first: int) -> tuple[Stack, list[Any]]:
    """Checks that are off from the *first* on; in one of them the target lies elsewhere."""
    of, causes = off_from(np.random.default_rng(seed), first, 40)
    residual = list(of.residual)
    residual[bad] = residual[bad] + 3.0 * of.targets[bad] @ [1.0, -0.4, 0.3]
    return replace(of, residual=tuple(residual)), causes


@parametrize_default("until", [1, 5, 9, 10, 11, 12, 13, 30], default=3)
def test_watched_on_from_any_check_is_watched_from_the_first(until: int) -> None:
    of, causes = with_a_bad_check(3, 9, 99)
    whole = detect_changes(of, causes)
    assert whole.alarm is None and whole.bad == (9,)
    before = detect_changes(of.select_checks(range(until)), causes).quiet
    assert len(before.statistic) == until - 1
    later = detect_changes(of, causes, begun=before)
    assert later.statistic == pytest.approx(whole.statistic, abs=1e-9)
    assert (later.alarm, later.bad, later.quiet.bad) == (None, (9,), (9,))


def test_a_change_is_told_at_the_same_check() -> None:
    of, causes = off_from(np.random.default_rng(1), 12, 40)
    whole = detect_changes(of, causes)
    assert whole.alarm is not None and len(whole.quiet.statistic) == whole.alarm
    before = detect_changes(of.select_checks(range(13)), causes).quiet
    later = detect_changes(of, causes, begun=before)
    assert later.alarm == whole.alarm
    until = whole.alarm + 1
    assert later.statistic[:until] == pytest.approx(whole.statistic[:until], abs=1e-9)
    # And what is remembered of a history with an alarm ends before it: it is raised again.
    again = detect_changes(of, causes, begun=whole.quiet)
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


#: Four checks; an alarm after the third was withdrawn, or a change is known since.
QUIET = EpochLooks(
    (
        EpochLook(0, (), (), QuietRun((0.5, 1.0), (1,))),
        EpochLook(2, (1,), (4.0, 0.5), QuietRun((4.7,), (1,))),
    ),
    after=(6.0,),
    left_out=(1,),
)
CHECKS: Any = tuple(FakeCheck(i) for i in range(5))


def remember(folder: Path, looked: EpochLooks, checks: Any = CHECKS) -> None:
    epoch = SimpleNamespace(checks=checks, detected=SimpleNamespace(looked=looked))
    judgement: Any = SimpleNamespace(epochs=(epoch,))
    write_memory(folder, judgement)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    remember(tmp_path, QUIET)
    return tmp_path


def test_what_is_remembered_is_of_these_checks_in_this_order(folder: Path) -> None:
    found = read_memory(folder)
    assert found.recall_looks(CHECKS) == found.recall_looks([*CHECKS, FakeCheck(9)]) == QUIET  # type: ignore[list-item]
    others: list[Any] = [
        CHECKS[:2],  # a history put back to what it was: its last check is watched again
        CHECKS[1:],
        [CHECKS[1], CHECKS[0], *CHECKS[2:]],
        [CHECKS[0], FakeCheck(9), *CHECKS[1:]],  # dated before the last one
        [FakeCheck(i, ("another", "arm")) for i in range(5)],
    ]
    for other in others:
        assert found.recall_looks(other) == NEVER_YET
    # Of what came after the last check that is the same nothing is believed.
    shorter = found.recall_looks([*CHECKS[:3], FakeCheck(9)])  # type: ignore[list-item]
    assert shorter == EpochLooks(QUIET.looks, (), (1,))
    assert found.recall_looks(CHECKS[:3]) == EpochLooks(QUIET.looks[:1], (), (1,))


def edited(change: Callable[[dict[str, Any]], object]) -> Callable[[str], str]:
    def edit(text: str) -> str:
        data = json.loads(text)
        change(data)
        return json.dumps(data)

    return edit


BROKEN: dict[str, Callable[[str], str]] = {
    "torn": lambda text: text[:100],
    "not finite": lambda text: text.replace("4.7", "NaN"),
    "edited": edited(lambda d: d["epochs"][0]["looks"][0]["statistic"].__setitem__(1, 1.5)),
    "of another version": edited(lambda d: d.update(armd="0.1.0")),
    "of another state of the code": edited(
        lambda d: d.update(code=f"{int(d['code'], 16) ^ 1:016x}")
    ),
    "of no state of the code": edited(lambda d: d.pop("code")),
    "another schema": edited(lambda d: d.update(schema="armd.interim.watched/2")),
    "a key more": edited(lambda d: d.update(more=1)),
}


@pytest.mark.parametrize("how", BROKEN)
def test_what_is_in_doubt_is_not_believed(folder: Path, how: str) -> None:
    path = folder / WATCHED
    text = path.read_text()
    path.write_text(BROKEN[how](text))
    assert read_memory(folder) == NOTHING
    path.unlink()
    assert read_memory(folder) == NOTHING
    path.write_text(text)
    assert read_memory(folder) != NOTHING


def test_any_edit_makes_another_state_of_the_code(tmp_path: Path) -> None:
    package = Path(hash_sources.__wrapped__.__defaults__[0])  # type: ignore[attr-defined]
    weighed = [search, catalogue, watching]  # what looks depend on lies in it
    for module in weighed:
        assert module.__file__ is not None and package in Path(module.__file__).parents
    copy = Path(shutil.copytree(package, tmp_path / "package"))
    assert hash_sources(copy) == hash_sources()
    found = {hash_sources()}
    for number, module in enumerate(weighed):
        assert module.__file__ is not None
        file = copy / Path(module.__file__).relative_to(package)
        file.write_text(file.read_text().replace("0.", "1.", 1) + " ")
        again = Path(shutil.copytree(copy, tmp_path / str(number)))
        found.add(hash_sources(again))
    (again / "new.py").write_text("")
    renamed = Path(shutil.copytree(again, tmp_path / "renamed"))
    (renamed / "new.py").rename(renamed / "newer.py")
    assert len({*found, hash_sources(renamed)}) == len(weighed) + 2


@pytest.mark.slow
@parametrize_default("late", [0, 5, 13, 25, 38])
def test_a_check_dated_before_others_has_them_watched_again(tmp_path: Path, late: int) -> None:
    """What was remembered without it says what a search that remembers nothing says."""
    of, causes = with_a_bad_check(2, 25, 12)
    others = [i for i in range(of.n) if i != late]
    looked = find(of.select_checks(others), causes).looked
    remember(tmp_path, looked, [*map(FakeCheck, others)])
    every: Any = [*map(FakeCheck, range(of.n))]
    before = read_memory(tmp_path).recall_looks(every)
    assert all(look.until <= late for look in before.looks)
    found, anew = find(of, causes, before), find(of, causes)
    assert found.statistic == pytest.approx(anew.statistic, abs=1e-9)
    assert (found.alarm, found.bad) == (anew.alarm, anew.bad) and found.changes
    told = np.concatenate([change.numbers for change in anew.changes])
    assert np.concatenate([c.numbers for c in found.changes]) == pytest.approx(told)


@pytest.mark.parametrize(
    "looked",
    [
        EpochLooks((EpochLook(0, (), (), QuietRun((0.5, 5.0, 1.0))),)),
        EpochLooks((EpochLook(0, (), (), QuietRun((0.5, 1.0, 1.0), (3,))),)),
        EpochLooks((EpochLook(0, (), (), QuietRun((0.5,) * 5)),)),
        EpochLooks((EpochLook(1, (), (), QuietRun((0.5,))),)),
        EpochLooks((EpochLook(1, (1,), (3.0,), QuietRun((0.5,))),)),
        EpochLooks((EpochLook(0, (), (), QuietRun((0.5,))),), after=(1.0, 2.0, 3.0)),
        EpochLooks((EpochLook(0, (), (), QuietRun((0.5,))),), left_out=(4,)),
        EpochLooks(),
    ],
)
def test_what_cannot_be_is_not_believed(tmp_path: Path, looked: EpochLooks) -> None:
    """A statistic over the limit, or a bad check that is none of these: its hash may be right."""
    remember(tmp_path, looked)
    assert read_memory(tmp_path) == NOTHING


def test_where_it_cannot_be_written_nothing_is_lost(tmp_path: Path) -> None:
    (tmp_path / WATCHED).mkdir()
    remember(tmp_path, QUIET)
    assert read_memory(tmp_path) == NOTHING


def weighings(monkeypatch: pytest.MonkeyPatch, search: Callable[[], ChangesFound]) -> int:
    """How often onsets are weighed in a search."""
    count = 0

    def counted(*given: Any) -> Weighed:
        nonlocal count
        count += 1
        return weigh(*given)

    with monkeypatch.context() as patched:
        for module in ("changes.find", "changes.likeliest", "evidence.watch"):
            patched.setattr(f"armd.compensation.interim.{module}.weigh", counted)
        search()
    return count


@parametrize_default("grows", [False, True])
@pytest.mark.slow
def test_after_a_change_a_check_more_is_searched_on_from_what_was_looked_at(
    grows: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    of, causes = with_a_bad_check(2, 25, 12)
    if grows:
        causes = [replace(cause, prior_sudden=0.0, prior_gradual=0.5) for cause in causes]
    before = NEVER_YET
    for n in range(14, of.n + 1):
        some = of.select_checks(range(n))
        anew, found = find(some, causes), find(some, causes, before)
        assert found.statistic == pytest.approx(anew.statistic, abs=1e-9)
        assert (found.alarm, found.bad) == (anew.alarm, anew.bad)
        told = np.concatenate([(), *(change.numbers for change in anew.changes)])
        assert np.concatenate([(), *(c.numbers for c in found.changes)]) == pytest.approx(told)
        before = found.looked
    assert found.changes and found.changes[0].gradual == grows and found.bad == (25,)
    assert len(before.looks) > 1 and len(before.after) == of.n - found.alarm - 2
    # Of all checks but the last one nothing is weighed again, save the changes themselves.
    again = weighings(monkeypatch, lambda: find(of, causes, before))
    assert again < 20 < weighings(monkeypatch, lambda: find(of, causes)) / 2


def test_a_look_is_believed_of_the_same_changes_and_bad_checks_only() -> None:
    known = (4.0, 0.5)
    begun = QUIET.find_quiet_run(2, (1,), known)
    assert begun == QUIET.looks[1].quiet
    assert QUIET.find_quiet_run(2, [1], (4.0, 0.5 * (1 + 1e-12))) == begun
    for other in ((1, (1,), known), (2, (), known), (2, (1,), (4.0,)), (2, (1,), (4.0, 0.51))):
        assert QUIET.find_quiet_run(*other) == NOTHING_YET
    assert QUIET.after_alarm(2, 3, [1]) == QUIET.after_alarm(2, 3, [1, 4]) == 6.0
    for no in ((2, 3, []), (2, 3, [1, 2]), (1, 3, [1]), (2, 4, [1]), (2, 2, [1])):
        assert QUIET.after_alarm(*no) is None
