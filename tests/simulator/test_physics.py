"""The arm's life before any wire: a person's motion, true tips, heat."""

from __future__ import annotations

from itertools import islice

import numpy as np

from armd.simulator.live.operator import Operator
from armd.simulator.live.physics import STEP_S, STEPS, Block, WarmUp, generate_blocks
from armd.simulator.live.prefetch import Prefetch
from armd.simulator.truth.arm import TrueArm

RATE_HZ = 500


def some_seconds(seconds: float, warm_up: WarmUp | None = None, seed: int = 1) -> list[Block]:
    arm = TrueArm.default(seed)
    life = generate_blocks(arm, Operator(arm, seed), RATE_HZ, 20.0, warm_up)
    return list(islice(life, round(seconds / (STEPS * STEP_S))))


def test_the_motion_is_a_persons() -> None:
    """Moves of up to 0.5 m/s, rests of a second or more, the button only while at rest."""
    life = some_seconds(60.0)
    tip = np.concatenate([block.tip_mm for block in life])
    buttons = np.concatenate([block.buttons for block in life])
    speed = np.linalg.norm(np.diff(tip, axis=0), axis=1) * RATE_HZ
    assert 240 < speed.max() < 510
    assert 0.2 < np.mean(speed < 1.0) < 0.7
    pressed = np.flatnonzero(buttons)
    presses = 1 + np.count_nonzero(np.diff(pressed) > 1)
    assert presses >= 8
    assert np.all(speed[pressed - 1] < 1.0)
    steps = np.diff(np.concatenate([block.encoder_rad for block in life]), axis=0)
    assert np.abs(steps).max() * RATE_HZ < 3.1  # rad/s, also across blocks and stretches


def test_every_rest_is_at_a_seat_with_a_warm_arm_too() -> None:
    arm = TrueArm.default(1)
    seats = Operator(arm, 1).seats_mm
    life = some_seconds(60.0, WarmUp(10.0, 40.0))
    tip = np.concatenate([block.tip_mm for block in life])
    buttons = np.concatenate([block.buttons for block in life])
    pressed = tip[np.flatnonzero(np.diff(buttons.astype(int)) > 0) + 1]
    miss = np.linalg.norm(pressed[:, None] - seats, axis=2).min(axis=1)
    assert len(pressed) >= 8
    # During a rest the arm goes on warming, ten kelvin in forty seconds.
    assert miss.max() < 0.5
    assert np.median(miss) < 0.1


def test_warm_up_reaches_its_rise_in_its_time() -> None:
    life = some_seconds(30.0, WarmUp(10.0, 25.0))
    assert np.all(np.abs(life[0].sensor_c[0] - 20.0) < 0.01)
    sensor_c = np.concatenate([block.sensor_c for block in life])
    middle, end = (sensor_c[round(s / STEP_S)].mean() - 20.0 for s in (5.0, 25.0))
    assert 2.0 < middle < 8.0
    assert 9.0 < end < 10.5


def test_one_seed_is_one_life() -> None:
    first, again, other = (some_seconds(3.0, seed=seed)[-1] for seed in (4, 4, 5))
    assert np.array_equal(first.encoder_rad, again.encoder_rad)
    assert not np.allclose(first.encoder_rad, other.encoder_rad)


def test_another_process_computes_ahead() -> None:
    ahead = Prefetch(iter(range(1000)))
    assert list(islice(ahead, 5)) == [0, 1, 2, 3, 4]
    ahead.close()  # although nobody took the rest
    assert list(Prefetch(iter("ab"))) == ["a", "b"]
