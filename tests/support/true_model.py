"""The simulated arm's own truth as arm.toml and calibration.json: points should then be true.

For tests of the live path: what is left between point and truth is noise, or a fault.
"""

from __future__ import annotations

from pathlib import Path

from armd.compensation.model.arm import load_arm
from armd.compensation.model.calibration import name_constants, save_calibration
from armd.compensation.model.slow_factors import Temperature
from armd.compensation.model.terms import Term
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.nominal import list_sensor_names, make_arm_toml
from support.drawn import drawn


def write_true_model(folder: Path, seed: int) -> None:
    """arm.toml and calibration.json of the arm that the simulator has for this *seed*."""
    true = TrueArm.default(seed)
    arm_path = folder / "arm.toml"
    arm_path.write_text(make_arm_toml(rows=true.rows, tip=true.tip_offset), encoding="utf-8")
    arm = load_arm(arm_path)
    constants = name_constants(arm.nominal(), arm.n_joints)
    materials = true.materials
    strains = {f"tip_{axis}": (materials.tip, arm.n_joints) for axis in "xyz"}
    for k in range(1, arm.n_joints + 1):
        strains[f"d_{k}"] = (materials.along_d[k - 1], k)
        strains[f"a_{k}"] = (materials.along_a[k - 1], k)
    terms = [
        Term(
            parameter=name,
            basis=[Temperature(weights={list_sensor_names()[link - 1]: 1.0})],
            coefficient=float(strain * constants[name]),
        )
        for name, (strain, link) in strains.items()
    ]
    calibration = drawn(
        arm,
        reference_temperature_c=true.reference_c,
        temperature_range_c=dict.fromkeys(arm.sensors, (10.0, 40.0)),
        terms=terms,
        provenance={"method": "the simulated arm's own truth"},
    )
    save_calibration(folder / "calibration.json", calibration)
