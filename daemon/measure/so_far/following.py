"""The next station of a guided measurement, and its coverage, from its progress."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from armd.arrays import F64
from armd.daemon.measure.in_use import MeasuredWith
from armd.daemon.measure.plan.postures import Proposal, choose_designed, propose
from armd.daemon.measure.plan.stations import Plan
from armd.daemon.measure.so_far.coverage import (
    collect_angles,
    count_targets,
    describe_joints,
    describe_temperatures,
)
from armd.daemon.measure.so_far.estimate import estimate_now
from armd.daemon.measure.so_far.progress import Progress
from armd.daemon.measure.so_far.whereabouts import Whereabouts


class Following:
    """The next station and the coverage at one moment.

    It is made again whenever a reading is taken or deleted, or a station is skipped.
    """

    def __init__(self, plan: Plan, progress: Progress, in_use: MeasuredWith) -> None:
        self.station = station = progress.next_station
        self._plan = plan
        arm = in_use.arm
        self.coverage = {
            "targets": count_targets(plan, progress),
            "joints": describe_joints(arm, progress),
            "temperatures": describe_temperatures(arm, progress),
        }
        self.estimate = estimate_now(plan, progress, in_use)
        #: The targets of the station's placement; None where there is no station.
        self.whereabouts: Whereabouts | None = None
        #: Those of earlier placements, as long as nothing was measured in the station's.
        self.earlier: dict[str, Whereabouts] = {}
        self._target_mm: F64 | None = None
        self._posture = Proposal(None, "")
        self._moved = True
        if station is None:
            return
        self.whereabouts = _locate_placement(plan, progress, station.placement)
        self._target_mm = self.whereabouts.get_position(station.target)
        readings = progress.readings
        self._moved = not readings or readings[-1].placement != station.placement
        measured_in = {reading.placement for reading in readings}
        # The bars of a verification may keep a mount in several placements.
        if station.placement not in measured_in and plan.kind != "verify":
            self.earlier = {
                place: _locate_placement(plan, progress, place) for place in measured_in
            }
        to = arm, in_use.constants, self._target_mm
        measured = collect_angles(progress, arm.n_joints)
        if plan.kind == "repeatability":
            self._posture = Proposal(measured[0] if len(measured) else None, "")
        elif station.posture_deg is None:
            self._posture = propose(*to, measured, progress.last_number)
        else:
            self._posture = choose_designed(*to, np.radians(station.posture_deg), measured)

    def distance_mm(self, tip_mm: Sequence[float] | F64) -> float | None:
        """Return the distance from the tip to the next target; None while that is unknown."""
        if self._target_mm is None:
            return None
        away = float(np.linalg.norm(np.asarray(tip_mm, float) - self._target_mm))
        return away if np.isfinite(away) else None

    def as_json(self, tip_mm: Sequence[float] | F64 | None) -> dict[str, Any] | None:
        """Return the next station for a face; None if everything is measured."""
        station = self.station
        if station is None:
            return None
        q = self._posture.q_rad
        return {
            "target": station.target,
            "placement": station.placement,
            "new_placement": self._moved,
            "place": self._plan.place_in_words(station.placement) if self._moved else "",
            "how": station.how,
            "why": self._posture.why,
            "posture_deg": None if q is None else np.degrees(q).tolist(),
            "position_mm": None if self._target_mm is None else self._target_mm.tolist(),
            "distance_mm": None if tip_mm is None else self.distance_mm(tip_mm),
            "near_mm": self._plan.near_mm,
        }


def _locate_placement(plan: Plan, progress: Progress, placement: str) -> Whereabouts:
    points: dict[str, list[list[float]]] = {}
    for reading in progress.readings:
        if reading.placement == placement:
            points.setdefault(reading.target, []).append(reading.measurement["position_mm"])
    measured = {
        name: np.array(target_points, dtype=float) for name, target_points in points.items()
    }
    return Whereabouts(plan.artefact, measured)
