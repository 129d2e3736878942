"""Which nuisance columns belong to whom, whatever findings come and go."""

import numpy as np

from armd.compensation.diagnose.fitting.nuisance import replace_findings
from armd.compensation.diagnose.problem.amplitudes import compute_amplitude_variance, is_sized
from armd.compensation.diagnose.problem.layout import select_findings
from support.small_fit import candidate, small_fit

A, B, C = (
    candidate("encoder_scale", 1),
    candidate("encoder_slip", 2, 3),
    candidate("time_skew", 4, 2),
)


def fit_of_three():
    rng = np.random.default_rng(1)
    placements, residual = rng.normal(size=(30, 2)), rng.normal(size=30)
    findings = {c: rng.normal(size=(30, len(c.columns))) for c in (A, B, C)}
    return small_fit(residual, placements, findings), findings


def test_some_of_the_findings_keep_their_columns_and_are_numbered_anew() -> None:
    fit, findings = fit_of_three()
    kept, layout = select_findings(fit.layout, [0, 2])
    columns = fit.nuisance.columns.to_dense(kept)
    assert [at.stop - at.start for at in layout.findings] == [1, 2]
    for at, own in zip(layout.findings, (A, C), strict=True):
        np.testing.assert_array_equal(columns[:, at], findings[own])
    assert layout.blocks.n == len(kept) == len(layout.nominal_variance) == 5
    assert layout.mount.start == layout.shared == 5


def test_other_findings_take_the_place_of_those_there() -> None:
    fit, _ = fit_of_three()
    other = candidate("axis_wobble", 5, 4)
    block = np.ones((30, 4))
    nuisance, layout = replace_findings(fit.nuisance, fit.layout, [other], [block], [3.0])
    (at,) = layout.findings
    np.testing.assert_array_equal(nuisance.columns.to_dense(at), block)
    np.testing.assert_array_equal(
        nuisance.columns.to_dense(slice(2)), fit.nuisance.columns.to_dense(slice(2))
    )
    np.testing.assert_array_equal(nuisance.variance[at], compute_amplitude_variance(other, 3.0))


def test_a_named_cause_is_bounded_by_what_it_can_be_and_a_curve_by_one_size() -> None:
    np.testing.assert_allclose(
        compute_amplitude_variance(candidate("time_skew", 1, 2, 0.1), 3.0), 25.0
    )
    assert np.isinf(compute_amplitude_variance(candidate("unknown", 1, 2), 3.0)).all()
    curve = candidate("encoder_periodic", 1, 20, 0.1)
    assert is_sized(curve)
    np.testing.assert_allclose(compute_amplitude_variance(curve, 3.0), 0.09)
