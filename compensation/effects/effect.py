"""A cause in the diagnosis: a named group of columns with a physical reason.

A `Column` is one unknown amplitude times a tie of terms (or a change of the artefact). A
`Candidate` is a cause at a place with its non-linear parameters fixed at one value of their grid.
An `Effect` lists the candidates that an arm and its sessions allow, and describes amplitudes
physically.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, field
from functools import cached_property
from typing import Literal

import numpy as np

from armd.arrays import F64
from armd.compensation.effects.by_temperature import is_difference
from armd.compensation.effects.location import Location
from armd.compensation.model.arm import Arm
from armd.compensation.model.parameters import LEAST_LENGTH_MM, TIP_PARAMETERS
from armd.compensation.model.pose_factors import Axis
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Factor, Term
from armd.compensation.wording import format_clock

AXES: tuple[Axis, ...] = ("x", "y", "z")


@dataclass(frozen=True)
class ArtefactChange:
    """A change of the artefact per unit of amplitude, in the placement's frame.

    "expansion": position × (artefact_c − its reference), amplitude in 1/K.
    "warmth": expansion by the mean of the arm's sensors, in sessions without any artefact_c.
    "scale": position, amplitude dimensionless.
    "target": the named target moves along `axis` (0…2), amplitude in mm.
    "distance": the certified length number `index` grows, amplitude in mm.
    "moved": placement number `index` moves as a whole after `after` of its rests, along or about
        `axis` (0…2, 3…5) of the base frame, about its middle; amplitude in mm and rad.
    "sag": a beam along principal axis `axis` (0…2, the longest first) of the targets bends
        towards gravity across it, by the square of the place along it; amplitude in mm at its end.
    """

    kind: Literal["expansion", "warmth", "scale", "target", "distance", "moved", "sag"]
    target: str = ""
    axis: int = 0
    index: int = 0
    after: int = 0
    artefact: str = ""  # name of the artefact, where the sessions have several; empty: all

    @property
    def is_report_only(self) -> bool:
        """Whether no correction of an artefact can contain it."""
        return self.kind in ("sag", "warmth")


@dataclass(frozen=True)
class Use:
    """A change of parameters by the warming of a joint through its use, at rest before each
    session.

    The parameters move by their weights times the steady rate, rad/s, that would keep it as warm.
    It is known only at the readings, so the daemon cannot evaluate it.
    """

    joint: int
    by_rate: bool  # by the rate at each reading; else by the way since the one before
    time_constant_s: float
    parameters: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Winding:
    """A change of parameters by a joint that is wound up by its way from reading to reading.

    It is wound up to a limiting angle, and is not wound where each session begins. The parameters
    move by their weights. It is known only at the readings.
    """

    joint: int
    within_rad: float
    parameters: tuple[tuple[str, float], ...]


@dataclass(frozen=True)
class Column:
    """One amplitude: its terms, its unit, and its prior standard deviation (typical size)."""

    name: str
    unit: str
    prior_sd: float
    terms: tuple[Term, ...] = ()
    artefact: ArtefactChange | None = None
    reach: float = np.inf  # largest plausible size, in typical sizes
    use: Use | Winding | None = None

    def make_terms(self, amplitude: float) -> Iterator[Term]:
        """Yield the column's terms at an amplitude."""
        for term in self.terms:
            yield term.model_copy(update={"coefficient": term.coefficient * amplitude})


@dataclass(frozen=True)
class Candidate:
    """A cause at a place; `setting` holds the grid's values (order, instant, time constant)."""

    cause: str
    location: Location
    columns: tuple[Column, ...]
    depends_on: tuple[str, ...]
    setting: tuple[tuple[str, float, str], ...] = ()  # (name, value, unit)
    _: KW_ONLY
    #: a finer grid around this candidate for its non-linear parameters; for an unknown effect, a
    #: richer function of the same variables; None if there is none
    refine: Callable[[], Sequence[Candidate]] | None = field(default=None, compare=False)
    #: the candidate at another value of its setting, if that can be as uncertain as a size
    elsewhere: Callable[[float], Candidate] | None = field(default=None, compare=False)
    #: for a candidate that acts through the model's terms: the findings whose terms it includes;
    #: for one that follows the other of two exchanged sensors: their exchange
    through: tuple[Acting, ...] | None = field(default=None, compare=False)
    #: the calibration under test could not contain it, and it is as likely to be there as not
    expected: bool = False
    #: the only cause whose finding it may replace; any other candidate may join any findings
    instead_of: str = ""

    @property
    def is_report_only(self) -> bool:
        """Whether no calibration can contain it, because the daemon and `evaluate` cannot
        apply it.
        """
        changes = (column.artefact for column in self.columns)
        return self.looks_back or any(
            change is not None and change.is_report_only for change in changes
        )

    @property
    def looks_back(self) -> bool:
        """Whether it depends on the history before a reading, and is known only at the readings."""
        return any(column.use is not None for column in self.columns)

    @property
    def factors(self) -> Iterator[Factor]:
        """The factors of all its terms."""
        return (factor for c in self.columns for term in c.terms for factor in term.basis)

    @property
    def instant_unix_s(self) -> float | None:
        """The instant of its step; None if it is no step."""
        return next((value for name, value, _ in self.setting if name == "instant"), None)

    @cached_property
    def place(self) -> tuple[str, str]:
        """The cause and location, as results have them, by which findings are separated."""
        return self.cause, str(self.location)

    def is_within(self, candidate: Candidate) -> bool:
        """Return whether *candidate* has all columns of this one, for example a lower order of a
        curve.
        """
        return self.place == candidate.place and self._adds <= candidate._adds

    def is_like(self, candidate: Candidate) -> bool:
        """Return whether *candidate* is equal, even if it acts through other terms."""
        if self.through is None or candidate.through is None:
            return self == candidate
        column_names, compared_names = (
            [column.name for column in c.columns] for c in (self, candidate)
        )
        return (
            self.place == candidate.place
            and self.setting == candidate.setting
            and column_names == compared_names
        )

    @cached_property
    def _adds(self) -> frozenset[str]:
        return frozenset(repr(column) for column in self.columns)


@dataclass(frozen=True)
class Acting:
    """A finding with its amplitudes in a fit; its terms count as terms of the model."""

    candidate: Candidate
    amplitudes: tuple[float, ...]

    @property
    def terms(self) -> Iterator[Term]:
        """The finding's terms with their coefficients."""
        pairs = zip(self.candidate.columns, self.amplitudes, strict=True)
        return (term for column, amplitude in pairs for term in column.make_terms(amplitude))


def join_finding(findings: Sequence[Candidate], finding: Candidate) -> list[Candidate]:
    """Return the findings with one more, which replaces those that it contains."""
    return [*(c for c in findings if not c.is_within(finding)), finding]


@dataclass(frozen=True, kw_only=True)
class SessionFacts:
    """Facts of the arm, the model under test and the sessions that the catalogue needs."""

    arm: Arm
    constants: F64  # (P,) mm and rad
    terms: tuple[Term, ...]  # of the model under test
    reference_c: float
    has_fixed_constants: bool  # True: constants and terms are those of a given calibration
    sensors: tuple[str, ...]  # with data
    lost_links: frozenset[int]  # links whose sensor is stuck or silent in some session
    timed: bool  # times of all readings known
    rates: bool  # joint rates known
    approach: bool  # directions of approach known
    artefact_c: bool
    artefact_unread: bool  # some session has no artefact_c, and the arm's sensors vary there
    artefacts: tuple[str, ...]  # names of those measured
    targets: tuple[str, ...]  # certified, and measured in several poses
    distances: tuple[str, ...]  # "S1, S2"
    start_unix_s: float  # of the first reading, and of the last
    end_unix_s: float
    #: intervals in which readings followed each other without a long pause
    spells_unix_s: tuple[tuple[float, float], ...]
    #: name, first and last reading of each session, if the sessions do not overlap
    sessions: tuple[tuple[str, float, float], ...]
    instants_unix_s: tuple[float, ...]  # where something may have stepped: between two readings
    #: all moments between two readings, for refining an instant
    all_instants_unix_s: F64
    #: the scatter of a reading under the model under test, as an angle; 0: not known
    scatter_rad: float = 0.0
    #: by sensor, the temperatures at which a given calibration was made; empty: none is given
    calibrated_c: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    #: parameters whose expansion that calibration leaves unknown
    open_growth: frozenset[str] = frozenset()

    @cached_property
    def joints(self) -> range:
        """The joint numbers 1…N."""
        return range(1, self.arm.n_joints + 1)

    def constant(self, joint: int, name: str) -> float:
        """Return a constant of a joint (1…N): "theta", "d", "a", "alpha" or "beta"; mm and rad."""
        return float(self.constants[self.arm.layout.index(f"{name}_{joint}")])

    def weights(self, joint: int) -> dict[str, float]:
        """Return the sensors of a joint with their weights; empty if one of them has no data."""
        if joint in self.lost_links:
            return {}
        weights = self.arm.joint[joint - 1].weights
        return weights if all(name in self.sensors for name in weights) else {}

    def nearby_instants(self, instant: float) -> list[float]:
        """Return the moments between readings around *instant*, between its neighbours on
        the grid.
        """
        grid = np.asarray(self.instants_unix_s)
        below, above = grid[grid < instant], grid[grid > instant]
        low = below.max() if below.size else -np.inf
        high = above.min() if above.size else np.inf
        moments = self.all_instants_unix_s
        return [float(t) for t in moments[(moments > low) & (moments < high)]]


@dataclass(frozen=True)
class Effect:
    """One cause of the catalogue."""

    cause: str
    reason: str  # physics, one sentence
    confounded_with: str
    experiment: str  # how to show it, one sentence that a person can follow
    candidates: Callable[[SessionFacts], Iterator[Candidate]]
    #: physical description of fitted amplitudes, e.g. "the disc sits 0.4 µm off centre"
    describe: Callable[[Candidate, F64], str]
    #: what sessions must contain for the cause to be detectable; empty: any poses will do
    needs: str = ""
    _: KW_ONLY
    #: a blow, a slip or a wrong certificate has any size; other causes are limited by their typical
    #: size
    accident: bool = False
    #: visible only by the rate, the side of approach or the moment, never by the pose
    by_motion: bool = False
    #: amplitudes are per weight carried
    by_weight: bool = False
    #: depends on the temperatures of the arm's sensors, and is no fault of these
    by_temperature: bool = False
    #: larger on a coarse arm, by its encoders and its calibration
    as_coarse_as_the_arm: bool = False
    #: the candidates that act through the terms of other findings (the second argument) as well as
    #: through those under test
    through_terms: Callable[[SessionFacts, Sequence[Term]], Iterator[Candidate]] | None = None
    #: relative frequency among the catalogue's causes: most arms lack a part that could cause it
    commonness: float = 1.0
    #: description if many harmonics of one joint make a curve over its turn, from the curve's root
    #: mean square in rad and its strongest order
    describe_curve: Callable[[Candidate, float, int], str] | None = None


def tie(parameter_weights: Sequence[tuple[str, float]], *basis: Factor) -> tuple[Term, ...]:
    """Return terms that share one amplitude and one basis: parameter += weight × amplitude
    × basis.
    """
    return tuple(
        Term(parameter=name, basis=list(basis), coefficient=weight)
        for name, weight in parameter_weights
        if weight != 0.0
    )


def tie_tip(response: F64, along: Callable[[Axis], Factor]) -> tuple[Term, ...]:
    """Return terms by which the tip yields by *response* (3, 3) times a vector, in the last frame.

    *along* returns the factor that is the vector's component along an axis of that frame.
    """
    return tuple(
        term
        for weights, axis in zip(response.T, AXES, strict=True)
        for term in tie(list(zip(TIP_PARAMETERS, map(float, weights), strict=True)), along(axis))
    )


def list_lengths(facts: SessionFacts, joint: int) -> list[tuple[str, float]]:
    """List the lengths of link *joint* in mm by parameter, as far as an expansion changes them."""
    pairs = [(name, facts.constant(joint, name)) for name in ("d", "a")]
    return [(f"{name}_{joint}", value) for name, value in pairs if abs(value) > LEAST_LENGTH_MM]


def list_stylus_offsets(facts: SessionFacts) -> list[tuple[str, float]]:
    """List the tip's offset in mm by parameter, as far as an expansion of the stylus changes it."""
    values = facts.constants[facts.arm.layout.tip]
    named = zip(TIP_PARAMETERS, values, strict=True)
    return [(name, float(value)) for name, value in named if abs(value) > LEAST_LENGTH_MM]


def make_temperature(weights: dict[str, float], **options: float) -> Temperature:
    """Make a temperature factor; a difference of sensors needs no reference."""
    if is_difference(weights):
        options["reference_c"] = 0.0
    return Temperature.model_validate({"weights": weights, **options})


def describe_instant(candidate: Candidate) -> str:
    """Return " at …" for a candidate with an instant, and "" for others."""
    instant = candidate.instant_unix_s
    return "" if instant is None else f" at {format_clock(instant)}"
