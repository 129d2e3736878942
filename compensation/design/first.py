"""Choose the poses before the first measurement: D-optimal for the constants of a nominal arm."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.compensation.data.sessions.format import Artefact
from armd.compensation.design.artefact_places import (
    ArtefactReadings,
    compute_artefact_columns,
    compute_length_rows,
    draw_places,
    draw_target_positions,
)
from armd.compensation.design.clearance import compute_height_mm
from armd.compensation.design.exchange import choose_readings, make_candidates
from armd.compensation.design.observability import (
    ReadingColumns,
    compute_observability_indices,
    compute_structural_rank,
    compute_tracker_columns,
    count_directions,
    factorise_constants,
)
from armd.compensation.estimate.gauge import ROUNDING, describe_unidentifiable, list_free_constants
from armd.compensation.estimate.linear.solution import LEAST_KNOWN
from armd.compensation.identify.admission.reading_counts import (
    LEAST_PLACEMENTS,
    count_certificate_readings,
    count_least_readings_for_plan,
)
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_pose
from armd.errors import BadInput

#: Candidate postures, and the most postures that are drawn to find as many within the bounds.
POOL, DRAWN = 600, 60_000
#: With fewer candidates there is no real choice.
LEAST_POOL = 60
#: Assumed noise of a reading per axis; the encoders' resolution is added.
READING_MM = 0.05


@dataclass(frozen=True)
class Bounds:
    """Bounds of postures besides the limits of arm.toml; None: no bound."""

    reach_mm: tuple[float, float] | None = None  # least and most distance of the tip from the base
    lowest_mm: float | None = None  # least height over the base of any part of the arm


@dataclass(frozen=True, kw_only=True)
class FirstExperiment:
    """The chosen postures, and how well they determine the constants."""

    parameters: F64  # (P,) of the model
    q: F64  # (n, N) rad
    tip_mm: F64  # (n, 3) base frame
    placements: list[str]  # (n,); empty for a tracker's points
    targets: list[str]  # (n,); empty for a tracker's points
    constants: int  # to identify, as in `armd calibrate`
    structural_rank: int
    rank: int  # number of directions known to a tenth of their plausible departure
    singular_values: F64  # (structural_rank,) mm per plausible departure, descending
    noise_mm: float
    not_known: list[str]  # in words, directions that better postures would determine
    below_base: int  # postures in which a part of the arm is lower than its base
    certificate: int  # readings that a certificate needs

    @property
    def observability(self) -> dict[str, float]:
        return compute_observability_indices(self.singular_values, len(self.q))

    @property
    def condition_number(self) -> float | None:
        """The largest over the smallest singular value; None if the latter is 0."""
        smallest = float(self.singular_values[-1])
        return float(self.singular_values[0]) / smallest if smallest > 0.0 else None


@dataclass(frozen=True)
class _Campaign:
    """Candidate readings and their columns; *fixed* rows contain only the nuisances."""

    places: ArtefactReadings
    columns: ReadingColumns
    fixed: F64 | None
    structural_rank: int


def design_first(
    arm: Arm,
    parameters: F64,
    readings: int | None = None,
    artefact: Artefact | None = None,
    bounds: Bounds | None = None,
    seed: int = 1,
) -> FirstExperiment:
    """Choose *readings* postures for a first calibration (None: as many as a certificate needs).

    Without an *artefact* a tracker measures the tip in one placement. *parameters* (P,): the
    model's. Raises `BadInput` for too few or too many readings, and for bounds that no posture
    keeps.
    """
    bounds = bounds or Bounds()
    placements = 1 if artefact is None else LEAST_PLACEMENTS
    seats = 0 if artefact is None else int(np.isnan(artefact.positions_mm()[:, 0]).sum())
    minimum = count_least_readings_for_plan(arm.n_joints, placements, seats)
    certificate = count_certificate_readings(arm.n_joints, placements, seats)
    _require_between(readings, minimum, POOL)
    rng = np.random.default_rng(seed)
    within = _draw_postures(arm, parameters, bounds, rng)
    if artefact is None:
        campaign = _make_tracker_campaign(arm, parameters, within)
    else:
        campaign = _make_artefact_campaign(arm, parameters, within, bounds, artefact, rng)
    maximum = len(campaign.places.q)
    _require_between(readings, minimum, maximum)
    count = readings or min(certificate, maximum)
    candidates = make_candidates(campaign.columns, campaign.fixed)
    group = campaign.places.groups(count)
    chosen = np.array(choose_readings(candidates, count, group), dtype=np.int64)
    order = np.lexsort((campaign.places.q[chosen, 0], campaign.places.placement[chosen]))
    chosen = chosen[order]
    names = [] if artefact is None else artefact.target_names
    places = campaign.places.rows(chosen)
    s, rank, not_known = _assess_readings(arm, campaign, chosen)
    return FirstExperiment(
        parameters=parameters,
        q=places.q,
        tip_mm=campaign.columns.tip_mm[chosen],
        placements=[f"P{p + 1}" for p in places.placement] if names else [],
        targets=[names[t] for t in places.target] if names else [],
        constants=campaign.columns.constants.shape[2],
        structural_rank=campaign.structural_rank,
        rank=rank,
        singular_values=s,
        noise_mm=_noise_mm(arm),
        not_known=not_known,
        below_base=int((compute_height_mm(places.q, parameters, arm) < 0.0).sum()),
        certificate=certificate,
    )


def _require_between(readings: int | None, minimum: int, maximum: int) -> None:
    if readings is not None and not minimum <= readings <= maximum:
        expected = f"{minimum} (fewer have no one answer) to {maximum} (candidate postures)"
        raise BadInput("--readings/--poses", "value", str(readings), expected)


def _is_within(arm: Arm, parameters: F64, q: F64, bounds: Bounds) -> Mask:
    """Return which postures (n,) keep the bounds; callers keep the joint limits."""
    keeps: Mask = np.ones(len(q), dtype=bool)
    if bounds.reach_mm is not None:
        base = parameters[arm.layout.base][:3]
        away = np.linalg.norm(compute_pose(q, parameters)[0] - base, axis=1)
        keeps &= (away >= bounds.reach_mm[0]) & (away <= bounds.reach_mm[1])
    if bounds.lowest_mm is not None:
        keeps &= compute_height_mm(q, parameters, arm) >= bounds.lowest_mm
    return keeps


def _draw_postures(arm: Arm, parameters: F64, bounds: Bounds, rng: np.random.Generator) -> F64:
    """Draw postures (m, N) rad, uniform within the limits, that keep the bounds; POOL at most.

    Raises `BadInput` if fewer than LEAST_POOL keep them.
    """
    q = rng.uniform(*arm.range_rad, (DRAWN, arm.n_joints))
    q = q[_is_within(arm, parameters, q, bounds)][:POOL]
    if len(q) < LEAST_POOL:
        drawn = f"{len(q)} of {DRAWN} random postures within the joint limits that keep them"
        options = "--reach and --lowest" if bounds.lowest_mm is not None else "--reach"
        raise BadInput(options, "value", drawn, f"values that at least {LEAST_POOL} keep")
    return q


def _make_tracker_campaign(arm: Arm, parameters: F64, q: F64) -> _Campaign:
    alike = np.zeros(len(q), dtype=np.int64)
    return _Campaign(
        ArtefactReadings(q, alike, alike, np.eye(3)[None]),
        compute_tracker_columns(arm, q, parameters),
        None,
        compute_structural_rank(arm, parameters),
    )


def _make_artefact_campaign(
    arm: Arm,
    parameters: F64,
    within: F64,
    bounds: Bounds,
    artefact: Artefact,
    rng: np.random.Generator,
) -> _Campaign:
    """Draw candidate readings of an artefact.

    The structural rank is that of all candidates, hundreds of random postures.
    """
    local = draw_target_positions(artefact, arm.reach_mm, rng)

    def keeps(q: F64) -> Mask:
        return _is_within(arm, parameters, q, bounds)

    places = draw_places(arm, parameters, local, within, keeps, rng)
    columns = compute_artefact_columns(arm, parameters, places, artefact)
    fixed = compute_length_rows(artefact, local, len(places.turn), _noise_mm(arm))
    rank = count_directions(factorise_constants(columns, fixed)[0])
    return _Campaign(places, columns, fixed, rank)


def _assess_readings(arm: Arm, campaign: _Campaign, chosen: I64) -> tuple[F64, int, list[str]]:
    """Return singular values (structural rank,), rank, and the undetermined directions in words."""
    s, directions = factorise_constants(campaign.columns.rows(chosen), campaign.fixed)
    s = s[: campaign.structural_rank]
    s = np.where(s > ROUNDING * s[0], s, 0.0)
    is_determined = s >= LEAST_KNOWN * _noise_mm(arm)
    weak = directions[:, : len(s)][:, ~is_determined]
    return s, int(is_determined.sum()), describe_unidentifiable(weak, list_free_constants(arm), arm)


def _noise_mm(arm: Arm) -> float:
    """Return a reading's noise per axis, from READING_MM and the encoders' resolution.

    The resolution acts at half the arm's reach.
    """
    steps = [2.0 * math.pi / j.counts_per_turn for j in arm.joint if j.counts_per_turn]
    return math.hypot(READING_MM, 0.5 * arm.reach_mm * math.hypot(*steps) / math.sqrt(12.0))
