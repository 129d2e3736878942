"""Links that expand plainly, over too few kelvin for a thermal model: no cause is found in that."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.data.sessions.session import Session
from armd.compensation.diagnose.diagnose import diagnose
from armd.compensation.diagnose.fitting.expansions import make_expansion_columns
from armd.compensation.diagnose.fitting.under_test import make_model_and_judge_sessions
from armd.compensation.diagnose.problem.baseline import from_calibration
from armd.compensation.diagnose.problem.linearise import linearise
from armd.compensation.diagnose.problem.rests import collect_rests
from armd.compensation.effects.thermal.link_expansion import EXPANSION_PER_K
from armd.compensation.identify.thermal.terms import make_length_terms
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.model.terms import Term
from support import synthetic
from support.selection import parametrize_default

ARM = synthetic.arm()
#: Less than 0.75 K in all: one temperature, no thermal model.
ONE_C = (20.6, 20.8, 21.0, 21.2)
#: Each less than 0.75 K from the next, but enough in all to tell expansion.
CLOSE_C = (20.6, 21.3, 22.0, 22.7)
#: Aluminium, steel and carbon fibre, per kelvin.
MATERIALS = (23e-6, 12e-6, 2e-6)
ECCENTRIC = Term(parameter="theta_3", basis=[Harmonic(kind="sin", joint=3)], coefficient=4e-5)


def measured(seed: int, celsius: tuple[float, ...], *more: Term) -> tuple[Session, ...]:
    """Sessions two hours apart of an arm whose links are of different materials."""
    rng = np.random.default_rng(seed)
    truth = synthetic.disturbed(ARM, rng, 0.1)
    sensors = [f"t{k}" for k in range(1, ARM.n_joints + 1)]
    per_k = dict(zip(sensors, rng.choice(MATERIALS, ARM.n_joints), strict=True))
    expansion = [
        term.model_copy(
            update={
                "coefficient": per_k[next(iter(term.basis[0].weights))]
                * truth[ARM.layout.index(term.parameter)]
            }
        )
        for term in make_length_terms(ARM, [1])
    ]
    sessions = [
        synthetic.session(
            ARM,
            truth,
            rng,
            terms=[*expansion, *more],
            temperature_c=c,
            scatter_k=0.05,
            readings=90,
            encoder_rad=2e-6,
            noise_mm=0.001,
            uncertainty_mm=0.0003,
            name=f"{c}",
        )
        for c in celsius
    ]
    return tuple(
        replace(
            session,
            started_unix_s=session.started_unix_s + 7200.0 * i,
            states=replace(session.states, time_s=session.states.time_s + 7200.0 * i),
        )
        for i, session in enumerate(sessions)
    )


def found(sessions: tuple[Session, ...], order: int) -> list[tuple[str, str]]:
    diagnosis = diagnose(sessions, ARM)
    assert diagnosis.baseline.calibration.provenance["thermal_order"] == order
    return [finding.candidate.place for finding in diagnosis.findings]


@pytest.mark.slow
@parametrize_default(("celsius", "order"), [(ONE_C, 0), (CLOSE_C, 1)])
def test_plain_expansion_of_all_links_is_no_finding(celsius: tuple[float, ...], order: int) -> None:
    assert found(measured(2, celsius), order) == []


@pytest.mark.slow
def test_what_is_wrong_beside_it_is_found_alone() -> None:
    sessions = measured(2, ONE_C, ECCENTRIC)
    assert found(sessions, 0) == [("encoder_eccentricity", "joint 3")]


def test_they_are_free_by_what_materials_do_and_beside_no_other_model() -> None:
    sessions = measured(1, ONE_C)
    baseline = make_model_and_judge_sessions(sessions, ARM, None)[0]
    linear = linearise(collect_rests(sessions, ARM), baseline.model, ARM)
    columns, variance = make_expansion_columns(linear, baseline, ARM)
    lengths_mm = [
        baseline.model.constants[ARM.layout.index(t.parameter)] for t in make_length_terms(ARM, [1])
    ]
    assert columns.shape == (len(linear.residual), len(lengths_mm))
    np.testing.assert_allclose(variance, (EXPANSION_PER_K * np.array(lengths_mm)) ** 2)
    # d₃ is the same for all that stands beyond it: its column tells the temperature.
    d3 = [t.parameter for t in make_length_terms(ARM, [1])].index("d_3")
    plain = linear.jacobian[ARM.layout.index("d_3")][: 3 * linear.rests.n].reshape(-1, 3)
    grown = columns[: 3 * linear.rests.n, d3].reshape(-1, 3)
    rise = (grown * plain).sum(axis=1) / (plain**2).sum(axis=1)
    assert abs(rise.mean()) < 1e-9 and 0.1 < rise.std() < 0.4

    held = from_calibration(baseline.calibration, ARM, is_given=True)
    assert make_expansion_columns(linear, held, ARM)[0].shape[1] == 0
    warm = measured(1, (14.0, 20.0, 26.0))
    thermal = make_model_and_judge_sessions(warm, ARM, None)[0]
    assert thermal.calibration.provenance["thermal_order"] == 1
    linear = linearise(collect_rests(warm, ARM), thermal.model, ARM)
    assert make_expansion_columns(linear, thermal, ARM)[0].shape[1] == 0
