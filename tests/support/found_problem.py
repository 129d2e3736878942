"""A diagnosis in which four thermal causes were found, and a session that has them all."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.arrays import F64
from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.fitting.alternating_fit import fit_by_turns
from armd.compensation.diagnose.fitting.fit import fit
from armd.compensation.diagnose.problem.baseline import add_findings, from_calibration
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline, Rests
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.diagnose.problem.session_facts import collect_facts
from armd.compensation.effects import catalogue
from armd.compensation.effects.effect import Candidate, SessionFacts
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model.calibration import Calibration
from support import synthetic
from support.drawn import drawn

ARM = synthetic.arm(6)
OFFSET_K = 0.8
NOISE_MM = 1e-3
#: Per millimetre and kelvin, rather much, in a curve: the derivative is not constant.
GROWTH = {1: 2e-5 * 300, 2: 4e-7 * 300}
#: What is found, as candidates of the catalogue by their place and number there, and how large.
FOUND = {
    ("thermal_gradient", "link 3"): (0, (2e-4, -1e-4)),
    ("joint_thermal", "joint 3"): (1, (3e-7,)),
    ("encoder_thermal", "joint 3"): (0, (5e-6, -8e-6)),
    ("link_expansion", "link 5"): (0, (2e-5,)),
}
GRADIENT = "thermal_gradient"


@dataclass(frozen=True)
class Problem:
    rests: Rests
    baseline: Baseline
    facts: SessionFacts
    findings: list[Candidate]
    amplitudes: list[F64]

    def found(self, *causes: str) -> Any:
        """As of a fit that found these causes, in this order."""
        numbers = [[c.cause for c in self.findings].index(cause) for cause in causes]
        some = tuple(self.findings[i] for i in numbers)
        return SimpleNamespace(findings=some, amplitudes=tuple(self.amplitudes[i] for i in numbers))

    def offset(self, sensor: str = "t3") -> Candidate:
        """The sensor's offset under the model under test."""
        every = (c for c in catalogue.list_all_candidates(self.facts) if c.through is not None)
        return next(c for c in every if c.place == ("sensor_offset", f"sensor {sensor}"))


def given() -> Calibration:
    terms = [
        term.model_copy(update={"coefficient": GROWTH[term.basis[0].order]})  # type: ignore[union-attr]
        for term in make_length_terms(ARM, [1, 2])
    ]
    return drawn(ARM, terms=terms, covariance_of=["theta_2"], covariance=[[1e-16]])


def problem_of(session: Session) -> Problem:
    rests = collect_rests([session], ARM)
    baseline = from_calibration(given(), ARM, is_given=True)
    facts = collect_facts(rests, ARM, baseline)
    every = list(catalogue.list_all_candidates(facts))
    findings = [
        [c for c in every if c.place == place][number] for place, (number, _) in FOUND.items()
    ]
    amplitudes = [np.array(values) for _, values in FOUND.values()]
    return Problem(rests, baseline, facts, findings, amplitudes)


def measured(found: Any, name: str = "own") -> Session:
    """Of an arm with what was *found*, whose sensor t3 reads too much."""
    model = add_findings(
        from_calibration(given(), ARM, is_given=True).model, found.findings, found.amplitudes
    )
    rng = np.random.default_rng(len(name))
    session = synthetic.session(
        ARM,
        model.constants,
        rng,
        terms=list(model.terms),
        scatter_k=3.0,
        noise_mm=NOISE_MM,
        name=name,
    )
    celsius = session.states.temperature_c.copy()
    celsius[:, 2] += OFFSET_K
    return replace(session, states=replace(session.states, temperature_c=celsius))


@pytest.fixture(scope="module")
def problem() -> Problem:
    rng = np.random.default_rng(7)
    return problem_of(synthetic.session(ARM, ARM.nominal(), rng, scatter_k=3.0))


def fitted(problem: Problem, findings: list[Candidate], turns: bool = True) -> Fit:
    start = [np.zeros(len(c.columns)) for c in findings]
    about = problem.rests, ARM, problem.baseline, problem.baseline.model
    if not turns:
        return fit(*about, findings, start)
    return fit_by_turns(problem.facts, *about, findings, start)
