"""One session with all tests of ISO 10360-12 and ASME B89.4.22.

The names of the targets determine the test of a reading:

- ``SPHERE1.01`` … ``SPHERE2.25``: 25 contact points on a test sphere in two positions (P_Size,
  P_Form). A contact point is its own target: the tip's centre is there, R + r from the
  sphere's centre. The certified diameter is the length between ``SPHERE.a`` and ``SPHERE.b``.
- ``LDIA.1.1`` … ``LDIA.5.5``: five points on the sphere in each of five arm orientations (L_Dia).
- ``EFFDIA.1.1`` … ``EFFDIA.3.9``: nine points, three repeats (effective diameter).
- ``SPAT1`` … ``SPAT3``: kinematic seats at 0–20, 20–80 and 80–100 % of reach, ten articulations.
- ``L0`` … ``L5``: a length bar, ``L0``–``L5`` being five certified lengths, in the placements
  ``E_UNI1`` … ``E_UNI7``, three repeats (E_Uni).
- ``BARS.a``, ``BARS.b`` and ``BARL.a``, ``BARL.b``: bars of about 65 and 135 % of the arm's
  length in the placements ``VOL1`` … ``VOL20`` (volumetric).
"""

from __future__ import annotations

import numpy as np

from armd.arrays import F64
from armd.simulator.measured.artefact import Artefact, Length
from armd.simulator.measured.campaign import Campaign, Rig
from armd.simulator.measured.noise import Noise
from armd.simulator.measured.plan import Climate, SessionPlan, Visit
from armd.simulator.truth import nominal
from armd.simulator.truth.arm import TrueArm
from armd.simulator.truth.rotations import ARC_SECOND

REACH_MM = 1200.0
SPHERE_MM, SPHERE_UNCERTAINTY_MM, SPHERE_FORM_MM = 25.4, 0.0002, 0.00005
LENGTHS_MM = (160.0, 480.0, 800.0, 1200.0, 1600.0)
BARS_MM = {"BARS": 780.0, "BARL": 1620.0}
LENGTH_UNCERTAINTY_MM = 0.0005
Rings = tuple[tuple[float, int], ...]  # degrees from the sphere's pole, points
#: 25 points as in ISO 10360-5, 9 as in B89.4.22, 5 that determine a centre: all above the stem.
RINGS_25: Rings = ((0.0, 1), (22.5, 4), (45.0, 8), (67.5, 4), (90.0, 8))
RINGS_9: Rings = ((0.0, 1), (45.0, 4), (90.0, 4))
RINGS_5: Rings = ((0.0, 1), (90.0, 4))
#: The bars are of steel, certified at 20 °C.
STEEL_PER_K = 11.5e-6
#: How well an arm agrees with its arm.toml before verification.
CERTIFIED_MM, CERTIFIED_ARCSEC = 0.002, 0.5
EVERYWHERE = (260.0, 1120.0)  # from the shoulder
ACROSS = (200.0, 1150.0)  # from the column's axis


def plan_verification(seed: int, noise: Noise) -> Campaign:
    rng = np.random.default_rng([seed, 0x150])
    arm = TrueArm.default(seed)
    rows = arm.rows.copy()
    rows[:, 1:3] += rng.normal(0.0, CERTIFIED_MM, (arm.n_joints, 2))
    rows[:, [0, 3]] += rng.normal(0.0, CERTIFIED_ARCSEC * ARC_SECOND, (arm.n_joints, 2))
    artefact = make_artefacts(rng)
    plan = SessionPlan("verify", 0.0, Climate(20.0), plan_visits(artefact), 10.0)
    text = nominal.make_arm_toml(rows=rows, tip=arm.tip_offset)
    return Campaign(text, Rig(arm, artefact, noise), [(plan, artefact)])


def make_artefacts(rng: np.random.Generator) -> Artefact:
    """Make sphere, bars and seats as targets of one session; only lengths are certified."""
    diameter = SPHERE_MM + rng.normal(0.0, 0.002)
    true: dict[str, F64] = {
        "SPHERE.a": np.array([0.0, 0.0, -diameter / 2]),
        "SPHERE.b": np.array([0.0, 0.0, diameter / 2]),
    }
    inward: dict[str, F64] = {}
    for name, normal in _contacts(rng).items():
        radius = diameter / 2 + nominal.TIP_RADIUS_MM + rng.normal(0.0, SPHERE_FORM_MM)
        true[name], inward[name] = radius * normal, -normal
    for i in (1, 2, 3):
        true[f"SPAT{i}"] = np.zeros(3)
    true["L0"] = np.zeros(3)
    for i, length in enumerate(LENGTHS_MM, 1):
        true[f"L{i}"] = np.array([length + rng.normal(0.0, 0.02), 0.0, 0.0])
    for bar, length in BARS_MM.items():
        true[f"{bar}.a"] = np.zeros(3)
        true[f"{bar}.b"] = np.array([length + rng.normal(0.0, 0.02), 0.0, 0.0])
    positions = np.array(list(true.values()))
    nowhere = np.full(3, np.nan)
    pairs = [("L0", f"L{i}") for i in range(1, 6)] + [(f"{bar}.a", f"{bar}.b") for bar in BARS_MM]
    return Artefact(
        name="test sphere, seats and length bars",
        targets=list(true),
        certified_mm=np.full_like(positions, np.nan),
        true_mm=positions,
        standard_uncertainty_mm=0.0,
        expansion_per_k=STEEL_PER_K,
        true_expansion_per_k=STEEL_PER_K,
        lengths=[
            _certify("SPHERE.a", "SPHERE.b", true, SPHERE_UNCERTAINTY_MM, rng),
            *(_certify(a, b, true, LENGTH_UNCERTAINTY_MM, rng) for a, b in pairs),
        ],
        inward=np.array([inward.get(name, nowhere) for name in true]),
    )


def plan_visits(artefact: Artefact) -> tuple[Visit, ...]:
    """Plan all placements, test after test."""

    def starting(prefix: str) -> tuple[str, ...]:
        return tuple(name for name in artefact.targets if name.startswith(prefix))

    near_mm, middle_mm, far_mm = 0.2 * REACH_MM, 0.8 * REACH_MM, REACH_MM
    out = [
        Visit("SPHERE1", starting("SPHERE1"), 1),
        Visit("SPHERE2", starting("SPHERE2"), 1),
        Visit("LDIA", starting("LDIA"), 1),
        Visit("EFFDIA", starting("EFFDIA"), 1),
        Visit("SPAT1", ("SPAT1",), 10, EVERYWHERE, (150.0, near_mm)),
        Visit("SPAT2", ("SPAT2",), 10, EVERYWHERE, (near_mm, middle_mm)),
        Visit("SPAT3", ("SPAT3",), 10, EVERYWHERE, (middle_mm, far_mm)),
    ]
    lengths = tuple(f"L{i}" for i in range(6))
    out += [Visit(f"E_UNI{i}", lengths, 3, EVERYWHERE, ACROSS) for i in range(1, 8)]
    for i in range(1, 21):
        bar = "BARS" if i % 2 else "BARL"
        out.append(Visit(f"VOL{i}", (f"{bar}.a", f"{bar}.b"), 1, EVERYWHERE, ACROSS))
    return tuple(out)


def _contacts(rng: np.random.Generator) -> dict[str, F64]:
    """Draw contacts on the sphere, name → unit vector; each pattern has a random azimuth."""
    patterns = {f"SPHERE{position}.": (RINGS_25, 2) for position in (1, 2)}
    patterns |= {f"LDIA.{orientation}.": (RINGS_5, 1) for orientation in range(1, 6)}
    patterns |= {f"EFFDIA.{repeat}.": (RINGS_9, 1) for repeat in (1, 2, 3)}
    return {
        f"{prefix}{number:0{digits}d}": normal
        for prefix, (rings, digits) in patterns.items()
        for number, normal in enumerate(_rings(rings, rng.uniform(0.0, 2 * np.pi)), 1)
    }


def _rings(rings: Rings, turned_rad: float) -> F64:
    """Return unit vectors (n, 3); each ring's first point is turned by half of its spacing."""
    normals = []
    for from_pole_deg, count in rings:
        down = np.radians(from_pole_deg)
        turned_rad += np.pi / count
        for around in turned_rad + 2 * np.pi / count * np.arange(count):
            normals.append(
                [np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)]
            )
    return np.array(normals)


def _certify(
    a: str, b: str, true: dict[str, F64], uncertainty_mm: float, rng: np.random.Generator
) -> Length:
    length = float(np.linalg.norm(true[b] - true[a])) + rng.normal(0.0, uncertainty_mm)
    return Length((a, b), round(length, 5), uncertainty_mm)
