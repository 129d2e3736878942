"""A guided measurement: the next target, readings, refusals, and the session.

See the package's docstring for how a face drives it.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from armd.arrays import F64
from armd.closing import Closing
from armd.compensation.data.sessions.files import READINGS
from armd.daemon.files.session_folder import make_reading_row, write_readings
from armd.daemon.measure.in_use import MeasuredWith
from armd.daemon.measure.log import NAME, Entry, Log, load_beginning
from armd.daemon.measure.plan.stations import Plan, Station, parse_plan
from armd.daemon.measure.refusal import Refusal, judge, refuse_changed
from armd.daemon.measure.so_far.following import Following
from armd.daemon.measure.so_far.progress import Progress
from armd.errors import BadInput

#: `state` lists the last readings, at most so many.
LISTED = 200


class Measuring(Closing):
    """A guided measurement; any thread may call its methods.

    Close it, or use it in a `with`.
    """

    def __init__(self, folder: Path, plan: Plan, in_use: MeasuredWith) -> None:
        """Begin in *folder*, or continue there after an interruption.

        Raises `BadInput` for a folder that holds another session, one that another process measures
        into, or one begun with another plan, arm or (kinds that judge it) calibration.
        """
        self.folder, self.plan, self.in_use = folder, plan, in_use
        self._mutex = threading.RLock()
        header = {
            "plan": plan.to_json(),
            "arm": in_use.arm.model_dump(mode="json", by_alias=True),
            "calibration": in_use.identity,
            "tip": in_use.tip,
            "tip_offset_mm": in_use.offset_mm.tolist(),
        }
        self._log = Log(folder, header)
        try:
            self._check_same(header)
            self._progress = self._replayed()
            self._following = Following(plan, self._progress, in_use)
            in_use.write(folder)
            self._write()
        except BaseException:
            self._log.close()
            raise

    @classmethod
    def resume(cls, folder: Path, in_use: MeasuredWith) -> Self:
        """Continue the measurement in *folder*; raises `BadInput` if there is none."""
        header = load_beginning(folder)
        if header is None:
            raise BadInput(folder, "the folder", f"no {NAME}", "one that `armd measure` began")
        return cls(folder, parse_plan(str(folder / NAME), header.get("plan")), in_use)

    def offer(self, measurement: Mapping[str, Any]) -> dict[str, Any]:
        """Take a measurement as published as the next reading, or refuse it.

        It is on the disk when this returns. The answer has `event`: "reading" or "refused", and
        `text`.
        """
        with self._mutex:
            measurement = _as_plain_json(measurement)
            station = self._progress.next_station
            refusal, row = self._judged(measurement, station)
            if refusal is not None or station is None or row is None:
                reason, text = refusal or Refusal("complete", "")
                refused = {"what": "refused", "reason": reason, "text": text}
                self._happen(refused | {"measurement": measurement})
                target = None if station is None else station.target
                return {"event": "refused", "reason": reason, "text": text, "target": target}
            number = self._progress.last_number + 1
            entry: Entry = {
                "what": "reading",
                "number": number,
                "station": self._progress.next_index,
                "placement": station.placement,
                "target": station.target,
                "artefact_c": self._progress.artefact_c,
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
                "next": self._following.as_json(None),
                "estimate": self._following.estimate["text"],
            }

    def delete_last(self) -> dict[str, Any]:
        """Delete the last reading; its station is the next.

        `event`: "deleted" or "nothing".
        """
        with self._mutex:
            if not self._progress.readings:
                return {"event": "nothing", "text": "there is no reading to delete"}
            gone = self._progress.readings[-1]
            self._happen({"what": "deleted", "number": gone.number})
            text = f"reading {gone.number} at {gone.target} deleted"
            return {"event": "deleted", "number": gone.number, "text": text, **self._counts()}

    def again(self) -> dict[str, Any]:
        """Repeat the last target, beyond the plan. `event`: "again" or "nothing"."""
        with self._mutex:
            if not self._progress.readings:
                return {"event": "nothing", "text": "there is no reading to repeat"}
            self._happen({"what": "again"})
            target = self._progress.readings[-1].target
            return {"event": "again", "target": target, "text": f"{target} once more"}

    def skip(self) -> dict[str, Any]:
        """Skip the next station, which cannot be reached. `event`: "skipped" or "nothing"."""
        with self._mutex:
            station = self._progress.next_index
            if station is None:
                return {"event": "nothing", "text": "there is no station to leave out"}
            self._happen({"what": "skipped", "station": station})
            target = self.plan.stations[station].target
            return {"event": "skipped", "target": target, "text": f"{target} left out"}

    def set_artefact_c(self, artefact_c: float | None) -> dict[str, Any]:
        """Set the artefact's temperature in °C, as a person read it.

        Later readings get it. `event`: "artefact_c".
        """
        with self._mutex:
            if artefact_c != self._progress.artefact_c:
                self._happen({"what": "artefact_c", "artefact_c": artefact_c})
            words = "not known" if artefact_c is None else f"at {artefact_c:g} °C"
            return {"event": "artefact_c", "text": f"the artefact is {words} from now on"}

    @property
    def complete(self) -> bool:
        """Whether every station has its reading or is skipped."""
        with self._mutex:
            return self._progress.next_station is None

    @property
    def progress(self) -> Progress:
        """The readings taken and the state; other threads must use it only for a moment."""
        return self._progress

    def state(self, tip_mm: Sequence[float] | F64 | None = None) -> dict[str, Any]:
        """Return everything that a face shows, as plain JSON data.

        *tip_mm* is the tip's present position, for the distance to the target.
        """
        with self._mutex:
            progress = self._progress
            return {
                "kind": self.plan.kind,
                "serial": self.in_use.arm.serial_number,
                "session": str(self.folder),
                **self._counts(),
                "next": self._following.as_json(tip_mm),
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
                "coverage": self._following.coverage,
                "estimate": self._following.estimate,
                "refusals": dict(progress.refused),
                "artefact_c": progress.artefact_c,
            }

    def distance_mm(self, tip_mm: Sequence[float] | F64) -> float | None:
        """Return the distance from the tip to the next target; None while that is unknown."""
        with self._mutex:
            return self._following.distance_mm(tip_mm)

    def finish(self) -> None:
        """Write the session's folder again; raises `BadInput` without a reading.

        `ending.list_commands` lists the commands that follow.
        """
        with self._mutex:
            if not self._progress.readings:
                raise BadInput(self.folder, "the session", "no reading", "one at least")
            self._write()

    def close(self) -> None:
        """Take no more readings; the measurement can be resumed."""
        with self._mutex:
            self._log.close()

    # --- what happens ---------------------------------------------------------------------

    def _happen(self, entry: Entry) -> None:
        """Write an entry to the log, from which the folder can be rebuilt, then apply it."""
        self._log.append(entry)
        self._progress.apply(entry)
        if entry["what"] not in ("refused", "artefact_c"):
            self._following = Following(self.plan, self._progress, self.in_use)
        if entry["what"] in ("reading", "deleted"):
            self._write()

    def _replayed(self) -> Progress:
        progress = Progress(self.plan)
        for number, entry in enumerate(self._log.past, 2):
            try:
                progress.apply(entry)
            except (KeyError, TypeError, ValueError) as error:
                problem = f"{type(error).__name__}: {error}"
                expected = "what can follow the lines before"
                raise BadInput(self.folder / NAME, f"line {number}", problem, expected) from error
        return progress

    def _check_same(self, header: Mapping[str, Any]) -> None:
        """Check that a resumed session has the same plan, arm and calibration."""
        path, then = self.folder / NAME, self._log.header
        judged = ("calibration", "tip", "tip_offset_mm") if self.plan.within_calibration else ()
        for key in ("plan", "arm", *judged):
            if key in then and then[key] != json.loads(json.dumps(header[key])):
                problem = f"a session begun with another {key}"
                raise BadInput(path, key, problem, "the same, or a new folder")

    def _judged(
        self, measurement: Mapping[str, Any], station: Station | None
    ) -> tuple[Refusal | None, dict[str, Any] | None]:
        """Return a refusal, or the row of the measurement."""
        try:
            surroundings = self._following.whereabouts, self._following.earlier
            refusal = judge(measurement, self.plan, self._progress, station, *surroundings)
            refusal = refusal or refuse_changed(measurement, self.plan, self.in_use)
            if refusal is not None or station is None:
                return refusal, None
            return None, self._row(measurement, 0, station.placement, station.target)
        except (KeyError, TypeError, ValueError) as error:
            return Refusal("invalid", f"no measurement of armd's: {error!r}"), None

    def _counts(self) -> dict[str, Any]:
        progress = self._progress
        return {
            "taken": len(progress.readings),
            "done": progress.done,
            "wanted": len(self.plan.stations),
            "left_out": len(progress.skipped),
            "complete": progress.next_station is None,
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
        row = make_reading_row(measurement, self.in_use.arm, started_s, placement, target)
        if any(reading.artefact_c is not None for reading in self._progress.readings):
            row["artefact_c"] = float("nan") if artefact_c is None else artefact_c
        return row


def _as_plain_json(measurement: Mapping[str, Any]) -> Any:
    """Return plain JSON data, which any reader accepts; other content becomes text."""
    try:
        return json.loads(json.dumps(dict(measurement), allow_nan=False))
    except (TypeError, ValueError):
        return {"unreadable": repr(measurement)[:1000]}
