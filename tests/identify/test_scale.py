"""The size of an arm is what is certified says it is, however large the scatter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.arrays import F64
from armd.compensation.estimate.gauge import list_free_constants
from armd.compensation.estimate.observations import Observations, collect_observations
from armd.compensation.estimate.unknowns import Unknowns
from armd.compensation.identify.fit import Identification
from support import synthetic
from support.fitted import fit_constants
from support.selection import parametrize_default

ARM = synthetic.arm()
UNKNOWNS = Unknowns(list_free_constants(ARM))
#: Seats 50 mm apart as a calliper tells it, whose standard uncertainty is 0.2 %.
CALLIPER_MM = 0.1
#: All lengths in proportion; d_1 and the last joint's are told by no reading, or only with others.
SIZED = [
    name.startswith(("d_", "a_")) and name not in ("d_1", "d_6", "a_6")
    for name in UNKNOWNS.constants
]


def seats(truth: np.ndarray, rng: np.random.Generator) -> Observations:
    measured = synthetic.session(
        ARM, truth, rng, readings=180, targets=2, placements=4, known=False,
        distances=[(0, 1)], spread_mm=25.0,
    )  # fmt: skip
    return collect_observations([measured], ARM)


def disturbed(clean: Observations, encoder_rad: float, rng: np.random.Generator) -> Observations:
    """Angles with noise, and a length that is wrong by its own uncertainty."""
    q = clean.states.q + encoder_rad * rng.normal(size=clean.states.q.shape)
    lengths = replace(
        clean.distances,
        length_mm=clean.distances.length_mm + CALLIPER_MM * rng.normal(size=1),
        standard_uncertainty_mm=np.array([CALLIPER_MM]),
    )
    return replace(clean, states=replace(clean.states, q=q), distances=lengths)


def size_of(found: Identification, truth: np.ndarray) -> tuple[float, float]:
    """By how much all lengths together are off, as a share, and its standard uncertainty."""
    true = np.where(SIZED, UNKNOWNS.values(truth, []), 0.0)
    along = true / (true @ true)
    error = float(along @ (UNKNOWNS.values(found.constants, []) - true))
    return error, float(np.sqrt(along @ found.covariance @ along))


@pytest.mark.slow
@parametrize_default("encoder_rad", [5e-5, 5e-4, 1e-3])
def test_a_larger_scatter_does_not_shrink_the_arm(encoder_rad: float) -> None:
    rng = np.random.default_rng(5)
    truth = synthetic.disturbed(ARM, rng, 0.3)
    clean = seats(truth, rng)
    length_mm = float(clean.distances.length_mm[0])
    sizes, told, stated = [], [], []
    for seed in range(16):
        observations = disturbed(clean, encoder_rad, np.random.default_rng(1000 + seed))
        found = fit_constants(observations)
        assert found.converged
        error, uncertainty = size_of(found, truth)
        sizes.append(error)
        stated.append(uncertainty)
        told.append(float(observations.distances.length_mm[0]) / length_mm - 1.0)
    # The arm is as wrong as the length it was told, and by nothing else in the mean.
    apart = np.array(sizes) - np.array(told)
    assert abs(apart.mean()) < 3 * apart.std() / np.sqrt(len(apart)) + 1e-5
    assert abs(apart.mean()) < 0.25 * CALLIPER_MM / length_mm
    # Stated is what was: the calliper's share, and with it the error of most.
    assert min(stated) > 0.9 * CALLIPER_MM / length_mm
    normalised = np.array(sizes) / np.array(stated)
    assert 0.4 < np.mean(normalised**2) < 2.0  # 16 unit normals: within three sigma


def sessions_on_one_bar(rng: np.random.Generator, artefacts: list[str]) -> tuple[F64, Observations]:
    """As many sessions as *artefacts*, each of which touches both ends of the bar so named."""
    truth = synthetic.disturbed(ARM, rng, 0.3)
    whole = synthetic.session(
        ARM, truth, rng, readings=300, targets=2, placements=6, known=False,
        distances=[(0, 1)], spread_mm=25.0, encoder_rad=5e-6,
    )  # fmt: skip
    bar = whole.artefact.distances[0].model_copy(update={"standard_uncertainty_mm": CALLIPER_MM})
    sessions = [
        replace(
            whole.rows(whole.placement % len(artefacts) == i),
            name=f"day {i}",
            artefact=whole.artefact.model_copy(update={"name": name, "distances": [bar]}),
        )
        for i, name in enumerate(artefacts)
    ]
    return truth, collect_observations(sessions, ARM)


def test_a_bar_measured_six_times_is_no_better_known() -> None:
    """The certificate's error is the same each time; six bars' errors are six."""
    stated = []
    for artefacts in (["bar"] * 6, [f"bar {i}" for i in range(6)]):
        truth, observations = sessions_on_one_bar(np.random.default_rng(7), artefacts)
        found = fit_constants(observations)
        share = CALLIPER_MM / float(observations.distances.length_mm[0])
        stated.append(size_of(found, truth)[1] / share / np.sqrt(found.variance_factor))
    assert stated[0] == pytest.approx(1.0, rel=0.03)
    assert stated[1] == pytest.approx(1.0 / np.sqrt(6.0), rel=0.03)


def test_lengths_to_a_seat_that_nobody_touched_say_nothing() -> None:
    """More lengths hold it than it has coordinates: no step from a guess would find it."""
    rng = np.random.default_rng(11)
    truth = synthetic.disturbed(ARM, rng, 0.3)
    pairs = [(i, j) for i in range(5) for j in range(i)]
    whole = synthetic.session(
        ARM, truth, rng, readings=240, targets=5, placements=4, known=False, distances=pairs,
        encoder_rad=5e-6,
    )  # fmt: skip
    touched = whole.rows(whole.target != 2)
    observations = collect_observations([touched], ARM)
    assert observations.distances.between.tolist() == [[i, j] for i, j in pairs if 2 not in (i, j)]
    found = fit_constants(observations)
    error, uncertainty = size_of(found, truth)
    assert abs(error) < 4.0 * uncertainty
