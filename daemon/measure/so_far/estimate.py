"""Estimates from the readings taken so far, with their uncertainty, and missing readings."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from armd.arrays import F64
from armd.compensation.data.sessions.format import Artefact, SurfaceKind
from armd.compensation.data.sessions.session import load_sessions
from armd.compensation.estimate.placements.rigid_motions import fit_by_kabsch
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.identify.tip import TipFit, fit_in_seat, fit_on_sphere
from armd.compensation.model.arm import Arm
from armd.compensation.verify.spheres import fit_sphere
from armd.compensation.verify.touched import fit_parallel_planes
from armd.daemon.measure.in_use import MeasuredWith
from armd.daemon.measure.plan.stations import Plan
from armd.daemon.measure.so_far.progress import Progress, Reading
from armd.errors import BadInput

#: Points beyond its unknowns that a surface needs for an estimate of its scatter.
SPARE = 2
UNKNOWNS: dict[SurfaceKind, int] = {"plane": 3, "sphere": 4}


def estimate_now(plan: Plan, progress: Progress, in_use: MeasuredWith) -> dict[str, Any]:
    """Estimate quickly after every reading: `text` for a person, and its figures."""
    if plan.kind == "tip":
        return _estimate_tip(plan, progress, in_use)
    return _estimate_scatter(plan, progress)


def identify_so_far(
    folder: Path, arm: Arm, earlier_sessions: Sequence[Path] = ()
) -> dict[str, Any]:
    """Calibrate from the unfinished session in *folder*, with *earlier_sessions*.

    Returns `text`, `enough` and figures. It takes seconds; call it in a thread of the face's own.
    """
    try:
        result = calibrate(load_sessions([*earlier_sessions, folder], arm), arm)
    except BadInput as error:
        text = f"not enough to calibrate yet: found {error.found}, expected {error.expected}"
        return {"text": text, "enough": False}
    unknowns = len(result.fit.unknowns.names)
    words = f"{result.heldout_rms_um:.1f} µm RMS by {result.heldout_by}s left out"
    if result.certificate.granted:
        text = f"enough for geometry: {words}"
    else:
        text = f"not enough for a certificate yet: {result.certificate.reason}"
    if result.thermal_order == 0 and arm.sensors:
        text += "; no thermal terms: they want readings at two temperatures or more"
    return {
        "text": text,
        "enough": result.certificate.granted,
        "heldout_rms_um": result.heldout_rms_um,
        "rms_um": result.rms_um,
        "rank": result.fit.solution.rank,
        "unknowns": unknowns,
        "thermal_order": result.thermal_order,
        "unidentifiable": result.unidentifiable,
    }


def fit_tip_so_far(plan: Plan, readings: Sequence[Reading], in_use: MeasuredWith) -> TipFit:
    """Fit the tip's offset to these readings.

    Raises `ArithmeticError` where they do not determine it.
    """
    if not readings:
        raise ArithmeticError("no readings")
    measurements = [reading.measurement for reading in readings]
    rotation = Rotation.from_quat([m["orientation"] for m in measurements]).as_matrix()
    origin = np.array([m["position_mm"] for m in measurements]) - rotation @ in_use.offset_mm
    if plan.sphere_mm is None:
        return fit_in_seat(origin, rotation)
    return fit_on_sphere(origin, rotation, in_use.offset_mm, plan.sphere_mm)


def _estimate_tip(plan: Plan, progress: Progress, in_use: MeasuredWith) -> dict[str, Any]:
    try:
        calibrated = fit_tip_so_far(plan, progress.readings, in_use)
    except ArithmeticError as error:
        return {"text": f"no tip yet: {error}"}
    offset = ", ".join(f"{value:.3f}" for value in calibrated.offset_mm)
    expanded = ", ".join(f"{2 * value:.3f}" for value in calibrated.uncertainty_mm)
    text = (
        f"offset [{offset}] mm, U = [{expanded}] mm (k = 2), form {calibrated.form_error_mm:.3f} mm"
    )
    return {"text": text, **calibrated.as_json()}


def _estimate_scatter(plan: Plan, progress: Progress) -> dict[str, Any]:
    """Estimate how well the live points repeat at seats, and fit the certified positions."""
    squares, freedom = 0.0, 0
    by_placement: defaultdict[str, list[Reading]] = defaultdict(list)
    for reading in progress.readings:
        by_placement[reading.placement].append(reading)
    for readings in by_placement.values():
        for part, unknowns in _compute_residuals(plan.artefact, readings):
            squares += float((part**2).sum())
            freedom += part.size - unknowns
    if freedom <= 0:
        return {"text": "nothing was measured twice yet", "rms_um": None, "freedom": 0}
    rms_um = 1e3 * math.sqrt(3 * squares / freedom)
    uncertainty_um = rms_um / math.sqrt(2 * freedom)
    return {
        "text": f"the points fit together within {rms_um:.1f} ± {uncertainty_um:.1f} µm RMS (3-D)",
        "rms_um": rms_um,
        "standard_uncertainty_um": uncertainty_um,
        "freedom": freedom,
    }


def _compute_residuals(artefact: Artefact, readings: Sequence[Reading]) -> list[tuple[F64, int]]:
    """Return the residuals of one placement in independent parts.

    The parts are the certified targets, each seat and each surface. Each has residuals in mm, (n,
    3) or on a surface (n,), and the number of its unknowns.
    """
    certified = {
        target.name: target.position_mm for target in artefact.targets if target.position_mm
    }
    parts = []
    placed = [reading for reading in readings if reading.target in certified]
    if len({reading.target for reading in placed}) >= 3:
        local = np.array([certified[reading.target] for reading in placed])
        base = _stack_points(placed)
        group, weight = np.zeros(len(placed), np.int64), np.ones(len(placed))
        rotation, translation = fit_by_kabsch(local, base, weight, group, 1)
        parts.append((base - local @ rotation[0].T - translation[0], 6))
    kinds = artefact.surface_kinds
    for name in {reading.target for reading in readings} - set(certified):
        points = _stack_points([reading for reading in readings if reading.target == name])
        if name in kinds:
            if (part := compute_surface_residuals(kinds[name], points)) is not None:
                parts.append(part)
        elif len(points) > 1:
            parts.append((points - points.mean(axis=0), 3))
    return parts


def _stack_points(readings: Sequence[Reading]) -> F64:
    return np.array([reading.measurement["position_mm"] for reading in readings], dtype=float)


def compute_surface_residuals(kind: SurfaceKind, points_mm: F64) -> tuple[F64, int] | None:
    """Return distances (n,) mm of points (n, 3) from the best surface.

    Also returns the number of its unknowns. Returns None for too few points, and for a cylinder.
    """
    unknowns = UNKNOWNS.get(kind)
    if unknowns is None or len(points_mm) < unknowns + SPARE:
        return None
    if kind == "sphere":
        try:
            centre, radius = fit_sphere(points_mm)
        except ArithmeticError:
            return None
        return np.linalg.norm(points_mm - centre, axis=1) - radius, unknowns
    planes = fit_parallel_planes([points_mm])
    if planes is None:
        return None
    return (points_mm - points_mm.mean(axis=0)) @ planes.normal, unknowns
