"""The search repeated without some placements: what is known of them when they took no part."""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.diagnosis import SearchResult
from armd.compensation.diagnose.heldout.cross_validation import CrossValidated, validate_in_turn
from armd.compensation.diagnose.problem.linear import Baseline, ModelState
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.diagnose.scoring.candidates import PartedSurvey
from armd.compensation.diagnose.search import search
from armd.compensation.effects import location
from armd.compensation.effects.effect import Candidate
from armd.compensation.effects.encoder.encoder_eccentricity import make_harmonic_columns
from armd.compensation.model.calibration import ArtefactCorrection
from armd.compensation.model.kinematics import compute_pose
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.model.terms import Term
from armd.compensation.wording import ARC_SECOND
from support import synthetic
from support.drawn import drawn

ARM = synthetic.arm()
PLACEMENTS, READINGS = 4, 240
NOISE_RAD, PLANTED_RAD = 1 * ARC_SECOND, 40 * ARC_SECOND
CANDIDATES = [
    Candidate(
        "encoder_eccentricity", location.joint(k), make_harmonic_columns(k, 1, 1e-4), (f"q{k}",)
    )
    for k in range(1, 7)
]


def measured(seed: int, planted: float) -> Session:
    """Poses on an artefact, joint 3's disc off centre."""
    wave = Harmonic(kind="sin", joint=3, order=1)
    term = Term(parameter="theta_3", basis=[wave], coefficient=planted)
    return synthetic.session(
        ARM,
        ARM.nominal(),
        np.random.default_rng(seed),
        terms=[term],
        targets=6,
        spread_mm=80.0,
        placements=PLACEMENTS,
        readings=READINGS,
        encoder_rad=NOISE_RAD,
    )


def searched(
    session: Session, monkeypatch: pytest.MonkeyPatch
) -> tuple[SearchResult, PartedSurvey | None]:
    """Under the true arm, held; only eccentric discs are in the catalogue."""
    monkeypatch.setattr(search.catalogue, "list_all_candidates", lambda _facts: iter(CANDIDATES))
    model = ModelState(ARM.nominal(), (), 20.0, ArtefactCorrection())
    baseline = Baseline(model, drawn(ARM), True, (), (), np.zeros((0, 0)))
    whole = search.Search(collect_rests([session], ARM), ARM, baseline)
    return whole.run(), whole.survey.parted


def validated(result: SearchResult, parted: PartedSurvey | None) -> CrossValidated:
    return validate_in_turn(result, parted, ARM, lambda _text, _share: None)


def rigid_squares(session: Session, terms: Sequence[Term] = ()) -> np.ndarray:
    """(n,) squared distances after each placement's best rigid fit, by scipy."""
    p = np.tile(ARM.nominal(), (session.n, 1))
    for term in terms:
        p[:, ARM.layout.index(term.parameter)] += term.coefficient * np.sin(session.states.q[:, 2])
    tip = compute_pose(session.states.q, p)[0]
    at = session.artefact.positions_mm()[session.target]
    found = np.empty(session.n)
    for placement in range(PLACEMENTS):
        own = session.placement == placement
        a, b = tip[own] - tip[own].mean(axis=0), at[own] - at[own].mean(axis=0)
        turned = Rotation.align_vectors(a, b)[0].apply(b)
        found[own] = ((a - turned) ** 2).sum(axis=1)
    return found


def fits_each_placement(squares: np.ndarray, session: Session) -> None:
    """No rigid fit is better than the best; single gross readings may pull it off by a little."""
    best = rigid_squares(session)
    for placement in range(PLACEMENTS):
        own = session.placement == placement
        assert 0.9999 * best[own].mean() < squares[own].mean() < 1.01 * best[own].mean()


def test_what_is_found_everywhere_is_gained_in_each_placement_left_out(monkeypatch) -> None:
    session = measured(3, PLANTED_RAD)
    result, parted = searched(session, monkeypatch)
    assert [str(f.candidate.location) for f in result.findings] == ["joint 3"]
    before, after = validated(result, parted).squares
    fits_each_placement(before, session)
    # The truth's own residuals are the best that anybody could reach on them.
    truth = Term(
        parameter="theta_3", basis=[Harmonic(kind="sin", joint=3, order=1)], coefficient=PLANTED_RAD
    )
    best = rigid_squares(session, [truth])
    for placement in range(PLACEMENTS):
        own = session.placement == placement
        assert best[own].mean() < 0.05 * before[own].mean()
        assert after[own].mean() < 1.1 * best[own].mean()


def test_what_one_placement_alone_shows_is_not_gained_there(monkeypatch) -> None:
    """Its own readings made the finding; the search on the others finds nothing."""
    with_it, without = measured(5, PLANTED_RAD), measured(5, 0.0)
    strange = with_it.placement == 2
    q = np.where(strange[:, None], with_it.states.q, without.states.q)
    states = without.states.rows(slice(None))
    object.__setattr__(states, "q", q)
    session = without.rows(slice(None))
    object.__setattr__(session, "states", states)
    result, parted = searched(session, monkeypatch)
    assert result.findings, "all readings together show something"
    first, *_, last = validated(result, parted).squares
    assert first[strange].mean() > 10 * first[~strange].mean()
    np.testing.assert_array_equal(last[strange], first[strange])


def test_nothing_found_has_the_figure_of_the_model_under_test_only(monkeypatch) -> None:
    session = measured(7, 0.0)
    result, parted = searched(session, monkeypatch)
    assert not result.findings
    found = validated(result, parted)
    (only,) = found.squares
    fits_each_placement(only, session)
    places = session.placement * len(session.artefact.targets) + session.target
    assert len(np.unique(found.groups)) == len(np.unique(places))
