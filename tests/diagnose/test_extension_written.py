"""From findings to a calibration: terms, constants, the artefact and the covariance of all."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from armd.compensation.diagnose.extend import extend_calibration
from armd.compensation.diagnose.problem.baseline import from_calibration
from armd.compensation.diagnose.problem.fitted import Fit
from armd.compensation.diagnose.problem.linear import Baseline
from armd.compensation.diagnose.report import sizes
from armd.compensation.effects import location
from armd.compensation.effects.effect import ArtefactChange, Candidate, Column, tie
from armd.compensation.model.calibration import Calibration
from armd.compensation.model.pose_factors import Harmonic
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from support import synthetic
from support.drawn import drawn
from support.small_fit import candidate, small_fit

ARM = synthetic.arm(3)
NAMES = list(ARM.layout.names)
N = 20
DISC = Candidate(
    "encoder_eccentricity",
    location.joint(2),
    (
        Column("sin", "rad", 1e-5, tie([("theta_2", 1.0)], Harmonic(kind="sin", joint=2, order=1))),
        Column("a", "mm", 0.1, tie([("alpha_2", 0.5)], Harmonic(kind="cos", joint=2, order=1))),
    ),
    ("q2",),
)
#: a_2 was identified, d_3 was not; the shift turns both.
SHIFT = Candidate(
    "geometry_shift",
    location.joint(2),
    (Column("by", "mm", 0.1, tie([("a_2", 2.0), ("d_3", -1.0)])),),
    (),
)
BALL = Candidate(
    "artefact_length", location.ARTEFACT,
    (
        Column("x", "mm", 0.01, artefact=ArtefactChange("target", target="B1", axis=0)),
        Column("size", "1", 1e-5, artefact=ArtefactChange("scale")),
        Column("growth", "1/K", 1e-6, artefact=ArtefactChange("expansion")),
    ), ("target",),
)  # fmt: skip


def session(name: str = "points") -> Any:
    artefact = SimpleNamespace(name=name, expansion_per_k=1e-5)
    return SimpleNamespace(name="s", fingerprint=lambda: "0", artefact=artefact)


def baseline(held: bool) -> Baseline:
    """A calibration that identified θ₂ and a₂, with a covariance; its first link grows as told."""
    growth = Term(parameter="d_1", basis=[Temperature(weights={"t1": 1.0})], coefficient=0.007)
    known = {"covariance_of": ["theta_2", "a_2"], "covariance": [[4e-10, 1e-7], [1e-7, 2.5e-3]]}
    calibration = drawn(ARM, terms=[growth], **known)
    return from_calibration(calibration, ARM, held)


def fitted(of: Baseline, findings: list[Candidate]) -> Fit:
    """A fit to made-up rows, with two columns for what the calibration identified."""
    rng = np.random.default_rng(1)
    of_findings = {
        candidate("encoder_scale", i, len(c.columns)): rng.normal(size=(3 * N, len(c.columns)))
        for i, c in enumerate(findings, 1)
    }
    found = small_fit(
        rng.normal(size=3 * N),
        rng.normal(size=(3 * N, 3)),
        of_findings,
        identified=rng.normal(size=(3 * N, 2)),
    )
    return replace(found, baseline=of, model=of.model, findings=tuple(findings))


def matrix(of: Calibration) -> np.ndarray:
    return np.array(of.covariance)


@pytest.mark.parametrize("held", [False, True])
def test_amplitudes_become_terms_and_constants_with_the_covariance_of_all(held: bool) -> None:
    given = baseline(held)
    last = fitted(given, [DISC, SHIFT])
    written = extend_calibration(last, ARM, [session()])
    (sine, cosine), (by,) = last.amplitudes
    assert [t.parameter for t in written.terms[1:]] == ["theta_2", "alpha_2"]
    assert [t.coefficient for t in written.terms[1:]] == pytest.approx([sine, 0.5 * cosine])
    first, second = last.layout.findings
    sigma = np.sqrt(np.diag(last.inverse))
    assert [t.standard_uncertainty for t in written.terms[1:]] == pytest.approx(
        [sigma[first.start], 0.5 * sigma[first.start + 1]]
    )
    own = -last.solution[last.layout.identified]
    own = given.root @ own if held else own
    constants = written.vector(ARM.n_joints) - ARM.nominal()
    expected = dict.fromkeys(NAMES, 0.0) | {"theta_2": own[0], "a_2": own[1] + 2.0 * by, "d_3": -by}
    np.testing.assert_allclose(constants, list(expected.values()), atol=1e-12)
    # Each quantity is a row of what it follows of the solution: its covariance is theirs.
    rows = np.zeros((5, len(last.solution)))
    rows[:2, last.layout.identified] = given.root if held else np.eye(2)
    rows[1, second.start] = 2.0
    rows[2, first.start], rows[3, first.start + 1], rows[4, second.start] = 1.0, 0.5, -1.0
    assert written.covariance_of == ["theta_2", "a_2", "term 1", "term 2", "d_3"]
    np.testing.assert_allclose(matrix(written), rows @ last.inverse @ rows.T, atol=1e-15)


def test_the_artefacts_correction_adds_to_the_one_there_was() -> None:
    given = baseline(True)
    last = fitted(given, [BALL])
    corrected = extend_calibration(last, ARM, [session()]).artefact
    (x, size, growth) = last.amplitudes[0]
    assert corrected is not None and corrected.artefacts == ["points"]
    assert corrected.target_offset_mm["B1"] == pytest.approx((x, 0.0, 0.0))
    assert corrected.scale == pytest.approx(1.0 + size)
    assert corrected.expansion_per_k == pytest.approx(1e-5 + growth)
    again = from_calibration(extend_calibration(last, ARM, [session()]), ARM, is_given=True)
    twice = extend_calibration(fitted(again, [BALL]), ARM, [session()]).artefact
    assert twice is not None
    assert twice.target_offset_mm["B1"] == pytest.approx((2 * x, 0.0, 0.0))
    assert twice.scale == pytest.approx((1.0 + size) ** 2)
    assert twice.expansion_per_k == pytest.approx(1e-5 + 2 * growth)


def test_without_findings_the_calibration_stays_and_says_what_was_left_out() -> None:
    given = baseline(True)
    last = fitted(given, [])
    assert extend_calibration(last, ARM, [session()]) is given.calibration
    told = extend_calibration(last, ARM, [session()], left_out=[DISC])
    assert told.provenance["diagnosis"]["not_borne_out"] == ["encoder_eccentricity joint 2"]
    assert (told.constants, told.terms) == (given.calibration.constants, given.calibration.terms)


def test_a_scanned_value_is_as_uncertain_as_dense_least_squares_has_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A time constant by whose logarithm the signature turns from one column into another."""
    rng = np.random.default_rng(2)
    base, turned = rng.normal(size=(2, 3 * N))

    def at(value: float) -> Candidate:
        return Candidate(
            "thermal_lag", location.link(1), (Column("by", "mm", 1.0),), (), (("tau", value, "s"),)
        )

    lag = replace(at(600.0), elsewhere=at)
    signature = lambda value: base + np.log(value / 600.0) * turned  # noqa: E731
    monkeypatch.setattr(
        sizes,
        "make_finding_columns",
        lambda linear, some, arm: [signature(c.setting[0][1])[:, None] for c in some],
    )
    placements = rng.normal(size=(3 * N, 3))
    last = small_fit(5.0 * base + rng.normal(size=3 * N), placements, {lag: base[:, None]})
    found = sizes.compute_scanned_uncertainty(last, 0, ARM)
    slope = last.amplitudes[0][0] * turned / 600.0
    dense = np.column_stack([placements, base, slope])
    ridge = np.diag([0.0, 0.0, 0.0, 1 / 100.0, 0.0])  # what is known a priori of the amplitude
    expected = np.sqrt(np.linalg.inv(dense.T @ dense + ridge)[-1, -1])
    assert found == pytest.approx(expected, rel=1e-3)
    still = replace(last, findings=(replace(lag, elsewhere=None),))
    assert sizes.compute_scanned_uncertainty(still, 0, ARM) == 0.0
