"""What a model gains in another session: against sessions that are drawn."""

from types import SimpleNamespace

import numpy as np
import pytest

from armd.compensation.diagnose.heldout.later_gain import predict_later_gain


def readings(session, placement):
    return SimpleNamespace(session=np.array(session), placement=np.array(placement))


def test_by_sessions_where_there_are_three_of_them():
    """Gains 1, 2 and 3 µm, 2 over all: s = 1, t = 4.303, √(1 + 1/3) = 1.155."""
    after_um, gain_um = 4.0, np.array([1.0, 2.0, 3.0])
    after = np.full(3, (1e-3 * after_um) ** 2)
    before = (1e-3 * (after_um + gain_um)) ** 2
    of_all_um = np.sqrt((25 + 36 + 49) / 3) - after_um
    low, high = predict_later_gain(before, after, readings([0, 1, 2], [0, 1, 2]))
    assert (low + high) / 2 == pytest.approx(of_all_um)
    assert (high - low) / 2 == pytest.approx(4.3027 * 1.1547, rel=1e-4)


def test_by_placements_where_there_are_fewer_sessions():
    """Two placements a session: the mean of two is one more session's."""
    before = (1e-3 * (4.0 + np.array([1.0, 2.0, 3.0, 2.0]))) ** 2
    after = np.full(4, (4e-3) ** 2)
    low, high = predict_later_gain(before, after, readings([0, 0, 1, 1], [0, 1, 2, 3]))
    s, t = np.sqrt(2 / 3), 3.1824
    assert (high - low) / 2 == pytest.approx(t * s * np.sqrt(1 / 2 + 1 / 4), rel=1e-4)


def test_one_placement_tells_nothing_of_another():
    assert predict_later_gain(np.ones(5), np.ones(5), readings([0] * 5, [0] * 5)) is None


@pytest.mark.parametrize("sessions", [3, 6, 12])
def test_nineteen_of_twenty_drawn_sessions_are_inside(sessions):
    """Each session shows its own amount of what was mended; forty readings of each."""
    rng = np.random.default_rng(sessions)
    inside = 0
    for _ in range(400):
        size_um = rng.normal(12.0, 2.0, sessions + 1)
        noise_um = rng.normal(0.0, 5.0, (sessions + 1, 40, 3))
        raw_um = noise_um + size_um[:, None, None] * rng.choice([-1, 1], (sessions + 1, 40, 1))
        before, after = ((1e-3 * each) ** 2 for each in (raw_um, noise_um))
        before, after = before.sum(axis=2), after.sum(axis=2)
        label = np.repeat(np.arange(sessions), 40)
        low, high = predict_later_gain(
            before[1:].ravel(), after[1:].ravel(), readings(label, label)
        )
        truly = 1e3 * (np.sqrt(before[0].mean()) - np.sqrt(after[0].mean()))
        inside += low <= truly <= high
    assert 0.92 < inside / 400 < 0.98  # 0.95 ± 2.8 standard errors
