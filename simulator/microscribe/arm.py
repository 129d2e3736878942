"""The arm with serial number 40937: the content of its memory, and its true tip.

The memory is the maker's, as captured from a real arm. The tip follows the maker's own chain, in
the modified form. armd's rows have the other form, so the two share no code.
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from armd.arrays import F64

TEXTS = {
    0xC8: b"MicroScribe3D\0",
    0xC9: b"MSCR\0",
    0xCA: b"DX\0",
    0xCB: b"40937\0",
    0xCC: b"Standard+Beta\0",
    0xCD: b"Format DH0.5\0",
    0xCE: b"HCI 2.0\0",
}
PARAMETERS = bytes.fromhex(
    "00003FF5FFF93FE5C002C00C 000003C028100215FE6F018F 206CFC92FFFD241C0140EB66"
)
EXTENDED = bytes.fromhex("0003")
MAXIMA = bytes.fromhex("03 3FFF 000000000000000000 3FFF3FFF1FFF0FFF0FFF0000")
COUNTS_PER_TURN = np.array([16384, 16384, 8192, 4096, 4096])
#: The angle registers at power-up and after HOME: the stylus in its rest.
HOME_COUNTS = np.array([12288, 6000, 6800, 2048, 1100])

_ALPHA, _A, _D = np.frombuffer(PARAMETERS, ">i2").reshape(3, 6).astype(float)
_BETA = int.from_bytes(EXTENDED, "big") * math.pi / 32768


def compute_tip_mm(angles: F64) -> F64:
    """Compute the tip's position (3,) for the true angles (5,) rad."""
    frame = np.eye(4)
    for i, theta in enumerate([*angles, 0.0]):
        frame = frame @ _shift(_A[i] * 0.0254, 0) @ _turn(0, _ALPHA[i] * math.pi / 32768)
        if i == 2:
            frame = frame @ _turn(1, _BETA)
        frame = frame @ _turn(2, theta) @ _shift(_D[i] * 0.0254, 2)
    return frame[:3, 3]


def make_arm_toml() -> str:
    """Make an arm.toml of the factory's geometry: A and α of a row are the maker's next ones."""
    lines = ['schema = "armd.arm/1"', f'serial_number = "{TEXTS[0xCB].rstrip(bytes(1)).decode()}"']
    for k, turn in enumerate(COUNTS_PER_TURN.tolist()):
        lines += [
            "",
            f"[[joint]]  # {k + 1}",
            f"d_mm = {_D[k] * 0.0254:.9g}",
            f"a_mm = {_A[k + 1] * 0.0254:.9g}",
            f"alpha_deg = {math.degrees(_ALPHA[k + 1] * math.pi / 32768)!r}",
            f"beta_deg = {math.degrees(_BETA) if k == 1 else 0.0!r}",
            f"counts_per_turn = {turn}",
        ]
    tip = f"offset_mm = [0.0, 0.0, {_D[5] * 0.0254:.9g}]"
    return "\n".join([*lines, "", "[tip]", tip, "radius_mm = 0.0", ""])


def _turn(axis: int, angle: float) -> F64:
    i, j = ((1, 2), (2, 0), (0, 1))[axis]
    frame = np.eye(4)
    frame[i, i] = frame[j, j] = math.cos(angle)
    frame[j, i], frame[i, j] = math.sin(angle), -math.sin(angle)
    return frame


def _shift(mm: float, axis: int) -> F64:
    frame = np.eye(4)
    frame[axis, 3] = mm
    return frame


class Holder(Protocol):
    """The person who holds the arm; instants in s after the simulator's start."""

    def note_home(self, t_s: float) -> None:
        """Record that HOME has come."""

    def angles(self, t_s: float) -> F64:
        """Return the true angles (5,) rad."""
        ...

    def buttons(self, t_s: float) -> int:
        """Return the pedals: bit 0 the right one, bit 1 the left one."""
        ...


class PedalHand:
    """A simulated user of the arm.

    Until the arm is homed, the stylus stays in its rest, and the right pedal is pressed every two
    seconds. Then the arm moves and rests in turns, with a pedal pressed at each rest.
    """

    PRESS_EVERY_S, PRESS_S = 2.0, 0.2
    TURN_S, MOVING_S = 5.0, 3.0

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng([seed, 0x35C])
        self._amplitude = rng.uniform(0.2, 0.7, 5)
        self._hz = rng.uniform(0.1, 0.35, 5)
        self._phase = rng.uniform(0, 2 * np.pi, 5)
        self._homed_s: float | None = None  # when the first HOME came

    def note_home(self, t_s: float) -> None:
        if self._homed_s is None:
            self._homed_s = t_s

    def angles(self, t_s: float) -> F64:
        """Return the true angles (5,) rad, *t_s* after the simulator's start."""
        home = HOME_COUNTS / COUNTS_PER_TURN * 2 * np.pi
        swing = np.sin(2 * np.pi * self._hz * self._progress(t_s) + self._phase)
        angles: F64 = home + self._amplitude * (swing - np.sin(self._phase))
        return angles

    def buttons(self, t_s: float) -> int:
        """Return the pedals: bit 0 the right one, bit 1 the left one."""
        if self._homed_s is None:
            return int(t_s % self.PRESS_EVERY_S > self.PRESS_EVERY_S - self.PRESS_S)
        turn, within = divmod(t_s - self._homed_s - 1.0, self.TURN_S)
        pressed = 0 < within - self.MOVING_S - 1.0 < self.PRESS_S and turn >= 0
        return pressed * (2 - int(turn) % 2)

    def _progress(self, t_s: float) -> float:
        """Return the time spent moving; motion starts and stops smoothly."""
        if self._homed_s is None or t_s <= self._homed_s + 1.0:
            return 0.0
        turns, within = divmod(t_s - self._homed_s - 1.0, self.TURN_S)
        part = min(within / self.MOVING_S, 1.0)
        return self.MOVING_S * (turns + part - math.sin(2 * math.pi * part) / (2 * math.pi))
