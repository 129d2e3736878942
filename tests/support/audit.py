"""Holds every published point against the simulator's truth log.

Each point must be a latch that was made, once, in order, near the truth or flagged; each latch
that is missing must have a reason.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from armd import Flag
from support.simulated_arm import TRUTH

#: A point further from the truth than this is wrong; noise is 3 µm, a damaged count far more.
WRONG_MM = 0.2
#: Temperatures in doubt excuse as much as 5 K of error in a sensor does, and no more.
DOUBTFUL_MM = 0.5
DOUBT = Flag.TEMPERATURE_RANGE | Flag.TEMPERATURE_STALE | Flag.TEMPERATURE_RATE
#: Faults after which the daemon has to find the arm again, and for how long that excuses a gap.
RECOVERY_S = {"silence": 1.0, "reboot": 1.5, "unplug": 2.0}
IN_PORT_S = 0.1  # a port that goes takes with it what was on its way
SPOILT = {"joint_invalid": 0, "count_jump": 5}  # and so many samples after it


@dataclass
class Audit:
    """Feed it batches as they come, then ask for the `report`."""

    truth_path: Path
    rate_hz: int
    delivered: int = 0
    flagged: Counter[str] = field(default_factory=Counter)
    faults: Counter[str] = field(default_factory=Counter)  # points that ought not to be
    max_error_um: float = 0.0  # of points without a doubt about temperature
    _waiting: list[tuple[int, np.ndarray]] = field(default_factory=list)
    _read_to: int = 0
    _truth: np.ndarray = field(default_factory=lambda: np.empty(0, TRUTH))
    _last_seq: int | None = None
    _missing: list[np.ndarray] = field(default_factory=list)
    _resumed: list[tuple[int, int]] = field(default_factory=list)  # seq after a gap, arrival ns
    _invalid: list[np.ndarray] = field(default_factory=list)

    def take(self, points: np.ndarray, arrival_ns: int) -> None:
        """Points (n,) of `armd.POINT` in the order in which they came."""
        self._waiting.append((arrival_ns, points))

    def settle(self) -> None:
        """Judge the points whose truth is known by now; the log is a moment behind."""
        self._read_truth()
        while self._waiting and len(self._truth):
            arrival_ns, points = self._waiting[0]
            if points["seq"].max() > self._truth["seq"][-1]:
                return
            del self._waiting[0]
            self._judge(points, arrival_ns)

    def report(self, log: list[dict[str, Any]]) -> dict[str, Any]:
        """Figures, given the simulator's fault log; call it when everything has settled."""
        missing = np.concatenate([np.empty(0, np.int64), *self._missing])
        reasons, unexplained = self._explain(missing, log)
        spoilt = self._spoilt(log)
        invalid = np.concatenate([np.empty(0, np.int64), *self._invalid])
        unexplained_invalid = [seq for seq in invalid.tolist() if seq not in spoilt]
        faults = Counter(self.faults)
        faults["unsettled"] = sum(len(points) for _, points in self._waiting)
        return {
            "delivered": self.delivered,
            "withheld": dict(sorted(reasons.items())),
            "published_invalid": len(invalid),
            "flagged": dict(sorted(self.flagged.items())),
            "wrong": sum(faults.values()),
            "wrong_by_kind": {kind: count for kind, count in faults.items() if count},
            "unexplained": len(unexplained) + len(unexplained_invalid),
            "unexplained_seq": [*unexplained[:10], *unexplained_invalid[:10]],
            "max_error_um": round(self.max_error_um, 1),
            "longest_recovery_s": self._recoveries(log),
        }

    # points

    def _judge(self, points: np.ndarray, arrival_ns: int) -> None:
        self.delivered += len(points)
        seq = points["seq"].astype(np.int64)
        flags = points["flags"]
        for flag in Flag:
            self.flagged[str(flag.name)] += int(np.count_nonzero(flags & flag))
        before = np.concatenate([[seq[0] - 1 if self._last_seq is None else self._last_seq], seq])
        self.faults["repeated or out of order"] += int(np.count_nonzero(np.diff(before) <= 0))
        gaps = np.diff(before) != 1
        lost = (flags & Flag.SAMPLES_LOST) != 0
        self.faults["flag 6 where nothing is lost"] += int(np.count_nonzero(lost & ~gaps))
        self.faults["flag 6 missing"] += int(np.count_nonzero(gaps & ~lost))
        for i in np.flatnonzero(gaps):
            self._note_gap(int(before[i]), int(seq[i]), arrival_ns)
        self._last_seq = int(seq[-1])
        row = np.searchsorted(self._truth["seq"], seq)
        known = self._truth["seq"][row] == seq
        self.faults["invented"] += int(np.count_nonzero(~known))
        self._measure(points[known], self._truth["position_mm"][row[known]])
        self._truth = self._truth[row[-1] :]

    def _measure(self, points: np.ndarray, true_mm: np.ndarray) -> None:
        error_mm = np.linalg.norm(points["position_mm"] - true_mm, axis=1)
        invalid = (points["flags"] & Flag.INVALID) != 0
        self._invalid.append(points["seq"][invalid].astype(np.int64))
        self.faults["invalid, yet a position"] += int(np.isfinite(error_mm[invalid]).sum())
        self.faults["valid, yet no position"] += int((~np.isfinite(error_mm[~invalid])).sum())
        doubtful = (points["flags"] & DOUBT) != 0
        limit_mm = np.where(doubtful, DOUBTFUL_MM, WRONG_MM)
        self.faults["far from the truth"] += int(np.count_nonzero((error_mm > limit_mm) & ~invalid))
        sure_mm = error_mm[~invalid & ~doubtful]
        if len(sure_mm):
            self.max_error_um = max(self.max_error_um, 1e3 * float(sure_mm.max()))

    def _note_gap(self, last: int, after: int, arrival_ns: int) -> None:
        seq = self._truth["seq"].astype(np.int64)
        self._missing.append(seq[(seq > last) & (seq < after)])
        self._resumed.append((after, arrival_ns))

    def _read_truth(self) -> None:
        with self.truth_path.open("rb") as file:
            file.seek(self._read_to)
            data = file.read()
        whole = len(data) // TRUTH.itemsize * TRUTH.itemsize
        self._read_to += whole
        self._truth = np.concatenate([self._truth, np.frombuffer(data[:whole], TRUTH)])

    # reasons

    def _explain(
        self, missing: np.ndarray, log: list[dict[str, Any]]
    ) -> tuple[Counter[str], list[int]]:
        reasons: Counter[str] = Counter()
        left = missing
        for line in log:
            if line["event"] == "withheld":
                inside = (left >= line["first_seq"]) & (left <= line["last_seq"])
                reasons[line["reason"]] += int(inside.sum())
                left = left[~inside]
        for begin, end in _spans(log):
            if begin["fault"] in RECOVERY_S:
                first = begin["seq"] - IN_PORT_S * self.rate_hz
                last = end["seq"] + RECOVERY_S[begin["fault"]] * self.rate_hz
                inside = (left >= first) & (left <= last)
                reasons[f"finding the arm again after {begin['fault']}"] += int(inside.sum())
                left = left[~inside]
        return Counter({k: v for k, v in reasons.items() if v}), left.tolist()

    def _spoilt(self, log: list[dict[str, Any]]) -> set[int]:
        return {
            seq
            for begin, end in _spans(log)
            if begin["fault"] in SPOILT
            for seq in range(begin["seq"], end["seq"] + SPOILT[begin["fault"]])
        }

    def _recoveries(self, log: list[dict[str, Any]]) -> dict[str, float]:
        """Longest time from a fault's end to the arrival of the first point after it."""
        longest: dict[str, float] = {}
        for begin, end in _spans(log):
            after = [ns for seq, ns in self._resumed if seq >= end["seq"]]
            if begin["fault"] in RECOVERY_S and after:
                took_s = (after[0] - end["monotonic_ns"]) * 1e-9
                longest[begin["fault"]] = round(max(took_s, longest.get(begin["fault"], 0.0)), 3)
        return longest


def _spans(log: list[dict[str, Any]]) -> list[tuple[dict[str, Any], dict[str, Any]]]:
    """Begin and end of each fault; one that was still on at the stop ends there."""
    spans = []
    for i, line in enumerate(log):
        if line["event"] == "begin":
            later = (
                other
                for other in log[i + 1 :]
                if other["event"] == "stop"
                or (other["event"] == "end" and other["fault"] == line["fault"])
            )
            spans.append((line, next(later)))
    return spans
