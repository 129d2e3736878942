"""Two searches of the same readings beside each other, made up as small as they may be."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.diagnosis import Finding
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.problem.baseline import from_calibration
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.diagnose.scoring.candidates import score_candidates
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.compensation.diagnose.search import compare_searches as module
from armd.compensation.diagnose.search.compare_searches import (
    has_clearly_lower_noise,
    has_fewer_findings,
    is_likely_beside,
)
from armd.compensation.effects.effect import Candidate
from armd.compensation.identify.calibrate import calibrate
from support import synthetic
from support.planting import eccentric, planted, wave
from support.small_fit import candidate

ARM = synthetic.arm()
DISC, SCALE = candidate("encoder_eccentricity", 3), candidate("encoder_scale", 3)


def finding(cause: Candidate, probability: float) -> Finding:
    return Finding(cause, 1e-9, 90.0, probability, (), ())


def result(noise_um: float, *found: Finding) -> Any:
    noise = SimpleNamespace(own_mm=1e-3 * noise_um)
    return SimpleNamespace(last=SimpleNamespace(noise=noise), findings=found)


@pytest.mark.parametrize(
    ("one", "other", "clearly"), [(6.0, 9.7, True), (6.0, 7.0, False), (7.0, 6.0, False)]
)
def test_a_tenth_less_noise_is_not_clearly_less(one: float, other: float, clearly: bool) -> None:
    assert has_clearly_lower_noise(result(one).last, result(other).last) is clearly


def test_less_is_told_only_where_no_more_is_left() -> None:
    one, two = (finding(DISC, 0.9),), (finding(DISC, 0.9), finding(SCALE, 0.9))
    assert has_fewer_findings(result(6.4, *one), result(6.0, *two))
    assert not has_fewer_findings(
        result(9.0, *one), result(6.0, *two)
    )  # what it lacks is in its noise
    assert not has_fewer_findings(result(6.0, *two), result(6.0, *two))
    assert not has_fewer_findings(result(6.0), result(6.0, *two))  # something is there


def searched(rests: Rests, baseline: Baseline, *found: Candidate) -> Any:
    """A search of two discs that found just these."""
    nothing = fit(rests, ARM, baseline, baseline.model, [], [])
    scored = score_candidates(make_projection(nothing, ARM), [eccentric(2), eccentric(4)])
    start = [np.zeros(len(c.columns)) for c in found]
    last = fit(rests, ARM, baseline, baseline.model, found, start)
    return SimpleNamespace(searched=last, scores=scored.scores)


def test_a_set_repeated_counts_only_if_hardly_less_likely_than_the_first() -> None:
    """The disc of joint 2 is off its axis; with that barred the search names joint 4's."""
    rng = np.random.default_rng(8)
    sessions = [
        synthetic.session(ARM, ARM.nominal(), rng, readings=60, noise_mm=0.004, name=name)
        for name in ("before", "later")
    ]
    given = from_calibration(calibrate(sessions[:1], ARM).calibration, ARM, is_given=True)
    rests = collect_rests(planted(sessions[1:], wave(2, 60.0)), ARM)
    true, false = (searched(rests, given, eccentric(joint)) for joint in (2, 4))
    assert not is_likely_beside(false, true, ARM)
    assert is_likely_beside(true, false, ARM)
    assert is_likely_beside(true, true, ARM)


@pytest.mark.parametrize(
    ("nats", "parted", "counts"), [(-9.9, False, True), (-10.1, False, False), (-99.0, True, True)]
)
def test_ten_nats_less_are_as_likely_and_what_was_parted_otherwise_is_not_compared(
    nats: float, parted: bool, counts: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    def of(placement: list[int], *findings: Candidate) -> Any:
        rests = SimpleNamespace(observations=SimpleNamespace(placement=np.array(placement)))
        fitted = SimpleNamespace(linear=SimpleNamespace(rests=rests), findings=findings)
        return SimpleNamespace(searched=fitted, scores=None)

    weight = {(DISC,): 50.0, (SCALE,): 50.0 + nats}
    monkeypatch.setattr(module, "compute_log_odds", lambda new, old, *_: weight[new] - weight[old])
    before, again = of([0, 0, 1], DISC), of([0, 0, 2] if parted else [0, 0, 1], SCALE)
    assert is_likely_beside(again, before, ARM) is counts
