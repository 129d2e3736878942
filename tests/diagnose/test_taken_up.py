"""Causes that are older than the calibration under test: it has taken up a part of them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.fitting.absorbed_error import _absorbed_by, allow_absorbed_error
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.problem.baseline import from_calibration
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.diagnose.search.compare_searches import (
    has_fewer_findings,
    has_lost_cause,
    may_replace,
)
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate, Column, tie
from armd.compensation.identify.calibrate import calibrate
from support import synthetic
from support.planting import Effect, eccentric, of_joint, planted, wave

ARM = synthetic.arm()
DISC, KNOCK = wave(2, 60.0), of_joint(3, lambda states: np.full(states.n, 30.0))
SHIFT = Candidate(
    "geometry_shift",
    location.joint(3),
    (Column("theta", "rad", 1e-4, tie([("theta_3", 1.0)])),),
    (),
)
ECCENTRIC, KNOCKED = ("encoder_eccentricity", "joint 2"), ("geometry_shift", "joint 3")


@dataclass(frozen=True)
class Years:
    """Sessions of one arm by which it was calibrated, and those of a later year."""

    calibrated: list[Session]
    later: list[Session]

    def told(self, before: tuple[Effect, ...], since: tuple[Effect, ...]) -> dict[object, float]:
        """Names and probabilities of what is found under the calibration."""
        calibration = calibrate(planted(self.calibrated, *before), ARM).calibration
        found = diagnose(planted(self.later, *since), ARM, calibration).findings
        return {finding.candidate.place: finding.probability for finding in found}


@pytest.fixture(scope="module")
def years() -> Years:
    rng = np.random.default_rng(2)
    truth = synthetic.disturbed(ARM, rng, 0.3)

    def sessions(count: int, first: int) -> list[Session]:
        made = [
            synthetic.session(
                ARM, truth, rng, targets=6, placements=2, readings=60, encoder_rad=4e-6,
                noise_mm=0.004, name=f"session-{first + k}",
            )
            for k in range(count)
        ]  # fmt: skip
        return [
            replace(s, states=replace(s.states, time_s=s.states.time_s + 7200.0 * (first + k)))
            for k, s in enumerate(made)
        ]

    return Years(sessions(4, 0), sessions(5, 10))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("before", "since", "places"),
    [
        ((DISC,), (DISC,), {ECCENTRIC}),
        ((DISC,), (DISC, KNOCK), {ECCENTRIC, KNOCKED}),
        ((), (DISC, KNOCK), {ECCENTRIC, KNOCKED}),
    ],
)
def test_a_disc_older_or_not_is_told_and_a_knock_if_there_was_one(
    years: Years, before: tuple[Effect, ...], since: tuple[Effect, ...], places: set[object]
) -> None:
    """What the constants took up of an older disc looked like knocks of joints 3 and 5, sure."""
    told = years.told(before, since)
    assert set(told) == places
    assert min(told.values()) > 0.95


@pytest.mark.slow
def test_the_calibration_counts_as_wrong_by_what_another_with_the_disc_has_taken_up(
    years: Years,
) -> None:
    """Two calibrations of the same readings, one with the disc, differ by what it took up: many of
    its standard uncertainties as it says itself, few as it counts beside disc and knock."""
    plain = calibrate(years.calibrated, ARM).calibration
    with_disc = calibrate(planted(years.calibrated, DISC), ARM).calibration
    given = from_calibration(with_disc, ARM, is_given=True)
    rests = collect_rests(planted(years.later, DISC), ARM)
    disc, knock = eccentric(2), SHIFT

    def counted(findings: list[Candidate]) -> F64 | None:
        start = [np.zeros(len(c.columns)) for c in findings]
        older = allow_absorbed_error(fit(rests, ARM, given, given.model, findings, start), ARM)
        return None if older is None else older.root

    names = [ARM.layout.names[i] for i in given.parameters]
    differs = np.array([with_disc.constants[n] - plain.constants[n] for n in names])
    root = counted([disc, knock])
    assert root is not None
    of_constants = slice(len(names))
    assert _sigmas(given.root[of_constants], differs) > 5.0
    assert _sigmas(root[of_constants], differs) < 1.5
    assert counted([disc]) is None  # nothing that a change of the constants would explain
    assert counted([knock]) is None  # nothing that could be older


def test_what_does_not_show_took_nothing_up() -> None:
    """The first joint turns the whole arm as the placements do: of that only rounding is left."""
    rng = np.random.default_rng(5)
    own = rng.standard_normal((300, 4)) * np.array([1e3, 1e3, 1e3, 1e-3])
    went = np.array([0.3, -0.2, 0.0, 0.0])
    taken = _absorbed_by(own, (own @ went + rng.standard_normal(300))[:, None])[:, 0]
    np.testing.assert_allclose(taken[:3], went[:3], atol=1e-3)
    assert abs(taken[3]) < 1e-3


@pytest.mark.slow
def test_a_cause_lost_to_the_doubt_that_it_made_itself_is_not_given_up(years: Years) -> None:
    """A new disc and a knock. The calibration being wrong by what it may have taken up of the disc,
    a search without the disc leaves hardly more to the noise, and tells less."""
    given = from_calibration(calibrate(years.calibrated, ARM).calibration, ARM, is_given=True)
    rests = collect_rests(planted(years.later, wave(4, 8.0), KNOCK), ARM)
    before = searched(rests, given, eccentric(4), SHIFT)
    older = allow_absorbed_error(before.last, ARM)
    assert older is not None
    again = searched(rests, older, SHIFT)
    assert has_fewer_findings(again, before)
    assert has_lost_cause(again, before, ARM)
    assert not may_replace(again, before, ARM)
    assert not has_lost_cause(before, before, ARM)
    nameless = searched(rests, given, replace(eccentric(4), cause="unknown"), SHIFT)
    assert not has_lost_cause(again, nameless, ARM)


def test_a_knock_that_only_an_older_disc_made_is_given_up(years: Years) -> None:
    """Of a disc the constants had taken up a part, and nobody knocked the arm."""
    with_disc = calibrate(planted(years.calibrated, wave(4, 60.0)), ARM).calibration
    given = from_calibration(with_disc, ARM, is_given=True)
    rests = collect_rests(planted(years.later, wave(4, 60.0)), ARM)
    before = searched(rests, given, eccentric(4), SHIFT)
    older = allow_absorbed_error(before.last, ARM)
    assert older is not None
    assert may_replace(searched(rests, older, eccentric(4)), before, ARM)


def searched(rests: Rests, baseline: Baseline, *found: Candidate) -> Any:
    """A search that found just these, of some thousand candidates."""
    last = fit(
        rests, ARM, baseline, baseline.model, found, [np.zeros(len(c.columns)) for c in found]
    )
    return SimpleNamespace(
        last=last, searched=last, findings=[SimpleNamespace(candidate=c) for c in found], tests=3000
    )


def _sigmas(root: F64, differs: F64) -> float:
    """RMS of a difference (n,) in standard uncertainties, its covariance being R Rᵀ."""
    covariance = root @ root.T
    scale = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    known = values > 1e-9
    own = vectors[:, known].T @ (differs / scale) / np.sqrt(values[known])
    return float(np.sqrt((own**2).mean()))
