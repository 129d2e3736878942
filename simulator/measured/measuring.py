"""Simulates measurements: the arm on an artefact, reading after reading.

The data that an operator would record go to a session folder. The truth stays in `Measured`; it may
be written to its own file, but never to the folder.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from armd.arrays import F64, I64, Mask
from armd.files.writing import write_whole
from armd.simulator.measured.artefact import Artefact
from armd.simulator.measured.campaign import Campaign, Rig
from armd.simulator.measured.placement import Placement, place
from armd.simulator.measured.plan import Climate, SessionPlan
from armd.simulator.measured.poses import Reach, compute_tip_jacobian, solve_posture
from armd.simulator.truth import nominal
from armd.simulator.truth.effects.effect import Conditions, Posture
from armd.simulator.truth.heat import HeatField
from armd.simulator.truth.rotations import draw_directions


@dataclass(frozen=True, kw_only=True)
class Measured:
    """A session's readings, and the truth behind them (n rows each)."""

    plan: SessionPlan
    artefact: Artefact
    placements: list[Placement]
    placement: I64  # index into placements
    target: I64  # index into artefact.targets
    encoder: F64  # (n, N) recorded, rad
    sensor_c: F64  # (n, S) recorded
    artefact_c: F64  # recorded
    felt_c: F64  # (n, S) true temperatures of the sensors
    conditions: Conditions  # true
    phi: F64  # (n, N) true axis angles
    tip_mm: F64  # (n, 3) true tip, base frame
    noise_mm: F64  # (n, 3) of encoder noise, seating and drift, base frame
    spoilt: Mask  # gross errors, which belong to no effect

    @property
    def n(self) -> int:
        return len(self.target)

    @property
    def session_time_s(self) -> F64:
        return self.conditions.time_s - 3600 * self.plan.start_h

    @property
    def down(self) -> F64:
        """The unit vector of gravity (n, 3) in each reading's placement frame."""
        return _down(self.placements, self.placement)

    def to_base(self, local: F64) -> F64:
        """Turn vectors (n, 3) of each reading's placement frame to the base frame."""
        turned = np.empty_like(local)
        for i, placement in enumerate(self.placements):
            rows = self.placement == i
            turned[rows] = local[rows] @ placement.rotation.T
        return turned


def _down(placements: list[Placement], placement: I64) -> F64:
    return -np.array([pose.rotation[2] for pose in placements])[placement]


def find_reach(rig: Rig, rng: np.random.Generator) -> Reach:
    """Return the reach of the rig's arm."""
    return Reach(rig.arm, rng, rig.limits_rad)


def measure_campaign(campaign: Campaign, rng: np.random.Generator) -> Iterator[Measured]:
    """Measure session after session."""
    reach = find_reach(campaign.rig, rng)
    for plan, artefact in campaign.sessions:
        yield measure(replace(campaign.rig, artefact=artefact), plan, reach, rng)


def measure(rig: Rig, plan: SessionPlan, reach: Reach, rng: np.random.Generator) -> Measured:
    """Carry out *plan*: its visits one after another, each in its own random order."""
    placements, placement, target, phi = [], [], [], []
    for i, visit in enumerate(plan.visits):
        targets = rig.artefact.index(visit.targets)
        pose, poses = place(visit, rig.artefact.true_mm[targets], reach, rng)
        placements.append(pose)
        # An operator goes round the artefact several times, and does not stay at one ball.
        count = len(targets) * visit.articulations
        order = rng.permutation(count)
        again = np.tile if rig.in_rounds else np.repeat
        order = again(order, rig.repeats)
        target.append(np.repeat(targets, visit.articulations)[order])
        phi.append(poses.reshape(count, -1)[order])
        placement.append(np.full(len(order), i))
    return take_readings(
        rig,
        plan,
        placements,
        np.concatenate(placement),
        np.concatenate(target),
        np.concatenate(phi),
        rng,
    )


def take_readings(
    rig: Rig,
    plan: SessionPlan,
    placements: list[Placement],
    placement: I64,
    target: I64,
    phi: F64,
    rng: np.random.Generator,
    sides: F64 | None = None,
) -> Measured:
    """Take one reading per row, in time order, the tip at its target, the arm close to *phi* (n,
    N).

    *sides* (n, N): the sign of each joint's last rate, where it is prescribed.
    """
    n = len(target)
    arm = rig.arm.with_payload(plan.payload_kg)
    time_s = plan.interval_s * (np.arange(n) + rng.uniform(0.0, 0.3, n))
    air_c = plan.climate.air_c(time_s)
    link_c, felt_c = _temperatures(plan.climate, time_s, rig.core_lag_s)
    pushed = np.full((n, 3), np.nan)
    for i, pose in enumerate(placements):
        rows = placement == i
        pushed[rows] = rig.artefact.inward[target[rows]] @ pose.rotation.T
    rigid = arm.posture(phi, Conditions.at_rest(n, arm.n_joints))
    approach, rate = _motion(rigid, pushed, plan, rng)
    if sides is not None:
        rate = np.copysign(rate, sides)
    conditions = Conditions(link_c, rate, 3600 * plan.start_h + time_s, approach, air_c)
    artefact_c = air_c  # the thin bars have the air's temperature
    local = rig.artefact.positions(target, artefact_c, _down(placements, placement))
    goal = np.empty((n, 3))
    for i, pose in enumerate(placements):
        rows = placement == i
        goal[rows] = pose.to_base(local[rows])
    if rig.touched is not None and rig.touched.session == plan.name:
        first = np.flatnonzero(placement == 0)
        after = first[int(rig.touched.share * len(first)) :]
        goal[after] = rig.touched.moved(goal[after])
    moved = rig.noise.seating(rng, n) + rig.noise.wander(rng, time_s)
    thrown = np.zeros((n, 3)) if rig.spoil is None else rig.spoil(rng, n)
    moved = moved + thrown
    phi = solve_posture(arm, phi, goal + moved, conditions)
    encoder_noise = rig.noise.encoders(rng, phi.shape) + rig.interpolation(phi)
    jacobian = compute_tip_jacobian(arm.posture(phi, conditions))
    encoder = arm.encoder_angles(phi, conditions) + encoder_noise
    sensor_c = rig.noise.sensors(rng, rig.read_sensors(felt_c))
    if rig.restarts is not None:
        encoder = rig.restarts.read(plan.name, encoder)
    if rig.brown_outs is not None:
        sensor_c = rig.brown_outs.read(plan.name, sensor_c)
    return Measured(
        plan=plan,
        artefact=rig.artefact,
        placements=placements,
        placement=placement,
        target=target,
        encoder=encoder,
        sensor_c=sensor_c,
        artefact_c=rig.noise.sensors(rng, artefact_c),
        felt_c=felt_c,
        conditions=conditions,
        phi=phi,
        tip_mm=goal + moved,
        noise_mm=moved + np.einsum("nij,nj->ni", jacobian, encoder_noise),
        spoilt=np.any(thrown != 0, axis=1),
    )


def write_session(folder: Path, measured: Measured, serial: str = nominal.SERIAL_NUMBER) -> None:
    """Write the operator's files: session.toml and readings.csv."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in make_session_files(measured, serial).items():
        write_whole(folder / name, text)


def make_session_files(measured: Measured, serial: str = nominal.SERIAL_NUMBER) -> dict[str, str]:
    """Make the texts of session.toml and readings.csv, by name, as the operator has them."""
    head = [
        'schema = "armd.session/1"',
        f'arm = "{serial}"',
        f"started = {measured.plan.started.strftime('%Y-%m-%dT%H:%M:%SZ')}",
        'angle_unit = "rad"',
        "",
    ]
    return {
        "session.toml": "\n".join(head) + "\n" + measured.artefact.toml(),
        "readings.csv": _readings_csv(measured),
    }


def _readings_csv(measured: Measured) -> str:
    joints = range(1, measured.phi.shape[1] + 1)
    header = ["time_s", "placement", "target"]
    header += [f"q{k}" for k in joints] + [f"w{k}" for k in joints]
    header += [*nominal.list_sensor_names(), "artefact_c", "approach_x", "approach_y", "approach_z"]
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(header)
    time_s = measured.session_time_s
    for i in range(measured.n):
        writer.writerow(
            [
                f"{time_s[i]:.3f}",
                measured.placements[measured.placement[i]].name,
                measured.artefact.targets[measured.target[i]],
                *(f"{q:.12f}" for q in measured.encoder[i]),
                *(f"{w:.6f}" for w in measured.conditions.rate[i]),
                *(f"{c:.8g}" for c in measured.sensor_c[i]),
                f"{measured.artefact_c[i]:.8g}",
                *(f"{u:.6f}" for u in measured.conditions.approach[i]),
            ]
        )
    return out.getvalue()


def _temperatures(climate: Climate, time_s: F64, core_lag_s: F64 | None) -> tuple[F64, F64]:
    """Return true link and sensor temperatures (n, N) at each reading."""
    field_ = HeatField(climate.ambient_c, core_lag_s)
    field_.settle(climate.ambient_c, 0.0 if climate.cold else climate.power_w)
    link_c, felt_c = [], []
    now = -3600 * climate.lead_h
    for moment in time_s:
        # Steps of at most a minute follow the ramp; a constant air is solved exactly in one.
        while now < moment:
            step = moment - now if climate.ramp_k_per_h == 0 else min(60.0, moment - now)
            middle = climate.air_c(np.array([now + step / 2]))[0]
            field_.step(step, float(middle), climate.power_w)
            now += step
        link_c.append(field_.link_c)
        felt_c.append(field_.sensor_c)
    return np.array(link_c), np.array(felt_c)


def _motion(
    posture: Posture, pushed: F64, plan: SessionPlan, rng: np.random.Generator
) -> tuple[F64, F64]:
    """Return approach directions (n, 3) and joint rates (n, N) that move the tip along them.

    The approach is *pushed* (n, 3), where a surface prescribes it, and mostly from above if NaN.
    """
    n = posture.tip.shape[0]
    above = draw_directions(rng, n) + np.array([0.0, 0.0, -0.8])
    above /= np.linalg.norm(above, axis=1, keepdims=True)
    approach = np.where(np.isnan(pushed), above, pushed)
    jacobian = compute_tip_jacobian(posture)
    inverse = np.linalg.pinv(jacobian)
    speed = plan.rate_rad_s * rng.uniform(0.3, 1.0, (n, 1)) * 300.0
    along = np.einsum("nij,nj->ni", inverse, speed * approach)
    joints = jacobian.shape[2]
    free = np.eye(joints) - inverse @ jacobian
    idle = plan.rate_rad_s * rng.normal(size=(n, joints))
    return approach, along + np.einsum("nij,nj->ni", free, idle)
