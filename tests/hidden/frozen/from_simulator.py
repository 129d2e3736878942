"""Cases by armd's own simulator, with the noise units and the oracle of each."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from hidden.frozen.case import Cause, Names, Truth, rounded, write_truth
from hidden.frozen.oracle import BEFORE, DIAGNOSED, F64, FURTHER, Problem

from armd.simulator.campaigns.hidden import NOISE, Design
from armd.simulator.hidden import HiddenCase, generate_case
from armd.simulator.measured.measuring import Measured
from armd.simulator.measured.noise import Noise
from armd.simulator.plants.plant import Plant, list_columns
from armd.simulator.truth.arm import Materials, TrueArm
from armd.simulator.truth.effects.effect import Conditions
from armd.simulator.truth.rotations import ARC_SECOND

#: Causes that only a calibration from before can show.
UNDER_A_CALIBRATION = {"geometry_shift", "sensor_offset", "sensor_swapped", "link_expansion"}
PARTS = {"before": BEFORE, "session": DIAGNOSED, "holdout": FURTHER}
STEPS = (1e-6, 1e-3, 1e-3, 1e-6, 1e-6)  # of θ, d, a, α, β: rad, mm


@dataclass(frozen=True)
class Made:
    """What to measure, what is planted, and what its truth says beside the causes."""

    plants: tuple[Plant, ...]
    design: Design
    noise: Noise = NOISE
    mess: str = ""
    words: str = ""
    neutral: Names = ()
    neutral_variables: tuple[str, ...] = ()
    refusable: str = ""
    growing: bool = False  # the growth of all links is a cause: the calibration knows none
    after: Callable[[Path], None] | None = field(default=None)  # changes the files written


def under_calibration(plants: Sequence[Plant]) -> bool:
    return any(plant.cause in UNDER_A_CALIBRATION for plant in plants)


def write_case(folder: Path, kind: str, seed: int, made: Made) -> Truth:
    """Write a whole case; return its truth, which is written too."""
    case = generate_case(folder, seed, made.plants, made.design, made.noise, made.mess)
    for path in case.holdout:
        path.rename(path.with_name(path.name.replace("holdout", "further")))
    for path in sorted(folder.glob("*/readings.csv")):
        _round_angles(path)
    if made.after is not None:
        made.after(folder)
    problem = _problem(case, made)
    units = problem.noise_units()
    causes = [_cause(plant, value) for plant, value in zip(made.plants, units, strict=False)]
    if made.growing:
        causes.append(_growth(case.present.rig.arm, units[-1]))
    certain = not made.mess
    truth = Truth(
        kind,
        seed,
        made.words or " + ".join(f"{p.cause} {p.location} {p.size:.3g}" for p in made.plants),
        tuple(causes),
        "calibrate" if case.before else "",
        rounded(problem.noise_um()) if certain else None,
        rounded(problem.oracle_um()) if certain else None,
        made.neutral,
        made.neutral_variables,
        refusable=made.refusable,
    )
    write_truth(folder, truth)
    return truth


def _cause(plant: Plant, units: float) -> Cause:
    names: Names = ()
    if plant.cause == "thermal_lag":
        names = (("thermal_lag", f"sensor t{plant.number}"),)
    return Cause(
        plant.cause, plant.location, rounded(units), names, variables=tuple(list_columns(plant)),
        needs="time_s" if "course" in plant.detail else "",
    )  # fmt: skip


def _growth(arm: TrueArm, units: float) -> Cause:
    """One cause at every link that grows by more than 0.5 µm per kelvin."""
    per_k = np.hypot(arm.rows[:, 1] * arm.materials.along_d, arm.rows[:, 2] * arm.materials.along_a)
    links = [f"link {k + 1}" for k in np.argsort(-per_k) if per_k[k] > 5e-4]
    names = tuple(("link_expansion", link) for link in links)
    variables = tuple(f"t{link.split()[-1]}" for link in links)
    return Cause("link_expansion", links[0], rounded(units), names, variables=variables)


def _problem(case: HiddenCase, made: Made) -> Problem:
    measured = list(case.measured.values())
    arm = replace(case.present.rig.arm, effects=())
    known = replace(arm, materials=Materials.without_expansion(arm.n_joints))
    parts, numbers = [], []
    for i, one in enumerate(measured):
        parts.append(np.full(one.n, PARTS[one.plan.name.split("-")[0]]))
        numbers.append(100 * i + one.placement)
    effects = [
        np.concatenate([effect.error_mm.get(m.plan.name, np.zeros((m.n, 3))) for m in measured])
        for effect in case.effects
    ]
    effects = [
        np.where((np.concatenate(parts) == BEFORE)[:, None], 0.0, effect) for effect in effects
    ]
    if made.growing:
        effects.append(
            np.concatenate(
                [known.tip(m.phi, m.conditions) - arm.tip(m.phi, m.conditions) for m in measured]
            )
        )
    # The growth that is planted is no constant that absorbs it.
    growing = made.growing or any(plant.cause == "link_expansion" for plant in made.plants)
    columns = [_columns(arm, m, growth=not growing) for m in measured]
    sigma = np.concatenate([_sigma(m, made.noise, arm) for m in measured])
    return Problem(
        np.concatenate(columns),
        effects,
        np.concatenate([case.noise_mm[m.plan.name] for m in measured]),
        np.concatenate([_lever(m) for m in measured]),
        np.concatenate(numbers),
        np.concatenate(parts),
        sigma,
    )


def _lever(measured: Measured) -> F64:
    origins = np.array([where.origin_mm for where in measured.placements])
    lever: F64 = measured.tip_mm - origins[measured.placement]
    return lever


def _sigma(measured: Measured, noise: Noise, arm: TrueArm) -> F64:
    """Of one axis, from encoders, seat, ball and stand."""
    lever = np.linalg.norm(arm.posture(measured.phi, measured.conditions).tip, axis=1)
    angles = noise.encoder_arcsec * ARC_SECOND * lever
    ball = measured.artefact.standard_uncertainty_mm
    rest = (1e-3 * noise.seating_um) ** 2 + (1e-3 * noise.wander_um) ** 2 + ball**2
    sigma: F64 = np.sqrt(angles**2 + rest)
    return sigma


def _columns(arm: TrueArm, measured: Measured, growth: bool) -> F64:
    """(n, 3, m) of every constant, and of what each length grows by per kelvin."""
    n, phi, conditions = arm.n_joints, measured.phi, measured.conditions

    def moved(changed: Callable[[float], TrueArm], step: float, when: Conditions) -> F64:
        difference: F64 = changed(step).tip(phi, when) - changed(-step).tip(phi, when)
        return difference / (2 * step)

    found = []
    for joint in range(n):
        for column, step in enumerate(STEPS):

            def constant(by: float, joint: int = joint, column: int = column) -> TrueArm:
                rows = arm.rows.copy()
                rows[joint, column] += by
                return replace(arm, rows=rows)

            found.append(moved(constant, step, conditions))
    for axis in range(3):
        found.append(
            moved(lambda by, a=axis: replace(arm, tip_offset=arm.tip_offset + by * np.eye(3)[a]),
                  1e-3, conditions)  # type: ignore[misc]
        )  # fmt: skip
    for name in ("along_d", "along_a") if growth else ():
        for joint in range(n):

            def grown(by: float, name: str = name, joint: int = joint) -> TrueArm:
                per_k = getattr(arm.materials, name) + by * np.eye(n)[joint]
                return replace(arm, materials=replace(arm.materials, **{name: per_k}))

            found.append(moved(grown, 1e-6, conditions))
    return np.stack(found, axis=2)


def _round_angles(path: Path) -> None:
    """Angles to 1e-9 rad, so that another processor's last digit does not change the file."""

    def change(row: dict[str, str]) -> None:
        for name, value in row.items():
            if name[:1] in "qw" and name[1:].isdigit() and value:
                row[name] = f"{float(value):.9f}" if name[0] == "q" else f"{float(value):.5f}"

    change_rows(path, change)


def change_rows(path: Path, change: Callable[[dict[str, str]], None]) -> None:
    """Rewrite a readings.csv row by row."""
    rows = list(csv.DictReader(io.StringIO(path.read_text(encoding="utf-8"))))
    for row in rows:
        change(row)
    out = io.StringIO()
    table = csv.DictWriter(out, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    path.write_text(out.getvalue(), encoding="utf-8")
