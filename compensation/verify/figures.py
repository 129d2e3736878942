"""Compute the figures of ISO 10360-12:2016 and ASME B89.4.22 from one session.

The names of a session's targets determine its tests (docs/how-to/verify.md). A test whose readings
are incomplete is skipped, with the reason. Lengths are compared at the artefact's temperature, by
its certified expansion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np
from threadpoolctl import threadpool_limits

from armd.arrays import F64
from armd.compensation.data.correction.overflow import find_overflows, refuse_overflow
from armd.compensation.data.sessions.session import Session
from armd.compensation.data.soundness.soundness import find_still_and_far
from armd.compensation.kernel.model import Model
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import LoadedCalibration
from armd.compensation.verify.limits import TestUncertainty
from armd.compensation.verify.readings import SPHERE, NotSupported, VerifiedReadings
from armd.compensation.verify.results import Deviation, Figure, Verification
from armd.compensation.verify.spheres import find_smallest_sphere, fit_sphere

ISO, ASME = "ISO 10360-12:2016", "ASME B89.4.22-2004"
CERTIFICATE = "the certificate"
BLOCK = "block_length"  # not in a standard: reported as missing only if it has a limit
POSITIONS = ("SPHERE1", "SPHERE2")


def correct_positions(session: Session, arm: Arm, calibration: LoadedCalibration | None) -> F64:
    """Return corrected points (n, 3) mm; NaN where a temperature is missing.

    Raises `BadInput` where the calibration makes points that are not finite.
    """
    model, states = Model(arm, calibration), session.states
    slow = model.slow_values(states)
    position, _ = model.correct_rows(states, slow)
    overflow = find_overflows(position) & np.isfinite(slow).all(axis=1)
    refuse_overflow(str(session.path), np.arange(session.n), overflow)
    return position


def evaluate_figures(
    session: Session, arm: Arm, position: F64, test: TestUncertainty, *, complete: bool = True
) -> Verification:
    """Compute all figures of corrected points (n, 3) mm, one per reading; NaN for a failed one.

    Unless *complete*, single-point articulation uses the seats that were measured, and remarks name
    those that were not.
    """
    readings = VerifiedReadings(session, arm, position, test, complete)
    figures: list[Figure] = []
    left_out: dict[str, str] = {}
    # The matrices are small: the library's own threads cost more than they gain.
    with threadpool_limits(limits=1, user_api="blas"):
        for keys, evaluate in TESTS.items():
            try:
                figures += evaluate(readings)
            except (NotSupported, ArithmeticError) as reason:
                left_out |= dict.fromkeys(keys, str(reason))
    remarks = [
        *session.remarks,
        *readings.list_without_position(),
        *dict.fromkeys(readings.remarks),
    ]
    remarks += [
        f"{name}: {celsius:g} °C in every row, far from all other temperatures: does it show any?"
        for name, celsius in find_still_and_far(session, arm)
    ]
    if session.artefact.expansion_per_k and not np.isfinite(session.artefact_c).any():
        remarks.append("no artefact_c: the artefact is taken to be at its reference temperature")
    return Verification(tuple(figures), left_out, tuple(remarks), tuple(readings.list_far_off()))


def _evaluate_sphere_size(readings: VerifiedReadings) -> Iterator[Figure]:
    """Compute P_Size: 25 points on the sphere, in two positions."""
    if touched := readings.list_spheres():
        yield Figure("p_size", "P_Size", ISO, tuple(map(readings.compute_size_error, touched)))
        return
    diameter, uncertainty = readings.compute_length(readings.get_certified(SPHERE))
    size = []
    for position in POSITIONS:
        _, radius = fit_sphere(readings.get_one_per_target(f"{position}.", 25))
        error = 2 * (radius - readings.tip_radius_mm) - diameter
        size.append(Deviation(position, error, uncertainty))
    yield Figure("p_size", "P_Size", ISO, tuple(size))


def _evaluate_sphere_form(readings: VerifiedReadings) -> Iterator[Figure]:
    """Compute P_Form from the points of P_Size; no certified diameter is needed."""
    form = []
    touched = [(sphere.label, sphere.points_mm) for sphere in readings.list_spheres()]
    named = ((label, readings.get_one_per_target(f"{label}.", 25)) for label in POSITIONS)
    for label, points in touched or named:
        offsets = points - fit_sphere(points)[0]
        distance = np.linalg.norm(offsets, axis=1)
        spread = float(distance.max() - distance.min())
        form.append(Deviation(label, spread, readings.test.sphere_form_mm, offsets_mm=offsets))
    yield Figure("p_form", "P_Form", ISO, tuple(form))


def _evaluate_location(readings: VerifiedReadings) -> Iterator[Figure]:
    """Compute L_Dia.5×5: the sphere's centre from five points in each of five orientations."""
    centres = np.array(
        [fit_sphere(readings.get_one_per_target(f"LDIA.{k}.", 5))[0] for k in range(1, 6)]
    )
    diameter = 2 * find_smallest_sphere(centres)[1]
    # A point displaced by the sphere's form error moves the centre of five by about as much.
    deviation = Deviation("5 orientations", diameter, readings.test.sphere_form_mm)
    yield Figure("l_dia", "L_Dia.5×5", ISO, (deviation,))


def _evaluate_lengths(readings: VerifiedReadings) -> Iterator[Figure]:
    """Compute E_Uni: five lengths in seven placements, three repeats."""
    placements = readings.list_placements("L0")
    if len(placements) < 7:
        raise NotSupported(f"{len(placements)} of 7 placements of the length bar L0 … L5")
    deviations = []
    for placement in placements:
        start = readings.get_repeats("L0", placement, 3)
        for i in range(1, 6):
            distance = readings.get_certified(("L0", f"L{i}"))
            end = readings.get_repeats(f"L{i}", placement, 3)
            if min(len(start), len(end)) < 3:
                raise NotSupported(f"{min(len(start), len(end))} of 3 repeats in {placement}")
            length, uncertainty = readings.compute_length(distance, placement)
            for repeat in range(3):
                measured = float(np.linalg.norm(end[repeat] - start[repeat]))
                label = f"{placement} L{i} repeat {repeat + 1}"
                error = measured - length
                deviations.append(Deviation(label, error, uncertainty, length, placement))
    yield Figure("e_uni", "E_Uni", ISO, tuple(deviations))


def _evaluate_block_lengths(readings: VerifiedReadings) -> Iterator[Figure]:
    """Compute the errors of gauge blocks: the distance of parallel planes, in each placement."""
    errors = tuple(readings.iterate_block_errors())
    if not errors:
        raise NotSupported("no two planes with a certified length between them were touched")
    yield Figure(BLOCK, "Block length", CERTIFICATE, errors)


def _evaluate_effective_diameter(readings: VerifiedReadings) -> Iterator[Figure]:
    """Compute the effective diameter: nine points on the sphere, three repeats."""
    diameter, uncertainty = readings.compute_length(readings.get_certified(SPHERE))
    deviations = []
    for repeat in (1, 2, 3):
        _, radius = fit_sphere(readings.get_one_per_target(f"EFFDIA.{repeat}.", 9))
        error = 2 * (radius - readings.tip_radius_mm) - diameter
        deviations.append(Deviation(f"repeat {repeat}", error, uncertainty))
    yield Figure("effective_diameter", "Effective diameter", ASME, tuple(deviations))


def _evaluate_articulation(readings: VerifiedReadings) -> Iterator[Figure]:
    """Compute single-point articulation: ten readings of a seat in each of three zones of the
    reach.
    """
    largest, spread = [], []
    missing = []
    for seat in ("SPAT1", "SPAT2", "SPAT3"):
        points = readings.get_points(seat)
        if len(points) < 10:
            missing.append(f"{len(points)} of 10 articulations in {seat}")
            if readings.complete:
                raise NotSupported(missing[0])
            continue
        offsets = points - points.mean(axis=0)
        distance = np.linalg.norm(offsets, axis=1)
        deviation = math.sqrt(float((distance**2).sum()) / (len(points) - 1))
        farthest = float(distance.max())
        largest.append(Deviation(seat, farthest, readings.test.seat_mm, offsets_mm=offsets))
        spread.append(Deviation(seat, 2 * deviation, readings.test.seat_mm))
        if not readings.complete:  # with points alone: the figure that makers' routines show
            half = ", ".join(f"{x:.1f}" for x in 500.0 * np.ptp(points, axis=0))
            readings.remarks.append(f"{seat}: half of the range in x, y, z: {half} µm")
    if not largest:
        raise NotSupported(missing[0])
    readings.remarks += [f"{text}: ASME B89.4.22 wants three seats" for text in missing]
    yield Figure("spat_max", "SPAT max δ", ASME, tuple(largest))
    yield Figure("spat_2s", "SPAT 2s", ASME, tuple(spread))


def _evaluate_volumetric(readings: VerifiedReadings) -> Iterator[Figure]:
    """Compute the volumetric figures: twenty placements of two bars."""
    deviations = []
    for bar in ("BARS", "BARL"):
        for placement in readings.list_placements(f"{bar}.a"):
            distance = readings.get_certified((f"{bar}.a", f"{bar}.b"))
            ends = [readings.get_points(f"{bar}.{end}", placement) for end in "ab"]
            if not all(len(end) for end in ends):
                continue
            length, uncertainty = readings.compute_length(distance, placement)
            measured = float(np.linalg.norm(ends[1].mean(axis=0) - ends[0].mean(axis=0)))
            error = measured - length
            deviations.append(Deviation(placement, error, uncertainty, length, placement))
    if len(deviations) < 20:
        raise NotSupported(f"{len(deviations)} of 20 placements of the bars BARS and BARL")
    values = np.array([deviation.value_mm for deviation in deviations])
    uncertainty = max(deviation.standard_uncertainty_mm for deviation in deviations)
    rms = Deviation("20 placements", 2 * math.sqrt(float((values**2).mean())), uncertainty)
    # Both ends of the range have the uncertainty of their bar, which two bars do not share.
    span = Deviation("20 placements", float(np.ptp(values)), math.sqrt(2) * uncertainty)
    yield Figure("volumetric_max", "Volumetric max |D|", ASME, tuple(deviations))
    yield Figure("volumetric_2rms", "Volumetric 2·RMS", ASME, (rms,))
    yield Figure("volumetric_range", "Volumetric range", ASME, (span,))


TESTS: dict[tuple[str, ...], Callable[[VerifiedReadings], Iterator[Figure]]] = {
    ("p_size",): _evaluate_sphere_size,
    ("p_form",): _evaluate_sphere_form,
    ("l_dia",): _evaluate_location,
    ("e_uni",): _evaluate_lengths,
    (BLOCK,): _evaluate_block_lengths,
    ("effective_diameter",): _evaluate_effective_diameter,
    ("spat_max", "spat_2s"): _evaluate_articulation,
    ("volumetric_max", "volumetric_2rms", "volumetric_range"): _evaluate_volumetric,
}
