"""How probable a name is does not depend on which name is in the model."""

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.diagnose.diagnose import model_under_test
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.problem.rests import gather_rests
from armd.compensation.diagnose.problem.session_facts import gather_facts
from armd.compensation.diagnose.scoring.candidates import score_candidates
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.compensation.diagnose.search.findings import weighed
from armd.compensation.effects import catalogue
from support import synthetic

ARM = synthetic.arm()
DISC, OVAL = ("encoder_eccentricity", "joint 3"), ("encoder_ellipticity", "joint 3")
ENCODER_RAD = 1e-5


@pytest.mark.parametrize(("size_rad", "share"), [(1e-5, 0.8), (1e-5, 1.0), (2e-5, 1.0)])
def test_a_rival_is_weighed_with_its_own_shape_as_a_finding_is(
    size_rad: float, share: float
) -> None:
    """A disc that errs once and twice a turn, the second *share* as much: neither an eccentric nor
    an oval one quite. Each beside the other as a finding once was sure."""
    rng = np.random.default_rng(5)
    session = synthetic.session(ARM, ARM.nominal(), rng, encoder_rad=ENCODER_RAD)
    q = session.states.q.copy()
    q[:, 2] += size_rad * (np.sin(q[:, 2]) + share * np.sin(2 * q[:, 2] + 1.0))
    session = replace(session, states=replace(session.states, q=q))
    rests, baseline = gather_rests([session], ARM), model_under_test([session], ARM, None)
    catalogued = catalogue.candidates(gather_facts(rests, ARM, baseline))
    names = {(c.cause, str(c.location)): c for c in catalogued}
    both = [names[DISC], names[OVAL]]
    told = []
    for own in both:
        found = fit(rests, ARM, baseline, baseline.model, [own], [np.zeros(2)])
        (finding,) = weighed(score_candidates(make_projection(found, ARM), both), 100)
        told.append(finding.probability)
    assert sum(told) == pytest.approx(1.0, abs=0.03)
