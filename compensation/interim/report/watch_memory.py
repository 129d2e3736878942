"""A cache of the results of watching earlier checks, so that a further check takes seconds.

    watched.json             for each epoch: the checks, and the results of each look at them

The cache saves time and changes no result. It is used only for exactly these checks in this order,
by the hashes in the history's lines. The same version of armd in the same state must have written
it, and its own hash must be right. Otherwise all checks are watched again, with the same result
(decision 30).
"""

from __future__ import annotations

import functools
import hashlib
import json
import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import takewhile
from pathlib import Path

from pydantic import Field

from armd import __version__
from armd.compensation.interim.checks.history import STATISTICS, Check
from armd.compensation.interim.evidence.likelihood import LIMIT
from armd.compensation.interim.evidence.looks import NEVER_YET, EpochLook, EpochLooks, QuietRun
from armd.compensation.interim.report.judgement import Judgement
from armd.errors import BadInput
from armd.files.schema import Strict, load_json
from armd.files.writing import write_changed

WATCHED = "watched.json"


class _Look(Strict):
    since: int = Field(ge=0)
    left_out: list[int]
    known_changes: list[float] = Field(alias="known")
    statistic: list[float]
    bad: list[int]

    def is_sound(self) -> bool:
        return (
            all(value < LIMIT for value in self.statistic)
            and _is_set(self.left_out, self.since)
            and _is_set(self.bad, self.since + len(self.statistic))
        )

    def to_epoch_look(self) -> EpochLook:
        quiet = QuietRun(tuple(self.statistic), tuple(self.bad))
        return EpochLook(self.since, tuple(self.left_out), tuple(self.known_changes), quiet)


def _is_set(numbers: Sequence[int], until: int) -> bool:
    return list(numbers) == sorted(set(numbers)) and all(0 <= i < until for i in numbers)


class _WatchedEpoch(Strict):
    checks: list[str]  # `_make_key` of each, in order of time
    looks: list[_Look]  # the first one with no change known
    after: list[float]  # the statistic of checks after the first alarm, without …
    left_out: list[int]

    def is_sound(self) -> bool:
        n = len(self.checks)
        return (
            bool(self.looks)
            and all(look.is_sound() and look.to_epoch_look().until <= n for look in self.looks)
            and (self.looks[0].since, self.looks[0].known_changes) == (0, [])
            and (not self.after or len(self.looks[0].statistic) + 1 + len(self.after) <= n)
            and _is_set(self.left_out, n)
        )


class _WatchedFile(Strict):
    schema_: str = Field(alias="schema", pattern="^armd.interim.watched/1$")
    armd: str  # the version that wrote it
    code: str  # the state of its sources
    epochs: list[_WatchedEpoch]
    sha256: str  # hash of all epochs


@dataclass(frozen=True)
class Remembered:
    """The cached results of a history's epochs."""

    epochs: tuple[_WatchedEpoch, ...] = ()

    def recall_looks(self, checks: Sequence[Check]) -> EpochLooks:
        """Return the looks at those of an epoch's *checks*, in order of time, that were watched
        before.
        """
        if not self.epochs:
            return NEVER_YET
        keys = [_make_key(check) for check in checks[:-1]]
        for epoch in self.epochs:
            pairs = zip(epoch.checks, keys, strict=False)
            same = sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], pairs))
            looks = [look for look in map(_Look.to_epoch_look, epoch.looks) if look.until <= same]
            if looks and looks[0].since == 0 and looks[0].until:
                after = epoch.after[: max(same - looks[0].until - 1, 0)]
                return EpochLooks(tuple(looks), tuple(after), tuple(epoch.left_out))
        return NEVER_YET


NOTHING = Remembered()


def read_memory(folder: Path) -> Remembered:
    """Read the cache of a history's folder; it is empty if any part of it is in doubt."""
    with suppress(BadInput):
        file = load_json(folder / WATCHED, _WatchedFile)
        ours = (file.armd, file.code) == (__version__, hash_sources())
        right = file.sha256 == _hash_epochs(file.epochs)
        if ours and right and all(epoch.is_sound() for epoch in file.epochs):
            return Remembered(tuple(file.epochs))
    return NOTHING


def write_memory(folder: Path, judgement: Judgement) -> None:
    """Write the cache; if that fails (a full disk), the next run takes longer."""
    epochs = [
        _WatchedEpoch(
            checks=[_make_key(check) for check in epoch.checks[:-1]],
            looks=[
                _Look(
                    since=look.since,
                    left_out=list(look.left_out),
                    known=list(look.known_changes),
                    statistic=list(look.quiet.statistic),
                    bad=list(look.quiet.bad),
                )
                for look in epoch.detected.looked.looks
                if look.finite
            ],
            after=list(takewhile(math.isfinite, epoch.detected.looked.after)),
            left_out=list(epoch.detected.looked.left_out),
        )
        for epoch in judgement.epochs
    ]
    file = {
        "schema": "armd.interim.watched/1",
        "armd": __version__,
        "code": hash_sources(),
        "epochs": [epoch.model_dump(by_alias=True) for epoch in epochs],
        "sha256": _hash_epochs(epochs),
    }
    with suppress(BadInput):
        write_changed(folder / WATCHED, json.dumps(file) + "\n")


@functools.cache
def hash_sources(package: Path = Path(__file__).parents[2]) -> str:
    """Hash the sources that may change the numbers of a check.

    A version has many states until it is released. The catalogue, its priors and all that weighs
    them are in *package*, `compensation`.
    """
    digest = hashlib.sha256()
    for file in sorted(package.rglob("*.py")):
        content = file.read_bytes()
        digest.update(f"{file.relative_to(package)} {len(content)}\n".encode() + content)
    return digest.hexdigest()[:16]


def _make_key(check: Check) -> str:
    """Hash a check's statistics, its arm, its calibration and its catalogue of causes."""
    facts = (*check.epoch, check.line.files[STATISTICS], check.reduced.catalogue)
    return hashlib.sha256("\n".join(facts).encode()).hexdigest()


def _hash_epochs(epochs: Sequence[_WatchedEpoch]) -> str:
    text = json.dumps([epoch.model_dump(by_alias=True) for epoch in epochs])
    return hashlib.sha256(text.encode()).hexdigest()
