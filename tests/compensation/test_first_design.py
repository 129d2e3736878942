"""The poses before the first measurement: against brute force, dense algebra and campaigns."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from threadpoolctl import threadpool_limits

from armd.compensation.data.sessions.format import Artefact
from armd.compensation.design.artefact_places import ArtefactReadings
from armd.compensation.design.clearance import compute_height_mm
from armd.compensation.design.exchange import (
    choose_readings,
    compute_log_determinant,
    make_candidates,
    split_count,
)
from armd.compensation.design.first import Bounds, FirstExperiment, design_first
from armd.compensation.design.observability import (
    compute_observability_indices,
    compute_structural_rank,
    compute_tracker_columns,
    factorise_constants,
)
from armd.compensation.estimate.gauge import list_free_constants
from armd.compensation.estimate.observations import collect_observations
from armd.compensation.identify.certificate import LEAST_PLACEMENTS
from armd.compensation.model.arm import Arm
from armd.compensation.model.kinematics import compute_pose
from armd.errors import BadInput
from support import synthetic
from support.fitted import fit_constants
from support.selection import parametrize_default


def first(arm: Arm, *args: object, **options: object) -> FirstExperiment:
    with threadpool_limits(limits=1, user_api="blas"):
        return design_first(arm, arm.nominal(), *args, **options)  # type: ignore[arg-type]


def dense_log_determinants(rows: np.ndarray, k: int, sets: np.ndarray) -> np.ndarray:
    """Of each set (s, count) of rows (n, r, c): log det M − log det of its nuisances' block."""
    grams = np.einsum("nri,nrj->nij", rows, rows)[sets].sum(axis=1)
    return np.linalg.slogdet(grams)[1] - np.linalg.slogdet(grams[:, :k, :k])[1]


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
def test_exchanges_come_near_the_best_of_all_choices(seed: int) -> None:
    """Of 20 postures of a small arm the best six, of 38 760 choices; 5 % in each direction."""
    arm = synthetic.arm(3)
    q = np.random.default_rng(seed).uniform(-2.5, 2.5, (20, 3))
    candidates = make_candidates(compute_tracker_columns(arm, q, arm.nominal()))
    chosen = choose_readings(candidates, 6, np.zeros(20, dtype=np.int64))
    sets = np.array(list(combinations(range(20), 6)))
    k = candidates.nuisances
    best = dense_log_determinants(candidates.rows, k, sets).max()
    found = dense_log_determinants(candidates.rows, k, np.array([chosen]))[0]
    assert len(set(chosen)) == 6
    assert np.exp((found - best) / 9) >= 0.95
    assert compute_log_determinant(candidates, chosen) == pytest.approx(found, abs=1e-3)


def test_the_criterion_is_the_determinant_of_the_calibrations_own_unknowns() -> None:
    """Up to a constant: by the singular values of the raw columns, nuisances eliminated."""
    arm = synthetic.arm(4)
    rng = np.random.default_rng(2)
    columns = compute_tracker_columns(arm, rng.uniform(-2, 2, (80, 4)), arm.nominal())
    candidates = make_candidates(columns)
    difference = []
    for _ in range(4):
        chosen = rng.choice(80, 20, replace=False)
        s = factorise_constants(columns.rows(chosen))[0][:13]
        difference.append(
            compute_log_determinant(candidates, chosen.tolist()) - 2 * np.log(s).sum()
        )
    assert np.ptp(difference) < 1e-3


@pytest.mark.slow
def test_indices_are_those_of_numpys_singular_values_by_hand() -> None:
    """Columns by central differences of the forward model, a tracker's frame fitted along."""
    arm = synthetic.arm(3)
    found = first(arm, 20)
    nominal, names = arm.nominal(), list_free_constants(arm)
    columns = []
    for name in names:
        i = arm.layout.names.index(name)
        size = 0.02 if name.startswith(("theta", "alpha", "beta")) else 10.0
        step = np.zeros_like(nominal)
        step[i] = 1e-4 * size
        ahead, behind = (compute_pose(found.q, nominal + sign * step)[0] for sign in (1.0, -1.0))
        columns.append(((ahead - behind) / 2e-4).ravel())
    turned = [np.cross(axis, found.tip_mm).ravel() for axis in np.eye(3)]
    shifted = [np.tile(axis, (20, 1)).ravel() for axis in np.eye(3)]
    frame = np.array([*turned, *shifted]).T
    jacobian = np.array(columns).T
    clear = jacobian - frame @ np.linalg.lstsq(frame, jacobian, rcond=None)[0]
    s = np.linalg.svd(clear, compute_uv=False)
    assert s[9] < 1e-4 * s[8]  # 4 · 3 − 3 directions
    s = s[:9]
    o = found.observability
    assert o["O1"] == pytest.approx(np.prod(s) ** (1 / 9) / np.sqrt(20), rel=1e-4)
    assert o["O2"] == pytest.approx(s[-1] / s[0], rel=1e-4)
    assert o["O3"] == pytest.approx(s[-1], rel=1e-4)
    assert o["O4"] == pytest.approx(s[-1] ** 2 / s[0], rel=1e-4)
    assert o["O5"] == pytest.approx(1 / np.sum(1 / s), rel=1e-4)
    assert found.condition_number == pytest.approx(s[0] / s[-1], rel=1e-4)
    assert set(compute_observability_indices(np.array([2.0, 0.0]), 4).values()) == {0.0}


@pytest.mark.parametrize("n", [3, 4, 6, 7, 9])
def test_the_structural_rank_of_a_chain_is_four_a_joint_less_three(n: int) -> None:
    arm = synthetic.arm(n)
    assert compute_structural_rank(arm, arm.nominal()) == 4 * n - 3


@pytest.mark.slow
def test_fewer_limits_than_the_chain_needs_show_in_the_practical_rank() -> None:
    """A joint that hardly turns is not known apart from its neighbours."""
    arm = synthetic.arm(4)
    joints = [joint.model_copy(update={"min_deg": 10.0, "max_deg": 10.5}) for joint in arm.joint]
    arm = arm.model_copy(update={"joint": [*joints[:2], *arm.joint[2:]]})
    found = first(arm)
    assert found.structural_rank == 13 and found.rank < 13
    assert found.not_known and found.condition_number is not None
    assert found.observability["O2"] < 0.02


def artefact(known: bool, targets: int, length_mm: float | None = None) -> Artefact:
    at = [[0.0, 0.0, 0.0], [250.0, 0.0, 0.0], [100.0, 150.0, 30.0], [20.0, 90.0, 0.0]]
    content: dict[str, object] = {
        "name": "balls",
        "target": [
            {"name": f"B{k}"} | ({"position_mm": at[k]} if known else {}) for k in range(targets)
        ],
    }
    if length_mm is not None:
        content["distance"] = [{"between": ["B0", "B1"], "length_mm": length_mm}]
    return Artefact.model_validate(content)


@pytest.mark.slow
@parametrize_default(
    ("known", "targets", "length_mm", "structural"),
    [(True, 4, None, 21), (False, 1, None, 20), (False, 2, None, 20), (False, 2, 300.0, 21)],
)
def test_an_artefact_is_touched_all_over_in_three_placements(
    known: bool, targets: int, length_mm: float | None, structural: int
) -> None:
    """Without a certified length the size of the arm is no direction that readings determine."""
    arm = synthetic.arm(6)
    found = first(arm, artefact=artefact(known, targets, length_mm))
    assert found.structural_rank == structural and found.rank >= structural - 1
    assert len(found.q) == found.certificate
    assert len(set(found.placements)) == LEAST_PLACEMENTS
    assert len(set(zip(found.placements, found.targets, strict=True))) == 3 * targets
    counts = np.unique(found.placements, return_counts=True)[1]
    assert np.ptp(counts) <= targets
    tip = compute_pose(found.q, arm.nominal())[0]
    apart = {
        (p, t): tip[
            [p == a and t == b for a, b in zip(found.placements, found.targets, strict=True)]
        ]
        for p, t in zip(found.placements, found.targets, strict=True)
    }
    assert all(np.ptp(points, axis=0).max() < 1.5 for points in apart.values())
    if length_mm is not None:
        for p in set(found.placements):
            between = np.linalg.norm(apart[p, "B0"].mean(axis=0) - apart[p, "B1"].mean(axis=0))
            assert between == pytest.approx(length_mm, abs=2.0)


@pytest.mark.slow
def test_limits_reach_and_height_are_kept() -> None:
    arm = synthetic.arm(6)
    limited = [
        joint.model_copy(update={"min_deg": -100.0, "max_deg": 120.0}) for joint in arm.joint
    ]
    arm = arm.model_copy(update={"joint": limited})
    bounds = Bounds(reach_mm=(300.0, 700.0), lowest_mm=0.0)
    for used in (None, artefact(True, 3)):
        found = first(arm, artefact=used, bounds=bounds)
        degrees, away = np.degrees(found.q), np.linalg.norm(found.tip_mm, axis=1)
        assert degrees.min() >= -100 and degrees.max() <= 120
        assert away.min() >= 300 and away.max() <= 700
        assert compute_height_mm(found.q, arm.nominal(), arm).min() >= 0 and found.below_base == 0


def test_what_cannot_be_chosen_is_refused() -> None:
    arm = synthetic.arm(3)
    for readings in (5, 601):
        with pytest.raises(
            BadInput, match=f"--readings/--poses: value: found {readings}, expected 6"
        ):
            first(arm, readings)
    assert len(first(arm, 6).q) == 6
    with pytest.raises(BadInput, match="--reach: value: found 0 of"):
        first(arm, bounds=Bounds(reach_mm=(9000.0, 9001.0)))
    far = [{"name": f"B{k}", "position_mm": [5000.0 * k, 0.0, 0.0]} for k in range(2)]
    wide = Artefact.model_validate({"name": "wide", "target": far})
    with pytest.raises(BadInput, match=r"--artefact: its targets: found [0-2] places"):
        first(arm, artefact=wide)


def test_readings_are_shared_out_evenly() -> None:
    assert split_count(7, np.array([5, 1, 5])).tolist() == [3, 1, 3]
    assert split_count(99, np.array([2, 1])).tolist() == [2, 1]
    number = np.array([0, 0, 1, 1])
    places = ArtefactReadings(np.zeros((4, 3)), number, np.array([0, 1, 0, 1]), np.zeros((2, 3, 3)))
    assert places.groups(4).tolist() == [0, 1, 2, 3]
    assert places.groups(3).tolist() == [0, 0, 1, 1]


def campaign_errors(arm: Arm, q: np.ndarray, seeds: range) -> np.ndarray:
    """RMS (s,) mm at fresh postures after calibrations on tracked postures with 0.1 mm of noise."""
    errors = []
    for seed in seeds:
        rng = np.random.default_rng([7, seed])
        truth = synthetic.disturbed(arm, rng)
        measured = synthetic.tracked(arm, truth, rng, len(q))
        measured.states.q[:] = q
        measured.truth_mm[:] = compute_pose(q, truth)[0] + rng.normal(0.0, 0.1, (len(q), 3))
        found = fit_constants(collect_observations([measured], arm))
        fresh = rng.uniform(-2.5, 2.5, (300, arm.n_joints))
        wrong = compute_pose(fresh, found.constants)[0] - compute_pose(fresh, truth)[0]
        tip = compute_pose(fresh, truth)[0] - compute_pose(fresh, truth)[0].mean(axis=0)
        frame = np.concatenate(
            [np.tile(np.eye(3), (300, 1, 1)), np.cross(np.eye(3), tip[:, None]).swapaxes(1, 2)],
            axis=2,
        ).reshape(900, 6)
        wrong = wrong.ravel() - frame @ np.linalg.lstsq(frame, wrong.ravel(), rcond=None)[0]
        errors.append(np.sqrt(3 * np.mean(wrong**2)))
    return np.array(errors)


@pytest.mark.slow
def test_a_campaign_in_these_postures_calibrates_better_than_one_in_random_ones() -> None:
    arm, seeds = synthetic.arm(6), range(4)
    designed = campaign_errors(arm, first(arm, 24).q, seeds)
    random = [
        campaign_errors(arm, np.random.default_rng(i).uniform(-np.pi, np.pi, (24, 6)), seeds)
        for i in range(3)
    ]
    assert np.sqrt(np.mean(designed**2)) < 0.85 * np.sqrt(np.mean(np.square(random)))
