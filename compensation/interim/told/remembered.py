"""What watching earlier checks came to, kept beside a history: a check more takes seconds.

    watched.json             of each epoch: the checks, and what `watch` said after each

It saves time and decides nothing. It is believed of these very checks in this order only, by the
hashes that the history's lines have of them, if the same version of armd wrote it and its own hash
is right; else all checks are watched anew, which says the same (decision 121).
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from pydantic import Field

from armd import __version__
from armd.compensation.interim.checks.history import STATISTICS, Check
from armd.compensation.interim.evidence.likelihood import LIMIT
from armd.compensation.interim.evidence.quiet import NOTHING_YET, Quiet
from armd.compensation.interim.told.judgement import Judgement
from armd.errors import BadInput
from armd.files.schema import Strict, load_json
from armd.files.writing import write_changed

WATCHED = "watched.json"


class _WatchedEpoch(Strict):
    checks: list[str]  # `_key` of each, in order of time
    statistic: list[float]
    bad: list[int]

    def is_sound(self) -> bool:
        n = len(self.checks)
        return (
            len(self.statistic) == n
            and all(value < LIMIT for value in self.statistic)
            and all(0 <= i < n for i in self.bad)
            and self.bad == sorted(set(self.bad))
        )


class _WatchedFile(Strict):
    schema_: str = Field(alias="schema", pattern="^armd.interim.watched/1$")
    armd: str  # the version that wrote it
    epochs: list[_WatchedEpoch]
    sha256: str  # of all epochs


@dataclass(frozen=True)
class Remembered:
    """What is remembered of a history's epochs."""

    epochs: tuple[_WatchedEpoch, ...] = ()

    def of(self, checks: Sequence[Check]) -> Quiet:
        """Of the *checks* of an epoch, in order of time, as many as were watched before."""
        if not self.epochs:
            return NOTHING_YET
        keys = [_key(check) for check in checks]
        for epoch in self.epochs:
            n = len(epoch.checks)
            if 0 < n < len(keys) and epoch.checks == keys[:n]:
                return Quiet(tuple(epoch.statistic), tuple(epoch.bad))
        return NOTHING_YET


NOTHING = Remembered()


def recall(folder: Path) -> Remembered:
    """What a history's folder has of it; nothing where any of it is in doubt."""
    with suppress(BadInput):
        file = load_json(folder / WATCHED, _WatchedFile)
        right = file.armd == __version__ and file.sha256 == _sha256(file.epochs)
        if right and all(epoch.is_sound() for epoch in file.epochs):
            return Remembered(tuple(file.epochs))
    return NOTHING


def remember(folder: Path, judgement: Judgement) -> None:
    """Write it; where that is refused (a full disk), the next time takes longer."""
    epochs = [
        _WatchedEpoch(
            checks=[_key(check) for check in epoch.checks[: len(quiet.statistic)]],
            statistic=list(quiet.statistic),
            bad=list(quiet.bad),
        )
        for epoch in judgement.epochs
        for quiet in [epoch.found.quiet]
    ]
    file = {
        "schema": "armd.interim.watched/1",
        "armd": __version__,
        "epochs": [epoch.model_dump() for epoch in epochs],
        "sha256": _sha256(epochs),
    }
    with suppress(BadInput):
        write_changed(folder / WATCHED, json.dumps(file) + "\n")


def _key(check: Check) -> str:
    """What a check says, of which arm under which calibration, by which catalogue of causes."""
    said = (*check.epoch, check.line.files[STATISTICS], check.reduced.catalogue)
    return hashlib.sha256("\n".join(said).encode()).hexdigest()


def _sha256(epochs: Sequence[_WatchedEpoch]) -> str:
    text = json.dumps([epoch.model_dump() for epoch in epochs])
    return hashlib.sha256(text.encode()).hexdigest()
