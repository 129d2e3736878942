"""The nuisance columns of a fit: placements, model under test, findings, targets, drift."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from armd.arrays import F64, I64
from armd.compensation.diagnose.constants import GAUGE, PER_KELVIN
from armd.compensation.diagnose.fitting.expansions import make_expansion_columns
from armd.compensation.diagnose.noise.shared_columns import make_drift_columns, make_target_nuisance
from armd.compensation.diagnose.problem.amplitudes import compute_amplitude_variance
from armd.compensation.diagnose.problem.layout import (
    AFTER,
    BEFORE,
    DRIFT,
    EXPANSIONS,
    IDENTIFIED,
    MOUNT,
    PLACEMENTS,
    TARGETS,
    FitLayout,
    name_block,
)
from armd.compensation.diagnose.problem.linear import Baseline, Linear, ModelState
from armd.compensation.diagnose.problem.whitening import Nuisance
from armd.compensation.effects.effect import Candidate
from armd.compensation.estimate.linear import linear_model
from armd.compensation.estimate.linear.blocks import Blocks, to_blocks
from armd.compensation.identify.thermal.terms import make_growth_terms
from armd.compensation.model import parameters
from armd.compensation.model.arm import Arm
from armd.compensation.model.terms import Term

#: Columns and the variances of their amplitudes.
NuisanceBlock = tuple[F64 | Blocks, F64]


def collect_nuisance(
    linear: Linear,
    arm: Arm,
    baseline: Baseline,
    findings: Sequence[Candidate],
    columns: Sequence[F64],
    sizes: Sequence[float],
) -> tuple[Nuisance, FitLayout]:
    """Collect the nuisance columns of a fit with *findings*, given their *columns* (N, m) in mm."""
    identified = baseline.columns(linear, arm)
    if baseline.is_given:
        identified = identified @ baseline.root
    always: dict[str, NuisanceBlock] = {
        PLACEMENTS: (linear.nuisance, np.full(linear.nuisance.size, np.inf)),
        IDENTIFIED: (
            identified,
            np.full(identified.shape[1], 1.0 if baseline.is_given else np.inf),
        ),
        MOUNT: _column_of_the_mount(linear, baseline, arm),
        EXPANSIONS: make_expansion_columns(linear, baseline, arm),
        TARGETS: make_target_nuisance(linear),
        DRIFT: make_drift_columns(linear),
    }
    variances = map(compute_amplitude_variance, findings, sizes)
    of_findings = list(zip(columns, variances, strict=True))
    nuisance, layout = join_blocks(always, of_findings, linear.rests.observations.placement)
    layout.nominal_variance[layout.identified] = _gauge(baseline, arm)
    return nuisance, layout


def join_blocks(
    always: Mapping[str, NuisanceBlock], findings: Sequence[NuisanceBlock], placement: I64
) -> tuple[Nuisance, FitLayout]:
    """Join the blocks that are *always* there, by name, with those of *findings* between them.

    *placement* (n,): of each rest.
    """
    blocks = {name: always[name] for name in BEFORE}
    blocks |= {name_block(i): block for i, block in enumerate(findings)}
    blocks |= {name: always[name] for name in AFTER}
    nuisance = Nuisance(
        to_blocks([columns for columns, _ in blocks.values()], placement),
        np.concatenate([variance for _, variance in blocks.values()]),
    )
    sizes = tuple((name, len(variance)) for name, (_, variance) in blocks.items())
    layout = linear_model.Layout(sizes)
    return nuisance, FitLayout(layout, np.full(layout.n, np.inf))


def replace_findings(
    nuisance: Nuisance,
    layout: FitLayout,
    findings: Sequence[Candidate],
    columns: Sequence[F64],
    sizes: Sequence[float],
) -> tuple[Nuisance, FitLayout]:
    """Return nuisance and layout with other findings in place of their own."""
    first, stop = layout.identified.stop, layout.mount.start
    variances = map(compute_amplitude_variance, findings, sizes)
    changed = Nuisance(
        nuisance.columns.replace_columns(slice(first, stop), columns),
        np.concatenate([nuisance.variance[:first], *variances, nuisance.variance[stop:]]),
    )
    return changed, layout.with_findings([block.shape[1] for block in columns])


def make_mount_term(model: ModelState, arm: Arm) -> Term | None:
    """Return the first link's growth (1 mm/K), where the model under test has no such term.

    At one temperature the placement absorbs this growth, so a calibration has no term for it. A
    ramp during one placement shows it, which must not be reported as a cause.
    """
    silent = not any(term.parameter == "d_1" and term.basis for term in model.terms)
    grown = make_growth_terms(arm)
    return grown[0].model_copy(update={"coefficient": 1.0}) if silent and grown else None


def _column_of_the_mount(linear: Linear, baseline: Baseline, arm: Arm) -> tuple[F64, F64]:
    term = make_mount_term(baseline.model, arm)  # a finding's d_1 of another basis does not count
    if term is None:
        return np.zeros((len(linear.residual), 0)), np.zeros(0)
    states = linear.rests.observations.states
    weights = arm.joint[0].weights
    temperature = sum(w * states.temperature_c[:, arm.sensors.index(s)] for s, w in weights.items())
    rise = np.nan_to_num(temperature - linear.model.reference_c)
    column = linear.signature(arm.layout.index(term.parameter), rise)
    return column[:, None], np.array([np.inf])


def make_noise_variances(nuisance: Nuisance, layout: FitLayout, extra: Sequence[F64]) -> F64:
    """Return variances during noise estimation, of the nuisance and then of *extra* columns.

    Findings absorb freely then, curves too.
    """
    variance = nuisance.variance.copy()
    for span in layout.findings:
        variance[span] = np.inf
    free = [np.full(block.shape[1], np.inf) for block in extra]
    return np.concatenate([variance, *free])


def _gauge(baseline: Baseline, arm: Arm) -> F64:
    if baseline.is_given:
        return np.full(baseline.root.shape[1], np.inf)
    names = arm.layout.names
    constants = [GAUGE[parameters.find_unit(names[i])] for i in baseline.parameters]
    term_parameters = [baseline.model.terms[i].parameter for i in baseline.terms]
    slopes = [PER_KELVIN * GAUGE[parameters.find_unit(name)] for name in term_parameters]
    return np.square([*constants, *slopes])
