"""The pictures of the reports show what was measured: places, joints, residuals, lengths, form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from armd.compensation.model.kinematics import compute_pose
from armd.compensation.report.calibration.arm_picture import draw_arm_picture
from armd.compensation.report.calibration.residual_plots import (
    choose_round,
    compute_running_mean,
    draw_residuals_by_joint,
    draw_residuals_by_sensor,
    draw_vectors,
)
from armd.compensation.report.coverage import MOST_NAMED, add_coverage
from armd.compensation.report.layout.drawing import make_svg
from armd.compensation.report.layout.page import Page
from armd.compensation.report.layout.units import Unit, choose_units
from armd.compensation.report.verification.figures import (
    draw_lengths,
    draw_rosettes,
    draw_sphere_form,
)
from armd.compensation.verify.limits import PermissibleErrors
from armd.compensation.verify.results import Deviation, Figure
from armd.compensation.verify.verdict import Judged
from support import synthetic

ARM = synthetic.arm()
MICROMETRES = Unit("µm", 1e3, 2)


def test_the_coverage_names_the_places_and_what_joints_used() -> None:
    session = synthetic.session(ARM, ARM.nominal(), np.random.default_rng(1))
    page = Page("P")
    add_coverage(page, ARM, [session])
    text = page.to_html()
    assert "from above" in text and "from the side" in text and "nan" not in text
    few = len(session.placement_names) <= MOST_NAMED
    assert [name for name in session.placement_names if (f">{name}<" in text) != few] == []
    low, high = ARM.range_rad
    share = np.ptp(session.states.q[:, 1]) / (high[1] - low[1])
    assert f"{100 * share:.0f} %" in text


def test_points_without_angles_have_no_coverage() -> None:
    session = synthetic.session(ARM, ARM.nominal(), np.random.default_rng(1))
    still = replace(session, states=replace(session.states, q=np.zeros_like(session.states.q)))
    page = Page("P")
    add_coverage(page, ARM, [still])
    assert "<svg" not in page.to_html()


def test_the_arm_has_its_frames_and_the_names_identified() -> None:
    q = np.linspace(0.1, 0.6, ARM.n_joints)
    figure = draw_arm_picture(ARM, q, ["theta_1", "beta_2", "a_3", "tip_x"])
    text = make_svg(figure, "arm", "arm")
    for label in ("base", "frame 1: θ1", "frame 2: β2", "frame 3: a3", "frame 4", "tip: tip_x"):
        assert f">{label}<" in text
    chain = figure.axes[0].lines[0].get_xydata()
    assert len(chain) == ARM.n_joints + 2  # base, frames, tip
    tip = compute_pose(q[None], ARM.nominal())[0][0]
    assert abs(chain[-1, 1] - tip[2]) <= np.hypot(tip[0], tip[1])


def test_residuals_along_a_joint_have_their_sign() -> None:
    rng = np.random.default_rng(2)
    q = rng.uniform(-2.0, 2.0, (400, ARM.n_joints))
    joints = rng.normal(size=(400, 3, ARM.n_joints)) + 300.0
    planted = 1e-5 * np.sin(q[:, 1])
    residual = joints[:, :, 1] * planted[:, None]
    units = choose_units(ARM)
    figure = draw_residuals_by_joint(q, joints, residual, units)
    mean = next(line for line in figure.axes[1].lines if len(line.get_xdata()) > 5)
    x, y = mean.get_data()
    assert y == pytest.approx(1e-5 * np.sin(np.radians(x)) * units.angle.per_base, abs=0.2)
    assert y.min() < -1.0 < 1.0 < y.max()  # ″, to both sides


def test_running_means_know_how_well() -> None:
    x, y = np.arange(160.0), np.tile([1.0, 3.0], 80)
    middle, mean, sigma = compute_running_mean(x, y)
    assert len(middle) == 16 and np.all(np.diff(middle) > 0)
    assert mean == pytest.approx(2.0)
    assert sigma == pytest.approx(np.std([1.0, 3.0] * 5, ddof=1) / np.sqrt(10))
    assert not compute_running_mean(x[:3], y[:3])[0].size


def test_a_sensor_that_nobody_read_is_not_drawn() -> None:
    celsius = np.array([[20.0, np.nan]] * 30)
    tip, residual = np.full((30, 3), 300.0), np.full((30, 3), 0.01)
    assert draw_residuals_by_sensor(celsius[:, 1:], ["t2"], tip, residual, MICROMETRES) is None
    figure = draw_residuals_by_sensor(celsius, ["t1", "t2"], tip, residual, MICROMETRES)
    assert figure is not None and "t2" not in make_svg(figure, "s", "s")
    mean = max(figure.axes[0].lines[0].get_ydata())
    assert mean == pytest.approx(10.0 * np.sqrt(2.0))  # µm outwards, both x and y


def test_vectors_are_to_a_scale_that_is_named() -> None:
    rng = np.random.default_rng(3)
    tip = rng.uniform(-500.0, 500.0, (50, 3))
    residual = np.full((50, 3), 0.005 / np.sqrt(3.0))
    figure, times = draw_vectors(tip, residual, MICROMETRES)
    key = figure.axes[0].lines[0].get_xdata()
    assert ">20 µm<" in make_svg(figure, "v", "v")
    assert np.ptp(key) == pytest.approx(0.020 * times)
    assert [choose_round(x) for x in (1.0, 4.9, 0.07, 230.0)] == [1.0, 2.0, 0.05, 200.0]


def test_lengths_stand_in_the_band_of_their_limit() -> None:
    limits = PermissibleErrors.model_validate({"mpe": {"e_uni_mm": 0.03, "e_uni_mm_per_m": 0.01}})
    results = tuple(Deviation(f"P{i}", 0.01 * i, 0.002, 500.0, f"P{i}") for i in range(3))
    item = Judged(Figure("e_uni", "E_Uni", "ISO", results), "conforms", results[2], 0.035)
    figure = draw_lengths(item, limits, MICROMETRES)
    text = make_svg(figure, "l", "l")
    for word in ("P0", "P1", "P2", "MPE", "error, µm"):
        assert f">{word}<" in text
    dashed = [line for line in figure.axes[0].lines if line.get_linestyle() == "--"]
    assert sorted(line.get_ydata()[0] for line in dashed) == [-30.0, 30.0]


def test_seats_and_spheres_show_their_points() -> None:
    rng = np.random.default_rng(4)
    offsets = rng.normal(0.0, 0.01, (10, 3))
    seat = Deviation("SPAT1", 0.03, 0.0, offsets_mm=offsets)
    item = Judged(Figure("spat_max", "SPAT max δ", "ASME", (seat,)), "conforms", seat, 0.05)
    figure = draw_rosettes(item, MICROMETRES)
    assert figure is not None
    ends = next(line for line in figure.axes[0].lines if line.get_marker() == "o")
    assert ends.get_xydata() == pytest.approx(1e3 * offsets[:, :2])
    directions = rng.normal(size=(25, 3)) + np.array([0.0, 0.0, 2.0])
    points = 12.5 * directions / np.linalg.norm(directions, axis=1)[:, None]
    points[3] *= 1.0 + 0.02 / 12.5
    sphere = Deviation("SPHERE1", 0.02, 0.0, offsets_mm=points)
    form = Judged(Figure("p_form", "P_Form", "ISO", (sphere,)), "not judged", sphere, None)
    figure = draw_sphere_form(form, MICROMETRES)
    assert figure is not None
    shown = np.asarray(figure.axes[0].collections[0].get_array())
    assert shown.argmax() == 3 and shown[3] == pytest.approx(20.0 * 24 / 25)
    without = replace(sphere, offsets_mm=None)
    alone = replace(form, figure=replace(form.figure, deviations=(without,)))
    assert (
        draw_sphere_form(alone, MICROMETRES) is None and draw_rosettes(alone, MICROMETRES) is None
    )
