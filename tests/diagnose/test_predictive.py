"""Drawn and refitted data sets: what noise leaves of a model, and what stands out of it."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csr_array

from armd.compensation.diagnose.constants import (
    HALF_WIDTH,
    LEAST_BIN_RESTS,
    MOST_TOGETHER,
    WIDEST_DEG,
)
from armd.compensation.diagnose.predictive import curves
from armd.compensation.diagnose.predictive.bins import (
    Bins,
    _bin_by_value,
    _find_inseparable,
    make_bins,
)
from armd.compensation.diagnose.predictive.components import Component, make_components
from armd.compensation.diagnose.predictive.copies import Copies
from armd.compensation.diagnose.predictive.curves import (
    ResidualComparison,
    ResidualCurve,
    _make_curves,
    _sum_up,
    make_layout,
)
from armd.compensation.diagnose.predictive.scores import compute_scores, solve_with_noise
from armd.compensation.diagnose.predictive.strength import Strength, make_features
from armd.compensation.diagnose.predictive.sums import Functions, FunctionSums, ShapeSums
from armd.compensation.report.diagnosis.predictive_plot import (
    choose_for_finding,
    choose_overview,
    draw_rows,
)
from support.small_fit import small_fit, unit_noise
from support.whole_scene import whole_scene

N, JOINTS = 120, 2


def a_fit(rng: np.random.Generator, error: np.ndarray | None = None) -> Any:
    """120 rests on six free columns, noise of one unit; *error* (n, 3) beside it."""
    placements = rng.normal(size=(3 * N, 6))
    residual = rng.normal(size=3 * N) + (0.0 if error is None else error.ravel())
    fit = small_fit(residual, placements)
    linear: Any = SimpleNamespace(
        rests=fit.linear.rests, residual=residual, joints=rng.normal(size=(N, 3, JOINTS))
    )
    held: Any = SimpleNamespace(is_given=False)
    return replace(fit, linear=linear, baseline=held)


@pytest.fixture
def along_the_joints(monkeypatch: pytest.MonkeyPatch) -> None:
    """The small fit has joints alone."""
    named = [Component(f"angle joint {k}", "angle", f"joint {k}") for k in (1, 2)]
    monkeypatch.setattr(curves, "make_components", lambda linear: (named, linear.joints))


def ten_bins(rng: np.random.Generator) -> Bins:
    return Bins("q1", "joint 1, °", rng.permutation(N), 12 * np.arange(10), np.arange(10.0))


def test_bins_are_of_equal_count_and_an_angles_are_not_wide() -> None:
    rng = np.random.default_rng(1)
    values = np.concatenate([rng.uniform(0, 40, 600), rng.uniform(0, 360, 40), [np.nan] * 5])
    plain = _bin_by_value("q1", "", values, "angle")
    counts = np.diff(np.append(plain.starts, len(plain.order)))
    assert len(plain.order) == 640 and counts.min() >= counts.max() // 2 >= LEAST_BIN_RESTS // 2
    narrow = _bin_by_value("q1", "", values, "angle", WIDEST_DEG)
    groups = np.split(values[narrow.order], narrow.starts[1:])
    assert max(np.ptp(group) for group in groups) <= WIDEST_DEG
    assert max(map(len, groups)) == counts.max()  # where they lie close, as many as before
    assert np.allclose(narrow.middle, [group.mean() for group in groups])
    tied = _bin_by_value("t1", "", np.repeat([20.0, 21.0, 22.0], 100), "temperature")
    assert [len(g) for g in np.split(tied.order, tied.starts[1:])] == [100, 100, 100]


def test_temperatures_and_time_that_only_rise_together_are_alike() -> None:
    rng = np.random.default_rng(2)
    hours = np.sort(rng.uniform(0.0, 5.0, 200))
    warm = 20.0 + 2.0 * hours + rng.normal(0.0, 0.5, 200)
    warm[:30] = np.nan  # a sensor that begins late
    assert 0.9 < np.corrcoef(hours[30:], warm[30:])[0, 1] ** 2 < 1.0
    apart = 20.0 + 2.0 * hours + rng.normal(0.0, 2.0, 200)
    assert np.corrcoef(hours, apart)[0, 1] ** 2 < 0.9
    time = _bin_by_value("time_s", "", hours, "time")
    read = {"t1": warm, "t2": apart, "t3": -hours, "t4": 0.0 * hours}
    sensors = [_bin_by_value(name, "", values, "temperature") for name, values in read.items()]
    turns = _bin_by_value(
        "q1", "", hours, "angle"
    )  # goes with the time, but is no matter of warming
    every = [turns, *sensors, time]
    assert _find_inseparable(time, every) == ("t1", "t3")
    assert _find_inseparable(sensors[0], every) == ("t3", "time_s")
    assert (
        _find_inseparable(sensors[1], every)
        == _find_inseparable(sensors[3], every)
        == _find_inseparable(turns, every)
        == ()
    )


def test_every_recorded_variable_has_bins_and_no_other() -> None:
    scene = whole_scene()
    rests = scene.linear.rests
    found = {bins.variable: bins for bins in make_bins(rests)}
    joints = [f"{letter}{k}" for letter in "qw" for k in range(1, 7)]
    sensors = rests.observations.arm.sensors
    expected = {*joints, *sensors, "artefact_c", "time_s", "placement", "target", "approach"}
    assert set(found) == expected
    for bins in found.values():
        assert len(np.unique(bins.order)) == len(bins.order) <= rests.n
        assert Functions.from_features(make_features(bins), bins, rests.n).is_in.sum() == len(
            bins.order
        )
    still: Any = replace(
        rests.observations,
        states=replace(
            rests.observations.states,
            rate=np.full_like(rests.observations.states.rate, np.nan),
            approach=np.full_like(rests.observations.states.approach, np.nan),
        ),
    )
    without = {bins.variable for bins in make_bins(replace(rests, observations=still))}
    assert without == expected - {f"w{k}" for k in range(1, 7)} - {"approach"}


def test_a_refit_takes_of_data_what_least_squares_takes() -> None:
    rng = np.random.default_rng(2)
    fit = a_fit(rng)
    columns = fit.nuisance.columns.to_dense()[:, :6]
    left = fit.residual - columns @ np.linalg.lstsq(columns, fit.residual, rcond=None)[0]
    again = solve_with_noise(fit, replace(unit_noise(N), scale_mm=1.0))
    assert np.abs(again.residual - again.fitted - left).max() < 1e-9


@pytest.mark.usefixtures("along_the_joints")
@pytest.mark.parametrize("size", [10, MOST_TOGETHER])
def test_curves_scatter_as_those_of_sets_that_are_drawn_and_refitted(size: int) -> None:
    """Ten thousand sets by brute force: copies of a posture in different bins share their error,
    columns are free or have a prior, and differ between copies or do not; each set is refitted by
    dense algebra with the weights that a refit gives to copies."""
    rng = np.random.default_rng(3)
    posture = np.arange(N) // 2
    free, held = rng.normal(size=(2, N // 2, 3, 4))
    joints = rng.normal(size=(N // 2, 3, JOINTS))[posture]
    alike = np.concatenate([free, held], axis=2)[posture]
    differing = (
        alike
        * np.where(np.arange(8) % 4 < 2, np.tile([1.0, -0.7], N // 2)[:, None], 1.0)[:, None, :]
    )
    columns = differing.reshape(3 * N, 8)
    fit = small_fit(np.zeros(3 * N), columns[:, :4], identified=columns[:, 4:])
    fit.linear.rests.posture = posture
    linear: Any = SimpleNamespace(rests=fit.linear.rests, joints=joints)
    whitener = np.linalg.inv(np.tril(rng.normal(size=(N // 2, 3, 3))) + 3.0 * np.eye(3))[posture]
    noise = replace(fit.noise, whitener=whitener).with_shared_part(0.6, posture)
    fit = replace(fit, linear=linear, baseline=SimpleNamespace(is_given=False))

    roots = np.linalg.inv(whitener)
    common = rng.normal(size=(N // 2, 3, 10_000))[posture]
    drawn = roots @ (np.sqrt(0.6) * common + np.sqrt(0.4) * rng.normal(size=(N, 3, 10_000)))
    amplitudes = np.concatenate([np.zeros((4, 10_000)), 10.0 * rng.normal(size=(4, 10_000))])
    drawn = drawn.reshape(3 * N, -1) + columns @ amplitudes
    weights = np.einsum("nji,njk->nik", noise.whitener, noise.whitener)
    by_rest = columns.reshape(N, 3, 8)
    weighted = np.einsum("nij,njk->nik", weights, by_rest).reshape(3 * N, 8)
    prior = np.diag([0.0] * 4 + [0.01] * 4)
    taken = columns @ np.linalg.solve(columns.T @ weighted + prior, weighted.T @ drawn)
    left = (drawn - taken).reshape(N, 3, -1)
    again = solve_with_noise(replace(fit, residual=drawn[:, 0]), noise)

    order = rng.permutation(N)
    starts = np.arange(N)[:: N // 10] if size == 10 else np.arange(N)
    bins = Bins("q1", "joint 1, °", order, starts, np.arange(float(len(starts))))
    assert (len(starts) < MOST_TOGETHER) == (size == 10)
    layout = make_layout([bins], again.nuisance.columns)
    sums = _sum_up(again, layout)
    scores = [*compute_scores(again, joints)]
    for k, curve in enumerate(_make_curves(sums, layout, np.ones(JOINTS))):
        metric = np.einsum("nji,njk,nk->ni", whitener, whitener, joints[:, :, k])
        parts = np.einsum("ni,nir->nr", metric, left)[order]
        lever = np.add.reduceat(np.einsum("ni,ni->n", metric, joints[:, :, k])[order], starts)
        means = np.add.reduceat(parts, starts, axis=0) / lever[:, None]
        sigma = means.std(axis=1)
        assert curve.band == pytest.approx(HALF_WIDTH * sigma, rel=0.06)
        if size == 10:
            correlation = np.corrcoef(means)
            assert np.abs(correlation - np.eye(10)).max() > 0.1
            own = np.sqrt(np.diag(curve.covariance))
            assert curve.covariance / np.outer(own, own) == pytest.approx(correlation, abs=0.05)
        shapes = rng.normal(size=(2, 3, N))
        of_shapes = scores[k].sum_along(shapes)[1].covariance
        scale = float(noise.counts[0])  # of a posture's copies, all of which count as much
        for shape, covariance in zip(shapes, of_shapes, strict=True):
            drawn_sums = scale * shape @ parts[np.argsort(order)]
            assert covariance == pytest.approx(np.cov(drawn_sums), rel=0.05, abs=2.0)
        squares = (np.einsum("ni,nir->nr", metric, left) ** 2).sum(axis=0)
        assert sums.spread[k] ** 2 == pytest.approx(squares[0] / squares.mean(), rel=0.02)


@pytest.mark.usefixtures("along_the_joints")
def test_p_values_of_data_from_the_model_are_even_and_a_structure_stands_out(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(curves, "CURVES", 1000)
    even = np.ones(JOINTS)
    low, high = [], []
    for seed in range(60):
        rng = np.random.default_rng([seed, 5])
        fit = a_fit(rng)
        layout = make_layout([ten_bins(rng)], fit.nuisance.columns)
        for curve in _make_curves(_sum_up(solve_with_noise(fit, fit.noise), layout), layout, even):
            low.append(curve.p_value <= 0.1)
            high.append(curve.p_value > 0.3)
    # Of few bins the share is coarse: p-values stand on few steps, none too small too often.
    assert np.mean(low) < 0.16 and np.mean(high) > 0.5
    rng = np.random.default_rng(6)
    bins = ten_bins(rng)
    fit = a_fit(rng)
    step = np.zeros((N, 3))
    step[bins.order[:48]] = 3.0 * fit.linear.joints[bins.order[:48], :, 1]
    planted = replace(fit, residual=fit.residual + step.ravel())
    layout = make_layout([bins], fit.nuisance.columns)
    sums = _sum_up(solve_with_noise(planted, fit.noise), layout)
    first, second = _make_curves(sums, layout, even)
    assert second.outside >= 0.4 and second.p_value <= 0.01
    assert (np.abs(second.mean[:4] - 3.0) < 1.0).all()
    assert second.outside > first.outside and second.rms_um > 2 * first.rms_um
    assert second.strength.noise_units > 20 and first.strength.noise_units < 8
    # Where the last fit's residuals scatter more along a joint, so does its band.
    assert sums.spread[1] > 1.5 and sums.spread[1] > 1.2 * sums.spread[0]
    wide = _make_curves(sums, layout, sums.spread)[1]
    assert wide.band == pytest.approx(sums.spread[1] * second.band)


def test_copies_share_noise_within_their_posture_only() -> None:
    """Three rests of one posture, one alone, two of another: sizes and products by hand."""
    rng = np.random.default_rng(15)
    columns = rng.normal(size=(18, 2))
    fit = small_fit(np.zeros(18), columns)
    assert Copies.from_fit(fit, fit.nuisance.columns) is None
    fit.linear.rests.posture = np.array([0, 0, 0, 1, 2, 2])
    noise = fit.noise.with_shared_part(0.5, fit.linear.rests.posture)
    fit = solve_with_noise(replace(fit, baseline=SimpleNamespace(is_given=False)), noise)
    copies = Copies.from_fit(fit, fit.nuisance.columns.whitened(noise.whitener, np.ones(0)))
    assert copies is not None and copies.number.tolist() == [0, 0, 0, -1, 1, 1]
    # Three copies count as 3 / (1 + 2 · 0.5), each as a half; two as two thirds each.
    assert copies.own_share == pytest.approx([0.25] * 3 + [1.0] + [1 / 3] * 2)
    assert copies.shared_size**2 == pytest.approx([0.25] * 3 + [0.0] + [1 / 3] * 2)
    motion = rng.normal(size=(6, 3))
    sizes = copies.make_sizes(motion).toarray()
    assert sizes.shape == (6, 6) and not sizes[3].any() and not sizes[:3, 3:].any()
    assert sizes[4, 3:] == pytest.approx(np.sqrt(1 / 3) * motion[4])
    by_rest = np.sqrt(noise.counts)[:, None, None] * columns.reshape(6, 3, 2)
    first = 0.5 * by_rest[:3].sum(axis=0)  # (3, 2), axis by axis
    assert copies.crossings[0][:, :3] == pytest.approx(first.T)


@pytest.mark.usefixtures("along_the_joints")
@pytest.mark.filterwarnings("error")
def test_what_is_wholly_absorbed_is_never_outside() -> None:
    """Joint 1 moves the tips of each bin of its own as free columns do: nothing is left of it."""
    rng = np.random.default_rng(14)
    bins = replace(ten_bins(rng), order=np.arange(N))
    joints = rng.normal(size=(N, 3, JOINTS))
    free = np.zeros((3 * N, 10))
    for b, rests in enumerate(np.split(np.arange(3 * N), 10)):
        free[rests, b] = joints[:, :, 0].ravel()[rests]
    residual = 1e3 * rng.normal(size=3 * N)
    fit = small_fit(residual, free)
    linear: Any = SimpleNamespace(rests=fit.linear.rests, residual=residual, joints=joints)
    held: Any = SimpleNamespace(is_given=False)
    again = solve_with_noise(replace(fit, linear=linear, baseline=held), fit.noise)
    layout = make_layout([bins], again.nuisance.columns)
    absorbed, other = _make_curves(_sum_up(again, layout), layout, np.ones(JOINTS))
    assert absorbed.outside == 0.0 and absorbed.p_value == 1.0
    assert not absorbed.mean.any() and not absorbed.sets.any() and not absorbed.band.any()
    assert other.outside > 0.9 and other.band.min() > 0.0


@pytest.mark.usefixtures("along_the_joints")
def test_noise_spreads_along_each_component_as_the_models_sets_do() -> None:
    spread = []
    for seed in range(20):
        fit = a_fit(np.random.default_rng([seed, 8]))
        layout = make_layout([ten_bins(np.random.default_rng(seed))], fit.nuisance.columns)
        spread.append(_sum_up(solve_with_noise(fit, fit.noise), layout).spread)
    # χ² of 114 degrees of freedom a component and set.
    assert np.square(spread).mean() == pytest.approx(1.0, abs=0.06)


@pytest.mark.usefixtures("along_the_joints")
@pytest.mark.parametrize("independent", [False, True])
def test_sets_that_are_shown_scatter_as_their_curve_says(
    monkeypatch: pytest.MonkeyPatch, independent: bool
) -> None:
    monkeypatch.setattr(curves, "SETS_SHOWN", 20_000)
    covariance = np.array([[4.0, 1.0, 0.0], [1.0, 1.0, 0.5], [0.0, 0.5, 9.0]])
    curve = replace(
        compared("q1", joint(1), 0.1, 1.0).before,
        covariance=np.diag(covariance) if independent else covariance,
    )
    expected = np.diag(np.diag(covariance)) if independent else covariance
    assert np.cov(curve.sets.T) == pytest.approx(expected, abs=0.2)


def test_sums_of_several_variables_are_those_of_each() -> None:
    rng = np.random.default_rng(13)
    first, second = ten_bins(rng), replace(ten_bins(rng), starts=np.array([0, 7, 50]))
    short = replace(second, order=second.order[:90], values=np.sort(rng.normal(size=90)))
    features = [make_features(bins) for bins in (first, short)]
    values = rng.normal(size=(N, 4))
    pieces = np.split(rng.permutation(N), [30, 70])
    functions = [*map(Functions.from_features, features, (first, short), (N, N))]
    sums = FunctionSums(functions, pieces)
    all_sums = sums.sum_values(values)
    by_piece = [sums.sum_at_piece(i, values[rests]) for i, rests in enumerate(pieces)]
    assert np.sum(by_piece, axis=0) == pytest.approx(all_sums)
    sparse = sums.sum_sparse(csr_array(values))
    assert sparse.select(slice(1, 3)) == pytest.approx(all_sums[:, 1:3])
    for over_all, of_variable in zip(sums.split(all_sums), sparse.split(), strict=True):
        assert of_variable == pytest.approx(over_all)
    for bins, of_rests, over_bins, over_all in zip(
        (first, short), features, sums.sum_over_bins(values), sums.split(all_sums), strict=True
    ):
        groups = np.split(values[bins.order], bins.starts[1:])
        assert over_bins == pytest.approx(np.array([group.sum(axis=0) for group in groups]))
        assert over_all[-len(groups) :] == pytest.approx(over_bins)
        assert over_all[: -len(groups)] == pytest.approx(of_rests.T @ values[bins.order])
    shapes = ShapeSums(rng.normal(size=(5, N)), pieces)
    in_turn = [shapes.sum_at_piece(i, values[rests]) for i, rests in enumerate(pieces)]
    assert np.sum(in_turn, axis=0) == pytest.approx(shapes.shapes @ values)
    assert shapes.sum_sparse(csr_array(values)).columns == pytest.approx(shapes.shapes @ values)
    # Beside too many bins there is no feature.
    each = replace(first, starts=np.arange(N))
    alone = Functions.from_features(np.ones((N, 1)), each, N)
    assert alone.count == 0 and not alone.is_together


def test_components_are_how_the_tip_moves() -> None:
    linear = whole_scene().linear
    named, moves = make_components(linear)
    by_name = {one.name: moves[:, :, k] for k, one in enumerate(named)}
    assert np.array_equal(by_name["angle joint 3"], linear.joints[:, :, 2])
    along = {f"{axis} artefact" for axis in "xyz"} | {f"{axis} base" for axis in "xyz"}
    assert {*along, "length link 2", "length stylus", "scale artefact"} < {*by_name}
    assert {"lean x link 1", "lean y link 5"} < {*by_name} and "lean x link 6" not in by_name
    for name in (*along, "length link 2", "length stylus"):  # a mm of each moves the tip by one
        assert np.linalg.norm(by_name[name], axis=1) == pytest.approx(1.0, abs=1e-6), name


def test_two_fits_of_one_arm_have_the_same_components() -> None:
    """A link of 20 mm by one fit and of 19 by the other was compared with its neighbour."""
    linear = whole_scene().linear
    layout = linear.rests.observations.arm.layout
    named, _ = make_components(linear)
    drawn = {f"length link {k}" for k in range(1, 7)} & {one.name for one in named}
    assert drawn
    constants = linear.model.constants.copy()
    for name in drawn:
        constants[layout.indices([f"{p}_{name[-1]}" for p in "da"])] *= 1e-3
    for name in {f"length link {k}" for k in range(1, 7)} - drawn:
        constants[layout.index(f"a_{name[-1]}")] += 50.0
    fitted = replace(linear, model=replace(linear.model, constants=constants))
    assert make_components(fitted)[0] == named


def compared(
    variable: str, component: Component, outside: float, best: float, flat: float = 0.0
) -> ResidualComparison:
    line = np.zeros(3)
    curve = ResidualCurve(
        mean=line + outside, covariance=np.eye(3) * (0.1 / HALF_WIDTH) ** 2, outside=outside,
        p_value=0.0, weight=line + 1.0, rests=3, strength=Strength(best, flat),
    )  # fmt: skip
    after = replace(curve, mean=line, outside=0.0, p_value=1.0, strength=Strength(-2.0, -2.0))
    named = variable in ("placement", "target", "approach")
    bins = Bins(
        variable, variable, np.arange(3), np.arange(3), np.arange(3.0),
        ("a", "b", "c") if named else (), kind="name" if named else "angle")  # fmt: skip
    return ResidualComparison(bins, component, curve, after)


def joint(number: int) -> Component:
    return Component(f"angle joint {number}", "angle", f"joint {number}")


def test_the_report_picks_what_stands_out_most_of_each_group_and_of_a_finding() -> None:
    every = [compared("q1", joint(1), 0.3, 30.0), compared("q3", joint(3), 0.6, 60.0),
             compared("q3", joint(5), 0.9, 90.0), compared("t1", joint(2), 0.1, 10.0),
             compared("artefact_c", joint(1), 0.2, 20.0), compared("time_s", joint(4), 0.5, 50.0),
             compared("placement", joint(2), 0.4, 40.0), compared("approach", joint(1), 0.7, 70.0),
             compared("target", Component("x artefact", "length", "artefact"), 0.2, 5.0),
             ]  # fmt: skip

    def picked(of: list[ResidualComparison]) -> list[tuple[str, str]]:
        return [(one.bins.variable, one.component.name.split()[-1]) for one in choose_overview(of)]

    groups = [("q3", "5"), ("artefact_c", "1"), ("time_s", "4"), ("placement", "2")]
    assert picked(every) == groups
    strong = compared("target", every[-1].component, 0.2, 500.0)
    assert picked([*every, strong]) == [("target", "artefact"), *groups]
    at_joint = choose_for_finding(every, {"depends_on": ["q3"], "location": "joint 3"})
    assert at_joint is every[1]
    assert choose_for_finding(every, {"depends_on": ["approach_z"], "location": "tip"}) is every[7]
    assert choose_for_finding(every, {"depends_on": [], "location": "rows"}) is None
    figure = draw_rows(choose_overview([*every, strong]))
    assert [panel.get_title() for panel in figure.axes[2:4]] == [
        "model under test: 90 % outside, p < 2e-05",
        "with the findings: 0 % outside, p = 1",
    ]
    assert [panel.get_ylabel() for panel in figure.axes[:4:2]] == [
        "residual, x artefact, µm", "residual, joint 5, ″"]  # fmt: skip
    assert every[1].as_json() == {
        "variable": "q3", "component": "angle joint 3", "alike": [], "outside_before": 0.6,
        "outside_after": 0.0, "p_before": 0.0, "p_after": 1.0,
        "noise_units_before": pytest.approx(np.sqrt(60.0)), "noise_units_after": 0.0,
        "curve_um_before": pytest.approx(1e3 * np.sqrt(0.6**2 - (0.1 / 1.96) ** 2)),
        "curve_um_after": 0.0}  # fmt: skip


def test_what_is_the_same_all_over_is_of_the_time_and_names_give_way_to_values() -> None:
    flat = [compared("q1", joint(1), 1.0, 105.0, 100.0), compared("time_s", joint(1), 1.0, 100.0)]
    assert min(flat, key=lambda one: one.order).bins.variable == "time_s"
    varies = compared("q1", joint(1), 1.0, 150.0, 100.0)
    assert min([varies, *flat], key=lambda one: one.order) is varies
    names = compared("placement", joint(1), 1.0, 155.0)
    assert min([names, varies], key=lambda one: one.order) is varies
    clear = compared("target", joint(1), 1.0, 200.0)
    assert min([clear, varies], key=lambda one: one.order) is clear


@pytest.mark.usefixtures("along_the_joints")
def test_a_model_without_findings_is_looked_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    fit = a_fit(np.random.default_rng(7))
    monkeypatch.setattr(curves, "make_bins", lambda _: [ten_bins(np.random.default_rng(1))])
    search = SimpleNamespace(first=fit, last=fit)
    diagnosis: Any = SimpleNamespace(search=search, arm=SimpleNamespace(n_joints=JOINTS))
    for comparison in curves.compare(diagnosis):
        assert comparison.before is comparison.after
