"""An arm whose links all grow more than its calibration says, and an artefact that does: they show
almost the same, and what tells them apart is that links and artefact are not equally warm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import Candidate, SessionFacts, make_temperature
from armd.compensation.effects.thermal.link_expansion import TOGETHER
from armd.compensation.identify.calibrate import calibrate
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.parameters import TIP_PARAMETERS
from armd.compensation.model.terms import Term
from support import synthetic
from support.whole_scene import whole_scene

ARM = synthetic.arm()
SHOP_C = (15.0, 18.0, 23.0, 26.0)
GROWTH_PER_K = 4e-6


def test_links_of_one_material_grow_together_where_the_calibration_knew_their_growth() -> None:
    """By all their lengths, each by the temperature of its own link; at the longest of them."""
    facts = replace(whole_scene().free, has_fixed_constants=True)
    assert _list_together(facts) == []  # its last link has no sensor
    joints = [*facts.arm.joint[:5], facts.arm.joint[4]]
    facts = replace(facts, arm=facts.arm.model_copy(update={"joint": joints}))
    (candidate,) = _list_together(facts)
    assert str(candidate.location) == "link 3"
    assert candidate.depends_on == ("t1", "t2", "t3", "t4")
    grown = {term.parameter: term for term in candidate.columns[0].terms}
    assert len(grown) == len(candidate.columns[0].terms) == 12  # d and a of six links
    for name, term in grown.items():
        assert term.coefficient == facts.constants[facts.arm.layout.index(name)]
        assert term.basis == [make_temperature(facts.weights(int(name[-1])))]
    text = CATALOGUE["link_expansion"].describe(candidate, np.array([3e-6]))
    assert text == "all links expand by +3.0 µm per metre and kelvin more"
    assert _list_together(replace(facts, has_fixed_constants=False)) == []
    assert _list_together(replace(facts, open_growth=frozenset({"a_1"}))) == []


def test_links_without_sensors_of_their_own_grow_together_by_any_one() -> None:
    facts = replace(whole_scene().free, has_fixed_constants=True)
    facts = replace(facts, lost_links=frozenset(facts.joints))
    found = _list_together(facts)
    assert [candidate.depends_on for candidate in found] == [(name,) for name in facts.sensors]


def _list_together(facts: SessionFacts) -> list[Candidate]:
    listed = CATALOGUE["link_expansion"].candidates(facts)
    return [c for c in listed if c.columns[0].name == TOGETHER]


def measured(grown: Sequence[int] = (), artefact_per_k: float = 0.0) -> tuple[Session, ...]:
    """Eight balls in three places, the artefact a kelvin warmer or colder than the links; noise of
    the encoders, 2 µm at the tip. Links *grown* grow by `GROWTH_PER_K` more than at the
    calibration, the artefact by *artefact_per_k* less than it says."""
    truth = synthetic.disturbed(ARM, np.random.default_rng(5), 0.1)
    rng = np.random.default_rng(6 + len(grown) + 10 * (artefact_per_k > 0.0))
    sessions = []
    for celsius in SHOP_C:
        session = synthetic.session(
            ARM, truth, rng, terms=_grow(truth, grown), temperature_c=celsius, scatter_k=0.05,
            targets=8, readings=96, encoder_rad=4e-6, uncertainty_mm=0.0003, name=f"{celsius}",
        )  # fmt: skip
        artefact = session.artefact.model_copy(update={"expansion_per_k": artefact_per_k})
        artefact_c = np.full(session.n, celsius + rng.normal())
        sessions.append(replace(session, artefact=artefact, artefact_c=artefact_c))
    return tuple(sessions)


def _grow(truth: np.ndarray, links: Sequence[int]) -> list[Term]:
    """Of *links*; the stylus is a body of its own."""
    return [
        term.model_copy(
            update={"coefficient": GROWTH_PER_K * truth[ARM.layout.index(term.parameter)]}
        )
        for term in make_length_terms(ARM, [1])
        if term.parameter not in TIP_PARAMETERS and int(term.parameter[-1]) in links
    ]


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    return calibrate(measured(), ARM).calibration


@pytest.mark.slow
def test_all_links_are_named_together(calibration: Calibration) -> None:
    diagnosis = diagnose(measured(grown=range(1, 7)), ARM, calibration)
    (finding,) = diagnosis.findings
    assert finding.candidate.place == ("link_expansion", "link 3")
    assert finding.candidate.columns[0].name == TOGETHER
    assert finding.probability > 0.9
    assert diagnosis.search.last.amplitudes[0] == pytest.approx(GROWTH_PER_K, rel=0.1)


@pytest.mark.slow
def test_two_links_are_named_each(calibration: Calibration) -> None:
    diagnosis = diagnose(measured(grown=(3, 5)), ARM, calibration)
    assert {f.candidate.place for f in diagnosis.findings} == {
        ("link_expansion", "link 3"),
        ("link_expansion", "link 5"),
    }
    assert all(f.candidate.columns[0].name != TOGETHER for f in diagnosis.findings)


@pytest.mark.slow
def test_an_artefact_is(calibration: Calibration) -> None:
    diagnosis = diagnose(measured(artefact_per_k=GROWTH_PER_K), ARM, calibration)
    (finding,) = diagnosis.findings
    assert finding.candidate.place == ("artefact_expansion", "artefact")
    assert finding.probability > 0.9
    assert diagnosis.search.last.amplitudes[0] == pytest.approx(-GROWTH_PER_K, rel=0.1)
