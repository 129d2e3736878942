"""Two searches of the same readings beside each other: which leaves less, which is likelier, and
what both found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armd.compensation.diagnose.constants import AS_QUIET_AGAIN, AS_WELL
from armd.compensation.diagnose.diagnosis import Finding, SearchResult
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.fitting.taken_up import wrong_only_by
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.scoring.candidates import score_candidates
from armd.compensation.diagnose.scoring.projection import make_projection
from armd.compensation.diagnose.scoring.threshold import significant
from armd.compensation.diagnose.search.revisit import log_weight
from armd.compensation.model.arm import Arm


def counts_instead(again: SearchResult, before: SearchResult, arm: Arm) -> bool:
    """Whether what was found *again*, the calibration being wrong by what it may have taken up,
    counts instead of what was found *before*."""
    return tells_less(again, before) and not loses_a_cause(again, before, arm)


def tells_less(again: SearchResult, before: SearchResult) -> bool:
    """Whether less was found *again* than *before*, and no more is left to the noise. The older
    causes are there still, so that it is not nothing."""
    return not quieter(before.last, again.last) and 0 < len(again.found) < len(before.found)


def loses_a_cause(again: SearchResult, before: SearchResult, arm: Arm) -> bool:
    """Whether a cause found *before*, and not *again*, is significant all the same. What has no
    name is none: what was taken up leaves such functions, too.

    *again* the calibration counted as wrong by what it took up of all causes found before. Of a
    cause that is not told it took up nothing: the calibration is asked here that is wrong only by
    what it took up of those told *again*, which are in the model.
    """
    last = again.searched
    told = {candidate.place for candidate in last.findings}
    named = [c for c in before.searched.findings if c.cause != "unknown"]
    gone = [candidate for candidate in named if candidate.place not in told]
    if not gone:
        return False
    baseline = wrong_only_by(before.searched.baseline, last, arm)
    about = fit(
        last.linear.rests, arm, baseline, last.model, last.findings, last.amplitudes,
        noise=last.noise,
    )  # fmt: skip
    log_p = score_candidates(make_projection(about, arm), gone).scores.log_p
    return bool(significant(log_p, before.tests).any())


def is_likely_beside(again: SearchResult, before: SearchResult, arm: Arm) -> bool:
    """Whether what was found *again*, without what readings held out refute, is hardly less likely
    than what was found *before*, all of it together, about that fit's point and in its noise.

    Readings held out refute a true finding that does not go on, too: a twist of the day, which
    stays as it is after the last reading. Of what a search may say instead, some set predicts
    them a little better, however unlikely it is. Where placements were parted otherwise the sets
    explain other readings, and are not compared.
    """
    about, other = before.searched, again.searched
    placements = [fitted.linear.rests.observations.placement for fitted in (about, other)]
    if not np.array_equal(placements[0], placements[1]):
        return True
    weights = [
        log_weight(about, findings, arm, before.scores)
        for findings in (other.findings, about.findings)
    ]
    return weights[0] >= weights[1] - AS_WELL


def quieter(one: Fit, other: Fit) -> bool:
    """Whether *one* leaves clearly less to the noise than the *other*."""
    return AS_QUIET_AGAIN * one.noise.own_mm <= other.noise.own_mm


def no_surer(found: Sequence[Finding], again: SearchResult) -> tuple[Finding, ...]:
    """The findings no surer than *again*, where that found the same by name."""
    known = {of.candidate.place: of.probability for of in again.found}
    if sorted(f.candidate.place for f in found) != sorted(of.candidate.place for of in again.found):
        return tuple(found)
    lower = [min(f.probability, known[f.candidate.place]) for f in found]
    return tuple(replace(f, probability=p) for f, p in zip(found, lower, strict=True))
