"""What else may be wrong between a joint and the angle it shows; shapes of size one."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from outsider.faults import inner
from outsider.measured import Rng
from outsider.scene import Fault, Scene


def gain(rng: Rng, scene: Scene) -> list[Fault]:
    """A linearised sensor shows too much per turn, and its line is a little bent."""
    k, bent = inner(rng, scene), rng.uniform(-0.05, 0.05)
    q = scene.readings.q[:, k]
    discs = {
        "encoder_eccentricity": (np.sin(q), np.cos(q)),
        "encoder_ellipticity": (np.sin(2 * q), np.cos(2 * q)),
    }
    return [
        Fault("encoder_scale", f"joint {k + 1}", (f"q{k + 1}",),
              scene.at_joint(k, q + bent * q**2), f"bent by {bent:.3f} per rad",
              rivals=scene.rivals_at(k, discs))
    ]  # fmt: skip


def wave(rng: Rng, scene: Scene) -> list[Fault]:
    """A gear between joint and encoder runs out, so many times a turn, and not quite as a sine."""
    k, waves, phase = inner(rng, scene), int(rng.integers(3, 13)), rng.uniform(0, 2 * np.pi)
    angle = waves * scene.readings.q[:, k] - phase
    by = np.sin(angle) + 0.15 * np.sin(2 * angle)
    return [
        Fault("encoder_periodic", f"joint {k + 1}", (f"q{k + 1}",), scene.at_joint(k, by),
              f"{waves} waves a turn", shapes=scene.waves_at(k, (angle,)))
    ]  # fmt: skip


def warmed(rng: Rng, scene: Scene) -> list[Fault]:
    """A joint's housing turns its zero as it grows warm, a little more so the warmer it is."""
    k, bent = inner(rng, scene), rng.uniform(0.0, 0.02)
    warm, q = scene.readings.warm[:, k], scene.readings.q[:, k]
    rivals = {
        "encoder_thermal": (warm * np.sin(q), warm * np.cos(q)),
        "geometry_shift": scene.each_session(),  # where sessions differ in warmth, within them less
    }
    return [
        Fault("joint_thermal", f"joint {k + 1}", (f"t{k + 1}",),
              scene.at_joint(k, warm + bent * warm**2), f"bent by {bent:.3f} per K",
              rivals=scene.rivals_at(k, rivals))
    ]  # fmt: skip


ANGLES: dict[str, Callable[[Rng, Scene], list[Fault]]] = {
    "gain": gain, "wave": wave, "warmed": warmed,
}  # fmt: skip
