"""Two searches of the same readings beside each other: which leaves less, and which is likelier."""

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
    """Whether what the *repeated* search found, the calibration being wrong by what it may have
    taken up, counts instead of what was found *before*."""
    return has_fewer_findings(repeated, before) and not has_lost_cause(repeated, before, arm)


def has_fewer_findings(repeated: SearchResult, before: SearchResult) -> bool:
    """Whether the *repeated* search found less than was found *before*, and no more is left to the
    noise. The older causes are there still, so that it is not nothing."""
    if has_clearly_lower_noise(before.last, repeated.last):
        return False
    return 0 < len(repeated.findings) < len(before.findings)


def has_lost_cause(repeated: SearchResult, before: SearchResult, arm: Arm) -> bool:
    """Whether a cause found *before*, and not in the *repeated* search, is significant all the
    same. What has no name is none: what was taken up leaves such functions, too.

    There the calibration counted as wrong by what it took up of all causes found before. Of a
    cause that is not told it took up nothing: the calibration is asked here that is wrong only by
    what it took up of those that *repeated* reports, which are in the model.
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
    """Whether what *repeated* found, without what readings held out refute, is hardly less likely
    than what was found *before*, all of it together, about that fit's point and in its noise.

    Readings held out refute a true finding that does not go on, too: a twist of the day, which
    stays as it is after the last reading. Of what a search may say instead, some set predicts
    them a little better, however unlikely it is. Where placements were parted otherwise the sets
    explain other readings, and are not compared.
    """
    about, repeated_fit = before.searched, repeated.searched
    placements = [fitted.linear.rests.observations.placement for fitted in (about, repeated_fit)]
    if not np.array_equal(placements[0], placements[1]):
        return True
    likelier = compute_log_odds(repeated_fit.findings, about.findings, about, arm, before.scores)
    return likelier >= -AS_WELL


def has_clearly_lower_noise(fitted: Fit, reference: Fit) -> bool:
    """Whether *fitted* leaves clearly less to the noise than the *reference*."""
    return AS_QUIET_AGAIN * fitted.noise.own_mm <= reference.noise.own_mm
