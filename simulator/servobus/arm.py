"""A printed arm of servos: an SO-101 with a servo at its gripper, or 3 to 9 of its joints.

Magnetic encoders on the output shafts, eccentric to their magnets; play between horn and link;
links of PLA that bend and expand; motors that warm their neighbours. Positions have a closed form
at any instant, because a servo samples when it is asked.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from armd.arrays import F64
from armd.simulator.live.operator import Stretch
from armd.simulator.servobus.motion import ServoMotion, make_wandering
from armd.simulator.truth.arm import Materials, TrueArm
from armd.simulator.truth.effects.effect import Conditions, Effect, Masses
from armd.simulator.truth.effects.encoder.eccentric_disc import EccentricDisc
from armd.simulator.truth.effects.mechanical.play import Play
from armd.simulator.truth.effects.mechanical.soft_joint import SoftJoint

if TYPE_CHECKING:  # loaded late: the wire must not wait
    from armd.simulator.live.led import Led


COUNTS_PER_TURN = 4096
N = 5  # joints of an SO-101
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
MIDDLE_DEG = np.array([0.0, -20.0, 30.0, 20.0, 0.0])  # of the postures of a hand
GRIPPER_OPEN, GRIPPER_PRESSED = 2300, 1500  # raw positions

#: heat of a servo: 55 g of metal and plastic; loss to still air; conduction to its neighbour
CAPACITY_J_K, TO_AIR_W_K, TO_NEXT_W_K = 45.0, 0.055, 0.02
POWER_W = np.array([0.6, 1.0, 0.9, 0.6, 0.5, 0.5])  # holding and electronics


def list_parts(joints: int) -> list[int]:
    """List the SO-101's joints (from 0) of an arm of so many, base to wrist.

    They are its first ones, or all and more elbows.
    """
    return list(range(min(joints, 3))) + [2] * max(joints - N, 0) + list(range(3, min(joints, N)))


def list_servo_ids(joints: int) -> tuple[int, ...]:
    """List the ids of the joints, and last that of the gripper, which serves as a button."""
    return tuple(range(1, joints + 2))


def draw_true_arm(seed: int, joints: int = N) -> TrueArm:
    """Draw an arm that departs from the drawing by about 0.5 mm and 0.3°, as prints do."""
    rng = np.random.default_rng([seed, 0x50101])
    which = list_parts(joints)
    rows = np.zeros((joints, 5))
    rows[:, [0, 3]] = np.radians(DRAWING[which][:, [0, 3]] + rng.normal(0.0, 0.3, (joints, 2)))
    rows[:, [1, 2]] = DRAWING[which][:, [1, 2]] + rng.normal(0.0, 0.5, (joints, 2))
    effects: list[Effect] = []
    for joint in range(1, joints + 1):
        effects += [
            EccentricDisc(joint, float(rng.uniform(40, 150)), float(rng.uniform(0, 2 * math.pi))),
            Play(joint, float(rng.uniform(200, 700))),
            SoftJoint(joint, float(rng.uniform(0.002, 0.006))),
        ]
    along = np.full(joints, PLA_PER_K)
    return TrueArm(
        rows,
        np.array(TIP_MM) + rng.normal(0.0, 0.5, 3),
        Materials(along, along, PLA_PER_K, np.zeros(joints)),
        Masses(np.array(MASS_KG)[which], np.tile([-40.0, 0.0, 0.0], (joints, 1))),
        tuple(effects),
    )


class ServoHeat:
    """Temperatures of the servos, in closed form.

    Each servo heats itself, the air cools it, and heat flows along the chain.
    """

    def __init__(
        self, ambient_c: float, rise_k: float | None, within_s: float, joints: int = N
    ) -> None:
        n = joints + 1
        power_w = POWER_W[[*list_parts(joints), N]]
        flow = np.diag(np.full(n, -TO_AIR_W_K))
        for k in range(n - 1):
            for a, b in ((k, k + 1), (k + 1, k)):
                flow[a, a] -= TO_NEXT_W_K
                flow[a, b] += TO_NEXT_W_K
        rise = np.linalg.solve(-flow, power_w)
        scale, haste = 1.0, 1.0
        if rise_k is not None:
            scale = rise_k / float(rise.mean())
            haste = 3 * CAPACITY_J_K / TO_AIR_W_K / within_s
        decay, self._modes = np.linalg.eigh(flow / CAPACITY_J_K * haste)
        self._decay = decay
        self._rise = scale * rise
        self._start = np.linalg.solve(self._modes, -self._rise)
        self._ambient_c = ambient_c

    def celsius_at(self, time_s: F64) -> F64:
        """Return temperatures (n, N + 1) °C at *time_s* (n,) since power-up."""
        fading = (np.exp(np.outer(time_s, self._decay)) * self._start) @ self._modes.T
        celsius: F64 = self._ambient_c + self._rise + fading
        return celsius


class ServoArm:
    """The arm in motion: the state of its servos at an instant, and its true tip."""

    def __init__(
        self,
        seed: int,
        ambient_c: float,
        rise_k: float | None = None,
        within_s: float = 20.0,
        led: Led | None = None,
        joints: int = N,
    ) -> None:
        """Draw the arm of *seed*; raises `BadInput` where a target of *led* is out of reach."""
        self.truth = draw_true_arm(seed, joints)
        self.ids = list_servo_ids(joints)
        self.warmth = ServoHeat(ambient_c, rise_k, within_s, joints)
        self._parts = list_parts(joints)
        self._direction = DIRECTION[self._parts].astype(float)
        self._nowhere = Conditions.at_rest(1, joints)
        self.motion = self._wandering(seed) if led is None else self._led(led, seed)
        self._ambient_c = ambient_c
        self._discs = {e.joint: e for e in self.truth.effects if isinstance(e, EccentricDisc)}

    def raw(self, servo: int, time_s: float) -> int:
        """Return the encoder's position in counts from the seam, not folded to a turn."""
        n = self.truth.n_joints
        if servo > n:
            return GRIPPER_PRESSED if self.motion.pressed(time_s) else GRIPPER_OPEN
        phi = np.zeros((1, n))
        phi[0, servo - 1] = angle = self.motion.angle(servo, time_s)
        error = self._discs[servo].encoder_error_rad(servo, phi, self._nowhere)
        assert error is not None
        shown_rad = float(self._direction[servo - 1]) * (angle + float(error[0]))
        return round(shown_rad / (2 * math.pi) * COUNTS_PER_TURN) + COUNTS_PER_TURN // 2

    def tips_mm(self, time_s: F64) -> F64:
        """Return the true tip (n, 3) at instants (n,)."""
        angle, joints = self.motion.angle, range(1, self.truth.n_joints + 1)
        phi = np.array([[angle(k, t) for k in joints] for t in time_s])
        ahead = np.array([[angle(k, t + 1e-4) for k in joints] for t in time_s])
        conditions = Conditions(
            link_c=self._link_c(time_s),
            rate=(ahead - phi) / 1e-4,
            time_s=time_s,
            approach=np.tile([0.0, 0.0, -1.0], (len(time_s), 1)),
            ambient_c=np.full(len(time_s), self._ambient_c),
        )
        return self.truth.tip(phi, conditions)

    def _link_c(self, time_s: F64) -> F64:
        """Return the links' temperatures (n, N): the body of servo k+1 is in link k."""
        return self.warmth.celsius_at(time_s)[:, 1:]

    def _wandering(self, seed: int) -> ServoMotion:
        low, high = np.radians(LIMITS_DEG[self._parts]).T * 0.6
        return make_wandering(seed, np.radians(MIDDLE_DEG[self._parts]), low, high)

    def _led(self, led: Led, seed: int) -> ServoMotion:
        from armd.simulator.live.led import LedOperator

        low, high = np.radians(LIMITS_DEG[self._parts]).T
        hand = LedOperator(self.truth, led, seed, (low, high))

        def plan_next(before: Stretch) -> Stretch:
            return hand.plan_next(before, self._link_c(np.array([before.end_s]))[0])

        return ServoMotion(hand.first, plan_next)


def make_arm_toml(serial_number: str, joints: int = N) -> str:
    """Make the arm.toml of the arm's drawing."""
    lines = ['schema = "armd.arm/1"', f'serial_number = "{serial_number}"']
    lines += ["reference_temperature_c = 20.0", ""]
    for k in list_servo_ids(joints)[1:]:
        lines += ["[[temperature_sensor]]", f'name = "servo{k}"']
    for k, part in enumerate(list_parts(joints), 1):
        theta, d, a, alpha = DRAWING[part].tolist()
        low, high = LIMITS_DEG[part]
        lines += [
            "",
            f"[[joint]]  # {k}",
            f"theta_deg = {theta}",
            f"d_mm = {d}",
            f"a_mm = {a}",
            f"alpha_deg = {alpha}",
            f"counts_per_turn = {COUNTS_PER_TURN}",
            f"direction = {DIRECTION[part]}",
            f"min_deg = {low}",
            f"max_deg = {high}",
            f'temperature = "servo{k + 1}"',
            f"mass_kg = {MASS_KG[part]}",
            "centre_of_mass_mm = [-40.0, 0.0, 0.0]",
        ]
    lines += ["", "[tip]", f"offset_mm = {list(TIP_MM)}", "radius_mm = 3.0"]
    return "\n".join(lines) + "\n"
