"""The result of a diagnosis, as data."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.constants import ALPHA, ENOUGH
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline
from armd.compensation.diagnose.problem.signatures import Signatures
from armd.compensation.diagnose.scoring.evidence import Scores
from armd.compensation.effects.effect import Candidate, SessionFacts
from armd.compensation.model.arm import Arm
from armd.compensation.model.calibration import Calibration

#: The held-out readings that judge the findings. They are not in the fit of the findings; with ""
#: they are not in the search for them either.
JudgedBy = Literal["", "placements left out", "targets left out within placements"]


@dataclass(frozen=True)
class PartCheck:
    """The amplitude of a cause in parts of the readings, as a share of that in all of them."""

    by: str  # "session", "placement", "time", or a column's name
    parts: tuple[str, ...]
    ratio: F64
    sigma: F64
    p_value: float  # that the amplitude is the same in all parts
    excess: float  # χ² beyond what noise makes


@dataclass(frozen=True)
class Explained:
    """The share that a cause explains of what depends on its variables."""

    share: float
    variables: tuple[str, ...]  # of the cause, and of unnamed structure that remains
    checks: tuple[PartCheck, ...]

    @property
    def guess(self) -> bool:
        """Whether the name is no more than the nearest one."""
        return self.share < ENOUGH


@dataclass(frozen=True)
class Rival:
    """Another cause that may explain these data."""

    candidate: Candidate
    probability: float
    angle_deg: float  # between the projected signatures


@dataclass(frozen=True)
class Finding:
    """A finding of the search, before its gain is measured."""

    candidate: Candidate
    p_value: float  # family-wise
    statistic: float
    probability: float
    rivals: tuple[Rival, ...]
    variants: tuple[tuple[Candidate, float], ...]  # what an experiment must separate, one by one
    #: how much it explains of what depends on its variables; set when all is found
    explained: Explained | None = None

    @property
    def is_of_several_names(self) -> bool:
        """Whether it has no name because several causes are possible, most probably one of them."""
        named = sum(r.probability for r in self.rivals if r.candidate.cause != "unknown")
        return self.candidate.cause == "unknown" and named > self.probability / 2


@dataclass(frozen=True)
class RivalCauses:
    """Causes that may be there instead of some findings, with all other findings there as well.

    Instead of no finding, they are beside all.
    """

    instead: tuple[Candidate, ...]
    finding_numbers: tuple[int, ...]  # of the findings that they replace
    odds: float  # against the findings


@dataclass(frozen=True)
class RefusedCandidate:
    """A candidate whose fit would lose a certified length."""

    candidate: Candidate
    reason: str


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """The result of the search."""

    facts: SessionFacts
    first: Fit  # without findings
    searched: Fit  # with those that the search found; unknown expansion of links absorbs
    last: Fit  # with all findings, among them the expansion of links that the readings show
    #: makes fits with none, the first, the first two … of the findings; slow
    steps: Callable[[], Sequence[Fit]]
    findings: tuple[Finding, ...]
    rival_causes: tuple[RivalCauses, ...]  # sets that explain as well
    further_causes: tuple[RivalCauses, ...]  # sets with one cause more
    further_odds: float  # of one more cause beside the findings, whichever it is
    scores: Scores  # of the whole catalogue
    tests: int  # candidates that are not absorbed
    remaining_p: float  # family-wise p of the strongest candidate that is not in the model
    remaining_depends_on: tuple[str, ...]
    untold: tuple[str, ...]  # causes that these data could not show whatever their size
    would_show: dict[str, float]  # noise units of each cause at its typical size, at best
    refused: tuple[RefusedCandidate, ...]  # would lower the residuals, but are not plausible

    @property
    def signatures(self) -> Signatures:
        """The signatures of the whole catalogue."""
        return self.scores.signatures


@dataclass(frozen=True)
class Gain:
    """The 3-D RMS on held-out readings before and after a finding, and 95 % of their difference."""

    before_um: float
    after_um: float
    interval_um: tuple[float, float]
    is_confirmed: bool  # held-out readings improve significantly
    #: before and after without the rows listed as outliers, if there are any
    without_outliers_um: tuple[float, float] | None = None


@dataclass(frozen=True)
class ValidatedFindings:
    """The findings written, by number, and squared held-out residuals (n,) mm² before and after.

    *before*: without any finding; *after*: with those written.
    """

    numbers: tuple[int, ...]
    before: F64
    after: F64
    #: by finding, where the repeated search is uninformative: gains of the scheme that validates it
    gains: dict[int, Gain]
    by: JudgedBy = ""
    contradicted_later: tuple[int, ...] = ()  # confirmed, but later readings contradict
    growth: bool = False  # the first link's expansion is written, too
    #: factors for the odds of findings that held-out readings contradict
    doubts: Mapping[int, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class MovedArtefact:
    """A placement that was split in two because its artefact moved."""

    session: str
    placement: str
    row: int  # first row after the move, from 1
    instant_unix_s: float  # halfway between the rests before and after; NaN without times
    candidate: Candidate
    amplitudes: F64  # (6,) mm and rad, base frame, about the middle of the placement
    uncertainties: F64  # (6,)
    p_value: float  # family-wise
    probability: float  # that it is this and not a slip or a step of the base, at that instant
    rivals: tuple[tuple[Candidate, float], ...]  # the latter, with probabilities


@dataclass(frozen=True)
class Outlier:
    """A reading that no cause explains: its session, its row (from 1), how far off it is."""

    session: str
    row: int
    error_um: float


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """Everything that `armd diagnose` reports."""

    arm: Arm
    sessions: tuple[Session, ...]
    holdout: tuple[Session, ...]
    baseline: Baseline
    search: SearchResult
    rms_um: float  # of the sessions, under the model to test
    heldout_rms_um: float
    noise_floor_um: float
    remaining_rms_um: float  # of the sessions, under the extended model
    gains: tuple[Gain, ...]  # one per finding of the search
    outliers: tuple[Outlier, ...]
    outlier_p: float
    outlier_gain: Gain | None
    written: tuple[int, ...]  # findings in the extended calibration, by number
    written_rms_um: tuple[float, float]  # held out, without any and with these
    written_clear_um: tuple[float, float] | None  # the same without the outliers, if there are any
    later_gain_um: tuple[float, float] | None  # 95 % of what these gain in another session
    contradicted_later: tuple[
        int, ...
    ]  # depend on time, not written: later readings contradict them
    written_by: JudgedBy  # the readings of written_rms_um and written_clear_um
    extended: Calibration
    remarks: tuple[str, ...]  # about the readings: what was corrected, what cannot be
    touched: tuple[MovedArtefact, ...]  # placements split in two
    touched_gain: Gain | None
    skipped: tuple[str, ...] = ()  # what was skipped because of the bound on the work

    @property
    def findings(self) -> tuple[Finding, ...]:
        """The findings other than outliers, in the order in which they were added."""
        return self.search.findings

    @property
    def significant_rest(self) -> bool:
        """Whether something significant remains that is in no finding."""
        return self.search.remaining_p < ALPHA
