"""A comparison of two searches of the same readings: their noise and their probability."""

from __future__ import annotations

import numpy as np

from armd.compensation.diagnose.constants import AS_QUIET_AGAIN, AS_WELL
from armd.compensation.diagnose.diagnosis import SearchResult
from armd.compensation.diagnose.fitting.absorbed_error import allow_only_absorbed_error
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.scoring.candidates import score_candidates
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.compensation.diagnose.scoring.threshold import is_significant
from armd.compensation.diagnose.search.set_posterior import compute_log_odds
from armd.compensation.model.arm import Arm


def may_replace(repeated: SearchResult, before: SearchResult, arm: Arm) -> bool:
    """Whether the findings of the *repeated* search replace those found *before*.

    In the repeated search the calibration may also be wrong by what it may have absorbed.
    """
    return has_fewer_findings(repeated, before) and not has_lost_cause(repeated, before, arm)


def has_fewer_findings(repeated: SearchResult, before: SearchResult) -> bool:
    """Whether the *repeated* search has fewer findings than *before*, with no clearly larger noise.

    At least one finding is needed: the causes that are older than the calibration are still there.
    """
    if has_clearly_lower_noise(before.last, repeated.last):
        return False
    return 0 < len(repeated.findings) < len(before.findings)


def has_lost_cause(repeated: SearchResult, before: SearchResult, arm: Arm) -> bool:
    """Whether a named cause found *before*, but not in the *repeated* search, is still significant.

    Findings without a name do not count: absorbed effects leave such functions, too.

    In the repeated search the calibration may be wrong by what it absorbed of all causes found
    before. Of a cause that is not reported it absorbed nothing. So the test allows only the
    calibration error from the causes that *repeated* reports, which are in the model.
    """
    last = repeated.searched
    places = {candidate.place for candidate in last.findings}
    named = [c for c in before.searched.findings if c.cause != "unknown"]
    gone = [candidate for candidate in named if candidate.place not in places]
    if not gone:
        return False
    baseline = allow_only_absorbed_error(before.searched.baseline, last, arm)
    refitted = fit(
        last.linear.rests, arm, baseline, last.model, last.findings, last.amplitudes,
        noise=last.noise,
    )  # fmt: skip
    log_p = score_candidates(make_projection(refitted, arm), gone).scores.log_p
    return bool(is_significant(log_p, before.tests).any())


def is_likely_beside(repeated: SearchResult, before: SearchResult, arm: Arm) -> bool:
    """Whether the findings of *repeated* are hardly less likely than those *before*, as whole sets.

    *repeated* lacks what held-out readings refute. Both sets are weighed about the point and in the
    noise of the fit *before*. Held-out readings also refute a true finding that does not continue,
    such as a twist of one day that stays after the last reading. Among the sets that a search may
    report instead, some set predicts held-out readings a little better, however improbable it is.
    True is returned where placements were split differently: the sets then explain different
    readings.
    """
    about, repeated_fit = before.searched, repeated.searched
    placements = [fitted.linear.rests.observations.placement for fitted in (about, repeated_fit)]
    if not np.array_equal(placements[0], placements[1]):
        return True
    likelier = compute_log_odds(repeated_fit.findings, about.findings, about, arm, before.scores)
    return likelier >= -AS_WELL


def has_clearly_lower_noise(fitted: Fit, reference: Fit) -> bool:
    """Whether *fitted* leaves a clearly lower noise than the *reference*."""
    return AS_QUIET_AGAIN * fitted.noise.own_mm <= reference.noise.own_mm
