"""The hand that moves the arm: smooth moves, a rest after each, a button press.

Without a plan, the operator has a few seats (fixed points in the base frame). He brings the tip to
one after the other, each time in another posture, as a person who measures an artefact. The
operator in `led` follows a plan.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from armd.arrays import F64
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import Movable
from armd.simulator.truth.effects.effect import Conditions

SEATS = 8
TIP_SPEED_MM_S = (250.0, 500.0)  # peak speed of a move: careful … brisk
JOINT_SPEED_RAD_S = 3.0  # no joint turns faster
REST_S = (1.2, 2.0)
PRESS_AFTER_S, PRESS_S = 0.8, 0.15  # time of the press in a rest, and its duration
BUTTON = 0x01
MARGIN_RAD = np.radians(8.0)  # distance kept from every end stop
#: A posture with the tip in front of the arm at table height, and the spread of postures about it.
COMFORTABLE_RAD = np.radians([0.0, 65.0, -95.0, 0.0, 50.0, 0.0])
SPREAD_RAD = np.radians([45.0, 18.0, 20.0, 45.0, 25.0, 60.0])
SEAT_TOLERANCE_MM = 1e-6
MOST_TRIES = 500


@dataclass(frozen=True)
class Stretch:
    """A move from one posture to the next (minimum jerk), then a rest there."""

    start_s: float
    move_s: float
    end_s: float
    begin: F64  # (N,) rad
    change: F64  # (N,) rad
    press_after_s: float = PRESS_AFTER_S

    def angles(self, time_s: F64) -> tuple[F64, F64]:
        """Return axis angles (n, N) rad and rates (n, N) rad/s."""
        u = np.clip((time_s - self.start_s) / self.move_s, 0.0, 1.0)[:, None]
        rate = _profile_rate(u) / self.move_s
        return self.begin + self.change * _profile(u), self.change * rate

    def buttons(self, time_s: F64) -> npt.NDArray[np.uint8]:
        since = time_s - (self.start_s + self.move_s + self.press_after_s)
        pressed = (since >= 0) & (since < PRESS_S)
        return pressed.astype(np.uint8) * np.uint8(BUTTON)


class Hand:
    """Motion without end; ask for it in order of time."""

    def __init__(self, arm: Movable, posture: F64) -> None:
        """Begin with a rest in *posture* (N,) rad."""
        self._arm = arm
        self.first = Stretch(0.0, 1e-9, 1.5, posture, np.zeros_like(posture), np.inf)
        self._stretch: Stretch | None = None  # the present one

    def angles(self, time_s: F64, link_c: F64) -> tuple[F64, F64, npt.NDArray[np.uint8]]:
        """Return axis angles (n, N) rad, rates (n, N) rad/s and buttons (n,) at *time_s* (n,).

        *time_s* ascends. *link_c* (N,) are the links' temperatures: the tip must meet a seat with a
        warm arm too.
        """
        parts = []
        done = 0
        now = self._stretch or self.first
        while done < len(time_s):
            if time_s[done] >= now.end_s:
                now = self.plan_next(now, link_c)
                continue
            end = int(np.searchsorted(time_s, now.end_s, side="left"))
            piece = time_s[done:end]
            parts.append((*now.angles(piece), now.buttons(piece)))
            done = end
        self._stretch = now
        angles, rates, buttons = zip(*parts, strict=True)
        return np.concatenate(angles), np.concatenate(rates), np.concatenate(buttons)

    def plan_next(self, before: Stretch, link_c: F64) -> Stretch:
        """Return the stretch after *before*; the links' temperatures are then *link_c* (N,)."""
        raise NotImplementedError

    def _durations(
        self, begin: F64, change: F64, link_c: F64, tip_mm_s: float, joint_rad_s: float
    ) -> tuple[float, float]:
        """Return the durations in s of a move whose tip, or whose fastest joint, has that peak
        speed.
        """
        u = np.linspace(0.0, 1.0, 41)[:, None]
        path = self._arm.tip(
            begin + change * _profile(u), Conditions.at_rest(len(u), len(begin), link_c)
        )
        peak_mm = float(np.linalg.norm(np.diff(path, axis=0), axis=1).max()) * (len(u) - 1)
        peak_rad = float(np.abs(change).max()) * float(_profile_rate(u).max())
        return peak_mm / tip_mm_s, peak_rad / joint_rad_s


@dataclass(frozen=True)
class Comfort:
    """The postures (N,) rad that a hand prefers, and the end stops that it avoids."""

    middle: F64
    spread: F64
    low: F64
    high: F64

    @classmethod
    def for_demo_arm(cls, joints: int) -> Comfort:
        parts = nominal.list_parts(joints)
        return cls(COMFORTABLE_RAD[parts], SPREAD_RAD[parts], *nominal.get_limits_rad(joints))


class Operator(Hand):
    """A hand that moves from seat to seat, the same way for the same *seed*."""

    def __init__(self, arm: Movable, seed: int, comfort: Comfort | None = None) -> None:
        """Draw the seats; *comfort* None: that of the demo arm."""
        self._rng = np.random.default_rng([seed, 0x09E])
        comfort = comfort or Comfort.for_demo_arm(arm.n_joints)
        self._comfortable_rad, self._spread_rad = comfort.middle, comfort.spread
        self._low, self._high = comfort.low + MARGIN_RAD, comfort.high - MARGIN_RAD
        self._arm = arm
        self._postures = [self._some_posture() for _ in range(SEATS)]
        cold = Conditions.at_rest(SEATS, arm.n_joints)
        self.seats_mm: F64 = arm.tip(np.array(self._postures), cold)  # (SEATS, 3), base frame
        self._seat = 0
        super().__init__(arm, self._postures[0])
        self.first = replace(self.first, press_after_s=PRESS_AFTER_S)

    def plan_next(self, before: Stretch, link_c: F64) -> Stretch:
        begin = before.begin + before.change
        self._seat = int((self._seat + self._rng.integers(1, SEATS)) % SEATS)
        change = self._posture_at(self._seat, link_c) - begin
        tip_mm_s = self._rng.uniform(*TIP_SPEED_MM_S)
        move_s = max(*self._durations(begin, change, link_c, tip_mm_s, JOINT_SPEED_RAD_S), 0.3)
        rest_s = self._rng.uniform(*REST_S)
        return Stretch(before.end_s, move_s, before.end_s + move_s + rest_s, begin, change)

    def _some_posture(self) -> F64:
        spread = self._rng.uniform(-1.0, 1.0, self._arm.n_joints) * self._spread_rad
        posture: F64 = np.clip(self._comfortable_rad + spread, self._low, self._high)
        return posture

    def _posture_at(self, seat: int, link_c: F64) -> F64:
        """Find a new posture (N,) with the tip in the seat, by Gauss–Newton.

        It starts near the known posture, and returns that one if it finds none.
        """
        for _ in range(MOST_TRIES):
            away = 0.3 * self._rng.uniform(-1, 1, len(link_c)) * self._spread_rad
            guess = self._postures[seat] + away
            for _ in range(12):
                tip, jacobian = self._tip_and_jacobian(guess, link_c)
                miss = self.seats_mm[seat] - tip
                if np.linalg.norm(miss) < SEAT_TOLERANCE_MM:
                    break
                guess = guess + np.linalg.pinv(jacobian, rcond=1e-2) @ miss
            close = float(np.linalg.norm(self.seats_mm[seat] - tip)) < SEAT_TOLERANCE_MM
            if close and bool(np.all((guess > self._low) & (guess < self._high))):
                return guess
        return self._postures[seat]

    def _tip_and_jacobian(self, posture: F64, link_c: F64) -> tuple[F64, F64]:
        step = 1e-6
        n = len(posture)
        around = np.vstack([posture, posture + step * np.eye(n)])
        tips = self._arm.tip(around, Conditions.at_rest(n + 1, n, link_c))
        jacobian: F64 = ((tips[1:] - tips[0]) / step).T
        return tips[0], jacobian


def _profile(u: F64) -> F64:
    """Return the share of the way at the share *u* of the time, with minimum jerk."""
    return u**3 * (10.0 + u * (-15.0 + 6.0 * u))


def _profile_rate(u: F64) -> F64:
    return 30.0 * (u * (1.0 - u)) ** 2
