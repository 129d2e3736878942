"""A guided measurement: what to touch next, what is taken, what is refused, and the session of it.

See the package's docstring for how a face drives it.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from armd.compensation.data.session import READINGS
from armd.daemon.measure.coverage import (
    angles_of,
    joints_covered,
    targets_covered,
    temperatures_covered,
)
from armd.daemon.measure.estimate import estimate
from armd.daemon.measure.in_use import InUse
from armd.daemon.measure.kinds import place_in_words
from armd.daemon.measure.log import NAME, Entry, Log, begun
from armd.daemon.measure.postures import Posture, propose
from armd.daemon.measure.progress import Progress
from armd.daemon.measure.refusal import Refusal, judge
from armd.daemon.measure.stations import Plan, Station, parse_plan
from armd.daemon.measure.whereabouts import Whereabouts
from armd.daemon.session_folder import reading_row, write_readings
from armd.errors import BadInput

F64 = npt.NDArray[np.float64]
#: Readings that `state` lists, the last ones.
LISTED = 200


class Measuring:
    """All methods may be called from any thread. Close it, or use it in a `with`."""

    def __init__(self, folder: Path, plan: Plan, in_use: InUse) -> None:
        """Begin in *folder*, or go on there after an interruption.

        Raises `BadInput` for a folder that holds another session, one that another process
        measures into, or one begun with another plan, arm or (kinds that judge it) calibration.
        """
        self.folder, self.plan, self.in_use = folder, plan, in_use
        #: °C of the artefact, as a person read it; goes with the readings from then on
        self.artefact_c: float | None = None
        self._mutex = threading.RLock()
        header = {
            "plan": plan.plain(),
            "arm": in_use.arm.model_dump(mode="json", by_alias=True),
            "calibration": in_use.identity,
            "tip": in_use.tip,
        }
        self._log = Log(folder, header)
        try:
            self._check_same(header)
            self._progress = self._replayed()
            self._what_next()
            in_use.write(folder)
            self._write()
        except BaseException:
            self._log.close()
            raise

    @classmethod
    def resume(cls, folder: Path, in_use: InUse) -> Self:
        """Go on with what *folder* holds; raises `BadInput` where no measurement was begun."""
        header = begun(folder)
        if header is None:
            raise BadInput(folder, "the folder", f"no {NAME}", "one that `armd measure` began")
        return cls(folder, parse_plan(str(folder / NAME), header.get("plan")), in_use)

    def offer(self, measurement: Mapping[str, Any]) -> dict[str, Any]:
        """A measurement as published: taken as the next reading, or refused. On the disk when this
        returns. The answer has `event`: "reading" or "refused", and `text`."""
        with self._mutex:
            measurement = _plain(measurement)
            station = self._progress.next_station
            refusal, row = self._judged(measurement, station)
            if refusal is not None or station is None or row is None:
                reason, text = refusal or Refusal("complete", "")
                refused = {"what": "refused", "reason": reason, "text": text}
                self._happen(refused | {"measurement": measurement})
                wanted = None if station is None else station.target
                return {"event": "refused", "reason": reason, "text": text, "target": wanted}
            number = self._progress.last_number + 1
            entry: Entry = {
                "what": "reading",
                "number": number,
                "station": self._progress.next_index,
                "placement": station.placement,
                "target": station.target,
                "artefact_c": self.artefact_c,
                "measurement": measurement,
            }
            self._happen(entry)
            return {
                "event": "reading",
                "number": number,
                "target": station.target,
                "placement": station.placement,
                "position_mm": measurement["position_mm"],
                "standard_deviation_mm": measurement["standard_deviation_mm"],
                "text": f"{station.target} in {station.placement}",
                **self._counts(),
                "next": self._next(None),
                "estimate": self._estimate["text"],
            }

    def delete_last(self) -> dict[str, Any]:
        """The last reading goes; its station is the next. `event`: "deleted" or "nothing"."""
        with self._mutex:
            if not self._progress.readings:
                return {"event": "nothing", "text": "there is no reading to delete"}
            gone = self._progress.readings[-1]
            self._happen({"what": "deleted", "number": gone.number})
            text = f"reading {gone.number} at {gone.target} deleted"
            return {"event": "deleted", "number": gone.number, "text": text, **self._counts()}

    def again(self) -> dict[str, Any]:
        """The last target once more, beyond the plan. `event`: "again" or "nothing"."""
        with self._mutex:
            if not self._progress.readings:
                return {"event": "nothing", "text": "there is no reading to repeat"}
            self._happen({"what": "again"})
            target = self._progress.readings[-1].target
            return {"event": "again", "target": target, "text": f"{target} once more"}

    def skip(self) -> dict[str, Any]:
        """The next station is left out: it cannot be reached. `event`: "skipped" or "nothing"."""
        with self._mutex:
            station = self._progress.next_index
            if station is None:
                return {"event": "nothing", "text": "there is no station to leave out"}
            self._happen({"what": "skipped", "station": station})
            target = self.plan.stations[station].target
            return {"event": "skipped", "target": target, "text": f"{target} left out"}

    @property
    def complete(self) -> bool:
        """Whether every station has its reading or is left out."""
        with self._mutex:
            return self._progress.next_station is None

    @property
    def progress(self) -> Progress:
        """What was taken; from a thread of its own take it for a moment only."""
        return self._progress

    def state(self, tip_mm: Sequence[float] | F64 | None = None) -> dict[str, Any]:
        """All that a face shows, as plain JSON data; *tip_mm* is where the tip is now, for the
        distance to the target."""
        with self._mutex:
            progress = self._progress
            return {
                "kind": self.plan.kind,
                "serial": self.in_use.arm.serial_number,
                "session": str(self.folder),
                **self._counts(),
                "next": self._next(tip_mm),
                "readings": [
                    {
                        "number": reading.number,
                        "placement": reading.placement,
                        "target": reading.target,
                        "stamp_ns": reading.measurement["stamp_ns"],
                        "position_mm": reading.measurement["position_mm"],
                        "standard_deviation_mm": reading.measurement["standard_deviation_mm"],
                    }
                    for reading in progress.readings[-LISTED:]
                ],
                "coverage": self._coverage,
                "estimate": self._estimate,
                "refusals": dict(progress.refused),
                "artefact_c": self.artefact_c,
            }

    def distance_mm(self, tip_mm: Sequence[float] | F64) -> float | None:
        """From the tip to the next target; None while nobody knows where that is."""
        with self._mutex:
            if self._target_mm is None:
                return None
            away = float(np.linalg.norm(np.asarray(tip_mm, float) - self._target_mm))
            return away if np.isfinite(away) else None

    def finish(self) -> None:
        """The session's folder once more of what was taken; raises `BadInput` if that is nothing.
        `ending.commands` says what is to be made of it."""
        with self._mutex:
            if not self._progress.readings:
                raise BadInput(self.folder, "the session", "no reading", "one at least")
            self._write()

    def close(self) -> None:
        """Nothing more is taken; the folder can be taken up again."""
        with self._mutex:
            self._log.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    # --- what happens ---------------------------------------------------------------------

    def _happen(self, entry: Entry) -> None:
        """The log first: what the folder is made of is never lost."""
        self._log.append(entry)
        self._progress.apply(entry)
        if entry["what"] != "refused":
            self._what_next()
        if entry["what"] in ("reading", "deleted"):
            self._write()

    def _replayed(self) -> Progress:
        progress = Progress(self.plan)
        for number, entry in enumerate(self._log.past, 2):
            try:
                progress.apply(entry)
            except (KeyError, TypeError, ValueError) as error:
                found = f"{type(error).__name__}: {error}"
                expected = "what can follow the lines before"
                raise BadInput(self.folder / NAME, f"line {number}", found, expected) from error
        return progress

    def _check_same(self, header: Mapping[str, Any]) -> None:
        """A session goes on as it was begun."""
        path, then = self.folder / NAME, self._log.header
        same = ["arm", *(("calibration", "tip") if self.plan.within_calibration else ())]
        for key in ("plan", *same):
            if then.get(key) != json.loads(json.dumps(header[key])):
                found = f"a session begun with another {key}"
                raise BadInput(path, key, found, "the same, or a new folder")

    def _judged(
        self, measurement: Mapping[str, Any], station: Station | None
    ) -> tuple[Refusal | None, dict[str, Any] | None]:
        """A refusal, or the row that the measurement would be."""
        try:
            where = self._whereabouts, self._earlier
            refusal = judge(measurement, self.plan, self._progress, station, *where)
            refusal = refusal or self._changed(measurement)
            if refusal is not None or station is None:
                return refusal, None
            return None, self._row(measurement, 0, station.placement, station.target)
        except (KeyError, TypeError, ValueError) as error:
            return Refusal("invalid", f"no measurement of armd's: {error!r}"), None

    def _changed(self, measurement: Mapping[str, Any]) -> Refusal | None:
        """Where the arm is judged as it is calibrated, that must not change under way."""
        if not self.plan.within_calibration:
            return None
        for key, then in (("calibration", self.in_use.identity), ("tip", self.in_use.tip)):
            if measurement[key] != then:
                return Refusal("changed", f"the {key} in use has changed since the session began")
        return None

    # --- what follows from it -------------------------------------------------------------

    def _what_next(self) -> None:
        progress, station = self._progress, self._progress.next_station
        arm = self.in_use.arm
        self._coverage = {
            "targets": targets_covered(self.plan, progress),
            "joints": joints_covered(arm, progress),
            "temperatures": temperatures_covered(arm, progress),
        }
        self._estimate = estimate(self.plan, progress, self.in_use)
        self._whereabouts: Whereabouts | None = None
        self._earlier: dict[str, Whereabouts] = {}
        self._target_mm: F64 | None = None
        self._posture = Posture(None, "")
        if station is None:
            return
        self._whereabouts = self._placed(station.placement)
        self._target_mm = self._whereabouts.of(station.target)
        measured_in = {reading.placement for reading in progress.readings}
        # The bars of a verification may share a mount from placement to placement.
        if station.placement not in measured_in and self.plan.kind != "verify":
            self._earlier = {placement: self._placed(placement) for placement in measured_in}
        if station.posture_deg is not None:
            self._posture = Posture(np.radians(station.posture_deg), "a pose of `armd design`")
        else:
            measured = angles_of(progress, arm.n_joints)
            constants, seed = self.in_use.constants, progress.last_number
            self._posture = propose(arm, constants, self._target_mm, measured, seed)

    def _placed(self, placement: str) -> Whereabouts:
        points: dict[str, list[list[float]]] = {}
        for reading in self._progress.readings:
            if reading.placement == placement:
                points.setdefault(reading.target, []).append(reading.measurement["position_mm"])
        measured = {name: np.array(seen, dtype=float) for name, seen in points.items()}
        return Whereabouts(self.plan.artefact, measured)

    def _counts(self) -> dict[str, Any]:
        progress = self._progress
        return {
            "taken": len(progress.readings),
            "done": progress.done,
            "wanted": len(self.plan.stations),
            "left_out": len(progress.skipped),
            "complete": progress.next_station is None,
        }

    def _next(self, tip_mm: Sequence[float] | F64 | None) -> dict[str, Any] | None:
        station = self._progress.next_station
        if station is None:
            return None
        readings = self._progress.readings
        moved = not readings or readings[-1].placement != station.placement
        q = self._posture.q_rad
        return {
            "target": station.target,
            "placement": station.placement,
            "new_placement": moved,
            "place": place_in_words(self.plan, station.placement) if moved else "",
            "how": station.how,
            "why": self._posture.why,
            "posture_deg": None if q is None else np.degrees(q).tolist(),
            "position_mm": None if self._target_mm is None else self._target_mm.tolist(),
            "distance_mm": None if tip_mm is None else self.distance_mm(tip_mm),
            "near_mm": self.plan.near_mm,
        }

    # --- the session's folder -------------------------------------------------------------

    def _write(self) -> None:
        readings = self._progress.readings
        if not readings:
            for name in ("session.toml", *READINGS):
                (self.folder / name).unlink(missing_ok=True)
            return
        started_s = min(reading.measurement["stamp_ns"] for reading in readings) // 10**9
        rows = [
            self._row(r.measurement, started_s, r.placement, r.target, r.artefact_c)
            for r in readings
        ]
        artefact = self.plan.artefact.model_dump(by_alias=True, exclude_defaults=True)
        write_readings(self.folder, self.in_use.arm, artefact, started_s, rows)

    def _row(
        self,
        measurement: Mapping[str, Any],
        started_s: int,
        placement: str,
        target: str,
        artefact_c: float | None = None,
    ) -> dict[str, str | float]:
        row = reading_row(measurement, self.in_use.arm, started_s, placement, target)
        if any(reading.artefact_c is not None for reading in self._progress.readings):
            row["artefact_c"] = float("nan") if artefact_c is None else artefact_c
        return row


def _plain(measurement: Mapping[str, Any]) -> Any:
    """As JSON that Python and others read alike: what it cannot carry is told as text."""
    try:
        return json.loads(json.dumps(dict(measurement), allow_nan=False))
    except (TypeError, ValueError):
        return {"unreadable": repr(measurement)[:1000]}
