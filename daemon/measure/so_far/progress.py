"""The progress of a guided measurement: a pure fold over the entries of its log.

An entry's `what` is one of

- `reading`: `number` (never used twice), `station` (index into the plan; None: a repetition), the
  `placement` and `target` measured, `artefact_c`, and the `measurement` as published;
- `deleted`: `number` of the deleted reading;
- `again`: the next reading repeats the last one's target;
- `skipped`: a `station` that is skipped;
- `artefact_c`: the artefact's temperature as a person read it, which later readings get (None: it
  is unknown from then on);
- `refused`: `reason`, `text`, and the `measurement`. It changes only a count, and a measurement
  that is too far off is stored until an entry other than `refused` or `artefact_c`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from armd.daemon.measure.plan.stations import Plan, Station


@dataclass(frozen=True)
class Reading:
    """A reading that was taken and not deleted."""

    number: int
    station: int | None
    placement: str
    target: str
    artefact_c: float | None
    measurement: Mapping[str, Any]


class Progress:
    """The progress, which only `apply` changes."""

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self.readings: list[Reading] = []
        self.refused: Counter[str] = Counter()
        self.skipped: set[int] = set()
        self.last_number = 0
        self.artefact_c: float | None = None
        #: The last measurement refused as too far off, if nothing was taken or deleted since.
        self.last_too_far: Mapping[str, Any] | None = None
        self._filled: set[int] = set()
        self._again: Station | None = None

    def apply(self, entry: Mapping[str, Any]) -> None:
        """Apply an entry; raises `ValueError` or `KeyError` if it cannot follow the others."""
        last_too_far = None
        match entry["what"]:
            case "reading":
                self._take(entry)
            case "deleted":
                self._delete(entry["number"])
            case "again":
                self._again = self._last_station()
            case "skipped":
                self._skip(entry["station"])
            case "artefact_c":
                self.artefact_c, last_too_far = entry["artefact_c"], self.last_too_far
            case "refused":
                self.refused[str(entry["reason"])] += 1
                last_too_far = (
                    entry["measurement"] if entry["reason"] == "too_far" else self.last_too_far
                )
            case other:
                raise ValueError(f"{other!r}, which is nothing that happens")
        self.last_too_far = last_too_far

    @property
    def next_index(self) -> int | None:
        """The index of the next station; None: the last one is repeated, or there is none."""
        if self._again is not None:
            return None
        done = self._filled | self.skipped
        return next((i for i in range(len(self._plan.stations)) if i not in done), None)

    @property
    def next_station(self) -> Station | None:
        """The next station; None: everything is measured."""
        if self._again is not None:
            return self._again
        index = self.next_index
        return None if index is None else self._plan.stations[index]

    @property
    def done(self) -> int:
        """The number of stations that have their reading."""
        return len(self._filled)

    def _take(self, entry: Mapping[str, Any]) -> None:
        number, station = entry["number"], entry["station"]
        if number != self.last_number + 1:
            raise ValueError(f"reading {number} after {self.last_number}")
        if station != self.next_index or self.next_station is None:
            raise ValueError(f"a reading of station {station}, not of {self.next_index}")
        reading = Reading(
            number,
            station,
            entry["placement"],
            entry["target"],
            entry["artefact_c"],
            entry["measurement"],
        )
        self.last_number = number
        self.readings.append(reading)
        if station is not None:
            self._filled.add(station)
        self._again = None

    def _delete(self, number: int) -> None:
        if not self.readings or self.readings[-1].number != number:
            raise ValueError(f"reading {number} deleted, which is not the last")
        gone = self.readings.pop()
        if gone.station is not None:
            self._filled.discard(gone.station)
        self._again = None

    def _skip(self, station: int) -> None:
        if station != self.next_index:
            raise ValueError(f"station {station} left out, which is not the next")
        self.skipped.add(station)

    def _last_station(self) -> Station:
        if not self.readings:
            raise ValueError("once more, and nothing was measured")
        last = self.readings[-1]
        how = "once more, the arm in another posture"
        return Station(placement=last.placement, target=last.target, how=how)
