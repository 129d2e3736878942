"""A printed arm of five servos and a sixth at the gripper: an SO-101 as it comes out of the box.

Magnetic encoders on the output shafts, eccentric to their magnets; play between horn and link;
links of PLA that bend and grow; motors that warm their neighbours. Positions are given in closed
form at any instant, because a servo samples when it is asked.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armd.simulator.truth.arm import Materials, TrueArm
from armd.simulator.truth.conditions import Conditions
from armd.simulator.truth.effects.base import Effect
from armd.simulator.truth.effects.eccentric_disc import EccentricDisc
from armd.simulator.truth.effects.play import Play
from armd.simulator.truth.effects.soft_joint import SoftJoint
from armd.simulator.truth.posture import Masses

F64 = npt.NDArray[np.float64]

COUNTS_PER_TURN = 4096
IDS = (1, 2, 3, 4, 5, 6)  # the sixth moves the gripper, which serves as a button
N = 5
#: θ0 °, d mm, a mm, α ° of so101_new_calib.urdf's axes; middle of travel is zero
DRAWING = np.array(
    [
        (0.0, 116.6, 30.3992, -90.0),
        (-76.0320399201738, 0.0, 116.000021120688, 0.0),
        (73.8245483080259, 0.0, 135.000185185058, 0.0),
        (-87.7925083878521, -0.1778, 0.0, 90.0),
        (0.0, -159.2274, 0.0, 0.0),
    ]
)
DIRECTION = np.array([-1, 1, 1, 1, 1])
LIMITS_DEG = np.array([(-110, 110), (-100, 100), (-96.83, 96.83), (-95, 95), (-157.21, 162.79)])
TIP_MM = (-7.9, 0.17, 0.0)
MASS_KG = (0.100, 0.103, 0.104, 0.079, 0.099)
PLA_PER_K = 70e-6
GRIPPER_OPEN, GRIPPER_PRESSED = 2300, 1500  # raw positions

#: of a servo: 55 g of mostly metal and plastic; still air; and what its neighbour in the chain gets
CAPACITY_J_K, TO_AIR_W_K, TO_NEXT_W_K = 45.0, 0.055, 0.02
POWER_W = np.array([0.6, 1.0, 0.9, 0.6, 0.5, 0.5])  # holding and electronics


def true_arm(seed: int) -> TrueArm:
    """Off the drawing by about 0.5 mm and 0.3°, as prints and screws are."""
    rng = np.random.default_rng([seed, 0x50101])
    rows = np.zeros((N, 5))
    rows[:, [0, 3]] = np.radians(DRAWING[:, [0, 3]] + rng.normal(0.0, 0.3, (N, 2)))
    rows[:, [1, 2]] = DRAWING[:, [1, 2]] + rng.normal(0.0, 0.5, (N, 2))
    effects: list[Effect] = []
    for joint in range(1, N + 1):
        effects += [
            EccentricDisc(joint, float(rng.uniform(40, 150)), float(rng.uniform(0, 2 * math.pi))),
            Play(joint, float(rng.uniform(200, 700))),
            SoftJoint(joint, float(rng.uniform(0.002, 0.006))),
        ]
    along = np.full(N, PLA_PER_K)
    return TrueArm(
        rows,
        np.array(TIP_MM) + rng.normal(0.0, 0.5, 3),
        Materials(along, along, PLA_PER_K, np.zeros(N)),
        Masses(np.array(MASS_KG), np.tile([-40.0, 0.0, 0.0], (N, 1))),
        tuple(effects),
    )


class Warmth:
    """Temperatures of the six servos, in closed form: each heats itself, the air cools it, and
    heat flows along the chain."""

    def __init__(self, ambient_c: float, rise_k: float | None, within_s: float) -> None:
        n = len(IDS)
        flow = np.diag(np.full(n, -TO_AIR_W_K))
        for k in range(n - 1):
            for a, b in ((k, k + 1), (k + 1, k)):
                flow[a, a] -= TO_NEXT_W_K
                flow[a, b] += TO_NEXT_W_K
        rise = np.linalg.solve(-flow, POWER_W)
        scale, haste = 1.0, 1.0
        if rise_k is not None:
            scale = rise_k / float(rise.mean())
            haste = 3 * CAPACITY_J_K / TO_AIR_W_K / within_s
        decay, self._modes = np.linalg.eigh(flow / CAPACITY_J_K * haste)
        self._decay = decay
        self._rise = scale * rise
        self._start = np.linalg.solve(self._modes, -self._rise)
        self._ambient_c = ambient_c

    def at(self, time_s: F64) -> F64:
        """(n, 6) °C at *time_s* (n,) since power-up."""
        fading = (np.exp(np.outer(time_s, self._decay)) * self._start) @ self._modes.T
        celsius: F64 = self._ambient_c + self._rise + fading
        return celsius


@dataclass(frozen=True)
class _Move:
    """From one posture to the next in a smooth motion, then a rest with a press of the button."""

    start_s: float
    move_s: float
    end_s: float
    begin: F64
    change: F64


class Hand:
    """Motion without end through postures within the limits, the same for the same *seed*."""

    REST_S, PRESS_AFTER_S, PRESS_S = 1.6, 0.9, 0.2

    def __init__(self, seed: int) -> None:
        self._rng = np.random.default_rng([seed, 0x4A4D])
        middle = np.radians([0.0, -20.0, 30.0, 20.0, 0.0])
        self._moves = [_Move(0.0, 1e-9, 1.5, middle, np.zeros(N))]
        self._at = 0

    def move_at(self, time_s: float) -> _Move:
        while self._moves[-1].end_s <= time_s:
            self._moves.append(self._next(self._moves[-1]))
        if not self._moves[self._at].start_s <= time_s < self._moves[self._at].end_s:
            starts = [move.start_s for move in self._moves]
            self._at = int(np.searchsorted(starts, time_s, side="right")) - 1
        return self._moves[self._at]

    def angle(self, joint: int, time_s: float) -> float:
        """Of the axis of *joint* (from 1), rad, as the drawing counts it."""
        move = self.move_at(time_s)
        u = min((time_s - move.start_s) / move.move_s, 1.0)
        profile = u**3 * (10.0 + u * (-15.0 + 6.0 * u))
        return float(move.begin[joint - 1] + move.change[joint - 1] * profile)

    def pressed(self, time_s: float) -> bool:
        move = self.move_at(time_s)
        return 0.0 <= time_s - move.start_s - move.move_s - self.PRESS_AFTER_S < self.PRESS_S

    def _next(self, before: _Move) -> _Move:
        begin = before.begin + before.change
        low, high = np.radians(LIMITS_DEG).T * 0.6
        change = self._rng.uniform(low, high) - begin
        move_s = max(float(np.abs(change).max()) * 1.875 / self._rng.uniform(0.8, 2.0), 0.4)
        start = before.end_s
        return _Move(start, move_s, start + move_s + self.REST_S, begin, change)


class PrintedArm:
    """The arm in motion: what its servos feel at an instant, and where its tip is then."""

    def __init__(
        self, seed: int, ambient_c: float, rise_k: float | None = None, within_s: float = 20.0
    ) -> None:
        self.truth = true_arm(seed)
        self.hand = Hand(seed)
        self.warmth = Warmth(ambient_c, rise_k, within_s)
        self._ambient_c = ambient_c
        self._discs = {e.joint: e for e in self.truth.effects if isinstance(e, EccentricDisc)}

    def raw(self, servo: int, time_s: float) -> int:
        """The encoder's position, counts from the seam, not folded to a turn."""
        if servo == IDS[-1]:
            return GRIPPER_PRESSED if self.hand.pressed(time_s) else GRIPPER_OPEN
        phi = np.zeros((1, N))
        phi[0, servo - 1] = angle = self.hand.angle(servo, time_s)
        error = self._discs[servo].shown(servo, phi, _NOWHERE)
        assert error is not None
        shown = float(DIRECTION[servo - 1]) * (angle + float(error[0]))
        return round(shown / (2 * math.pi) * COUNTS_PER_TURN) + COUNTS_PER_TURN // 2

    def tips_mm(self, time_s: F64) -> F64:
        """The true tip (n, 3) at instants (n,)."""
        phi = np.array([[self.hand.angle(k, t) for k in range(1, N + 1)] for t in time_s])
        ahead = np.array([[self.hand.angle(k, t + 1e-4) for k in range(1, N + 1)] for t in time_s])
        conditions = Conditions(
            link_c=self.warmth.at(time_s)[:, 1:],  # the body of servo k+1 sits in link k
            rate=(ahead - phi) / 1e-4,
            time_s=time_s,
            approach=np.tile([0.0, 0.0, -1.0], (len(time_s), 1)),
            ambient_c=np.full(len(time_s), self._ambient_c),
        )
        return self.truth.tip(phi, conditions)


_NOWHERE = Conditions.at_rest(1, N)


def arm_toml(serial_number: str) -> str:
    """The drawing of the arm, as an arm.toml."""
    lines = ['schema = "armd.arm/1"', f'serial_number = "{serial_number}"']
    lines += ["reference_temperature_c = 20.0", ""]
    for k in IDS[1:]:
        lines += ["[[temperature_sensor]]", f'name = "servo{k}"']
    for k, (theta, d, a, alpha) in enumerate(DRAWING.tolist(), 1):
        low, high = LIMITS_DEG[k - 1]
        lines += [
            "",
            f"[[joint]]  # {k}",
            f"theta_deg = {theta}",
            f"d_mm = {d}",
            f"a_mm = {a}",
            f"alpha_deg = {alpha}",
            f"counts_per_turn = {COUNTS_PER_TURN}",
            f"direction = {DIRECTION[k - 1]}",
            f"min_deg = {low}",
            f"max_deg = {high}",
            f'temperature = "servo{k + 1}"',
            f"mass_kg = {MASS_KG[k - 1]}",
            "centre_of_mass_mm = [-40.0, 0.0, 0.0]",
        ]
    lines += ["", "[tip]", f"offset_mm = {list(TIP_MM)}", "radius_mm = 3.0"]
    return "\n".join(lines) + "\n"
