"""A frozen case: a folder of sessions as a user has them, and truth.json, which only a judge reads.

arm.toml · before-*: sessions for a calibration from before (where there is one) · session-*: to
diagnose · further-*: to judge the model by; given as `--holdout` only where the truth says so.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

Names = tuple[tuple[str, str], ...]
FRACTION = re.compile(r"[-+]?\d+\.\d+(?:[eE][-+]?\d+)?")
SUMS = 4
#: Of the sum of all numbers, some 1e5 in a case. Twelve decimals are written: a last digit that
#: differs in each of 1e4 numbers makes some 1e-15. Angles that are solved for, past a posture where
#: rounding grows, differed by 7e-6° in some 140 rows of a case between two processors: 4e-12.
LAST_DIGITS = 1e-11
#: Of the sum of the truth's numbers, which are the result of a fit and have four digits.
FOURTH_DIGIT = 2e-3
#: Noise units, clear of everything that absorbs, from which on a cause should be named.
DUE_UNITS = 8.0


@dataclass(frozen=True)
class Cause:
    """One planted cause. Its name counts at *location*, or as any of *names*."""

    cause: str
    location: str
    units: float  # norm of its signature in noise units, clear of all that absorbs it
    names: Names = ()  # just as true
    same_signal: Names = ()  # names that these readings cannot separate from it
    variables: tuple[str, ...] = ()  # a finding at its place in one of these is near
    needs: str = ""  # a variable without which the name is not this cause's
    placement: str = ""  # "SESSION PLACEMENT" of a moved artefact

    @property
    def due(self) -> bool:
        return self.units >= DUE_UNITS


@dataclass(frozen=True)
class Truth:
    kind: str
    seed: int
    words: str
    causes: tuple[Cause, ...]
    given: str = ""  # the model under test: "": made of the same sessions; else of before-*, by
    # "calibrate" or by "diagnose"
    noise_um: float | None = None  # 3-D RMS of the noise alone on further-*
    oracle_um: float | None = None  # of a fit that is told the causes (oracle.py)
    neutral: Names = ()  # true of how it was measured: reported or not, they do not count
    neutral_variables: tuple[str, ...] = ()  # nor does `unknown` in nothing but these
    holdout_given: bool = False
    refusable: str = ""  # a session that a command may refuse, if its message names it
    count_foreign: bool = True  # False: a real arm, of which nobody knows what else is wrong


def rounded(value: float) -> float:
    """To four digits and 0.001, as much as a fit on another processor gives again."""
    return round(float(f"{value:.4g}"), 3)


def write_truth(folder: Path, truth: Truth) -> None:
    text = json.dumps(asdict(truth), indent=1, ensure_ascii=False) + "\n"
    (folder / "truth.json").write_text(text, encoding="utf-8")


def read_truth(folder: Path) -> Truth:
    """Truth of a case's folder."""
    data = json.loads((folder / "truth.json").read_text(encoding="utf-8"))
    causes = tuple(Cause(**_pairs(one, "names", "same_signal")) for one in data.pop("causes"))
    return Truth(causes=causes, **_pairs(data, "neutral"))


def _pairs(data: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    """JSON's lists as tuples, those of *keys* as tuples of pairs."""
    read = {k: tuple(v) if isinstance(v, list) else v for k, v in data.items()}
    return read | {key: tuple((c, where) for c, where in data[key]) for key in keys}


def sessions(folder: Path, prefix: str) -> list[str]:
    """Names of the case's sessions that begin so, in order."""
    return sorted(path.name for path in folder.glob(f"{prefix}-*"))


def digest(folder: Path, truth: bool = True) -> str:
    """SHA-256 of every file of a case, names included; without what only the judge reads, if not
    *truth*."""
    total = hashlib.sha256()
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        if path.name == "truth.json" and not truth:
            continue
        total.update(path.relative_to(folder).as_posix().encode() + b"\0")
        total.update(hashlib.sha256(path.read_bytes()).digest())
    return total.hexdigest()


@dataclass(frozen=True)
class Sums:
    """Of some decimal fractions."""

    size: float
    """Of their absolute values."""
    weighted: tuple[float, ...]
    """Of them, each under other weights."""

    def agrees(self, other: Sums, tolerance: float) -> bool:
        apart = max(abs(a - b) for a, b in zip(self.weighted, other.weighted, strict=True))
        return apart <= tolerance * self.size


@dataclass(frozen=True)
class Fingerprint:
    """What tells a case drawn elsewhere from another one: processors differ in the last digits of
    a sine, and so do the files."""

    text: str
    """First digits of the SHA-256 of all files, their decimal fractions taken out."""
    read: Sums
    """Of the files that a revision reads."""
    judged: Sums
    """Of the truth."""

    def agrees(self, other: Fingerprint) -> bool:
        return (
            self.text == other.text
            and self.read.agrees(other.read, LAST_DIGITS)
            and self.judged.agrees(other.judged, FOURTH_DIGIT)
        )


def fingerprint(folder: Path) -> Fingerprint:
    """Of every file of a case, names included."""
    text, read, judged = hashlib.sha256(), list[str](), list[str]()
    for path in sorted(p for p in folder.rglob("*") if p.is_file()):
        content = path.read_text(encoding="utf-8")
        (judged if path.name == "truth.json" else read).extend(FRACTION.findall(content))
        text.update(path.relative_to(folder).as_posix().encode() + b"\0")
        text.update(FRACTION.sub("#", content).encode() + b"\0")
    return Fingerprint(text.hexdigest()[:16], _sums(read), _sums(judged))


def _sums(fractions: list[str]) -> Sums:
    values = np.array(fractions, dtype=float)
    weights = np.random.default_rng(0).uniform(-1.0, 1.0, (SUMS, len(values)))
    return Sums(float(np.abs(values).sum()), tuple(float(one) for one in weights @ values))
