"""What a measurement averages."""

from __future__ import annotations

import json

import numpy as np

from armd import POINT, Flag
from armd.daemon.live.measurement import REMEMBERED, Averager


def points_of(n: int, seed: int = 1) -> np.ndarray:
    """n points a millisecond apart, scattered by 10 µm about (1, 2, 3)."""
    points = np.zeros(n, POINT)
    points["seq"] = np.arange(n)
    points["monotonic_ns"] = np.arange(n) * 1_000_000
    points["position_mm"] = np.random.default_rng(seed).normal([1, 2, 3], 0.01, (n, 3))
    points["orientation"] = [0, 0, 0, 1]
    return points


def angles_of(points: np.ndarray) -> np.ndarray:
    """(n, 2): other numbers for every point."""
    return np.column_stack([points["seq"] * 1e-6, points["position_mm"][:, 0]])


def test_the_average_of_a_rest_up_to_the_press_is_from_its_begin_at_most():
    averager, points = Averager(0.5, 2), points_of(1000)
    points["buttons"][900:] = 2
    (press,) = averager.remember(points, angles_of(points))
    assert press.row == 900 and press.buttons == [1]
    measured = averager.average("button", points[900], still_since_ns=300_000_000)
    taken = points["position_mm"][400:901]
    assert measured.count == 501 and measured.duration_s == 0.5
    np.testing.assert_allclose(measured.still_s, 0.6)
    np.testing.assert_allclose(measured.position_mm, taken.mean(axis=0))
    np.testing.assert_allclose(measured.standard_deviation_mm, taken.std(axis=0, ddof=1))
    np.testing.assert_allclose(measured.angles_rad, [650e-6, taken[:, 0].mean()])
    json.dumps(measured.as_json(), allow_nan=False)
    assert averager.average("button", points[900], 800_000_000).count == 101


def test_pressed_in_motion_it_is_the_one_point():
    averager, points = Averager(0.5, 2), points_of(10)
    averager.remember(points, angles_of(points))
    measured = averager.average("button", points[5], int(points["monotonic_ns"][5]))
    assert measured.count == 1 and measured.standard_deviation_mm is None
    assert measured.position_mm == points["position_mm"][5].tolist()


def test_invalid_points_are_left_out_and_an_invalid_press_gives_no_position():
    averager, points = Averager(0.5, 2), points_of(100)
    points["flags"][50:60] = Flag.INVALID
    points["position_mm"][50:60] = np.nan
    averager.remember(points, angles_of(points))
    measured = averager.average("button", points[99], 0)
    assert measured.count == 90 and np.isfinite(measured.position_mm).all()
    refused = averager.average("button", points[55], 0)
    assert refused.count == 0 and refused.position_mm is None and refused.angles_rad is None
    json.dumps(refused.as_json(), allow_nan=False)


def test_a_button_held_down_is_one_press_and_batches_do_not_matter():
    points = points_of(60)
    points["buttons"][10:40] = 1
    points["buttons"][20:50] |= 4
    averager = Averager(0.5, 2)
    presses = [
        press
        for row in range(60)
        for press in averager.remember(points[row : row + 1], angles_of(points[row : row + 1]))
    ]
    assert [press.buttons for press in presses] == [[0], [2]]
    assert [press.row for press in Averager(0.5, 2).remember(points, angles_of(points))] == [10, 20]


def test_a_rest_begins_once():
    points = points_of(10)
    points["flags"][3:6] = Flag.AT_REST
    averager = Averager(0.5, 2)
    assert averager.find_rests(points[:4]) == [3]
    assert averager.find_rests(points[4:]) == []


def test_memory_is_bounded_and_the_last_points_are_kept():
    averager, points = Averager(0.5, 2), points_of(REMEMBERED + 5000)
    for start in range(0, len(points), 777):
        averager.remember(points[start : start + 777], angles_of(points[start : start + 777]))
    measured = averager.average("rest", points[-1], 0)
    np.testing.assert_allclose(measured.position_mm, points["position_mm"][-501:].mean(axis=0))
    np.testing.assert_allclose(measured.angles_rad, angles_of(points)[-501:].mean(axis=0))


def test_half_a_second_is_remembered_where_the_rate_rises_twentyfold():
    points = points_of(23_000)
    points["monotonic_ns"][3000:] = 3_000_000_000 + np.arange(20_000) * 50_000
    measured = []
    for rows in (7, 4099, 23_000):
        averager = Averager(0.5, 2)
        for start in range(0, len(points), rows):
            batch = points[start : start + rows]
            averager.remember(batch, angles_of(batch))
        measured.append(averager.average("rest", points[-1], 0))
    assert measured[0].count == 10_001
    np.testing.assert_allclose(
        measured[0].position_mm, points["position_mm"][-10_001:].mean(axis=0)
    )
    assert measured[0] == measured[1] == measured[2]


def test_a_contact_that_bounces_is_one_press():
    points = points_of(400)
    for start in (50, 200):  # pressed at 50 and 200 ms, let go 100 ms later; 5 ms of bounce each
        for on in (0, 2, 4, 100, 103):
            points["buttons"][start + on : start + on + 1] = 1
        points["buttons"][start + 5 : start + 98] = 1
    points["buttons"][330:] = 1  # 27 ms after the last: still the same; 60 ms later a new one
    points["buttons"][331:391] = 0
    pressed = []
    averager = Averager(0.5, 2)
    for row in range(0, 400, 7):
        batch = points[row : row + 7]
        pressed += [row + press.row for press in averager.remember(batch, angles_of(batch))]
    assert pressed == [50, 200, 391]


def test_buttons_that_bounce_on_their_own():
    points = points_of(100)
    points["buttons"][10:50] = 1
    points["buttons"][20:60] |= 4
    points["buttons"][30] = 1
    presses = Averager(0.5, 2).remember(points, angles_of(points))
    assert [(press.row, press.buttons) for press in presses] == [(10, [0]), (20, [2])]
