"""What a fit lets absorb: placements, the model under test, findings, targets, a drifting base."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.compensation.diagnose.fitting import noise as noise_model
from armd.compensation.diagnose.fitting.baseline import Baseline
from armd.compensation.diagnose.fitting.noise import Nuisance
from armd.compensation.diagnose.fitting.problem import Linear, ModelState
from armd.compensation.effects.catalogue import CATALOGUE
from armd.compensation.effects.effect import SCALES, Candidate, Column
from armd.compensation.estimate import linear_model
from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm
from armd.compensation.model.terms import Temperature, Term

F64 = npt.NDArray[np.float64]
I64 = npt.NDArray[np.int64]

#: Functions of more columns than this have amplitudes that share one likely size.
MOST_FREE_COLUMNS = 6
#: Where the data leave constants open (the last joint's turn against the tip's offset), the
#: solution nearest to the model under test is taken: as if each were known this well.
GAUGE = {"mm": 1.0, "rad": 2e-3}
PER_KELVIN = 0.1  # of that, for the slope of a term


PLACEMENTS, IDENTIFIED, MOUNT, TARGETS, DRIFT = (
    "placements and seats",
    "identified",
    "mount",
    "targets",
    "drift",
)


@dataclass(frozen=True)
class Layout:
    """Which of the nuisance columns belong to whom."""

    blocks: linear_model.Layout
    drawing: F64  # (b,) variance with which to choose where the data leave it open; inf: none

    @property
    def identified(self) -> slice:
        """Constants and terms (when held: the directions of their covariance)."""
        return self.blocks[IDENTIFIED]

    @property
    def findings(self) -> tuple[slice, ...]:
        """Of each finding."""
        return tuple(self.blocks[finding(i)] for i in range(self._n_findings))

    @property
    def mount(self) -> slice:
        """One column or none: the first link's growth, see `mount_term`."""
        return self.blocks[MOUNT]

    @property
    def shared(self) -> int:
        """First of those that targets and drift share."""
        return int(self.blocks[TARGETS].start)

    @property
    def drift(self) -> slice:
        """Of the wandering base."""
        return self.blocks[DRIFT]

    @property
    def _n_findings(self) -> int:
        return len(self.blocks.sizes) - 5  # the blocks that are always there

    def with_findings(self, counts: Sequence[int]) -> Layout:
        """With findings of so many columns each in the place of those that it has."""
        first, stop = self.identified.stop, self.mount.start
        open_ = np.full(sum(counts), np.inf)
        drawing = np.concatenate([self.drawing[:first], open_, self.drawing[stop:]])
        sizes = self.blocks.sizes
        own = tuple((finding(i), int(count)) for i, count in enumerate(counts))
        return Layout(linear_model.Layout((*sizes[:2], *own, *sizes[-3:])), drawing)


def finding(index: int) -> str:
    """The name of a finding's block."""
    return f"finding {index + 1}"


def gather_nuisance(
    linear: Linear,
    arm: Arm,
    baseline: Baseline,
    findings: Sequence[Candidate],
    columns: Sequence[F64],
    sizes: Sequence[float],
) -> tuple[Nuisance, Layout]:
    """What the fit of *findings*, by their *columns* (N, m) in mm, lets absorb."""
    own = baseline.columns(linear, arm)
    if baseline.held:
        own = own @ baseline.root
    blocks = {
        PLACEMENTS: Nuisance(linear.nuisance, np.full(linear.nuisance.shape[1], np.inf)),
        IDENTIFIED: Nuisance(own, np.full(own.shape[1], 1.0 if baseline.held else np.inf)),
    }
    for i, (candidate, block, size) in enumerate(zip(findings, columns, sizes, strict=True)):
        blocks[finding(i)] = Nuisance(block, amplitude_variance(candidate, size))
    blocks[MOUNT] = _column_of_the_mount(linear, baseline, arm)
    blocks[TARGETS] = noise_model.target_columns(linear)
    blocks[DRIFT] = noise_model.drift_columns(linear)
    joined = Nuisance(
        np.hstack([block.columns for block in blocks.values()]),
        np.concatenate([block.variance for block in blocks.values()]),
    )
    layout = linear_model.Layout(
        tuple((name, block.columns.shape[1]) for name, block in blocks.items())
    )
    drawing = np.full(layout.n, np.inf)
    drawing[layout[IDENTIFIED]] = _gauge(baseline, arm)
    return joined, Layout(layout, drawing)


def with_other_findings(
    nuisance: Nuisance,
    layout: Layout,
    findings: Sequence[Candidate],
    columns: Sequence[F64],
    sizes: Sequence[float],
) -> tuple[Nuisance, Layout]:
    """The same with other findings in the place of those that it has."""
    first, stop = layout.identified.stop, layout.mount.start
    variances = map(amplitude_variance, findings, sizes)
    changed = Nuisance(
        np.hstack([nuisance.columns[:, :first], *columns, nuisance.columns[:, stop:]]),
        np.concatenate([nuisance.variance[:first], *variances, nuisance.variance[stop:]]),
    )
    return changed, layout.with_findings([block.shape[1] for block in columns])


def with_some_findings(layout: Layout, some: Sequence[int]) -> tuple[I64, Layout]:
    """Which nuisance columns stay with *some* of the findings, and their layout."""
    names = [name for name, _ in layout.blocks.sizes]
    own = [finding(i) for i in some]
    kept = layout.blocks.of([*names[:2], *own, *names[-3:]])
    sizes = dict(layout.blocks.sizes)
    return kept, layout.with_findings([sizes[name] for name in own])


def mount_term(model: ModelState, arm: Arm) -> Term | None:
    """How the first link grows per kelvin (1 mm/K), where the model under test is silent on it.

    Within one temperature that is the placement's, so a calibration leaves it out; a ramp during
    one placement shows it, and no cause is to be found in that.
    """
    silent = not any(term.parameter == "d_1" and term.basis for term in model.terms)
    weights = arm.joint[0].weights
    if not (silent and weights):
        return None
    return Term(parameter="d_1", basis=[Temperature(weights=weights)], coefficient=1.0)


def _column_of_the_mount(linear: Linear, baseline: Baseline, arm: Arm) -> Nuisance:
    term = mount_term(baseline.model, arm)  # a finding's d_1 of another basis does not count
    if term is None:
        return Nuisance(np.zeros((len(linear.residual), 0)), np.zeros(0))
    states = linear.rests.observations.states
    weights = arm.joint[0].weights
    temperature = sum(w * states.temperature_c[:, arm.sensors.index(s)] for s, w in weights.items())
    rise = np.nan_to_num(temperature - linear.model.reference_c)
    column = linear.signature(arm.layout.index(term.parameter), rise)
    return Nuisance(column[:, None], np.array([np.inf]))


def is_sized(candidate: Candidate) -> bool:
    """Whether it is a nearly free function, its amplitudes held together by one likely size."""
    own_shape = candidate.location.kind == "shape"
    return len(candidate.columns) > MOST_FREE_COLUMNS and not own_shape


def is_curve(candidate: Candidate) -> bool:
    """Whether it is such a function over the turn of one joint."""
    return CATALOGUE[candidate.cause].curve_reading is not None and is_sized(candidate)


def most_plausible(column: Column) -> float:
    """Standard deviation of an amplitude under the broadest prior that the catalogue has for it."""
    return min(max(SCALES), column.reach) * column.typical


def amplitude_variance(candidate: Candidate, size: float) -> F64:
    """A named cause's amplitudes are as large as they can be, those without a name free; a nearly
    free function's are of a size in units of the catalogue's.

    Where the readings tell the amplitudes, that changes nothing; where several do the same, they
    share it rather than stand against each other, a thousand times what they could be.
    """
    if not is_sized(candidate):
        if candidate.cause == "unknown":
            return np.full(len(candidate.columns), np.inf)
        return np.square([most_plausible(column) for column in candidate.columns])
    return np.array([(size * column.typical) ** 2 for column in candidate.columns])


def for_noise(nuisance: Nuisance, layout: Layout, extra: Sequence[F64]) -> Nuisance:
    """What absorbs while the noise is estimated: findings freely, curves too."""
    variance = nuisance.variance.copy()
    for at in layout.findings:
        variance[at] = np.inf
    free = [np.full(block.shape[1], np.inf) for block in extra]
    return Nuisance(np.hstack([nuisance.columns, *extra]), np.concatenate([variance, *free]))


def _gauge(baseline: Baseline, arm: Arm) -> F64:
    if baseline.held:
        return np.full(baseline.root.shape[1], np.inf)
    names = arm.layout.names
    constants = [GAUGE[parameters.unit(names[i])] for i in baseline.parameters]
    own = [baseline.model.terms[i].parameter for i in baseline.terms]
    slopes = [PER_KELVIN * GAUGE[parameters.unit(name)] for name in own]
    return np.square([*constants, *slopes])
