"""How probable a name is does not depend on which name is in the model."""

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.fitting.under_test import make_model_and_judge_sessions
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.diagnose.problem.session_facts import collect_facts
from armd.compensation.diagnose.scoring.candidates import score_candidates
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.compensation.diagnose.search.findings import weigh_findings
from armd.compensation.effects import catalogue
from support import synthetic
from support.selection import parametrize_default

ARM = synthetic.arm()
DISC, OVAL = ("encoder_eccentricity", "joint 3"), ("encoder_ellipticity", "joint 3")
ENCODER_RAD = 1e-5


def told(size_rad: float, second: float) -> list[float]:
    """How probable the names are, each beside the other as the only finding: the eccentric disc and
    the oval one, of a disc that errs once a turn and a share of that twice."""
    rng = np.random.default_rng(5)
    session = synthetic.session(ARM, ARM.nominal(), rng, encoder_rad=ENCODER_RAD)
    q = session.states.q.copy()
    q[:, 2] += size_rad * (np.sin(q[:, 2]) + second * np.sin(2 * q[:, 2] + 1.0))
    session = replace(session, states=replace(session.states, q=q))
    rests = collect_rests([session], ARM)
    baseline, _ = make_model_and_judge_sessions([session], ARM, None)
    catalogued = catalogue.list_all_candidates(collect_facts(rests, ARM, baseline))
    names = {(c.cause, str(c.location)): c for c in catalogued}
    both = [names[DISC], names[OVAL]]
    probabilities = []
    for own in both:
        found = fit(rests, ARM, baseline, baseline.model, [own], [np.zeros(2)])
        (finding,) = weigh_findings(score_candidates(make_projection(found, ARM), both), 100)
        probabilities.append(finding.probability)
    return probabilities


@parametrize_default(("size_rad", "second"), [(1e-5, 0.8), (1e-5, 1.0), (2e-5, 1.0)])
def test_a_rival_is_weighed_with_its_own_shape_as_a_finding_is(
    size_rad: float, second: float
) -> None:
    """A disc that is neither an eccentric nor an oval one quite: each beside the other as a finding
    once was sure."""
    assert sum(told(size_rad, second)) == pytest.approx(1.0, abs=0.03)


@pytest.mark.slow
@parametrize_default("size_rad", [2e-4, 1e-3, 5e-3])
def test_a_rival_far_from_likely_stays_so_with_its_own_shape(size_rad: float) -> None:
    """An eccentric disc that is hundreds of noise units strong: an oval one gains thousands by
    another shape, and lacks more."""
    eccentric, oval = told(size_rad, 0.0)
    assert eccentric > 0.99
    assert oval < 0.01
