"""Every cause of the catalogue, whichever there are: what it adds, how large, what it asks for.

A new cause is held to this by standing in its room. What it adds is compared with finite
differences of plain matrices, its basis by definition (`support.plain_basis`), not by armd's own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.diagnose.problem.signatures import compile_candidates
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import ArtefactChange, Candidate, Column, SessionFacts, Use
from armd.compensation.effects.setup.artefact_moved import make_candidate
from armd.compensation.model.pose_factors import Approach, Rate, Side
from armd.compensation.model.slow_factors import Dated, Temperature, TemperatureRate
from support.plain_basis import Scene, value
from support.plain_kinematics import rotation, tip_pose
from support.selection import parametrize_default
from support.whole_scene import Whole, warm, whole_scene, wound

#: Found by other means than the search: their columns have tests of their own.
LOOKED_FOR = {"artefact_moved", "outliers"}
#: So many of a cause's candidates, evenly spread over all that there are.
MOST = 40
#: Of its typical size a column is taken so little that its second order is nothing.
FRACTION = 0.01
JOINTS = {f"q{k}" for k in range(1, 7)}
CAUSES = [cause for cause in CATALOGUE if cause not in LOOKED_FOR]


@pytest.fixture(scope="module")
def whole() -> Whole:
    return whole_scene()


def all_of(cause: str, whole: Whole) -> list[Candidate]:
    """Under a calibration given, and without."""
    of = CATALOGUE[cause].candidates
    return [*of(whole.held), *of(whole.free)]


def some_of(cause: str, whole: Whole) -> list[Candidate]:
    found = all_of(cause, whole)
    chosen = [found[i] for i in np.unique(np.linspace(0, len(found) - 1, MOST).astype(int))]
    for candidate in chosen[:: MOST // 4]:
        if candidate.refine is not None:
            chosen += candidate.refine()[::4]
    return chosen


def added(column: Column, scene: Scene) -> np.ndarray:
    """(n, P) what a column adds to the parameters per unit of its amplitude."""
    found = np.zeros_like(scene.parameters)
    names = scene.arm.layout.names
    for term in column.terms:
        worth = np.prod([value(factor, scene) for factor in term.basis], axis=0)
        found[:, names.index(term.parameter)] += term.coefficient * worth
    if column.use is not None:
        before = (
            warm(column.use, scene) if isinstance(column.use, Use) else wound(column.use, scene)
        )
        for name, weight in column.use.parameters:
            found[:, names.index(name)] += weight * before
    return found


def motion(column: Column, whole: Whole) -> np.ndarray:
    """(3 n + lengths,) how the residual moves at the column's typical size, by plain means."""
    scene, n = whole.plain, len(whole.plain.q)
    step = FRACTION * column.prior_sd * added(column, scene)
    up, down = (tip_pose(scene.q, whole.parameters + s * step)[:, :3, 3] for s in (1, -1))
    found = np.zeros(len(whole.linear.residual))
    found[: 3 * n] = (up - down).ravel() / (2 * FRACTION)
    if column.artefact is not None and column.artefact.kind == "distance":
        found[3 * n + column.artefact.index] -= column.prior_sd
    elif column.artefact is not None:
        found[: 3 * n] -= column.prior_sd * of_targets(column.artefact, whole).ravel()
    return found


def of_targets(change: ArtefactChange, whole: Whole) -> np.ndarray:
    """(n, 3) motion of the targets in the base frame per unit of a change."""
    rests, poses = whole.linear.rests, whole.linear.poses
    observations = rests.observations
    names = [rests.target_label[i] for i in observations.target]
    certified = observations.position_mm
    at = certified[observations.target]
    if change.kind == "expansion":
        move = at * whole.artefact_rise_k[:, None]
    elif change.kind == "scale":
        move = at
    elif change.kind == "target":
        move = np.outer([name == change.target for name in names], np.eye(3)[change.axis])
    elif change.kind == "sag":
        middle = certified.mean(axis=0)
        size, axes = np.linalg.eigh(np.cov(certified.T))
        axis = axes[:, np.argsort(-size)[change.axis]]
        half = np.abs((certified - middle) @ axis).max()
        down = np.stack([whole.plain.down @ poses.rotation[p] for p in observations.placement])
        across = down - np.outer(down @ axis, axis)
        move = (((at - middle) @ axis) / half)[:, None] ** 2 * across
    else:
        raise AssertionError(f"no plain motion of {change.kind}: say it here")
    if change.artefact:
        of = [rests.sessions[i].artefact.name == change.artefact for i in observations.session]
        move = move * np.array(of)[:, None]
    turned = [poses.rotation[p] @ m for p, m in zip(observations.placement, move, strict=True)]
    return np.array(turned)


@parametrize_default("cause", CAUSES, default=range(0, 99, 3))
def test_it_adds_what_plain_matrices_say(cause: str, whole: Whole) -> None:
    candidates = some_of(cause, whole)
    assert candidates
    signatures = compile_candidates(candidates, whole.linear, whole.plain.arm)
    rows = signatures.rows(whole.linear, np.arange(signatures.n_columns))
    columns = [column for candidate in candidates for column in candidate.columns]
    largest = 0.0
    for column, row in zip(columns, rows, strict=True):
        expected = motion(column, whole)
        error = np.abs(row * column.prior_sd - expected).max()
        assert error < 1e-6 * np.abs(expected).max() + 1e-11, (column.name, error)
        largest = max(largest, np.abs(expected).max())
    assert 1e-4 < largest < 1.0, f"{largest} mm: its typical size is not one that arms have"
    # A link may be late by all of its growth, and by no more.
    least = 1.0 if cause == "thermal_lag" else 5.0
    assert all(column.prior_sd > 0.0 and column.reach >= least for column in columns)


def without(facts: SessionFacts) -> Iterator[tuple[str, SessionFacts]]:
    """The same sessions with one thing missing, by a word that says what."""
    yield (
        "time",
        replace(
            facts,
            timed=False,
            instants_unix_s=(),
            all_instants_unix_s=np.empty(0),
            spells_unix_s=(),
            sessions=(),
        ),
    )
    yield "rates", replace(facts, rates=False)
    yield "approach", replace(facts, approach=False)
    yield "temperature", replace(facts, sensors=(), terms=())
    yield "artefact_c", replace(facts, artefact_c=False)
    yield "certified", replace(facts, targets=(), distances=())
    yield "calibration", replace(facts, has_fixed_constants=False)


def asked_of(column: Column) -> set[str]:
    """What the readings must have for a column to be known."""
    found = set()
    for factor in (factor for term in column.terms for factor in term.basis):
        if isinstance(factor, Temperature | TemperatureRate):
            found.add("temperature")
        if isinstance(factor, Dated | TemperatureRate) or getattr(factor, "lag_s", 0.0):
            found.add("time")
        if isinstance(factor, Side | Rate):
            found.add("rates")
        if isinstance(factor, Approach):
            found.add("approach")
    if column.use is not None:
        by_rate = isinstance(column.use, Use) and column.use.by_rate
        found |= {"time", "rates"} if by_rate else {"time"}
    if column.artefact is not None and column.artefact.kind == "expansion":
        found.add("artefact_c")
    return found


@parametrize_default("cause", CAUSES, default=range(1, 99, 3))
def test_it_asks_for_no_more_than_the_sessions_have(cause: str, whole: Whole) -> None:
    for missing, facts in without(whole.held):
        left = list(CATALOGUE[cause].candidates(facts))
        for column in (column for candidate in left for column in candidate.columns):
            assert missing not in asked_of(column), column.name
        if not left:
            assert missing in CATALOGUE[cause].needs, f"all are gone without {missing}"


@parametrize_default("cause", CAUSES, default=range(2, 99, 3))
def test_it_depends_on_what_it_says(cause: str, whole: Whole) -> None:
    """Angles, rates and temperatures of others may be exchanged between readings."""
    scene, rng = whole.plain, np.random.default_rng(4)
    other = rng.permutation(len(scene.q))
    for candidate in some_of(cause, whole):
        named = set(candidate.depends_on)
        if "approach_x" in named:  # which the stylus has in its own frame, turned by all joints
            named |= JOINTS
        exchanged = {}
        for field, names in (("q", "q{}"), ("rate", "w{}"), ("temperature_c", "t{}")):
            columns = getattr(scene, field).copy()
            free = [i for i in range(columns.shape[1]) if names.format(i + 1) not in named]
            columns[:, free] = columns[other][:, free]
            exchanged[field] = columns
        for column in candidate.columns:
            first, then = added(column, scene), added(column, replace(scene, **exchanged))
            assert np.abs(then - first).max() <= 1e-8 * np.abs(first).max(), column.name


@pytest.mark.parametrize("cause", CAUSES)
def test_it_is_told_in_words(cause: str, whole: Whole) -> None:
    effect = CATALOGUE[cause]
    for candidate in some_of(cause, whole):
        assert candidate.cause == cause
        prior_sd = np.array([column.prior_sd for column in candidate.columns])
        told = effect.describe(candidate, prior_sd)
        assert told and "nan" not in told and "inf " not in told
        for finer in candidate.refine() if candidate.refine else ():
            assert finer.place == candidate.place
        if candidate.elsewhere:
            name, scanned, _ = candidate.setting[0]
            again = candidate.elsewhere(scanned * 1.3)
            assert again.place == candidate.place
            assert again.setting[0][:2] == (name, scanned * 1.3)


def test_an_artefact_moved_takes_its_later_targets_along(whole: Whole) -> None:
    """Of placement 4, from its eighth rest on: as one body, about the middle of its targets."""
    signatures = compile_candidates([make_candidate(4, 7)], whole.linear, whole.plain.arm)
    rows = signatures.rows(whole.linear, np.arange(6))
    observations, poses = whole.linear.rests.observations, whole.linear.poses
    own = np.flatnonzero(observations.placement == 4)  # readings stand in the order of time
    at = np.array(
        [
            poses.rotation[4] @ observations.position_mm[observations.target[i]]
            + poses.translation_mm[4]
            for i in own
        ]
    )
    about = at - at.mean(axis=0)
    for column, row in zip(range(6), rows, strict=True):
        expected = np.zeros((len(whole.plain.q), 3))
        for i, lever in zip(own[7:], about[7:], strict=True):
            step = 1e-6
            turn = rotation(column % 3, step)[:3, :3] - rotation(column % 3, -step)[:3, :3]
            shift = np.eye(3)[column % 3]
            expected[i] = -shift if column < 3 else -turn @ lever / (2 * step)
        np.testing.assert_allclose(row[: expected.size].reshape(-1, 3), expected, atol=1e-6)
        assert not row[expected.size :].any(), "no certified length changes"
