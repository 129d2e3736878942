"""Everything that a diagnosis found, as data."""

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

#: What judges the findings: left out of their fit only, or ("") of the search for them, too.
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
    """How much of what goes with its variables a cause accounts for."""

    share: float
    variables: tuple[str, ...]  # of the cause, and of what is left beside it
    checks: tuple[PartCheck, ...]

    @property
    def guess(self) -> bool:
        """Whether the name is no more than the nearest one."""
        return self.share < ENOUGH


@dataclass(frozen=True)
class Rival:
    """Another cause that these data would also bear."""

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
    variants: tuple[tuple[Candidate, float], ...]  # what an experiment must tell apart, one by one
    #: how much of what goes with its variables; once all is found
    explained: Explained | None = None

    @property
    def is_of_several_names(self) -> bool:
        """Whether it has no name because several causes would do, most probably one of these."""
        named = sum(r.probability for r in self.rivals if r.candidate.cause != "unknown")
        return self.candidate.cause == "unknown" and named > self.probability / 2


@dataclass(frozen=True)
class RivalCauses:
    """Causes that may be there instead of some findings, all others being there as well."""

    instead: tuple[Candidate, ...]
    finding_numbers: tuple[int, ...]  # of those that they would be instead of
    odds: float  # against the findings


@dataclass(frozen=True)
class RefusedCandidate:
    """A candidate whose fit left the neighbourhood of the model under test."""

    candidate: Candidate
    reason: str


@dataclass(frozen=True, kw_only=True)
class SearchResult:
    """What the search ends with."""

    facts: SessionFacts
    first: Fit  # without findings
    searched: Fit  # with those that the search found, growth that is not known absorbing
    last: Fit  # with all, the growth that the readings show among them
    #: makes fits with none, the first, the first two … of the findings; each takes its time
    steps: Callable[[], Sequence[Fit]]
    findings: tuple[Finding, ...]
    rival_causes: tuple[RivalCauses, ...]  # sets that explain as well
    scores: Scores  # of the whole catalogue
    tests: int  # candidates that the data can see
    remaining_p: float  # family-wise p of the strongest candidate left out
    remaining_depends_on: tuple[str, ...]
    untold: tuple[str, ...]  # causes that these data could not show whatever their size
    would_show: dict[str, float]  # noise units of each cause at its typical size, at best
    refused: tuple[RefusedCandidate, ...]  # what the residuals would like, and cannot be

    @property
    def signatures(self) -> Signatures:
        """Those of the whole catalogue."""
        return self.scores.signatures


@dataclass(frozen=True)
class Gain:
    """3-D RMS on held-out readings before and after a finding, and 95 % of their difference."""

    before_um: float
    after_um: float
    interval_um: tuple[float, float]
    is_confirmed: bool  # held-out readings improve beyond doubt
    #: before and after, the rows named as outliers left out of both, where there are some
    without_outliers_um: tuple[float, float] | None = None


@dataclass(frozen=True)
class ValidatedFindings:
    """The findings written, by number, and squared residuals held out (n,) mm² without any and
    with what is written."""

    numbers: tuple[int, ...]
    before: F64
    after: F64
    #: of those of which the repeated search tells nothing: of the look that bears them out
    gains: dict[int, Gain]
    by: JudgedBy = ""
    contradicted_later: tuple[int, ...] = ()  # confirmed, but not by what came after
    growth: bool = False  # the first link's joins them
    #: factors for the odds of findings that the readings held out speak against
    doubts: Mapping[int, float] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class MovedArtefact:
    """A placement that became two."""

    session: str
    placement: str
    row: int  # the first afterwards, from 1
    instant_unix_s: float  # halfway from the last before; NaN without times
    candidate: Candidate
    amplitudes: F64  # (6,) mm and rad, base frame, about the middle of the placement
    uncertainties: F64  # (6,)
    p_value: float  # family-wise
    probability: float  # that it is this and not a slip or a step of the base, at that instant
    rivals: tuple[tuple[Candidate, float], ...]  # those, with probabilities
    sessions: tuple[Session, ...]  # with the placement parted


@dataclass(frozen=True)
class Outlier:
    """A reading that no cause explains: its session, its row (from 1), how far off it is."""

    session: str
    row: int
    error_um: float


@dataclass(frozen=True, kw_only=True)
class Diagnosis:
    """Everything `armd diagnose` tells."""

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
    written_clear_um: tuple[float, float] | None  # the same without the outliers, if any are named
    later_gain_um: tuple[float, float] | None  # 95 % of what these gain in another session
    contradicted_later: tuple[
        int, ...
    ]  # go with time and are not written: what came later contradicts
    written_by: JudgedBy  # these two
    extended: Calibration
    remarks: tuple[str, ...]  # of the readings themselves: what was mended, what cannot be
    touched: tuple[MovedArtefact, ...]  # placements parted in two
    touched_gain: Gain | None
    skipped: tuple[str, ...] = ()  # what the bound on the search's work did not allow

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Findings other than outliers, in the order in which they were added."""
        return self.search.findings

    @property
    def significant_rest(self) -> bool:
        """Whether something significant stays that is in no finding."""
        return self.search.remaining_p < ALPHA
