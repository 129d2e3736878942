"""What a search does between its steps: fits, scores, prunes, and renames findings."""

from __future__ import annotations

import numpy as np
import pytest

from armd.compensation.diagnose.problem.linear import Baseline, ModelState
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.diagnose.search.search import Search
from armd.compensation.diagnose.search.survey import Survey
from armd.compensation.effects import catalogue, location
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.encoder.encoder_eccentricity import make_harmonic_columns
from armd.compensation.model.calibration import ArtefactCorrection, Calibration
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.model.terms import Term
from support import synthetic

ARM = synthetic.arm()
DISCS = [
    Candidate(
        "encoder_eccentricity", location.joint(k), make_harmonic_columns(k, 1, 1e-4), (f"q{k}",)
    )
    for k in range(1, 7)
]
RIGHT, WRONG = DISCS[2], DISCS[4]


@pytest.fixture
def search(monkeypatch: pytest.MonkeyPatch) -> Search:
    """Of a session with the disc of joint 3 off centre; the disc of joint 6 is not looked for."""
    monkeypatch.setattr(catalogue, "list_all_candidates", lambda _facts: iter(DISCS))
    wave = Harmonic(kind="sin", joint=3, order=1)
    term = Term(parameter="theta_3", basis=[wave], coefficient=2e-4)
    session = synthetic.session(
        ARM, ARM.nominal(), np.random.default_rng(3), terms=[term], encoder_rad=5e-6
    )
    content = Calibration(
        arm=ARM.serial_number, created="2026-03-01T00:00:00Z", reference_temperature_c=20.0,
        constants={},
    )  # fmt: skip
    model = ModelState(ARM.nominal(), (), 20.0, ArtefactCorrection())
    baseline = Baseline(model, content, True, (), (), np.zeros((0, 0)))
    rests = collect_rests([session], ARM)
    return Search(rests, ARM, baseline, barred=DISCS[5].__eq__)


@pytest.fixture
def survey(search: Search) -> Survey:
    return search.survey


def test_candidates_are_counted_as_tests_and_work(survey: Survey) -> None:
    scored = survey.score(survey.fit([]))
    alive = int((scored.scores.freedom > 0).sum())
    assert len(scored.scores.signatures.candidates) == 5 and survey.tests == alive > 1
    assert survey.parted is None and survey.work.done > 0.0
    survey.score(survey.fit([RIGHT]))
    assert survey.parted is not None and survey.tests == alive


def test_what_is_not_significant_is_pruned_and_steps_add_one_finding_each(survey: Survey) -> None:
    first = survey.fit([])
    both = survey.fit([WRONG, RIGHT], first)
    assert survey.prune(both).findings == (RIGHT,)
    steps = survey.fit_steps(first, both)
    assert [step.findings for step in steps] == [(), (WRONG,), (WRONG, RIGHT)]
    assert steps[0] is first and steps[-1] is both


def test_a_wrong_name_gives_way_to_the_right_one(search: Search) -> None:
    current = search.survey.fit([WRONG])
    scored = search.survey.score(current)
    assert search._rename_one(current, scored)[0].findings == (RIGHT,)
    tried = set[str]()
    renamed, _, findings = search._rename_less_likely(current, scored, tried)
    assert renamed.findings == (RIGHT,) == tuple(f.candidate for f in findings) and tried
    # A set that was tried before leads nowhere new.
    assert search._rename_less_likely(current, scored, tried)[0] is current
