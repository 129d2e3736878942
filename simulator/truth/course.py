"""Courses of drifts in time: from zero at the beginning to about one.

Each follows its own law: swelling by water, relaxation, a daily wave, a random walk.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armd.arrays import F64

#: (n,) seconds since the arm was mounted → (n,) share of the drift.
CourseInTime = Callable[[F64], F64]

DAY_S = 86400.0
#: Diffusion into a wall: number of terms, enough for a ten thousandth of the diffusion time.
DIFFUSION_TERMS = 200


def make_creeping(since_s: float, until_s: float) -> CourseInTime:
    """Make a course at a constant rate, to 1 at *until_s*."""
    return lambda time_s: (time_s - since_s) / (until_s - since_s)


def make_relaxing(since_s: float, time_constant_s: float) -> CourseInTime:
    """Make the course of a relaxing stress, or a settling screw: Maxwell's body."""
    return lambda time_s: 1.0 - np.exp(-np.maximum(time_s - since_s, 0.0) / time_constant_s)


def make_swelling(since_s: float, diffusion_s: float) -> CourseInTime:
    """Make the course of a wall that takes up water from both sides.

    It is the mean content by Fick's law (Crank, plane sheet), at first as the square root of time;
    *diffusion_s* is thickness² / (π² D).
    """

    def water_content(time_s: F64) -> F64:
        passed = np.maximum(time_s - since_s, 0.0)[:, None] / diffusion_s
        odd_numbers = 2.0 * np.arange(DIFFUSION_TERMS) + 1.0
        remaining_share: F64 = (
            8.0 / (np.pi * odd_numbers) ** 2 * np.exp(-(odd_numbers**2) * passed)
        ).sum(axis=1)
        return 1.0 - remaining_share

    return water_content


def make_daily(noon_s: float, sharpness: float = 0.3) -> CourseInTime:
    """Make the daily course of the sun on a wall: a wave with a second harmonic."""

    def sun_wave(time_s: F64) -> F64:
        turn = 2.0 * np.pi * (time_s - noon_s) / DAY_S
        wave: F64 = 0.5 * (np.cos(turn) + sharpness * np.cos(2.0 * turn))
        return wave

    return sun_wave


def draw_wandering(rng: np.random.Generator, since_s: float, until_s: float) -> CourseInTime:
    """Draw Brownian motion, of standard deviation 1 at *until_s*."""
    knots = np.linspace(since_s, until_s, 2001)
    path = np.concatenate([[0.0], np.cumsum(rng.normal(0.0, 1.0, 2000))]) / np.sqrt(2000.0)
    return lambda time_s: np.interp(time_s, knots, path)
