"""The truth about an arm as plain data, for tests and `--truth-out`."""

from __future__ import annotations

from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.nominal import list_sensor_names


def list_true_constants(arm: TrueArm) -> dict[str, float]:
    """Return the true geometry at the reference temperature: theta_1 … tip_z, rad and mm."""
    names = ("theta", "d", "a", "alpha", "beta")
    constants = {
        f"{name}_{k}": float(value)
        for k, row in enumerate(arm.rows, 1)
        for name, value in zip(names, row, strict=True)
    }
    tip = zip("xyz", arm.tip_offset, strict=True)
    return constants | {f"tip_{axis}": float(value) for axis, value in tip}


def list_true_expansion(arm: TrueArm) -> list[tuple[str, str, float]]:
    """List each length's change per kelvin of its link's sensor: (parameter, sensor, mm/K)."""
    sensors = list_sensor_names(arm.n_joints)
    growing = []
    for k, row in enumerate(arm.rows):
        growing.append((f"d_{k + 1}", sensors[k], row[1] * arm.materials.along_d[k]))
        growing.append((f"a_{k + 1}", sensors[k], row[2] * arm.materials.along_a[k]))
    for axis, length in zip("xyz", arm.tip_offset, strict=True):
        growing.append((f"tip_{axis}", sensors[-1], length * arm.materials.tip))
    return [(name, sensor, float(rate)) for name, sensor, rate in growing if rate]
